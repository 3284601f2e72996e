"""The upright body: where its two ends are, and what the rays of a box or of joints say of them, linear about a guess.

World: z up. A body stands at (x, y), and reaches from its lowest to its highest point. Its lowest visible point is nearer to
the camera than its axis. Two rays, of its highest and of its lowest point, give three equations that are linear once the
distances along the rays are known: the *centre* between both, across and up the picture, tight, and the *size*, loose, since a
detector's slack moves both edges apart and leaves the centre where it is. All that fits bodies to pictures builds on these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Columns, Floats
from passerby.core.cameras import Camera
from passerby.core.observations import inside_picture
from passerby.people.model import Noise

X, Y, LOW, HIGH = range(4)
"""Columns of a body: its place on the ground, and its lowest and highest points above the ground, metres."""
HORIZON = 0.02
"""Rays that fall less steeply, by this sine, meet no ground."""
NEAREST_M = 0.3
"""No person is nearer to a camera: it keeps the equations of a guess that is far off finite."""
CUT_TIMES = 10.0
"""So much less is believed of a box that the picture's border cuts off: a part of the body is missing from it."""


def body_ends(
    centre: Floats, body: Floats, moved: Floats, top_fraction: Floats | float = 1.0, bottom_fraction: Floats | float = 0.0
) -> tuple[Floats, Floats, Floats, Floats]:
    """The highest and the lowest point that cameras see of upright bodies.

    Args:
        centre: (M, 3) of the cameras, metres.
        body: (M, 4) x, y, height of the lowest and of the highest point, metres.
        moved: (M, 1) how much nearer to the camera the lowest visible point is than the body's axis, metres.
        top_fraction: (M,) where on the body the highest point sits, as a share of its height.
        bottom_fraction: (M,) the same of the lowest point.

    Returns:
        (M, 3) highest points; (M, 3) lowest points; (M, 2) unit vectors over the ground to the cameras, (M,) how far that is.
    """
    length = body[:, HIGH] - body[:, LOW]
    top = np.column_stack([body[:, :2], body[:, LOW] + top_fraction * length])
    toward = centre[:, :2] - body[:, :2]
    distance = np.maximum(np.linalg.norm(toward, axis=1), 0.1)
    toward = toward / distance[:, None]
    bottom = np.column_stack([body[:, :2] + moved * toward, body[:, LOW] + bottom_fraction * length])
    return top, bottom, toward, distance


def by_low_and_high(by_point: Floats, fraction: Floats) -> Floats:
    """Chain (M, k, 3) derivatives by a point on the body's axis to (M, k, 4) by x, y, low and high.

    Args:
        by_point: by the point, metres.
        fraction: (M,) where on the body the point sits, as a share of its height.
    """
    by_z = by_point[:, :, 2:]
    return np.concatenate([by_point[:, :, :2], by_z * (1 - fraction)[:, None, None], by_z * fraction[:, None, None]], axis=2)


@dataclass(frozen=True, eq=False)
class Rays(Columns):
    """N boxes as rays. World frame, metres, radians."""

    centre: Floats
    """(N, 3) of the cameras."""
    top: Floats
    """(N, 3) unit rays of the middle of the upper edge; NaN where the lens cannot tell."""
    bottom: Floats
    """(N, 3) the same of the lower edge."""
    size: Floats
    """(N,) the angle between both."""
    centre_sd: Floats
    """(N,) one sigma of the centre's direction, in each of two directions."""
    size_sd: Floats
    """(N,) one sigma of the size."""

    @property
    def known(self) -> Bools:
        """(N,) whether the lens can tell both rays."""
        return np.asarray(np.isfinite(self.size))


def rays_of(camera: Camera, ltwh: Floats, noise: Noise | None = None) -> Rays:
    """The rays of boxes (N, 4) in pixels of a camera with a pose."""
    noise = noise or Noise()
    assert camera.pose is not None
    x, y, w, h = ltwh.T
    middle = x + w / 2
    top = camera.lens.bearings(np.column_stack([middle, y])) @ camera.pose.R_cw
    bottom = camera.lens.bearings(np.column_stack([middle, y + h])) @ camera.pose.R_cw
    size = 2 * np.arcsin(np.clip(np.linalg.norm(top - bottom, axis=1) / 2, 1e-5, 1.0))
    floor = size * noise.floor_px / h
    less = np.where(inside_picture(ltwh, camera.lens.size), 1.0, CUT_TIMES)
    return Rays(
        np.tile(camera.pose.centre, (len(x), 1)), top, bottom, size,
        less * np.hypot(floor, noise.centre * size), less * np.hypot(floor, noise.height * size),
    )  # fmt: skip


def reach_by_size(
    top: Floats, bottom: Floats, size: Floats, length_m: Floats | float, least_level: float = 0.0
) -> tuple[Floats, Floats]:
    """How far upright bodies are away, by how large they look.

    Args:
        top: (N, 3) unit rays of the highest points, world.
        bottom: (N, 3) the same of the lowest.
        size: (N,) the angle between both, radians.
        length_m: (N,) metres between both on the body.
        least_level: a body from straight above looks no shorter than by this factor.

    Returns:
        (N, 3) unit rays of the middles, (N,) metres along them.
    """
    middle = top + bottom
    middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    level = np.maximum(np.hypot(middle[:, 0], middle[:, 1]), least_level)
    return middle, np.asarray(length_m * level / np.maximum(size, 1e-4))


def ground_under(camera: Camera, pixels: Floats) -> Floats:
    """(N, 2) where the rays of pixels (N, 2) meet the ground z = 0, metres; NaN near the horizon and above it."""
    assert camera.pose is not None
    ray = camera.lens.bearings(pixels) @ camera.pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(ray[:, 2] < -HORIZON, camera.pose.centre[2] / -ray[:, 2], np.nan)
    return np.asarray(camera.pose.centre[:2] + reach[:, None] * ray[:, :2])


def height_over(camera: Camera, place: Floats, pixels: Floats) -> Floats:
    """(N,) how high the rays of pixels (N, 2) pass over places (N, 2) on the ground, metres."""
    assert camera.pose is not None
    ray = camera.lens.bearings(pixels) @ camera.pose.R_cw
    away = np.linalg.norm(place - camera.pose.centre[:2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(camera.pose.centre[2] + away * ray[:, 2] / np.linalg.norm(ray[:, :2], axis=1))


def pixels_over(camera: Camera, place: Floats, height_m: float) -> Floats:
    """(N, 2) pixels of points at a height over places (N, 2) on the ground; NaN where the camera cannot see them."""
    return camera.project(np.column_stack([place, np.full(len(place), height_m)]))


@dataclass(frozen=True, eq=False)
class LinearisedEnds:
    """What N pairs of rays say of the two ends of bodies: three whitened rows each, across, up, and size.

    Ends that are moved leave `residual - by_top d(top) - by_bottom d(bottom)`.
    """

    residual: Floats
    """(N, 3)"""
    by_top: Floats
    """(N, 3, 3) by the highest point, metres, world."""
    by_bottom: Floats
    """(N, 3, 3) by the lowest."""
    top: Floats
    """(N, 3) from the camera to the highest point, metres, world."""
    bottom: Floats
    """(N, 3) to the lowest."""
    distance: Floats
    """(N,) metres along the rays to the body's middle."""


def linearise_ends(rays: Rays, top: Floats, bottom: Floats) -> LinearisedEnds:
    """The equations about ends (N, 3) and (N, 3), world, metres.

    The size that was seen is the angle between the rays, about which the rows are linear: their difference has none left.
    """
    axes, reach, along = [], (top - rays.centre, bottom - rays.centre), []
    for ray, end in zip((rays.top, rays.bottom), reach, strict=True):
        across = np.column_stack([-ray[:, 1], ray[:, 0], np.zeros(len(ray))])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        along.append(np.maximum((end * ray).sum(axis=1), NEAREST_M))
        axes.append(np.stack([across, np.cross(ray, across)], axis=1) / along[-1][:, None, None])
    tight, loose = (0.5 / rays.centre_sd)[:, None, None], (1 / rays.size_sd)[:, None, None]
    by_top, by_bottom = (
        np.concatenate([one * tight, sign * one[:, 1:] * loose], axis=1) for one, sign in zip(axes, (1, -1), strict=True)
    )
    residual = -((by_top @ reach[0][:, :, None]) + (by_bottom @ reach[1][:, :, None]))[:, :, 0]
    return LinearisedEnds(residual, by_top, by_bottom, *reach, 0.5 * (along[0] + along[1]))
