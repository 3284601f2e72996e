"""The cases of the benchmark of sites: what a simulation takes, and which candidates are found."""

from __future__ import annotations

import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from command import passerby
from passerby.association.camera_tracklets import build_camera_tracklets
from passerby.association.candidates import Candidates, find_candidates
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats
from passerby.core.observations import Clock
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.single_view import Level
from passerby.simulation.sites import Site, SiteOptions, simulate_site
from passerby.simulation.sites.plan import CELL_M

ALONG, ACROSS_M = 0.04, 0.15
"""Standard deviation of a place along the ray, as a share of its distance, and across it: boxes with 2 % noise from 3.5 m."""


def true_tracks(site: Site, missing: float) -> list[GroundTracks]:
    """Of every camera, by its own clock and in its own frame; `missing` is the share of samples that are left out."""
    reach = round(site.options.clock_offsets / STEP_S) + 1
    last = round(site.options.seconds / STEP_S)
    steps = np.arange(-reach, last + reach + 1)
    rng = site.options.rng(20)
    found = []
    people = np.arange(len(site.walkers))
    xy, floor = site.walkers.places(people, steps * STEP_S)
    for index, own in enumerate(rng.spawn(len(site.rig))):
        found.append(_tracks(site, index, steps, xy, floor, missing, own))
    return found


def _tracks(
    site: Site, index: int, steps: Floats, xy: Floats, floor: Floats, missing: float, rng: np.random.Generator
) -> GroundTracks:
    sight, camera = site.sights[index], site.rig.cameras[index]
    assert camera.pose is not None
    ground = np.array(site.plan.mounts[index].ground)
    rows = np.flatnonzero((floor == sight.floor).ravel())
    rows = rows[(np.abs(xy.reshape(-1, 2)[rows] - ground) < 30.0).all(axis=1)]
    place = xy.reshape(-1, 2)[rows]
    cell = np.clip(np.floor(place / CELL_M).astype(np.int64) - sight.corner, 0, np.array(sight.seen.shape) - 1)
    seen = sight.seen[cell[:, 0], cell[:, 1]] & (rng.uniform(size=len(rows)) >= missing)
    rows, place = rows[seen], place[seen]
    forward = camera.pose.R_cw[2, :2]
    turn = 1j * np.exp(-1j * np.angle(complex(*forward)))
    away = (place - ground) @ np.array([1.0, 1j])
    distance = np.abs(away)
    noise = ALONG * distance * rng.standard_normal(len(rows)) + 1j * ACROSS_M * rng.standard_normal(len(rows))
    local = (away + noise * away / np.maximum(distance, 1e-6)) * turn
    # The camera's clock shows less by its offset than the world's; grid times of its own are the nearest.
    own_step = steps[rows // xy.shape[1]] - round(float(site.clock_offsets_s[index]) / STEP_S)
    inside = (own_step >= 0) & (own_step <= round(site.options.seconds / STEP_S))
    level = Level(np.array([0.0, 1.0, 0.0]), site.options.camera_height_m, 0.0)
    return GroundTracks(
        level, Tolerance(), own_step[inside], (rows % xy.shape[1])[inside], local[inside], np.zeros(inside.sum(), dtype=complex)
    )


SECONDS, BOX_NOISE, MISSING, TRACKLET_S = 600.0, 0.02, 0.1, 20.0
FIRST_SEED = 810  # constants of the search come from seeds 800 to 804
OVERLAP_M2 = 5.0  # cameras overlap that share so much ground: on less hardly anybody walks
COUNTS = (4, 6, 8, 10, 12)  # candidates of a camera at which the recall is measured
CLOCKS_S = 10.0  # two clocks differ by up to so much


@dataclass(frozen=True)
class SiteCase:
    """One site."""

    cameras: int
    seed: int = FIRST_SEED
    boxes: bool = True  # whether boxes are simulated and tracked; otherwise places of people, with noise, take their part
    seconds: float = SECONDS

    @property
    def options(self) -> SiteOptions:
        """Of the simulation."""
        return SiteOptions(
            cameras=self.cameras, seed=self.seed, seconds=self.seconds, box_noise=BOX_NOISE, missing=MISSING,
            tracklet_seconds=TRACKLET_S,
        )  # fmt: skip

    @property
    def arguments(self) -> list[str]:
        """The same of `passerby simulate`."""
        return [
            "--preset", self.options.preset, "--cameras", str(self.cameras), "--seed", str(self.seed),
            "--seconds", f"{self.seconds:g}", "--box-noise", str(BOX_NOISE), "--missing", str(MISSING),
            "--tracklet-seconds", str(TRACKLET_S),
        ]  # fmt: skip


def taken(*arguments: str) -> dict[str, float]:
    """What a `passerby` command takes with all its processes."""
    run = passerby(*arguments)
    return {"cpu_s": run.cpu_seconds, "wall_s": run.seconds, "memory_mb": run.peak_mb * 1e6 / 2**20}


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
    with tempfile.TemporaryDirectory(prefix="passerby-site-") as folder:
        spent = taken("simulate", "-o", f"{folder}/site", *case.arguments)
        boxes = sum(path.read_bytes().count(b"\n") for path in (Path(folder) / "site" / "tracks").iterdir())
    return {"cameras": case.cameras, **spent, "boxes": boxes}


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
