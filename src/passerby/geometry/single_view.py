"""The vertical, the camera's height and the ground plane from the people in one camera's view.

People are upright, stand on one plane and are about equally tall. In the camera's frame the ground is given by the up
direction n and the camera's height H: the foot ray b meets it at `H b / -(n . b)`; raised along n by a person's height, it
must project onto the box's top. Three unknowns, two residuals a box.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.geometry.robust import cauchy_weights
from passerby.geometry.rotations import rotation_between

MIN_PEOPLE = 8
# A foot closer than this to the horizon (radians) tells nothing of the ground below it.
HORIZON = 0.01
_PITCHES = np.deg2rad(np.arange(-25.0, 90.0, 7.5))
_ROLLS = np.deg2rad(np.array([-30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0]))
# People bend and boxes slip: residuals are weighed at this share of the body's extent, with a Cauchy loss.
_SHARE = 0.06


@dataclass(frozen=True, eq=False)
class Level:
    """One camera's place above the ground, in its own frame."""

    up: Floats
    """(3,) unit vector, camera frame."""
    height: float
    """Camera above ground, metres (as far as the people are as tall as expected)."""
    residual: float
    """Median misfit, as a share of the bodies' extent."""

    @property
    def R_lc(self) -> Floats:
        """(3, 3) rotation from the camera's frame to a levelled one: z up, the view's heading along +y."""
        R = rotation_between(self.up, np.array([0.0, 0.0, 1.0]))
        heading = R @ np.array([0.0, 0.0, 1.0])
        turn = np.arctan2(heading[0], heading[1]) if np.hypot(heading[0], heading[1]) > 1e-6 else 0.0
        c, s = np.cos(turn), np.sin(turn)
        return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R)

    def ground_positions(self, bottom: Floats) -> Floats:
        """Where foot rays (N, 3) meet the ground: (N, 2) metres below the camera's frame of `R_lc`; NaN above the horizon."""
        ray = bottom @ self.R_lc.T
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(ray[:, 2] < -HORIZON, self.height / -ray[:, 2], np.nan)
        return np.asarray(ray[:, :2] * reach[:, None])


def level_camera(
    top: Floats,
    bottom: Floats,
    top_tangent: Floats,
    extent_px: Floats,
    body_m: Floats,
    foot_m: Floats,
    rng: np.random.Generator,
    *,
    max_people: int = 400,
) -> Level | None:
    """Robust fit of up direction and height from several starting pitches and rolls.

    Args:
        top: (N, 3) rays to the people's highest points, camera frame.
        bottom: (N, 3) rays to their lowest points.
        top_tangent: (N, 2, 3) of the top rays, from `Lens.tangents`.
        extent_px: (N,) extent in the picture.
        body_m: (N,) expected distance of the two points along the vertical, metres.
        foot_m: (N,) expected height of the lowest point above the ground, metres.
        rng: draws the people used where there are more than `max_people`.
        max_people: limit of the fit.

    Returns:
        The level, or None where fewer than eight people can be used.
    """
    if len(top) > max_people:
        rows = np.sort(rng.choice(len(top), max_people, replace=False))
        top, bottom, top_tangent, extent_px = top[rows], bottom[rows], top_tangent[rows], extent_px[rows]
        body_m, foot_m = body_m[rows], foot_m[rows]
    if len(top) < MIN_PEOPLE:
        return None
    fit = _Fit(top, bottom, top_tangent / extent_px[:, None, None], body_m, foot_m)
    starts = []
    for pitch in _PITCHES:
        for roll in _ROLLS:
            up = Rotation.from_euler("z", roll).apply(np.array([0.0, -np.cos(pitch), -np.sin(pitch)]))
            height = fit.height_given_up(up)
            if height is not None:
                starts.append((fit.cost(up, height), up, height))
    if not starts:
        return None
    starts.sort(key=lambda start: start[0])
    best = min((fit.refine(up, height) for _, up, height in starts[:4]), key=lambda found: found[0])
    _, up, height = best
    residual = float(np.median(np.linalg.norm(fit.residual(up, height), axis=1)))
    return Level(up, height, residual)


def level_by_heights(
    top: Floats, bottom: Floats, top_tangent: Floats, extent_px: Floats, body_m: Floats, foot_m: Floats,
    start: Level | None = None,
) -> Level | None:  # fmt: skip
    """The level by how tall people seem alone, whatever way they lean in the picture.

    A box is upright whatever the lens: the middles of its upper and lower edge say nothing of where the vertical vanishes, and
    would draw an unknown focal length to infinity. Arguments as of `level_camera`.

    Args:
        top: (N, 3) rays to the people's highest points, camera frame.
        bottom: (N, 3) rays to their lowest points.
        top_tangent: (N, 2, 3) of the top rays.
        extent_px: (N,) extent in the picture.
        body_m: (N,) expected distance of the two points, metres.
        foot_m: (N,) expected height of the lowest point, metres.
        start: where to begin; all over when None.

    Returns:
        The level, or None where fewer than eight people can be used or most feet are above any horizon.
    """
    if len(top) < MIN_PEOPLE:
        return None
    fit = _Fit(top, bottom, top_tangent / extent_px[:, None, None], body_m, foot_m, upright=True)
    starts = [] if start is None else [(0.0, start.up, start.height)]
    if start is None:
        for pitch, roll in itertools.product(_PITCHES, _ROLLS):
            up = Rotation.from_euler("z", roll).apply(np.array([0.0, -np.cos(pitch), -np.sin(pitch)]))
            height = fit.height_given_up(up)
            if height is not None:
                starts.append((fit.cost(up, height), up, height))
        starts.sort(key=lambda one: one[0])
    if not starts:
        return None
    _, up, height = min((fit.refine(up, height) for _, up, height in starts[:4]), key=lambda found: found[0])
    return Level(up, height, float(np.median(np.linalg.norm(fit.residual(up, height), axis=1))))


def keep_horizon(up: Floats, longer: float) -> Floats:
    """The up direction that keeps the horizon's line in the picture when the focal length grows by a factor."""
    moved = up * np.array([longer, longer, 1.0])
    return np.asarray(moved / np.linalg.norm(moved))


class _Fit:
    """Residuals of one camera's people, as shares of their extent; `upright` leaves those across the picture out."""

    def __init__(
        self, top: Floats, bottom: Floats, tangent: Floats, body_m: Floats, foot_m: Floats, *, upright: bool = False
    ) -> None:
        self.top, self.bottom, self.tangent, self.body_m, self.foot_m = top, bottom, tangent, body_m, foot_m
        if upright:
            self.tangent = np.concatenate([np.zeros_like(tangent[:, :1]), tangent[:, 1:]], axis=1)

    def residual(self, up: Floats, height: float) -> Floats:
        """(N, 2) misfit of the predicted highest points; large for feet above the horizon."""
        drop, _, head, depth = self._heads(up, height)
        residual = np.einsum("nki,ni->nk", self.tangent, head) / depth[:, None]
        return np.asarray(np.where((drop > HORIZON)[:, None], residual, 3.0))

    def jacobian(self, up: Floats, height: float, residual: Floats) -> Floats:
        """(N, 2, 3) derivative of `residual` by the steps of `_move`; 0 for feet above the horizon."""
        drop, reach, _, depth = self._heads(up, height)
        a, b = _across(up)
        per_reach = (reach / np.maximum(drop, HORIZON))[:, None]
        by_a = per_reach * (self.bottom @ a)[:, None] * self.bottom + self.body_m[:, None] * a
        by_b = per_reach * (self.bottom @ b)[:, None] * self.bottom + self.body_m[:, None] * b
        by_height = (height / np.maximum(drop, HORIZON))[:, None] * self.bottom
        head_by_step = np.stack([by_a, by_b, by_height], axis=2)
        along = np.einsum("ni,nij->nj", self.top, head_by_step)
        J = (self.tangent @ head_by_step - residual[:, :, None] * along[:, None, :]) / depth[:, None, None]
        return np.asarray(np.where((drop > HORIZON)[:, None, None], J, 0.0))

    def _heads(self, up: Floats, height: float) -> tuple[Floats, Floats, Floats, Floats]:
        """How steeply the foot rays fall (N,), how far they reach (N,), the heads above (N, 3) and their depths (N,)."""
        drop = -self.bottom @ up
        reach = (height - self.foot_m) / np.maximum(drop, HORIZON)
        head = reach[:, None] * self.bottom + self.body_m[:, None] * up
        floor = 0.05 * np.sqrt(np.einsum("ni,ni->n", head, head)) + 1e-9
        return drop, reach, head, np.maximum(np.einsum("ni,ni->n", self.top, head), floor)

    def height_given_up(self, up: Floats) -> float | None:
        """Median over the people of the camera height that puts the head on its ray; None if most feet are above the
        horizon.
        """
        drop = -self.bottom @ up
        use = drop > HORIZON
        if np.count_nonzero(use) < 0.6 * len(use):
            return None
        along = (self.tangent[use] @ (self.bottom[use] / drop[use, None])[:, :, None])[:, :, 0]
        rise = (self.tangent[use] @ up) * self.body_m[use, None]
        square = np.einsum("nk,nk->n", along, along)
        heights = -np.einsum("nk,nk->n", along, rise) / np.maximum(square, 1e-12) + self.foot_m[use]
        height = float(np.median(heights))
        return height if 0.2 < height < 200.0 else None

    def cost(self, up: Floats, height: float) -> float:
        """Mean Cauchy cost."""
        squared = (self.residual(up, height) ** 2).sum(axis=1) / _SHARE**2
        return float(np.log1p(squared).mean())

    def refine(self, up: Floats, height: float) -> tuple[float, Floats, float]:
        """Damped Gauss-Newton on (tilt about two axes, log height), reweighted for the Cauchy loss."""
        cost, damping = self.cost(up, height), 1e-3
        for _ in range(30):
            residual = self.residual(up, height)
            weight = cauchy_weights((residual**2).sum(axis=1) / _SHARE**2)
            J = self.jacobian(up, height, residual).reshape(-1, 3)
            weighted = J * np.repeat(weight, 2)[:, None]
            H, g = weighted.T @ J, weighted.T @ residual.reshape(-1)
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)) + 1e-12 * np.eye(3), g)
            moved = self._move(up, height, np.clip(step, -0.5, 0.5))
            new = self.cost(*moved)
            if new < cost:
                done = cost - new < 1e-7 * cost
                (up, height), cost, damping = moved, new, damping * 0.2
                if done:
                    break
            else:
                damping *= 5.0
                if damping > 1e6:
                    break
        return cost, up, height

    @staticmethod
    def _move(up: Floats, height: float, step: Floats) -> tuple[Floats, float]:
        a, b = _across(up)
        moved = up + step[0] * a + step[1] * b
        return moved / np.linalg.norm(moved), height * float(np.exp(step[2]))


def _across(up: Floats) -> tuple[Floats, Floats]:
    """Two directions (3,) at right angles to a unit vector and to each other."""
    x, y, z = up
    a = np.array([0.0, z, -y]) if abs(x) < 0.6 else np.array([y, -x, 0.0])
    a /= np.sqrt(a @ a)
    return a, np.array([y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]])
