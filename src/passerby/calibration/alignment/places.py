"""Points and camera positions with known coordinates: their rays and places in a rig, and the sigmas of these."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.calibration.alignment.sigmas import own_covariances
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.scale_cues import KnownPoint
from passerby.findings.finding import Finding, notice
from passerby.geometry.geodesy import east_north_up, mean_place

CLICK_SD_PX = 2.0
"""Standard deviation of a person's click on a mark, pixels."""
OWN_SHARE = 0.1
"""Least share of a camera's sigma that no other camera shares: 2 to 50 per cent by the adjustment, usually about 10 (PETS,
WILDTRACK)."""
UNKNOWN_ORIENTATION_DEG = 0.2
"""Standard deviation of the orientation in a rig without sigmas."""


def visible_points(rig: Rig, points: Sequence[KnownPoint]) -> tuple[list[tuple[KnownPoint, Camera, Floats]], list[Finding]]:
    """Return each sighting of a known point with its camera and its ray (3,), world; and notices on those not usable."""
    rows, lost = [], dict[str, int]()
    for point in points:
        for name, (u, v) in point.pixels.items():
            camera = camera_of(rig, name)
            width, height = camera.lens.size
            if not (-0.5 <= u <= width and -0.5 <= v <= height):
                raise InputError(
                    f"point {point.name} in camera {name}: ({u:g}, {v:g}) lies outside its {width} x {height} image: give "
                    "pixels of that image"
                )
            if camera.pose is None:
                lost[name] = lost.get(name, 0) + 1
                continue
            bearing = camera.lens.bearings(np.array([[u, v]]))[0]
            if not np.isfinite(bearing).all():
                raise InputError(
                    f"point {point.name} in camera {name}: ({u:g}, {v:g}) is outside the range of its lens model: choose "
                    f"another"
                )
            rows.append((point, camera, np.asarray(bearing @ camera.pose.R_cw)))
    return rows, [notice("points_without_pose", name, count=count) for name, count in lost.items()]


def local_places(place: Floats, cameras: Sequence[Camera]) -> tuple[Floats, Floats]:
    """Convert geodetic places (N, 3) to metres, and return their origin: their mean, at the altitude of the ground."""
    origin = mean_place(np.where(np.isfinite(place), place, 0.0))
    above = np.array([camera.centre[2] for camera in cameras])
    known = np.isfinite(place[:, 2])
    origin[2] = float((place[known, 2] - above[known]).mean()) if known.any() else 0.0
    filled = np.column_stack([place[:, :2], np.where(known, place[:, 2], origin[2] + above)])
    return east_north_up(filled, origin), origin


def position_sds(rig: Rig, with_scale: bool, tilt: bool = False) -> dict[str, float]:
    """Return the sigma of one coordinate of each camera's place in the rig, metres, by camera.

    With `with_scale` or `tilt`, the part that all cameras share by the scale or the vertical is removed: a fit determines it.
    """
    own = own_covariances(rig, with_scale=with_scale, tilt=tilt)
    sizes = _sizes_without_scale(rig) if with_scale else _stated_sizes(rig)
    sizes |= {name: float(np.sqrt(np.trace(covariance[:3, :3]))) for name, covariance in own.items()}
    return {name: float(size / np.sqrt(3)) for name, size in sizes.items()}


def _stated_sizes(rig: Rig) -> dict[str, float]:
    """Return one sigma of each camera's position; 0 for an infinite one, which belongs to the rig as a whole."""
    sigmas = {camera.name: 0.0 if camera.sigma is None else camera.sigma.position_m for camera in rig.posed()}
    return {name: sd if np.isfinite(sd) else 0.0 for name, sd in sigmas.items()}


def _sizes_without_scale(rig: Rig) -> dict[str, float]:
    """Return the sigmas of `_stated_sizes` without the scale, for cameras without covariances.

    The scale moves each camera in proportion to its distance from the middle. The largest scale error that fits into the sigmas
    of all cameras is removed.
    """
    total, posed = _stated_sizes(rig), rig.posed()
    if not len(posed):
        return total
    middle = np.mean([camera.centre for camera in posed], axis=0)
    distance = {camera.name: max(float(np.linalg.norm(camera.centre - middle)), 1e-9) for camera in posed}
    common = min(total[name] / distance[name] for name in total)
    return {
        name: float(np.sqrt(max(sd**2 - (common * distance[name]) ** 2, (OWN_SHARE * sd) ** 2))) for name, sd in total.items()
    }


def angle_sd(camera: Camera) -> float:
    """Return one sigma of the camera's orientation about one axis, radians."""
    if camera.sigma is None or not np.isfinite(camera.sigma.orientation_deg):
        return float(np.radians(UNKNOWN_ORIENTATION_DEG))
    return float(np.radians(camera.sigma.orientation_deg / np.sqrt(3)))


def camera_of(rig: Rig, name: str) -> Camera:
    """Return a camera by name. Raises `InputError` if the rig does not have it."""
    if name not in rig.names:
        raise InputError(f"the rig has no camera {name}: it has {', '.join(rig.names)}")
    return rig[name]
