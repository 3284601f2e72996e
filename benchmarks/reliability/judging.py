"""One scene of the battery: calibrated, and its verdict held against the truth.

A rig is wrong by what it measures where people walked. A principal point that is off and a camera that is turned the other
way are nearly the same camera, so neither counts alone. After the best *similarity* of the whole rig, nine of ten points above
the ground that cameras share have to be right to 0.5 m, and each camera's positions on the ground (the median) to 0.5 m or to
three of their stated sigmas. The *scale* has to be right to three of its stated sigmas: who says that it is known to 5 % may be
wrong by 15 %.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from passerby.calibration.calibration import Calibration
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Pose, Rig
from passerby.core.figures import adjusted
from passerby.core.measuring import MeasuringErrors, measure_change, measuring_errors
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import angle_between
from reliability.staging import HandedIn

MOST_M, MOST_SIGMAS, LEAST_SCALE = 0.5, 3.0, 0.03
"""A scale that is off by less than the last is right whatever its sigma."""


@dataclass(frozen=True)
class Errors:
    """The worst camera's errors."""

    similarity_mm: float
    similarity_deg: float
    placed_mm: float
    placed_deg: float
    wrong: bool
    """Whether the rig measures worse than may be accepted."""
    points_mm: float | None = None
    """Nine of ten points that cameras share are right to so much;"""
    ground_mm: float | None = None
    """the worst camera's positions on the ground, median. None where the rig measures nothing."""


def calibrated(scene: HandedIn) -> Calibration:
    """The scene as a user would have it calibrated. Raises `InputError` as `calibrate_observations` does."""
    tables: dict[str, Any] = dict(scene.tables)
    return calibrate_observations(scene.lenses, scene.boxes, fps=scene.fps, **tables)


def judge(scene: HandedIn) -> dict[str, Any]:
    """JSON-ready: the verdict, the reasons, and how wrong the rig is."""
    truths = [scene.truth] if scene.later is None else [scene.truth, scene.later]
    return judge_run(lambda: calibrated(scene), truths, scene.walked)


def judge_run(calibrate: Callable[[], Calibration], truths: Sequence[Rig], places: Floats | None = None) -> dict[str, Any]:
    """The same of any run: a rig is right only if it is right for all truths, where people were (`errors_of`)."""
    began = time.process_time()
    try:
        found = calibrate()
    except InputError as error:
        return {"verdict": "refused", "reasons": [str(error)], "wrong": False, "posed": 0, "seconds": 0.0}
    out: dict[str, Any] = {
        "verdict": found.verdict, "reasons": list(found.reasons), "findings": list(found.findings),
        "posed": len(found.rig.posed()), "cameras": len(found.rig), "seconds": time.process_time() - began,
    }  # fmt: skip
    scale_sd = adjusted(found.figures).scale.relative_sigma
    by_truth = [errors for truth in truths if (errors := errors_of(found.rig, truth, scale_sd, places)) is not None]
    if not by_truth:
        return out | {"wrong": False}
    errors = max(by_truth, key=lambda errors: (errors.wrong, errors.similarity_mm))
    return out | {
        "wrong": errors.wrong, "similarity_mm": errors.similarity_mm, "similarity_deg": errors.similarity_deg,
        "placed_mm": errors.placed_mm, "placed_deg": errors.placed_deg, "points_mm": errors.points_mm,
        "ground_mm": errors.ground_mm,
    }  # fmt: skip


def errors_of(rig: Rig, truth: Rig, scale_sd: float | None = None, places: Floats | None = None) -> Errors | None:
    """How wrong a rig is, whose scale is stated to `scale_sd`, if it is; None where fewer than two cameras have a pose.

    It is tested at `places` (N, 2) on the true ground, metres; None: on a grid over the ground that cameras share.
    A rig that no similarity brings near the truth (cameras at one place, or the wrong way round) is off by the size of it.
    """
    posed = rig.posed()
    if len(posed) < 2:
        return None
    comparison, measured = compare(posed, truth), _measured(posed, truth, places)
    similarity = comparison.similarity
    true = [_pose(truth, name) for name in posed.names]
    own = [_pose(posed, name) for name in posed.names]
    centres = np.array([pose.centre for pose in true])
    size = 1000 * float(np.max(np.linalg.norm(centres - centres.mean(axis=0), axis=1)))
    shape_mm = max(similarity.position_mm.values(), default=size)
    shape_deg = max(similarity.orientation_deg.values(), default=180.0)
    placed = _placed(own, true)
    off_mm = np.array([1000 * np.linalg.norm(a.centre - b.centre) for a, b in zip(placed, true, strict=True)])
    off_deg = np.array([np.degrees(angle_between(a.R_cw, b.R_cw)) for a, b in zip(placed, true, strict=True)])
    worst = shape_mm, shape_deg, float(off_mm.max()), float(off_deg.max())
    if measured is None:  # the cameras see no ground in common: they count themselves
        return Errors(*worst, shape_mm > 1000 * MOST_M)
    ground = {name: one.median_mm for name, one in measured.cameras.items()}
    sure = {camera.name: 0.0 if camera.sigma is None else 1000 * (camera.sigma.ground_m or 0.0) for camera in posed}
    far = any(mm > max(1000 * MOST_M, MOST_SIGMAS * sure[name]) for name, mm in ground.items())
    scale = abs(float(np.log(measured.scale)))
    unscaled = scale_sd is not None and scale > max(MOST_SIGMAS * scale_sd, LEAST_SCALE)
    wrong = measured.points.p90_mm > 1000 * MOST_M or far or unscaled
    return Errors(*worst, wrong, measured.points.p90_mm, max(ground.values(), default=None))


def _measured(posed: Rig, truth: Rig, places: Floats | None) -> MeasuringErrors | None:
    return measuring_errors(posed, truth) if places is None else measure_change(truth, posed, places)


def _pose(rig: Rig, name: str) -> Pose:
    pose = rig[name].pose
    assert pose is not None
    return pose


def _placed(own: list[Pose], true: list[Pose]) -> list[Pose]:
    """The poses after the best turn about the vertical and shift along the ground (Kabsch in the plane)."""
    a, b = (np.array([complex(*pose.centre[:2]) for pose in poses]) for poses in (own, true))
    turn = np.vdot(a - a.mean(), b - b.mean())
    turn = turn / abs(turn) if abs(turn) > 1e-12 else 1.0 + 0.0j
    R = np.array([[turn.real, -turn.imag, 0.0], [turn.imag, turn.real, 0.0], [0.0, 0.0, 1.0]])
    shift = b.mean() - turn * a.mean()
    return [pose.moved(R, np.array([shift.real, shift.imag, 0.0])) for pose in own]
