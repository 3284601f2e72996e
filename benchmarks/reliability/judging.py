"""One scene of the battery: calibrated, and its verdict held against the truth.

The world's heading and place on the ground are arbitrary, and a rig's scale rests on how tall people are taken to be. So the
rig is laid upon the truth twice. After the best *similarity* an error counts as it is: more than 0.5 m or 3 degrees of any
camera. After the best *placement along the ground* (a turn about the vertical and a shift, least squares on the centres) an
error that large counts where it is also more than three of the camera's own stated sigmas: who says that the scale is known
to 5 % may be wrong by 10 %.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from passerby.calibration.calibration import Calibration
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.errors import InputError
from passerby.core.cameras import Pose, Rig
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import angle_between
from reliability.staging import HandedIn

MOST_M, MOST_DEG, MOST_SIGMAS = 0.5, 3.0, 3.0


@dataclass(frozen=True)
class Errors:
    """The worst camera's errors."""

    similarity_mm: float
    similarity_deg: float
    placed_mm: float
    placed_deg: float
    wrong: bool
    """Whether a camera is off by more than may be accepted."""


def calibrated(scene: HandedIn) -> Calibration:
    """The scene as a user would have it calibrated. Raises `InputError` as `calibrate_observations` does."""
    tables: dict[str, Any] = dict(scene.tables)
    return calibrate_observations(scene.lenses, scene.boxes, fps=scene.fps, **tables)


def judge(scene: HandedIn) -> dict[str, Any]:
    """JSON-ready: the verdict, the reasons, and how wrong the rig is."""
    truths = [scene.truth] if scene.later is None else [scene.truth, scene.later]
    return judge_run(lambda: calibrated(scene), truths)


def judge_run(calibrate: Callable[[], Calibration], truths: Sequence[Rig]) -> dict[str, Any]:
    """The same of any run: a rig is right only if it is right for all truths."""
    began = time.process_time()
    try:
        found = calibrate()
    except InputError as error:
        return {"verdict": "refused", "reasons": [str(error)], "wrong": False, "posed": 0, "seconds": 0.0}
    out: dict[str, Any] = {
        "verdict": found.verdict, "reasons": list(found.reasons), "findings": list(found.findings),
        "posed": len(found.rig.posed()), "cameras": len(found.rig), "seconds": time.process_time() - began,
    }  # fmt: skip
    by_truth = [errors for truth in truths if (errors := errors_of(found.rig, truth)) is not None]
    if not by_truth:
        return out | {"wrong": False}
    errors = max(by_truth, key=lambda errors: (errors.wrong, errors.similarity_mm))
    return out | {
        "wrong": errors.wrong, "similarity_mm": errors.similarity_mm, "similarity_deg": errors.similarity_deg,
        "placed_mm": errors.placed_mm, "placed_deg": errors.placed_deg,
    }  # fmt: skip


def errors_of(rig: Rig, truth: Rig) -> Errors | None:
    """How wrong a rig is; None where fewer than two cameras have a pose.

    A rig that no similarity brings near the truth (cameras at one place, or the wrong way round) is off by the size of it.
    """
    posed = rig.posed()
    if len(posed) < 2:
        return None
    similarity = compare(posed, truth).similarity
    true = [_pose(truth, name) for name in posed.names]
    own = [_pose(posed, name) for name in posed.names]
    centres = np.array([pose.centre for pose in true])
    size = 1000 * float(np.max(np.linalg.norm(centres - centres.mean(axis=0), axis=1)))
    shape_mm = max(similarity.position_mm.values(), default=size)
    shape_deg = max(similarity.orientation_deg.values(), default=180.0)
    placed = _placed(own, true)
    off_mm = np.array([1000 * np.linalg.norm(a.centre - b.centre) for a, b in zip(placed, true, strict=True)])
    off_deg = np.array([np.degrees(angle_between(a.R_cw, b.R_cw)) for a, b in zip(placed, true, strict=True)])
    sigmas = [camera.sigma for camera in posed]
    sure_mm = np.array([0.0 if sigma is None else 1000 * sigma.position_m for sigma in sigmas])
    sure_deg = np.array([0.0 if sigma is None else sigma.orientation_deg for sigma in sigmas])
    too_far = (off_mm > 1000 * MOST_M) & (off_mm > MOST_SIGMAS * sure_mm)
    too_turned = (off_deg > MOST_DEG) & (off_deg > MOST_SIGMAS * sure_deg)
    wrong = shape_mm > 1000 * MOST_M or shape_deg > MOST_DEG or bool(too_far.any() or too_turned.any())
    return Errors(shape_mm, shape_deg, float(off_mm.max()), float(off_deg.max()), wrong)


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
