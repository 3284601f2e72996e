"""Fit of the vertical, the camera's height and the ground plane from the people in one camera's view.

People are upright, stand on one plane and are about equally tall. In the camera's frame the ground is given by the up
direction n and the camera's height H: the foot ray b meets it at `H b / -(n . b)`. This point, raised along n by a person's
height, must project to the top of the box. There are three unknowns, and two residuals per box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats
from passerby.geometry.groups import cauchy_weights
from passerby.geometry.rotations import rotation_between

MIN_PEOPLE = 8
# A foot closer than this to the horizon (radians) does not determine a place on the ground.
HORIZON = 0.01
_PITCHES = np.deg2rad(np.arange(-25.0, 90.0, 7.5))
_ROLLS = np.deg2rad(np.array([-30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0]))
# Scale of the Cauchy loss of the residuals, as a share of the body's extent: people bend, and boxes are inexact.
_SHARE = 0.06


@dataclass(frozen=True, eq=False)
class Level:
    """Up direction and height above the ground of one camera, in its own frame."""

    up: Floats
    """(3,) unit vector, camera frame."""
    height: float
    """Height of the camera above the ground, metres (correct if the people are as tall as expected)."""
    residual: float
    """Median residual, as a share of the bodies' extent."""
    residual_90: float = 0.0
    """Residual that 90 % of the bodies do not exceed, as a share of their extent."""

    @property
    def R_lc(self) -> Floats:
        """(3, 3) rotation from the camera's frame to a levelled frame: z up, the heading of the optical axis along +y."""
        R = rotation_between(self.up, np.array([0.0, 0.0, 1.0]))
        heading = R @ np.array([0.0, 0.0, 1.0])
        turn = np.arctan2(heading[0], heading[1]) if np.hypot(heading[0], heading[1]) > 1e-6 else 0.0
        c, s = np.cos(turn), np.sin(turn)
        return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R)

    def ground_positions(self, bottom: Floats) -> Floats:
        """Return where foot rays (N, 3) meet the ground: (N, 2) metres along x and y of the levelled frame (`R_lc`).

        The origin is the point below the camera; NaN for rays above the horizon.
        """
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
    """Fit the up direction and the height robustly, from several starting pitches and rolls.

    Args:
        top: (N, 3) rays to the people's highest points, camera frame.
        bottom: (N, 3) rays to their lowest points.
        top_tangent: (N, 2, 3) maps to pixels at the top rays, from `Lens.tangents`.
        extent_px: (N,) extent of the body in the image, pixels.
        body_m: (N,) expected distance of the two points along the vertical, metres.
        foot_m: (N,) expected height of the lowest point above the ground, metres.
        rng: draws the people that are used, where there are more than `max_people`.
        max_people: largest number of people in the fit.

    Returns:
        The level, or None with fewer than eight people, or where no start has enough feet below the horizon.
    """
    if len(top) > max_people:
        rows = np.sort(rng.choice(len(top), max_people, replace=False))
        top, bottom, top_tangent, extent_px = top[rows], bottom[rows], top_tangent[rows], extent_px[rows]
        body_m, foot_m = body_m[rows], foot_m[rows]
    if len(top) < MIN_PEOPLE:
        return None
    fit = _Fit(top, bottom, top_tangent / extent_px[:, None, None], body_m, foot_m)
    starts = fit.starts()
    if not starts:
        return None
    best = min((fit.refine(up, height) for _, up, height in starts[:4]), key=lambda found: found[0])
    return fit.level(*best[1:])


def level_by_heights(
    top: Floats, bottom: Floats, top_tangent: Floats, extent_px: Floats, body_m: Floats, foot_m: Floats,
    start: Level | None = None,
) -> Level | None:  # fmt: skip
    """Fit the level from the apparent heights of people only, not from how they lean in the image.

    The edges of a box are parallel to the image's edges for every lens. The middles of its upper and lower edge do not show the
    vanishing point of the vertical, and would pull an unknown focal length to infinity.

    Args:
        top: (N, 3) rays to the people's highest points, camera frame.
        bottom: (N, 3) rays to their lowest points.
        top_tangent: (N, 2, 3) maps to pixels at the top rays.
        extent_px: (N,) extent of the body in the image, pixels.
        body_m: (N,) expected distance of the two points, metres.
        foot_m: (N,) expected height of the lowest point, metres.
        start: start of the fit; several starting pitches and rolls when None.

    Returns:
        The level, or None with fewer than eight people, or where no start has enough feet below the horizon.
    """
    if len(top) < MIN_PEOPLE:
        return None
    fit = _Fit(top, bottom, top_tangent / extent_px[:, None, None], body_m, foot_m, upright=True)
    starts = fit.starts() if start is None else [(0.0, start.up, start.height)]
    if not starts:
        return None
    _, up, height = min((fit.refine(up, height) for _, up, height in starts[:4]), key=lambda found: found[0])
    return fit.level(up, height)


def keep_horizon(up: Floats, longer: float) -> Floats:
    """Return the up direction (3,) that keeps the horizon's line in the image when the focal length grows by a factor."""
    moved = up * np.array([longer, longer, 1.0])
    return np.asarray(moved / np.linalg.norm(moved))


@dataclass(frozen=True, eq=False)
class _Heads:
    """Residuals of N heads as predicted by a level, and values for their derivatives."""

    residual: Floats
    """(2, N) residuals, as shares of the extent; large for feet above the horizon."""
    sound: Bools
    """(N,) whether the foot is below the horizon."""
    per_reach: Floats
    """(N,) derivative of the foot's distance by the component of its ray along the up direction, metres."""
    per_height: Floats
    """(N,) derivative of the foot's distance by the logarithm of the camera's height, metres."""
    depth: Floats
    """(N,) depth of the head along its ray, metres."""

    @property
    def squares(self) -> Floats:
        """(N,) squared lengths of the residuals, in units of the loss's scale."""
        return np.asarray((self.residual[0] ** 2 + self.residual[1] ** 2) / _SHARE**2)

    @property
    def cost(self) -> float:
        """Mean Cauchy cost of the people."""
        return float(np.log1p(self.squares).mean())


class _Fit:
    """Residuals of one camera's people, as shares of their extent; `upright` leaves out the horizontal component.

    All terms are linear in the rays. For a tilt, only the products of each ray with the new direction are computed again.
    """

    def __init__(
        self, top: Floats, bottom: Floats, tangent: Floats, body_m: Floats, foot_m: Floats, *, upright: bool = False
    ) -> None:
        self.body_m, self.foot_m = body_m, foot_m
        across, down = tangent[:, 0], tangent[:, 1]
        if upright:
            across = np.zeros_like(across)
        self.rows = np.concatenate([bottom, top, across, down])
        # The foot's ray: its squared length, its component along the head's ray, and its image in shares of the extent.
        self.square, self.along_top = np.einsum("ni,ni->n", bottom, bottom), np.einsum("ni,ni->n", top, bottom)
        self.seen = np.array([np.einsum("ni,ni->n", across, bottom), np.einsum("ni,ni->n", down, bottom)])

    def _project_along(self, direction: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the foot's (N,) and the head's ray (N,) along a direction, and its image (2, N) in shares of the extent."""
        foot, head, *seen = (self.rows @ direction).reshape(4, -1)
        return foot, head, np.array(seen)

    def level(self, up: Floats, height: float) -> Level:
        """Return the level with its residuals."""
        misfit = np.linalg.norm(self.residual(up, height), axis=1)
        return Level(up, height, float(np.median(misfit)), float(np.quantile(misfit, 0.9)))

    def residual(self, up: Floats, height: float) -> Floats:
        """Return the residuals (N, 2) of the predicted highest points; large for feet above the horizon."""
        return self._heads(up, height).residual.T

    def _heads(self, up: Floats, height: float) -> _Heads:
        """Predict the heads: the foot's ray is followed to the foot, and the body stands upright on it."""
        foot, head, seen = self._project_along(up)
        below = np.maximum(-foot, HORIZON)
        reach = (height - self.foot_m) / below
        far = np.sqrt(np.maximum(reach * (reach * self.square + 2 * self.body_m * foot) + self.body_m**2, 0.0))
        depth = np.maximum(reach * self.along_top + self.body_m * head, 0.05 * far + 1e-9)
        sound = -foot > HORIZON
        residual = np.where(sound, (reach * self.seen + self.body_m * seen) / depth, 3.0)
        return _Heads(residual, sound, reach / below, height / below, depth)

    def jacobian(self, up: Floats, heads: _Heads) -> Floats:
        """Return the derivative (3, 2, N) of the residual by the steps of `_move`; 0 for feet above the horizon."""
        out = np.empty((3, *heads.residual.shape))
        for row, direction in enumerate(_find_perpendiculars(up)):
            foot, head, seen = self._project_along(direction)
            reach = heads.per_reach * foot
            along = reach * self.along_top + self.body_m * head
            out[row] = (reach * self.seen + self.body_m * seen - heads.residual * along) / heads.depth
        out[2] = heads.per_height * (self.seen - heads.residual * self.along_top) / heads.depth
        return np.where(heads.sound, out, 0.0)

    def starts(self) -> list[tuple[float, Floats, float]]:
        """Return (cost, up direction, height) of all starts of the fit, the lowest cost first.

        A start is a pitch and a roll with 60 % of the feet or more below the horizon. Its height is the median, over the
        people, of the camera height that puts the head on its ray.
        """
        pitch, roll = (angle.ravel() for angle in np.meshgrid(_PITCHES, _ROLLS, indexing="ij"))
        ups = np.column_stack([np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch), -np.sin(pitch)])
        foot, _, across, down = (self.rows @ ups.T).reshape(4, -1, len(ups))
        use = -foot > HORIZON
        count = np.count_nonzero(use, axis=0)
        below = np.where(use, -foot, 1.0)
        along_across, along_down = self.seen[0][:, None] / below, self.seen[1][:, None] / below
        rise = along_across * across + along_down * down
        square = np.maximum(along_across**2 + along_down**2, 1e-12)
        of_each = self.foot_m[:, None] - rise * self.body_m[:, None] / square
        ascending = np.sort(np.where(use, of_each, np.inf), axis=0)
        columns = np.arange(len(ups))
        middle = ascending[np.maximum(count - 1, 0) // 2, columns], ascending[np.minimum(count // 2, len(foot) - 1), columns]
        heights = 0.5 * (middle[0] + middle[1])
        sound = (count >= 0.6 * len(foot)) & (heights > 0.2) & (heights < 200.0)
        found = [(self.cost(ups[k], float(heights[k])), ups[k], float(heights[k])) for k in np.flatnonzero(sound)]
        return sorted(found, key=lambda start: start[0])

    def cost(self, up: Floats, height: float) -> float:
        """Return the mean Cauchy cost of a level."""
        return self._heads(up, height).cost

    def refine(self, up: Floats, height: float) -> tuple[float, Floats, float]:
        """Refine a level by damped Gauss-Newton on (tilt about two axes, log height), reweighted for the Cauchy loss.

        Returns the cost, the up direction (3,) and the height.
        """
        heads, damping = self._heads(up, height), 1e-3
        cost = heads.cost
        for _ in range(30):
            weight = cauchy_weights(heads.squares)
            J = self.jacobian(up, heads)
            weighted = (J * weight).reshape(3, -1)
            H, g = weighted @ J.reshape(3, -1).T, weighted @ heads.residual.ravel()
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)) + 1e-12 * np.eye(3), g)
            moved = self._move(up, height, np.clip(step, -0.5, 0.5))
            there = self._heads(*moved)
            new = there.cost
            if new < cost:
                done = cost - new < 1e-7 * cost
                (up, height), heads, cost, damping = moved, there, new, damping * 0.2
                if done:
                    break
            else:
                damping *= 5.0
                if damping > 1e6:
                    break
        return cost, up, height

    @staticmethod
    def _move(up: Floats, height: float, step: Floats) -> tuple[Floats, float]:
        a, b = _find_perpendiculars(up)
        moved = up + step[0] * a + step[1] * b
        return moved / np.linalg.norm(moved), height * float(np.exp(step[2]))


def _find_perpendiculars(up: Floats) -> tuple[Floats, Floats]:
    """Return two directions (3,) at right angles to a unit vector and to each other."""
    x, y, z = up
    a = np.array([0.0, z, -y]) if abs(x) < 0.6 else np.array([y, -x, 0.0])
    a /= np.sqrt(a @ a)
    return a, np.array([y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]])
