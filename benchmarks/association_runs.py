"""Scenes whose identities are to be found, real and simulated: how they are written, calibrated and judged."""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from command import ONE_THREAD, Calibrated, calibrate, passerby
from datasets import DataSet
from metrics.identities import IdentityAgreement, identity_agreement
from passerby.core.observations import Boxes, Clock
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.rig_toml import read_rig

LARGEST_SHIFT_S = 5.0
BOX_NOISE, MISSING, TRACKLET_SECONDS = 0.02, 0.1, 4.0
CRASHED = "crashed"


@dataclass(frozen=True)
class Found:
    """A calibration and how well the identities agree with the true ones."""

    calibrated: Calibrated
    identities: IdentityAgreement | None = None
    """None where nothing was calibrated, or where the true ones are not at hand."""


@dataclass(frozen=True)
class RealCase:
    """A real recording, the shifts of its cameras' clocks, and how it is solved."""

    data: DataSet
    mode: str
    source: str
    """Folder of the boxes: `detections`, or `identities` whose numbers become unrelated unless the mode is given."""
    seed: int | None = None
    """Draws the shifts; None for none."""
    refine_time: bool = False
    """Refine the clocks where identities are given."""

    def shifts(self, names: tuple[str, ...]) -> dict[str, int]:
        """Frames that are added to each camera's numbers; all are moved by the same so that none falls below one."""
        if self.seed is None:
            return dict.fromkeys(names, 0)
        assert self.data.fps is not None, f"{self.data.name} has no frame rate to shift its clocks by"
        most = int(LARGEST_SHIFT_S * self.data.fps)
        drawn = np.random.default_rng(self.seed).integers(-most, most, len(names), endpoint=True)
        return {name: most + int(shift) for name, shift in zip(names, drawn, strict=True)}


def run_real(case: RealCase, folder: Path, into: Path) -> Found:
    """Write the scene of a real recording with the case's changes, calibrate it and judge it."""
    scene = write_real(case, folder, into)
    names = read_rig(folder / "rig.toml").names
    shifts, fps = case.shifts(names), case.data.fps or 1.0
    calibrated = _calibrated(scene, folder / "rig.toml", into / "out")
    true = {name: _later(read_boxes(folder / "identities" / f"{name}.txt"), shifts[name]) for name in names}
    clocks = {name: Clock(fps, -shifts[name] / fps) for name in names}
    return Found(calibrated, _agreement(calibrated, into / "out", true, clocks))


def write_real(case: RealCase, folder: Path, into: Path) -> Path:
    """Write the scene file of a case and its boxes, and return the scene file's path."""
    into.mkdir(parents=True)
    names = read_rig(folder / "rig.toml").names
    shifts, rng = case.shifts(names), np.random.default_rng(0)
    cameras = {}
    for name in names:
        boxes = read_boxes(folder / case.source / f"{name}.txt")
        if case.source == "identities" and case.mode != "given":
            boxes = _renamed(boxes, rng)
        write_boxes(into / f"{name}.txt", _later(boxes, shifts[name]))
        key = "detections" if case.source == "detections" else "tracks"
        cameras[name] = {"intrinsics": str(folder / "rig.toml"), key: f"{name}.txt"}
    content: dict[str, Any] = {"scene": {"name": case.data.name, "fps": case.data.fps}, "cameras": cameras}
    content |= {"association": {"mode": case.mode}, "solver": {"options": {"refine_time": True} if case.refine_time else {}}}
    path = into / "scene.toml"
    path.write_text(tomli_w.dumps(content))
    return path


def _later(boxes: Boxes, frames: int) -> Boxes:
    return replace(boxes, frame=boxes.frame + frames)


def _renamed(boxes: Boxes, rng: np.random.Generator) -> Boxes:
    """The same boxes, their identities exchanged for others at random."""
    known, which = np.unique(boxes.identity, return_inverse=True)
    return replace(boxes, identity=1 + rng.permutation(len(known))[which])


def simulate(into: Path, preset: str, seed: int, *options: str) -> Path:
    """Simulate a scene with unrelated tracklets and embeddings that tell nobody apart; its folder."""
    passerby(
        "simulate", "--preset", preset, "--seed", str(seed), "--box-noise", str(BOX_NOISE), "--missing", str(MISSING),
        "--unrelated-ids", "--tracklet-seconds", str(TRACKLET_SECONDS), "--embeddings", "alike", *options, "-o", str(into),
        environment=ONE_THREAD,
    )  # fmt: skip
    return into


def run_simulated(folder: Path, mode: str) -> Found:
    """Calibrate a simulated scene in one mode: given takes the true identities of the same boxes, trajectory no embeddings."""
    content = tomllib.loads((folder / "scene.toml").read_text())
    content["association"] = {"mode": mode}
    for name, camera in content["cameras"].items():
        if mode == "given":
            camera["tracks"] = f"truth/{name}.txt"
        if mode in ("given", "trajectory"):
            del camera["embeddings"]
    scene = folder / f"{mode}.toml"
    scene.write_text(tomli_w.dumps(content))
    out = folder / f"{mode}-out"
    calibrated = _calibrated(scene, folder / "truth.toml", out)
    true = {name: read_boxes(folder / "truth" / f"{name}.txt") for name in content["cameras"]}
    return Found(calibrated, _agreement(calibrated, out, true, None))


def _calibrated(scene: Path, truth: Path, out: Path) -> Calibrated:
    """A run that ends in a bug is one more that has missed its goal, and the benchmark goes on."""
    try:
        return calibrate(scene, truth, out, environment=ONE_THREAD)
    except RuntimeError as error:
        print(error, file=sys.stderr)
        cameras = len(tomllib.loads(scene.read_text())["cameras"])
        return Calibrated(CRASHED, None, None, cameras, status=1, report={}, seconds=float("nan"), peak_mb=float("nan"))


def _agreement(
    calibrated: Calibrated, out: Path, true: dict[str, Boxes], clocks: dict[str, Clock] | None
) -> IdentityAgreement | None:
    if calibrated.errors is None:
        return None
    tracks = {name: out / "tracks" / f"{name}.txt" for name in true}
    return identity_agreement({name: read_boxes(path) for name, path in tracks.items() if path.is_file()}, true, clocks)
