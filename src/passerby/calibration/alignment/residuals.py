"""How far a rig that was laid upon known places lies from each, and what is odd about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Rig
from passerby.core.scale_cues import KnownPoint, KnownPosition
from passerby.findings.finding import Finding, notice
from passerby.geometry.alignment import Places, SeenPoints, WorldFit, fit_world
from passerby.geometry.rotations import Similarity, direction_angle

POOR_FIT = 3.0
"""Residuals of three times their stated standard deviations are reported."""
LEAN_DEG, HEIGHT_M = 0.05, 0.02
"""A ground that is nearer to z = 0 is at z = 0: a step of 20 m climbs by less than 2 cm."""
TELLING_SCALE = 0.01
"""A scale that is off by less is not reported: people's heights never determine it better."""
WEAK_SCALE = 0.3
"""A scale that is known no better than this is not known."""


def point_residuals(
    rig: Rig, rows: Sequence[tuple[KnownPoint, Camera, Floats]], places: SeenPoints, fit: WorldFit
) -> list[dict[str, Any]]:
    """Of each sighting: metres on the plane of the point, or across the ray; pixels; the height that several rays tell."""
    flat = np.linalg.norm(places.on_plane(fit.motion) - places.target[:, :2], axis=1)
    across = np.linalg.norm(places.residuals(fit.motion), axis=1)
    which, met = places.points()
    heights = dict(zip(which.tolist(), fit.motion.apply(met)[:, 2].tolist(), strict=True))
    out = []
    for row, (point, camera, _) in enumerate(rows):
        pixel = rig[camera.name].project(point.xyz[None])[0]
        height = heights.get(int(places.group[row]))
        out.append({
            "point": point.name, "camera": camera.name,
            "off_m": float(flat[row] if np.isfinite(flat[row]) else across[row]),
            "off_px": float(np.linalg.norm(pixel - point.pixels[camera.name])) if np.isfinite(pixel).all() else None,
            "height_off_m": None if height is None else height - float(point.xyz[2]),
            "used": bool(fit.used[row]),
        })  # fmt: skip
    return out


def position_residuals(
    rig: Rig, rows: Sequence[KnownPosition], target: Floats, with_height: Any, fit: WorldFit
) -> list[dict[str, Any]]:
    """Of each camera: metres on the ground, and of its height where that is known."""
    out = []
    for index, known in enumerate(rows):
        away = rig[known.camera].centre - target[index]
        out.append({
            "camera": known.camera, "off_m": float(np.hypot(away[0], away[1])),
            "height_off_m": float(away[2]) if with_height[index] else None, "used": bool(fit.used[index]),
        })  # fmt: skip
    return out


def gross_points(residuals: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """One notice for each point, or each sighting, that was left out."""
    notes = []
    for name in dict.fromkeys(row["point"] for row in residuals):
        seen = [row for row in residuals if row["point"] == name]
        wrong = [row for row in seen if not row["used"]]
        if len(wrong) == len(seen) > 1:
            off = float(np.median([row["off_m"] for row in wrong]))
            notes.append(notice("point_off_everywhere", point=name, off_m=off, count=len(wrong)))
        else:
            notes += [notice("point_off", row["camera"], point=name, off_m=row["off_m"]) for row in wrong]
    return notes


def doubts(places: Places, fit: WorldFit, with_scale: bool, tilt: bool, what: str, count: int) -> list[Finding]:
    """Evidence against the fit as a whole, and whether another scale would fit better."""
    notes = []
    if fit.noise > POOR_FIT:
        size = float(np.sqrt(np.mean((places.residuals(fit.motion)[fit.used] ** 2).sum(axis=1))))
        notes.append(notice("places_fit_poorly", what=what, off_m=size, times=fit.noise))
    if with_scale or count < 3:
        return notes
    try:
        free = fit_world(places, with_scale=True, tilt=tilt)
    except EvidenceError:
        return notes
    growth = float(np.log(free.motion.scale))
    same = bool((free.used | ~fit.used).all())  # else a gross error biases the scale
    if same and abs(growth) > max(TELLING_SCALE, 3 * free.scale_sigma) and free.scale_sigma < WEAK_SCALE:
        percent, sigma_percent = 100 * abs(free.motion.scale - 1), 100 * free.scale_sigma
        notes.append(notice("places_want_scale", what=what, percent=percent, larger=growth > 0, sigma_percent=sigma_percent))
    return notes


def ground_note(rig: Rig, motion: Similarity) -> list[Finding]:
    """Where the ground of the people lies now, unless it lies at z = 0."""
    below = np.mean([camera.centre for camera in rig.posed()], axis=0) * (1.0, 1.0, 0.0)
    lean = float(np.degrees(direction_angle(motion.rotation[:, 2], np.array([0.0, 0.0, 1.0]))))
    height = round(float(motion.apply(below)[2]), 3) + 0.0  # no -0.00
    if lean < LEAN_DEG and abs(height) < HEIGHT_M:
        return []
    return [notice("ground_elsewhere", lean_deg=lean, height_m=height)]
