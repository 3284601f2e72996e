"""The upright body: where its two ends are, and what the rays of a box or of joints say of them, linear about a guess.

World: z up. A body stands at (x, y), and reaches from its lowest to its highest point. Its lowest visible point is nearer to
the camera than its axis. Two rays, of its highest and of its lowest point, give three equations that are linear once the
distances along the rays are known: the *centre* between both, across and up the picture, tight, and the *size*, loose, since a
detector's slack moves both edges apart and leaves the centre where it is. All that fits bodies to pictures builds on these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Bools, Floats
from passerby.core.cameras import Camera
from passerby.core.observations import inside_picture
from passerby.people.model import Noise

X, Y, LOW, HIGH = range(4)
"""Columns of a body: its place on the ground, and its lowest and highest points above the ground, metres."""
NEAREST_M = 0.3
"""Nobody is nearer to a camera: it keeps the equations of a guess that is far off finite."""
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
class Rays:
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

    @classmethod
    def joined(cls, parts: Sequence[Rays]) -> Rays:
        """The boxes of several cameras, one after the other."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__})

    def take(self, rows: NDArray[np.generic]) -> Rays:
        """The boxes of the given rows."""
        return Rays(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})

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
