"""PETS2009 with identities calibrated by this version and by an earlier one: the processor time of whole processes."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from command import ONE_THREAD, passerby, run_program
from datasets import DATA_SETS, ROOT, folder_of, write_scene
from earlier_version import commit_named, unpack
from passerby.evaluation.metrics import compare
from passerby.interchange.output_folder import read_folder_rig

EARLIER = "c4d19336c2dd5e959b4fcf350dafd7fb79426d97"
"""The last commit before sites."""
REPETITIONS = 3
"""Of either version, by turns; the least counts: what else the computer does only adds to it."""


@dataclass(frozen=True)
class EarlierCase:
    """The version to compare with."""

    against: str


def cases(seeds: int) -> dict[str, EarlierCase]:
    """By key; none where the data are not here. Raises `subprocess.CalledProcessError` without the repository's history."""
    del seeds
    return {} if folder_of(_PETS) is None else {f"against {EARLIER[:10]}": EarlierCase(commit_named(EARLIER))}


def measure(case: EarlierCase) -> dict[str, Any]:
    """Processor time of both versions, reports included, and by how much their rigs differ: plain values."""
    data = folder_of(_PETS)
    if data is None:
        raise RuntimeError(f"the data of {_PETS.name} are not here")
    with tempfile.TemporaryDirectory(prefix="passerby-earlier-") as scratch:
        folder = Path(scratch)
        scene = write_scene(_PETS, data, folder / "scene")
        sources = {"earlier": unpack(case.against, folder / "source"), "now": ROOT / "src"}
        took: dict[str, list[float]] = {name: [] for name in sources}
        for _ in range(REPETITIONS):
            for name, source in sources.items():
                took[name].append(_calibrated(scene, source, folder / name))
        rigs = [read_folder_rig(folder / name).posed() for name in sources]
        apart = compare(*rigs).similarity
    least = {name: min(each) for name, each in took.items()}
    return {
        "about": {"against": case.against}, "cpu_s": sum(map(sum, took.values())), **least,
        "apart_mm": max(apart.position_mm.values()), "apart_deg": max(apart.orientation_deg.values()),
    }  # fmt: skip


def _calibrated(scene: Path, source: Path, out: Path) -> float:
    """Processor seconds of one whole calibration by the package in `source`."""
    # With compiled code, as where it is installed.
    environment = ONE_THREAD | {"PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": ""}
    used = Path(run_program(["-c", "import passerby; print(passerby.__file__)"], environment).output.strip())
    if used.parent.parent.resolve() != source.resolve():
        raise RuntimeError(f"{source} was to be run, and {used} was")
    return passerby("calibrate", str(scene), "-o", str(out), environment=environment).cpu_seconds


_PETS = next(data for data in DATA_SETS if data.name == "pets2009")
