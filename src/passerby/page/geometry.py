"""What clicks say by a rig: where an end lies in the other pictures, how long a marked length is, where the ground is.

World: z up, ground at z = 0, metres. Pixels are OpenCV's: (0, 0) is the centre of the first one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.calibration.alignment.places import CLICK_SD_PX, angle_sd, position_sds
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.geometry.rotations import exp_rotation

NEAREST_M, FARTHEST_M, SAMPLES = 0.3, 300.0, 160
"""Distances along a ray that are drawn in the other pictures, evenly by their logarithm."""
BAND_SIGMAS = 2.0
"""Half of the band's width: 95 % of all clicks and rigs."""
SAME_RAY = 1e-3
"""Radians. A lens model may fold pixels beyond its range over the picture: those are not drawn."""
NEAREST_AXIS_M = 0.5
"""Between the two clicks of an axis: closer ones give no heading."""
STEP = 1e-4
"""Of numerical derivatives, metres and radians."""

Pixel = tuple[float, float]


@dataclass(frozen=True)
class EpipolarLine:
    """Where a point of one picture can be in another one."""

    camera: str
    line: tuple[tuple[Pixel, float], ...]
    """Pixels along the curve, each with the half width of its band, pixels across."""


@dataclass(frozen=True)
class MeasuredAxis:
    """Two clicks on the ground, by the rig as it is."""

    metres: float
    """Between them."""
    heading_sigma_deg: float
    """Of the direction from the first to the second, from the clicks alone."""


def epipolar_lines(rig: Rig, name: str, at: Pixel) -> tuple[EpipolarLine, ...]:
    """The epipolar lines of a pixel in all other cameras with poses, bent as their lenses bend them.

    The width is `BAND_SIGMAS` sigma of the click (2 px), and of the poses of both cameras without the scale that all share.

    Raises `InputError` for a camera without a pose or a pixel that its lens cannot see.
    """
    camera = _camera(rig, name)
    ray_c = _ray(camera, at)
    own = position_sds(rig, True)
    distances = np.geomspace(NEAREST_M, FARTHEST_M, SAMPLES)
    lines = []
    for other in rig.posed():
        if other.name == name:
            continue
        pixels = _along(camera, other, ray_c, distances)
        variance = np.zeros(len(distances))
        across = _across(pixels)
        for moved, seen_by, turned, sd in _perturbed(camera, other, ray_c, own):
            shift = (_along(moved, seen_by, turned, distances) - pixels) / STEP * sd
            with np.errstate(invalid="ignore"):
                variance += np.nan_to_num((shift * across).sum(axis=1)) ** 2
        width, height = other.lens.size
        inside = (pixels > -0.05 * width).all(axis=1) & (pixels < [1.05 * width, 1.05 * height]).all(axis=1)
        line = tuple(
            ((round(float(u), 2), round(float(v), 2)), round(BAND_SIGMAS * float(np.sqrt(var)), 2))
            for (u, v), var in zip(pixels[inside], variance[inside], strict=True)
        )
        lines.append(EpipolarLine(other.name, line))
    return tuple(lines)


def ground_point(rig: Rig, name: str, at: Pixel) -> Floats:
    """(3,) where the ray of a pixel meets the ground.

    Raises `InputError` for a camera without a pose, or a pixel at or above the horizon.
    """
    camera = _camera(rig, name)
    assert camera.pose is not None
    ray = camera.pose.R_cw.T @ _ray(camera, at)
    if ray[2] > -1e-3:
        raise InputError(f"camera {name}: [{at[0]:.1f}, {at[1]:.1f}] is not on the ground but above the horizon: click lower")
    centre = camera.centre
    return np.asarray(centre - ray * (centre[2] / ray[2]))


def measure_axis(rig: Rig, clicks: Sequence[tuple[str, Pixel]]) -> MeasuredAxis:
    """The x axis from one click on the ground, (camera, pixel), to another one. Raises as `ground_point` does."""

    def between(moved: Sequence[tuple[str, Pixel]]) -> Floats:
        first, second = (ground_point(rig, name, at)[:2] for name, at in moved)
        return np.asarray(second - first)

    along = between(clicks)
    metres = float(np.linalg.norm(along))
    if metres < NEAREST_AXIS_M:
        raise InputError(f"the two clicks are {100 * metres:.0f} cm from each other: click a point of the x axis farther away")
    variance = 0.0
    for number in range(2):
        for axis in range(2):
            moved = list(clicks)
            name, (u, v) = clicks[number]
            moved[number] = name, (u + 0.5, v) if axis == 0 else (u, v + 0.5)
            there = between(moved)
            turn = np.arctan2(along[0] * there[1] - along[1] * there[0], float(along @ there))
            variance += (float(turn) / 0.5 * CLICK_SD_PX) ** 2
    return MeasuredAxis(metres, float(np.degrees(np.sqrt(variance))))


def _camera(rig: Rig, name: str) -> Camera:
    """A camera with a pose."""
    if name not in rig.names or rig[name].pose is None:
        raise EvidenceError(f"camera {name} has no pose yet: calibrate first")
    return rig[name]


def _ray(camera: Camera, at: Pixel) -> Floats:
    """(3,) unit ray in the camera's frame."""
    ray = np.asarray(camera.lens.bearings(np.array([at]))[0])
    if not np.isfinite(ray).all():
        raise InputError(f"camera {camera.name}: [{at[0]:.1f}, {at[1]:.1f}] is outside what its lens can see: choose another")
    return ray


def _along(camera: Camera, other: Camera, ray_c: Floats, distances: Floats) -> Floats:
    """(N, 2) pixels in `other` of the points at these distances (N,) along a ray of `camera`; NaN where it sees none."""
    assert camera.pose is not None
    assert other.pose is not None
    points = camera.centre + distances[:, None] * (camera.pose.R_cw.T @ ray_c)
    pixels = other.project(points)
    local = points @ other.pose.R_cw.T + other.pose.t_cw
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        seen = other.lens.bearings(np.where(np.isfinite(pixels), pixels, 0.0))
        good = np.isfinite(pixels).all(axis=1) & (np.linalg.norm(seen - local, axis=1) < SAME_RAY)
    return np.where(good[:, None], pixels, np.nan)


def _across(pixels: Floats) -> Floats:
    """(N, 2) unit normals of a curve of pixels."""
    along = np.gradient(pixels, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.column_stack([-along[:, 1], along[:, 0]])


def _perturbed(
    camera: Camera, other: Camera, ray_c: Floats, own: Mapping[str, float]
) -> list[tuple[Camera, Camera, Floats, float]]:
    """Both cameras and the ray with each unknown moved by `STEP`, and that unknown's sigma."""
    click = CLICK_SD_PX / camera.lens.focal
    found = []
    helper = np.eye(3)[int(np.argmin(np.abs(ray_c)))]
    first = np.cross(ray_c, helper) / np.linalg.norm(np.cross(ray_c, helper))
    for axis in (first, np.cross(ray_c, first)):
        found.append((camera, other, ray_c + STEP * axis, click))
    for axis in np.eye(3):
        found.append((_shifted(camera, axis), other, ray_c, own[camera.name]))
        found.append((camera, _shifted(other, axis), ray_c, own[other.name]))
        found.append((_turned(camera, axis), other, ray_c, angle_sd(camera)))
        found.append((camera, _turned(other, axis), ray_c, angle_sd(other)))
    return found


def _shifted(camera: Camera, axis: Floats) -> Camera:
    assert camera.pose is not None
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.centre + STEP * axis))


def _turned(camera: Camera, axis: Floats) -> Camera:
    assert camera.pose is not None
    return replace(camera, pose=Pose.from_centre(exp_rotation(STEP * axis) @ camera.pose.R_cw, camera.centre))
