"""Public scenes with a stick: Yang 2026's synthetic sports, by joints alone and with the stick as a wand of known length.

Each scene is one person with 19 joints and a stick in the hands, 50 time steps, cameras on a hemisphere. The data are the
user's own; see `datasets`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from datasets import data_root
from lenses.outcomes import outcome
from pages.cases import Outcomes
from pages.parts import found_of
from pages.records import Found
from pages.tables import Table, number, table
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Keypoints
from passerby.evaluation.metrics import compare

SIZE = (1200, 1200)
FPS = 10.0  # the scenes state no frame rate; all cameras are synchronised
JOINTS = (
    "pelvis", "spine", "right_shoulder", "left_shoulder", "neck", "head", "head_top", "right_elbow", "right_forearm",
    "right_wrist", "left_elbow", "left_forearm", "left_wrist", "right_hip", "right_knee", "right_ankle", "left_hip",
    "left_knee", "left_ankle",
)  # fmt: skip
ENDS = ("stick_a", "stick_b")
STICK_SD_M = 0.002  # of the stick's length, which is exact: as good as a tape
LENSES = {"known": "Intrinsics known", "unknown": "Only the image size known"}
INPUTS = {"joints": "joints alone", "stick": "with the stick"}


@dataclass(frozen=True)
class PublicCase:
    """One scene, and what is known of it."""

    path: Path
    lenses: str  # known, or unknown: only the image size is stated
    input: str  # joints, or stick: the joints and the stick's two ends

    @property
    def key(self) -> str:
        """A name within its part."""
        return f"{self.path.stem} {self.lenses} {self.input}"


def cases() -> dict[str, PublicCase]:
    """All cases by key; none where the data are not at hand."""
    root = data_root()
    paths = [] if root is None else sorted((root / "stick").glob("*.npz"))
    found = [PublicCase(path, lenses, given) for lenses in LENSES for path in paths for given in INPUTS]
    return {case.key: case for case in found}


def work(case: PublicCase) -> dict[str, Any]:
    """Calibrate a scene and compare with the truth: plain values, with the processor time of the calibration."""
    with np.load(case.path) as content:
        scene = dict(content)
    truth = _true_rig(scene)
    stick = case.input == "stick"
    scale = {"wands": [{"points": ENDS, "metres": float(scene["stick_length_m"]), "sd_m": STICK_SD_M}]} if stick else {}
    lenses = {camera.name: camera.lens if case.lenses == "known" else Lens.unknown(SIZE) for camera in truth}
    about = {"cameras": len(truth), "noise_px": float(scene["noise_px"])}
    began = time.process_time()
    try:
        found = calibrate_observations(
            lenses, keypoints=_keypoints(scene, truth, stick), fps=FPS, association={"mode": "given"}, scale=scale
        )
    except InputError as error:
        return about | {"registered": 0, "verdict": "refused", "why": str(error), "cpu_s": time.process_time() - began}
    seconds = time.process_time() - began
    figures = outcome(found.rig, truth, truth.names if case.lenses == "unknown" else ())
    errors = compare(found.rig.posed(), truth) if len(found.rig.posed()) else None
    focal = [abs(lens["focal_percent"]) for lens in figures.pop("lenses").values()]
    return about | figures | {
        "verdict": found.verdict,
        "cpu_s": seconds,
        "metric_mm": None if errors is None else errors.metric.mean_position_mm,
        "scale_ratio": None if errors is None else errors.scale_ratio,
        "focal_percent": fmean(focal) if focal else None,
    }  # fmt: skip


def _true_rig(scene: Mapping[str, Any]) -> Rig:
    lens = Lens(SIZE, scene["K"], np.zeros(5))
    poses = [Pose(R, np.asarray(t, dtype=np.float64).reshape(3)) for R, t in zip(scene["R"], scene["t"], strict=True)]
    return Rig(tuple(Camera(f"C{number}", lens, pose) for number, pose in enumerate(poses, start=1)))


def _keypoints(scene: Mapping[str, Any], truth: Rig, stick: bool) -> dict[str, Keypoints]:
    """The joints of the one person, with the ends of the stick where they are wanted; marks at (0, 0) are missing."""
    xy, seen = scene["joints"].astype(np.float64), scene["visible"].astype(bool)
    names = JOINTS
    if stick:
        ends = scene["stick"].astype(np.float64)
        xy, seen = np.concatenate([xy, ends], axis=2), np.concatenate([seen, ends.any(axis=3)], axis=2)
        names += ENDS
    xy = np.where(seen[..., None], xy, 0.0)
    frames = np.arange(1, xy.shape[1] + 1)
    person = np.zeros(len(frames), dtype=np.int64)
    return {
        camera: Keypoints(frames, person, xy[index], seen[index].astype(np.float64), names)
        for index, camera in enumerate(truth.names)
    }


def tabulate(given: Mapping[str, PublicCase], done: Outcomes) -> Found:
    """The tables of the finished cases."""
    if not given:
        return Found(notes=["Not run: data not here."])
    return found_of(given, done, {title: _table(given, done, lenses) for lenses, title in LENSES.items()})


def _table(given: Mapping[str, PublicCase], done: Outcomes, lenses: str) -> Table:
    groups: dict[tuple[int, float, str], list[dict[str, Any]]] = {}
    for key, case in given.items():
        if case.lenses == lenses and key in done:
            one = done[key]
            groups.setdefault((one["cameras"], one["noise_px"], case.input), []).append(one)
    unknown = lenses == "unknown"
    head = (
        "cameras", "noise", "input", "similarity", "metric", "scale error", *(["focal error"] * unknown), "registered",
        "verdicts", "time",
    )  # fmt: skip
    rows = []
    for (cameras, noise, given_input), group in sorted(groups.items()):
        rows.append([
            str(cameras), f"{noise:g} px", INPUTS[given_input],
            f"{_mean(group, 'mm', 2)} mm {_mean(group, 'deg', 4)}°", f"{_mean(group, 'metric_mm')} mm",
            f"{_percent([abs(ratio - 1) for ratio in _known(group, 'scale_ratio')])}",
            *([f"{number(fmean(_known(group, 'focal_percent')), 2)} %"] * unknown),
            f"{sum(one['registered'] for one in group)} of {sum(one['cameras'] for one in group)}", _verdicts(group),
            f"{_mean(group, 'cpu_s')} s",
        ])  # fmt: skip
    return table(head, rows)


def _known(group: Sequence[Mapping[str, Any]], figure: str) -> list[float]:
    """A figure of all scenes, infinite where one lacks it."""
    return [float("inf") if one.get(figure) is None else float(one[figure]) for one in group]


def _mean(group: Sequence[Mapping[str, Any]], figure: str, digits: int = 1) -> str:
    return number(fmean(_known(group, figure)), digits)


def _percent(shares: Sequence[float]) -> str:
    return f"{number(100 * fmean(shares), 2)} %"


def _verdicts(group: Sequence[Mapping[str, Any]]) -> str:
    found = [one["verdict"] for one in group]
    return ", ".join(f"{found.count(verdict)} {verdict}" for verdict in dict.fromkeys(found))
