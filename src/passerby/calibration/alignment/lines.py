"""The vertical and the heading of a rig by straight lines that a user marks: door frames, edges of houses, court lines.

Two pixels of a straight line and a camera's centre span a plane that contains the line. The plane of a vertical line
contains the vertical. The planes of two cameras intersect in the line, whose direction is level if the line is horizontal. The
rig's own vertical, by upright people, is used as a further observation, with its sigma.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from passerby.calibration.alignment.places import CLICK_SD_PX, OWN_SHARE, UNKNOWN_ORIENTATION_DEG, angle_sd, camera_of
from passerby.calibration.alignment.world import Aligned, aligned_by
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Rig
from passerby.findings.finding import Finding, notice
from passerby.geometry.rotations import Similarity, exp_rotation

OFF_SIGMAS = 3.0
"""A line that contradicts the vertical by more sigmas is reported and left out."""
LEAST_ANGLE = np.radians(3.0)
"""Least angle between the planes of two cameras; below it, their intersection has no usable direction."""
STEP_PX = 0.5
"""Step of the numerical derivatives, pixels."""

Pixel = tuple[float, float]


@dataclass(frozen=True)
class MarkedLine:
    """A straight line of known direction."""

    direction: Literal["vertical", "horizontal", "x"]
    points: Mapping[str, tuple[Pixel, Pixel]]
    """camera name -> two pixels on the line. For direction "x", x runs from the first pixel to the second."""


@dataclass(frozen=True)
class LineAngle:
    """Angle between a marked line and its stated direction, by the rig as it is."""

    off_deg: float
    """Angle between the line and its stated direction: the vertical, or the horizontal plane."""
    sigma_deg: float
    """One sigma of the angle, by the clicks and by the part of the cameras' orientation errors that they do not share."""


@dataclass(frozen=True, eq=False)
class _Row:
    """One equation for the vertical: `normal @ up = 0`."""

    line: int
    cameras: tuple[str, ...]
    normal: Floats
    """(3,) unit vector, world: normal of a camera's plane through a vertical line, or direction of a horizontal line."""
    sigma: float
    """One sigma of the equation's angle, radians."""

    def off_deg(self, up: Floats) -> float:
        """Return the angle between the line and its stated direction, for a vertical `up` (3,)."""
        return float(np.degrees(np.arcsin(np.clip(self.normal @ up, -1.0, 1.0))))

    def told(self, up: Floats, used: bool) -> dict[str, Any]:
        """Return the figures of the row for a vertical `up` (3,), JSON-ready."""
        sigma_deg = float(np.degrees(self.sigma))
        told = {"number": self.line + 1, "cameras": list(self.cameras), "used": used}
        return {**told, "off_deg": self.off_deg(up), "sigma_deg": sigma_deg}


def align_to_lines(rig: Rig, lines: Sequence[MarkedLine], vertical_sigma_deg: float | None = None) -> Aligned:
    """Correct the vertical of a rig by marked lines, and turn it until x runs along the lines of direction "x".

    Args:
        rig: its world z axis points up by people; its ground is at z = 0 near the cameras.
        lines: the marked lines; cameras without a pose are not used.
        vertical_sigma_deg: one sigma of the angle between the rig's vertical and the true one; None: `UNKNOWN_ORIENTATION_DEG`.

    Raises:
        InputError: the rig lacks a camera, or a pixel is outside the range of its lens.
        EvidenceError: no camera of any line has a pose.
    """
    sigma_deg = UNKNOWN_ORIENTATION_DEG if vertical_sigma_deg is None else vertical_sigma_deg
    rows = [row for number, line in enumerate(lines) for row in _rows(rig, number, line, sigma_deg)]
    along = [(number, *_heading(rig, line)) for number, line in enumerate(lines) if line.direction == "x" and _posed(rig, line)]
    if not rows and not along:
        raise EvidenceError("no camera in which a line is marked has a pose: mark lines in other cameras")
    prior = np.radians(max(sigma_deg, 1e-6)) / np.sqrt(2)
    up, covariance, used = _vertical(rows, prior)
    level = _turn_to(up)
    pivot = np.append(np.mean([camera.centre[:2] for camera in rig.posed()], axis=0), 0.0)
    angle, heading_sigma = _mean_heading([(level @ direction, sigma) for _, direction, sigma in along])
    turn = exp_rotation(np.array([0.0, 0.0, -angle])) @ level
    # The ground keeps its height in the middle of the cameras, and the origin stays below the same camera.
    motion = Similarity(1.0, turn, exp_rotation(np.array([0.0, 0.0, -angle])) @ (pivot - level @ pivot))
    notes: list[Finding] = [
        notice("line_off", *row.cameras, number=row.line + 1, off_deg=abs(row.off_deg(up)))
        for row, good in zip(rows, used, strict=True)
        if not good
    ]
    told: dict[str, Any] = {
        "lines": [row.told(up, good) for row, good in zip(rows, used, strict=True)],
        "tilt_deg": float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0)))),
        "vertical_sigma_deg": float(np.degrees(np.sqrt(np.trace(covariance)))),
        "heading_sigma_deg": None if heading_sigma is None else float(np.degrees(heading_sigma)),
    }
    aligned = aligned_by(rig, motion, f"{len(lines)} line{'s' if len(lines) > 1 else ''}", told)
    return Aligned(aligned.rig, aligned.motion, aligned.figures, (*aligned.diagnostics, *notes))


def measure_line(rig: Rig, line: MarkedLine, vertical_sigma_deg: float | None = None) -> LineAngle | None:
    """Compute the angle between a line and the rig's own vertical or level; None for a horizontal line that one camera sees.

    Raises as `align_to_lines` does.
    """
    sigma_deg = UNKNOWN_ORIENTATION_DEG if vertical_sigma_deg is None else vertical_sigma_deg
    if not _posed(rig, line):
        raise EvidenceError("no camera in which the line is marked has a pose: mark it in another one")
    rows = _rows(rig, 0, line, sigma_deg)
    if not rows:
        return None
    weight = np.array([1 / row.sigma**2 for row in rows])
    off = np.array([row.off_deg(np.array([0.0, 0.0, 1.0])) for row in rows])
    mean = np.sqrt((weight * off**2).sum() / weight.sum())
    return LineAngle(float(mean), float(np.degrees(1 / np.sqrt(weight.sum()))))


def _posed(rig: Rig, line: MarkedLine) -> list[str]:
    return [name for name in line.points if camera_of(rig, name).pose is not None]


def _rows(rig: Rig, number: int, line: MarkedLine, vertical_sigma_deg: float) -> list[_Row]:
    """Return the equations for the vertical that a line gives."""
    names = _posed(rig, line)
    own = {name: _own_sd(rig[name], vertical_sigma_deg) for name in names}
    if line.direction == "vertical":
        return [_Row(number, (name,), _plane(rig[name], line.points[name]), _sigma(rig, line, (name,), own)) for name in names]
    pairs = [(a, b) for place, a in enumerate(names) for b in names[place + 1 :]]
    planes = {name: _plane(rig[name], line.points[name]) for name in names}
    found = []
    for pair in pairs:
        direction = np.cross(planes[pair[0]], planes[pair[1]])
        size = float(np.linalg.norm(direction))
        if size > np.sin(LEAST_ANGLE):
            found.append(_Row(number, pair, direction / size, _sigma(rig, line, pair, own)))
    return found


def _own_sd(camera: Camera, vertical_sigma_deg: float) -> float:
    """Return the sigma of a camera's orientation about one axis, without the error of the shared vertical, radians."""
    total, shared = angle_sd(camera), np.radians(vertical_sigma_deg) / np.sqrt(2)
    return float(np.sqrt(max(total**2 - shared**2, (OWN_SHARE * total) ** 2)))


def _plane(camera: Camera, ends: Sequence[Pixel]) -> Floats:
    """Return the unit normal (3,), world, of the plane through a camera's centre and two of its pixels."""
    first, second = _rays(camera, ends)
    normal = np.cross(first, second)
    return np.asarray(normal / np.linalg.norm(normal))


def _rays(camera: Camera, ends: Sequence[Pixel]) -> Floats:
    """Return the unit rays (2, 3) of two pixels, world."""
    assert camera.pose is not None
    bearings = camera.lens.bearings(np.asarray(ends, dtype=np.float64))
    for (u, v), bearing in zip(ends, bearings, strict=True):
        if not np.isfinite(bearing).all():
            raise InputError(f"camera {camera.name}: [{u:g}, {v:g}] is outside what its lens can see: choose another pixel")
    return np.asarray(bearings @ camera.pose.R_cw)


def _sigma(rig: Rig, line: MarkedLine, names: tuple[str, ...], own: Mapping[str, float]) -> float:
    """Return the sigma of a row's angle with the vertical, by the clicks and the cameras' own orientations, radians."""

    def height(moved: Mapping[str, Sequence[Pixel]]) -> float:
        planes = [_plane(rig[name], moved[name]) for name in names]
        if len(planes) == 1:
            return float(planes[0][2])
        direction = np.cross(planes[0], planes[1])
        return float(direction[2] / np.linalg.norm(direction))

    ends = {name: line.points[name] for name in names}
    here, variance = height(ends), sum(own[name] ** 2 for name in names)
    for name in names:
        for end in range(2):
            for axis in range(2):
                moved = np.array(ends[name], dtype=np.float64)
                moved[end, axis] += STEP_PX
                slope = (height({**ends, name: [tuple(row) for row in moved.tolist()]}) - here) / STEP_PX
                variance += (slope * CLICK_SD_PX) ** 2
    return float(np.sqrt(variance))


def _vertical(rows: Sequence[_Row], prior: float) -> tuple[Floats, Floats, list[bool]]:
    """Return the vertical (3,) by lines and people, its covariance (2, 2) in x and y, radians^2, and whether each row was used.

    While a row is off by more than `OFF_SIGMAS`, the worst one is left out.
    """
    used = [True] * len(rows)
    while True:
        kept = [row for row, good in zip(rows, used, strict=True) if good]
        information = np.eye(2) / prior**2
        right = np.zeros(2)
        for row in kept:
            information += np.outer(row.normal[:2], row.normal[:2]) / row.sigma**2
            right -= row.normal[:2] * row.normal[2] / row.sigma**2
        covariance = np.linalg.inv(information)
        across = covariance @ right
        up = np.asarray(np.append(across, 1.0) / np.hypot(1.0, np.linalg.norm(across)))
        off = [abs(row.normal @ up) / np.hypot(row.sigma, prior) if good else 0.0 for row, good in zip(rows, used, strict=True)]
        if not off or max(off) <= OFF_SIGMAS:
            return up, np.asarray(covariance), used
        used[int(np.argmax(off))] = False


def _turn_to(up: Floats) -> Floats:
    """Return the smallest rotation (3, 3) that turns `up` (3,) into the z axis."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    size = float(np.linalg.norm(axis))
    return np.eye(3) if size < 1e-15 else exp_rotation(axis / size * np.arctan2(size, up[2]))


def _heading(rig: Rig, line: MarkedLine) -> tuple[Floats, float]:
    """Return the level direction (3,) of a line of direction "x", and the sigma of its heading, radians."""
    directions, weights = [], []
    for name in _posed(rig, line):
        first, second = line.points[name]
        direction, variance = _level(rig[name], (first, second)), angle_sd(rig[name]) ** 2
        for end in range(2):
            for axis in range(2):
                moved = [list(first), list(second)]
                moved[end][axis] += STEP_PX
                there = _level(rig[name], [(u, v) for u, v in moved])
                variance += ((direction[0] * there[1] - direction[1] * there[0]) / STEP_PX * CLICK_SD_PX) ** 2
        directions.append(direction)
        weights.append(1 / variance)
    mean = np.average(directions, axis=0, weights=weights)
    return np.asarray(mean / np.linalg.norm(mean)), float(1 / np.sqrt(sum(weights)))


def _level(camera: Camera, ends: Sequence[Pixel]) -> Floats:
    """Return the level unit direction (3,) in the plane of two pixels, from the first pixel to the second."""
    rays, normal = _rays(camera, ends), _plane(camera, ends)
    direction = np.array([normal[1], -normal[0], 0.0])
    if np.linalg.norm(direction) < 1e-9:
        raise InputError(f"camera {camera.name}: the line lies at the camera's own height: mark it in another camera")
    direction /= np.linalg.norm(direction)
    return np.asarray(direction if (rays[1] - rays[0]) @ direction > 0 else -direction)


def _mean_heading(found: Sequence[tuple[Floats, float]]) -> tuple[float, float | None]:
    """Return the mean heading of x lines from the rig's x axis, and its sigma, radians; 0 and None without lines."""
    if not found:
        return 0.0, None
    weights = np.array([1 / sigma**2 for _, sigma in found])
    mean = np.average([direction[:2] / np.linalg.norm(direction[:2]) for direction, _ in found], axis=0, weights=weights)
    return float(np.arctan2(mean[1], mean[0])), float(1 / np.sqrt(weights.sum()))
