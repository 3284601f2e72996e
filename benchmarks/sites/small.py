"""Small scenes: PETS2009 against an earlier version of Passerby, and the solver against COLMAP's incremental mapper."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from command import ONE_THREAD, passerby, run_program
from datasets import ROOT, data_set, folder_of, write_scene
from earlier_version import commit_named, unpack
from passerby.evaluation.metrics import compare
from passerby.interchange.output_folder import read_folder_rig
from peers.cases import all_cases
from peers.page import merged, run_case
from peers.runners import PASSERBY, PEERS

EARLIER = "c4d19336c2dd5e959b4fcf350dafd7fb79426d97"  # the last commit before sites
REPETITIONS = 3  # of either version, by turns; the least counts: what else the computer does only adds to it
COLMAP = next(peer for peer in PEERS if peer.name == "COLMAP")


def cases(seeds: int) -> dict[str, str]:
    """By key the commit, or the peer, to compare with; none where the data or COLMAP's environment are not here.

    Raises `subprocess.CalledProcessError` without the repository's history.
    """
    del seeds
    found = {} if folder_of(data_set("pets2009")) is None else {f"against {EARLIER[:10]}": commit_named(EARLIER)}
    return found | ({} if COLMAP.interpreter() is None else {"against COLMAP": COLMAP.name})


def measure(against: str) -> dict[str, Any]:
    """One of the two races: plain values."""
    return _race() if against == COLMAP.name else _against_earlier(against)


def _against_earlier(against: str) -> dict[str, Any]:
    """Processor time of whole processes of both versions, reports included, and by how much their rigs differ."""
    pets = data_set("pets2009")
    data = folder_of(pets)
    if data is None:
        raise RuntimeError(f"the data of {pets.name} are not here")
    with tempfile.TemporaryDirectory(prefix="passerby-earlier-") as scratch:
        folder = Path(scratch)
        scene = write_scene(pets, data, folder / "scene")
        sources = {"earlier": unpack(against, folder / "source"), "now": ROOT / "src"}
        took: dict[str, list[float]] = {name: [] for name in sources}
        for _ in range(REPETITIONS):
            for name, source in sources.items():
                took[name].append(_calibrated(scene, source, folder / name))
        rigs = [read_folder_rig(folder / name).posed() for name in sources]
        apart = compare(*rigs).similarity
    return {
        "about": {"against": against}, "cpu_s": sum(map(sum, took.values())),
        **{name: min(each) for name, each in took.items()}, "apart_mm": max(apart.position_mm.values()),
        "apart_deg": max(apart.orientation_deg.values()),
    }  # fmt: skip


def _calibrated(scene: Path, source: Path, out: Path) -> float:
    """Processor seconds of one whole calibration by the package in `source`."""
    # With compiled code, as where it is installed.
    environment = ONE_THREAD | {"PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": ""}
    used = Path(run_program(["-c", "import passerby; print(passerby.__file__)"], environment).output.strip())
    if used.parent.parent.resolve() != source.resolve():
        raise RuntimeError(f"{source} was to be run, and {used} was")
    return passerby("calibrate", str(scene), "-o", str(out), environment=environment).cpu_seconds


def _race() -> dict[str, Any]:
    """Processor seconds of both solvers on the cases of the page of peers, where neither fails."""
    with tempfile.TemporaryDirectory(prefix="passerby-race-") as folder:
        rows = merged([row for one in all_cases() for row in run_case(one, Path(folder), (COLMAP,))])
    pairs = [(row.results[PASSERBY.name], row.results[COLMAP.name]) for row in rows]
    both = [(ours, theirs) for ours, theirs in pairs if not ours.failure and not theirs.failure]
    spent = [one.whole_seconds for pair in pairs for one in pair if math.isfinite(one.whole_seconds)]
    return {
        "cpu_s": sum(spent), "rows": len(rows), "neither_fails": len(both),
        "ours_fail": sum(bool(ours.failure) for ours, _ in pairs),
        "theirs_fail": sum(bool(theirs.failure) for _, theirs in pairs),
        "ratio": median(ours.solve_seconds / theirs.solve_seconds for ours, theirs in both),
        "whole_ratio": median(ours.whole_seconds / theirs.whole_seconds for ours, theirs in both),
        "ours_s": sum(ours.solve_seconds for ours, _ in both), "theirs_s": sum(theirs.solve_seconds for _, theirs in both),
    }  # fmt: skip
