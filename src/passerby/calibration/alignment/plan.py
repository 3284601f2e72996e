"""Alignment of a rig with a floor plan: origin, heading and, on request, the scale."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from passerby.calibration.alignment.places import camera_of, position_sds
from passerby.calibration.alignment.residuals import POOR_FIT, TELLING_SCALE
from passerby.calibration.alignment.sigmas import in_known_world
from passerby.calibration.alignment.world import RIG_SCALE_SD, WEAK_TURN_DEG, Aligned, aligned_by, with_residuals
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Rig
from passerby.core.scale_cues import FloorPlan
from passerby.findings.finding import Finding, doubt, notice
from passerby.findings.texts import text_of
from passerby.geometry.plan_fit import Placements, ScalePrior, fit_plan
from passerby.geometry.rotations import Similarity, exp_rotation
from passerby.solver.plan_rows import PlanRows, Settled, plan_rows

LEAST_RIG_SD_M = 1e-3
"""Least standard deviation of a camera's place by the rig, also if the rig states a smaller one."""


class PlanRefusedError(EvidenceError):
    """A plan contradicts the rig, so no rig with this plan can be accepted (exit status 3)."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(text_of(finding))
        self.finding = finding


def align_to_plan(rig: Rig, plan: FloorPlan, image: Path, *, with_scale: bool = False) -> Aligned:
    """Move a rig into the frame of a plan: x to the right and y up on the plan, metres; people walk at z = 0.

    Args:
        rig: at least one camera has a pose.
        plan: the plan, with its origin.
        image: path of its picture, which a report shows: absolute, or relative to the scene file's folder.
        with_scale: whether the rig is scaled to the lengths of the plan. Otherwise its lengths stay.

    Raises:
        InputError: the rig lacks a camera, or a pixel is outside the range of its lens.
        EvidenceError: fewer than two placements of cameras with poses or of points are left, or they do not fix the heading.
        PlanRefusedError (an `EvidenceError`): the plan is mirrored, its unit is wrong, or its placements contradict each other.
    """
    for name in (*(one.camera for one in plan.cameras), *(name for point in plan.points for name in point.pixels)):
        camera_of(rig, name)
    posed, notes = rig.posed(), list[Finding]()
    lost = [one.camera for one in plan.cameras if one.camera not in posed.names]
    notes += [notice("position_without_pose", name) for name in lost]
    seen = [name for point in plan.points for name in point.pixels if name not in posed.names]
    notes += [notice("points_without_pose", name, count=seen.count(name)) for name in dict.fromkeys(seen)]
    rows = plan_rows(plan, posed)
    if rows is not None:
        R, centre = (np.array([getattr(camera.pose, part) for camera in posed]) for part in ("R_cw", "centre"))
        rows = rows.settle(R, centre, ScalePrior(0.0, RIG_SCALE_SD))
    if rows is None or rows.settled is None:
        raise EvidenceError(
            "fewer than two cameras or points that are registered and on the ground are placed on the plan: place more of "
            "them, metres apart, and points below the horizon"
        )
    fit, settled = rows.settled.fit, rows.settled
    placements = rows.placements(R, centre)
    if settled.wrong_unit is not None:
        stated, unit = plan.metres_per_pixel, settled.wrong_unit.unit
        values = {"metres_per_pixel": stated, "by_people": stated * placements.scale}
        raise PlanRefusedError(doubt("plan_unit_wrong", **values, **({} if unit is None else {"unit": unit})))
    if settled.is_mirrored:
        raise PlanRefusedError(doubt("plan_mirrored"))
    turn = float(np.degrees(fit.yaw_sd * fit.factor))
    if turn > WEAK_TURN_DEG and settled.suspects:
        off = np.linalg.norm(fit.on_plan(placements.place) - placements.target, axis=1)[settled.used]
        raise PlanRefusedError(doubt("plan_contradicts_itself", **_suspects(rows, settled, float(off.max()))))
    if turn > WEAK_TURN_DEG:
        raise EvidenceError(f"the plan fixes the heading to {turn:.0f} degrees only: place cameras or points farther apart")
    scale = 1 / fit.scale if with_scale else 1.0
    rotation = exp_rotation(np.array([0.0, 0.0, -fit.yaw]))
    middle = placements.target[settled.used].mean(axis=0)
    there = fit.shift + fit.scale * middle @ exp_rotation(np.array([0.0, 0.0, fit.yaw]))[:2, :2].T
    motion = Similarity(scale, rotation, np.append(middle, 0.0) - scale * rotation @ np.append(there, 0.0))
    moved = motion.apply(np.column_stack([placements.place, np.zeros(len(placements.place))]))[:, :2]
    aligned = aligned_by(rig, motion, f"plan {plan.name}", _figures(rows, settled, plan, image, with_scale=with_scale))
    fitted = _covariance(posed, rows, placements, scale, with_scale=with_scale)
    centre = np.append(middle, 0.0)
    aligned = replace(aligned, rig=in_known_world(aligned.rig, fitted, centre, with_scale=with_scale, tilt=False))
    residuals = _residuals(rows, plan, moved, placements.target)
    return with_residuals(aligned, residuals, notes + _findings(rows, settled, residuals, with_scale=with_scale))


def _covariance(posed: Rig, rows: PlanRows, placements: Placements, scale: float, *, with_scale: bool) -> Floats:
    """Return the covariance (n, n), n = 3 or 4, of turn, shifts and, if fitted, log scale, as `WorldFit.covariance` has it.

    The places get the sigmas that the rig states, not the share of its extent that the fit uses for rigs of any quality.
    """
    assert rows.settled is not None
    own = position_sds(posed, with_scale)
    of_row = [posed.names[c] for c in (*rows.camera.tolist(), *rows.rays.camera.tolist())]
    stated = replace(placements, rig_sd=np.maximum([own.get(name, 0.0) for name in of_row], LEAST_RIG_SD_M))
    fit = fit_plan(stated.take(rows.settled.used))
    sds = np.array([fit.yaw_sd, scale * fit.shift_sd, scale * fit.shift_sd, fit.scale_sd]) * fit.factor
    sds[3] = np.hypot(sds[3], rows.unit_sd)
    return np.diag(sds[: 4 if with_scale else 3] ** 2)


def _figures(rows: PlanRows, settled: Settled, plan: FloorPlan, image: Path, *, with_scale: bool) -> dict[str, Any]:
    """Return the figures of the fit, JSON-ready."""
    fit = settled.fit
    return {
        "scale_fitted": with_scale, "tilt_fitted": False,
        "used": int(np.count_nonzero(settled.used)), "left_out": int(np.count_nonzero(~settled.used)),
        "turn_sigma_deg": float(np.degrees(fit.yaw_sd * fit.factor)), "place_sigma_mm": 1000 * fit.shift_sd * fit.factor,
        "scale_sigma": rows.sigma if with_scale else None, "residuals_over_stated": fit.factor,
        "plan": {
            "image": str(image), "metres_per_pixel": plan.metres_per_pixel,
            "origin": [float(value) for value in plan.origin],
        },
    }  # fmt: skip


def _residuals(rows: PlanRows, plan: FloorPlan, moved: Floats, target: Floats) -> list[dict[str, Any]]:
    """Return a row for each camera on the plan and each observation of a point: its place by the rig, and its distance off."""
    assert rows.settled is not None
    out = []
    for row, (place, wanted) in enumerate(zip(moved, target, strict=True)):
        ray = row - len(rows.camera)
        camera = int(rows.camera[row]) if ray < 0 else int(rows.rays.camera[ray])
        off = float(np.linalg.norm(place - wanted))
        found = np.isfinite(off)
        out.append({
            **({} if ray < 0 else {"point": rows.point_names[int(rows.rays.point[ray])]}),
            "camera": rows.camera_names[camera], "off_m": off if found else None,
            "off_px": off / plan.metres_per_pixel if found else None, "height_off_m": None,
            "used": bool(rows.settled.used[row]), "stated_m": wanted.tolist(), "found_m": place.tolist() if found else None,
        })  # fmt: skip
    return out


def _findings(rows: PlanRows, settled: Settled, residuals: list[dict[str, Any]], *, with_scale: bool) -> list[Finding]:
    """Return findings on placements that were left out or contradict each other, and on a scale unlike that of the plan."""
    out, fit = list[Finding](), settled.fit
    for number in dict.fromkeys(row["point"] for row in residuals if "point" in row):
        own = [row for row in residuals if row.get("point") == number]
        wrong = [row for row in own if not row["used"] and row["off_m"] is not None]
        out += [notice("point_above_horizon", row["camera"], point=number) for row in own if row["off_m"] is None]
        if len(wrong) == len(own) > 1:
            off = float(np.median([row["off_m"] for row in wrong]))
            out.append(notice("point_off_everywhere", point=number, off_m=off, count=len(wrong)))
        else:
            out += [notice("point_off", row["camera"], point=number, off_m=row["off_m"]) for row in wrong]
    out += [
        notice("position_off", row["camera"], off_m=row["off_m"]) for row in residuals if "point" not in row and not row["used"]
    ]
    if settled.suspects:
        cameras, points = _named_suspects(rows, settled)
        named = [row for row in residuals if (row["point"] in points if "point" in row else row["camera"] in cameras)]
        off_m = max(float(row["off_m"]) for row in named if row["used"])
        out.append(doubt("plan_contradicts_itself", **_suspects(rows, settled, off_m)))
    elif fit.factor > POOR_FIT:
        size = float(np.sqrt(np.mean([row["off_m"] ** 2 for row in residuals if row["used"]])))
        out.append(notice("places_fit_poorly", what="plan", off_m=size, times=fit.factor))
    growth = -np.log(fit.scale)
    if not with_scale and abs(growth) > max(TELLING_SCALE, 3 * rows.sigma):
        percent, sigma_percent = 100 * abs(float(np.expm1(growth))), 100 * rows.sigma
        larger = bool(growth > 0)
        out.append(notice("places_want_scale", what="plan", percent=percent, larger=larger, sigma_percent=sigma_percent))
    return out


def _suspects(rows: PlanRows, settled: Settled, off_m: float) -> dict[str, Any]:
    """Return the values of a finding: cameras and points that contradict each other, and by how much at most."""
    cameras, points = _named_suspects(rows, settled)
    return {"on_plan": cameras, "points": points, "off_m": off_m}


def _named_suspects(rows: PlanRows, settled: Settled) -> tuple[list[str], list[str]]:
    """Return the cameras and the points that contradict each other."""
    k = len(rows.camera)
    cameras = [rows.camera_names[int(rows.camera[number])] for number in settled.suspects if number < k]
    return cameras, [rows.point_names[number - k] for number in settled.suspects if number >= k]
