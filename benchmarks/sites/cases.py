"""The cases of the benchmark of sites: what a simulation takes, and which candidates are found."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passerby.association.camera_tracklets import build_camera_tracklets
from passerby.association.candidates import Candidates, find_candidates
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.core.observations import Clock
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.simulation.sites import Site, SiteOptions, simulate_site
from sites.true_tracks import true_tracks

SECONDS, BOX_NOISE, MISSING, TRACKLET_S = 600.0, 0.02, 0.1, 20.0
FIRST_SEED = 810
"""Constants of the search come from seeds 800 to 804."""
OVERLAP_M2 = 5.0
"""Cameras overlap that share so much ground: on less hardly anybody walks."""
COUNTS = (4, 6, 8, 10, 12)
"""Candidates of a camera at which the recall is measured."""
CLOCKS_S = 10.0
"""Two clocks differ by up to so much."""


@dataclass(frozen=True)
class SiteCase:
    """One site."""

    cameras: int
    seed: int
    boxes: bool = True
    """Whether boxes are simulated and tracked; otherwise places of people, with noise, take their part."""

    @property
    def options(self) -> SiteOptions:
        """Of the simulation."""
        return SiteOptions(
            cameras=self.cameras, seed=self.seed, seconds=SECONDS, box_noise=BOX_NOISE, missing=MISSING,
            tracklet_seconds=TRACKLET_S,
        )  # fmt: skip


def simulations(seeds: int) -> dict[str, SiteCase]:
    """Sites that are written, by key."""
    del seeds
    return {f"{count} cameras": SiteCase(count, FIRST_SEED) for count in (25, 100)}


def candidate_cases(seeds: int) -> dict[str, SiteCase]:
    """Sites of which candidates are found, by key."""
    cases = [SiteCase(100, FIRST_SEED + k, boxes=False) for k in range(seeds)]
    cases += [SiteCase(1000, FIRST_SEED, boxes=False), SiteCase(100, FIRST_SEED)]
    return {f"{case.cameras} {'boxes' if case.boxes else 'positions'} {case.seed}": case for case in cases}


def measure_simulation(case: SiteCase) -> dict[str, Any]:
    """What `passerby simulate` takes, in a process of its own."""
    options = case.options
    with tempfile.TemporaryDirectory(prefix="passerby-site-") as folder:
        command = [
            sys.executable, "-m", "passerby", "simulate", "-o", str(Path(folder) / "site"), "--preset", options.preset,
            "--cameras", str(case.cameras), "--seed", str(case.seed), "--seconds", f"{SECONDS:g}",
            "--box-noise", str(BOX_NOISE), "--missing", str(MISSING), "--tracklet-seconds", str(TRACKLET_S),
        ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise RuntimeError(f"{' '.join(command)} ended with status {status}")
        tracks = Path(folder) / "site" / "tracks"
        boxes = sum(path.read_bytes().count(b"\n") for path in tracks.iterdir())
    return {
        "cameras": case.cameras, "cpu_s": used.ru_utime + used.ru_stime, "memory_mb": used.ru_maxrss / 1024, "boxes": boxes,
    }  # fmt: skip


def measure_candidates(case: SiteCase) -> dict[str, Any]:
    """The recall of true overlaps at several numbers of candidates, and what finding them takes."""
    began = time.process_time()
    site = simulate_site(case.options)
    tracks: list[GroundTracks | None] = _tracked(site) if case.boxes else list(true_tracks(site, MISSING))
    true = [pair for pair, area in site.shared_m2.items() if area >= OVERLAP_M2]
    start = time.process_time()
    found = {count: find_candidates(tracks, CLOCKS_S, count) for count in COUNTS[-1:]}
    search_s = time.process_time() - start
    if case.cameras <= 100:  # of a thousand, once is enough
        found |= {count: find_candidates(tracks, CLOCKS_S, count) for count in COUNTS[:-1]}
    degree = np.bincount(np.array(true).ravel(), minlength=case.cameras)
    return {
        "about": {"cameras": case.cameras, "boxes": case.boxes}, "cpu_s": time.process_time() - began, "search_s": search_s,
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "overlaps": len(true),
        "degree": [int(degree.min()), float(degree.mean()), int(degree.max())],
        "recall": {str(count): recall(candidates, true) for count, candidates in found.items()},
        "tried": found[COUNTS[-1]].tried.tried,
    }  # fmt: skip


def recall(candidates: Candidates, true: list[tuple[int, int]]) -> float:
    """The share of the true overlaps that are candidates."""
    return sum(pair in candidates for pair in true) / len(true)


def _tracked(site: Site) -> list[GroundTracks | None]:
    """The ground tracks of each camera, as a calibration makes them of its boxes."""
    clock = Clock(site.options.fps)
    rngs = np.random.default_rng(0).spawn(len(site.rig))
    return [
        build_camera_tracklets(lens, seen.seen, clock, PERSON_HEIGHT_M, rng).tracks
        for lens, seen, rng in zip(site.rig, site.cameras(), rngs, strict=True)
    ]
