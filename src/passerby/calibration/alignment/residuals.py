"""Residuals of a rig that was aligned with known places, and findings about these places."""

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
"""A fit whose residuals are more than this many times their stated standard deviations is reported."""
LEAN_DEG, HEIGHT_M = 0.05, 0.02
"""A ground that leans less and lies nearer to z = 0 is taken to be at z = 0: over 20 m such a lean rises by less than 2 cm."""
TELLING_SCALE = 0.01
"""Relative error of the scale below which it is not reported: people's heights never determine the scale better."""
WEAK_SCALE = 0.3
"""Relative standard deviation of the scale above which it counts as unknown."""


def point_residuals(
    rig: Rig, rows: Sequence[tuple[KnownPoint, Camera, Floats]], places: SeenPoints, fit: WorldFit
) -> list[dict[str, Any]]:
    """Return the residuals of each sighting of a known point, JSON-ready.

    `off_m` is the distance on the horizontal plane of the point, or across the ray if the ray does not meet this plane.
    `off_px` is the distance in the image. `height_off_m` is the height of the triangulated point above the stated one, None
    without a triangulated point.
    """
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
    """Return the residuals of each camera, JSON-ready: metres on the ground, and of its height where this is known."""
    out = []
    for index, known in enumerate(rows):
        away = rig[known.camera].centre - target[index]
        out.append({
            "camera": known.camera, "off_m": float(np.hypot(away[0], away[1])),
            "height_off_m": float(away[2]) if with_height[index] else None, "used": bool(fit.used[index]),
        })  # fmt: skip
    return out


def gross_points(residuals: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """Return notices on sightings that were left out: one for a point that lost all its sightings, else one for each."""
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
    """Return notices where the residuals are large as a whole, and where another scale would fit better."""
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
    """Return a notice with the lean and the height of the people's ground after a motion, unless it lies at z = 0."""
    below = np.mean([camera.centre for camera in rig.posed()], axis=0) * (1.0, 1.0, 0.0)
    lean = float(np.degrees(direction_angle(motion.rotation[:, 2], np.array([0.0, 0.0, 1.0]))))
    height = round(float(motion.apply(below)[2]), 3) + 0.0  # no -0.00
    if lean < LEAN_DEG and abs(height) < HEIGHT_M:
        return []
    return [notice("ground_elsewhere", lean_deg=lean, height_m=height)]
