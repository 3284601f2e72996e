"""One person's boxes as linear measurements of where the body stands on the ground and how tall it is.

An upright body stands at (x, y) on the ground z = 0 and is `top` metres high. The rays of a box's upper and lower edge give
three equations that are linear in (x, y, top), once the distances along the rays are known: the box's *centre* across and up
the picture, tight, and its *size*, loose, since a detector's slack moves both edges apart and leaves the centre where it is.
This is the person model of the solver (`passerby.solver.person_model`) with the cameras held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Bools, Floats
from passerby.core.cameras import Camera
from passerby.core.observations import BORDER_PX
from passerby.people.model import Noise

ROUNDS = 4
"""Of a box's distance, from its size to the place where the body stands; the fourth moves nobody by a millimetre."""
SHORTEST_SHARE, LONGEST_SHARE = 0.3, 1.3
"""Of the usual height: what a body's highest point is taken to be while its distance is sought."""
CUT_TIMES = 10.0
"""So much less is believed of a box that the picture's border cuts off: a part of the body is missing from it."""
NEAREST_M = 0.3
STANCE_SD = 0.06
"""Of the highest point, as a share of the standing height: gait, a bent neck, shoes (`Priors.high` of the solver)."""


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
    width, height = camera.lens.size
    cut = (x <= BORDER_PX) | (y <= BORDER_PX) | (x + w >= width - BORDER_PX) | (y + h >= height - BORDER_PX)
    floor = size * noise.floor_px / h
    less = np.where(cut, CUT_TIMES, 1.0)
    return Rays(
        np.tile(camera.pose.centre, (len(x), 1)), top, bottom, size,
        less * np.hypot(floor, noise.centre * size), less * np.hypot(floor, noise.height * size),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Measurements:
    """Of N boxes: three whitened rows `by_body @ (x, y, top) = value`."""

    by_body: Floats
    """(N, 3, 3) across, up, size."""
    value: Floats
    """(N, 3)"""
    distance: Floats
    """(N,) metres along the ray to the body's middle."""

    @property
    def information(self) -> Floats:
        """(N, 3, 3)"""
        return np.asarray(self.by_body.transpose(0, 2, 1) @ self.by_body)

    @property
    def pull(self) -> Floats:
        """(N, 3)"""
        return np.asarray((self.by_body.transpose(0, 2, 1) @ self.value[:, :, None])[:, :, 0])


def measure(rays: Rays, body: Floats, foot_shift: float | Floats) -> Measurements:
    """The measurements about bodies (N, 3): x, y, top.

    Args:
        rays: of the boxes.
        body: about where each of them stands; only distances are taken from it.
        foot_shift: how much nearer to the camera the lowest visible point is than the body's axis, metres; (N, 1) where bodies
            differ in it.
    """
    away = body[:, :2] - rays.centre[:, :2]
    toward = -away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), NEAREST_M)
    ends = (
        (rays.top, np.zeros_like(body), body, 1.0),
        (rays.bottom, np.column_stack([foot_shift * toward, np.zeros(len(body))]), body * (1.0, 1.0, 0.0), 0.0),
    )
    by_end, value_end, reach = [], [], []
    for ray, shift, point, is_top in ends:
        across = np.column_stack([-ray[:, 1], ray[:, 0], np.zeros(len(ray))])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        up = np.cross(ray, across)
        along = np.maximum(((point + shift - rays.centre) * ray).sum(axis=1), NEAREST_M)
        axes = np.stack([across, up], axis=1) / along[:, None, None]
        by_end.append(np.concatenate([axes[:, :, :2], is_top * axes[:, :, 2:]], axis=2))
        value_end.append((axes @ (rays.centre - shift)[:, :, None])[:, :, 0])
        reach.append(along)
    (by_top, by_bottom), (value_top, value_bottom) = by_end, value_end
    tight, loose = 1 / rays.centre_sd, 1 / rays.size_sd
    by_body = np.concatenate(
        [(by_top + by_bottom) * (tight / 2)[:, None, None], ((by_top - by_bottom) * loose[:, None, None])[:, 1:]], axis=1
    )
    # The size that was seen is the angle between the rays, about which the rows are linear: their difference has none left.
    value = np.concatenate(
        [(value_top + value_bottom) * (tight / 2)[:, None], ((value_top - value_bottom) * loose[:, None])[:, 1:]], axis=1
    )
    return Measurements(by_body, value, 0.5 * (reach[0] + reach[1]))


def stand(information: Floats, pull: Floats, height: Floats, height_sd: Floats) -> tuple[Floats, Floats]:
    """Bodies from sums of measurements and what is known of their height.

    Args:
        information: (N, 3, 3) of (x, y, top).
        pull: (N, 3)
        height: (N,) expected highest point, metres.
        height_sd: (N,) its sigma.

    Returns:
        (N, 3) x, y, top; (N, 3, 3) covariance.
    """
    weight = 1 / np.asarray(height_sd) ** 2
    normal, right = np.array(information), np.array(pull)
    normal[:, 2, 2] += weight
    right[:, 2] += weight * height
    covariance = np.linalg.inv(normal + 1e-9 * np.eye(3))
    return (covariance @ right[:, :, None])[:, :, 0], np.asarray(covariance, dtype=np.float64)


def stand_alone(rays: Rays, height_m: float, foot_shift: float) -> tuple[Floats, Floats, Measurements]:
    """Where each box by itself puts a body of about the given height.

    Returns:
        (N, 3) x, y, top; (N, 3, 3) covariance; the measurements about them. NaN where the lens cannot tell the rays.
    """
    middle = rays.top + rays.bottom
    level = np.hypot(middle[:, 0], middle[:, 1]) / np.linalg.norm(middle, axis=1)
    reach = height_m * level / np.maximum(rays.size, 1e-4)
    forward = middle[:, :2] / np.maximum(np.hypot(middle[:, :1], middle[:, 1:2]), 1e-9)
    body = np.column_stack([rays.centre[:, :2] + (reach * level)[:, None] * forward, np.full(len(reach), height_m)])
    known = np.full(len(reach), height_m)
    for _ in range(ROUNDS):
        seen = measure(rays, body, foot_shift)
        body, covariance = stand(seen.information, seen.pull, known, STANCE_SD * known)
        body[:, 2] = np.clip(body[:, 2], SHORTEST_SHARE * height_m, LONGEST_SHARE * height_m)
    return body, covariance, seen
