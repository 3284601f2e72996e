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
# Number of starts that are refined.
_REFINED = 4


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
    return fit.best(starts) if starts else None


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
    starts = fit.starts() if start is None else [(start.up, start.height)]
    return fit.best(starts) if starts else None


def keep_horizon(up: Floats, longer: float) -> Floats:
    """Return the up direction (3,) that keeps the horizon's line in the image when the focal length grows by a factor."""
    moved = up * np.array([longer, longer, 1.0])
    return np.asarray(moved / np.linalg.norm(moved))


@dataclass(frozen=True, eq=False)
class _Heads:
    """Residuals of N heads as predicted by K levels, and values for their derivatives."""

    residual: Floats
    """(K, 2, N) residuals, as shares of the extent; large for feet above the horizon."""
    sound: Bools
    """(K, N) whether the foot is below the horizon."""
    per_reach: Floats
    """(K, N) derivative of the foot's distance by the component of its ray along the up direction, metres."""
    per_height: Floats
    """(K, N) derivative of the foot's distance by the logarithm of the camera's height, metres."""
    depth: Floats
    """(K, N) depth of the head along its ray, metres."""

    @property
    def squares(self) -> Floats:
        """(K, N) squared lengths of the residuals, in units of the loss's scale."""
        return np.asarray((self.residual[:, 0] ** 2 + self.residual[:, 1] ** 2) / _SHARE**2)

    @property
    def costs(self) -> Floats:
        """(K,) mean Cauchy cost of the people."""
        return np.asarray(np.log1p(self.squares).mean(axis=1))

    def replaced(self, other: _Heads, by_other: Bools) -> _Heads:
        """Return the values of another object where `by_other` (K,) is true, and those of this one elsewhere."""
        of_both = ((own, getattr(other, name)) for name, own in vars(self).items())
        return _Heads(*(np.where(by_other.reshape(-1, *[1] * (own.ndim - 1)), there, own) for own, there in of_both))

    def take(self, levels: Bools) -> _Heads:
        """Select some of the levels."""
        return _Heads(*(own[levels] for own in vars(self).values()))


class _Fit:
    """Residuals of one camera's people, as shares of their extent; `upright` leaves out the horizontal component.

    Several levels are computed at once. All terms are linear in the rays: for a tilt, only the products of each ray with the
    new direction are computed again.
    """

    def __init__(
        self, top: Floats, bottom: Floats, tangent: Floats, body_m: Floats, foot_m: Floats, *, upright: bool = False
    ) -> None:
        self.body_m, self.foot_m = body_m, foot_m
        across, down = tangent[:, 0], tangent[:, 1]
        if upright:
            across = np.zeros_like(across)
        self.columns = np.concatenate([bottom, top, across, down]).T
        # The foot's ray: its squared length, its component along the head's ray, and its image in shares of the extent.
        self.square, self.along_top = np.einsum("ni,ni->n", bottom, bottom), np.einsum("ni,ni->n", top, bottom)
        self.seen = np.array([np.einsum("ni,ni->n", across, bottom), np.einsum("ni,ni->n", down, bottom)])

    def _project_along(self, directions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the foot's and the head's ray (K, N) along directions (K, 3), and their images (K, 2, N), as shares."""
        along = (directions @ self.columns).reshape(len(directions), 4, -1)
        return along[:, 0], along[:, 1], along[:, 2:]

    def best(self, starts: list[tuple[Floats, float]]) -> Level:
        """Refine starts (up direction, height), and return the level of the least cost."""
        cost, ups, heights = self.refine(np.array([up for up, _ in starts]), np.array([height for _, height in starts]))
        best = int(np.argmin(cost))
        misfit = np.linalg.norm(self._heads(ups[[best]], heights[[best]]).residual[0], axis=0)
        return Level(ups[best], float(heights[best]), float(np.median(misfit)), float(np.quantile(misfit, 0.9)))

    def _heads(self, ups: Floats, heights: Floats) -> _Heads:
        """Predict the heads by K levels: the foot's ray is followed to the foot, and the body stands upright on it."""
        foot, head, seen = self._project_along(ups)
        below = np.maximum(-foot, HORIZON)
        height = heights[:, None]
        reach = (height - self.foot_m) / below
        far = np.sqrt(np.maximum(reach * (reach * self.square + 2 * self.body_m * foot) + self.body_m**2, 0.0))
        depth = np.maximum(reach * self.along_top + self.body_m * head, 0.05 * far + 1e-9)
        sound = -foot > HORIZON
        residual = np.where(sound[:, None], (reach[:, None] * self.seen + self.body_m * seen) / depth[:, None], 3.0)
        return _Heads(residual, sound, reach / below, height / below, depth)

    def jacobian(self, ups: Floats, heads: _Heads) -> Floats:
        """Return the derivatives (K, 3, 2, N) of the residuals by the steps of `_move`; 0 for feet above the horizon."""
        k, _, n = heads.residual.shape
        out = np.empty((k, 3, 2, n))
        for row, directions in enumerate(_find_perpendiculars(ups)):
            foot, head, seen = self._project_along(directions)
            reach = heads.per_reach * foot
            along = reach * self.along_top + self.body_m * head
            out[:, row] = reach[:, None] * self.seen + self.body_m * seen - heads.residual * along[:, None]
        out[:, 2] = heads.per_height[:, None] * (self.seen - heads.residual * self.along_top)
        return np.where(heads.sound[:, None, None], out / heads.depth[:, None, None], 0.0)

    def starts(self) -> list[tuple[Floats, float]]:
        """Return up direction and height of the best starts of the fit, the lowest cost first.

        A start is a pitch and a roll with 60 % of the feet or more below the horizon. Its height is the median, over the
        people, of the camera height that puts the head on its ray.
        """
        pitch, roll = (angle.ravel() for angle in np.meshgrid(_PITCHES, _ROLLS, indexing="ij"))
        ups = np.column_stack([np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch), -np.sin(pitch)])
        foot, _, image = self._project_along(ups)
        use = -foot > HORIZON
        count = np.count_nonzero(use, axis=1)
        along = self.seen / np.where(use, -foot, 1.0)[:, None]
        rise = (along * image).sum(axis=1)
        square = np.maximum((along**2).sum(axis=1), 1e-12)
        ascending = np.sort(np.where(use, self.foot_m - rise * self.body_m / square, np.inf), axis=1)
        rows = np.arange(len(ups))
        heights = 0.5 * (
            ascending[rows, np.maximum(count - 1, 0) // 2] + ascending[rows, np.minimum(count // 2, foot.shape[1] - 1)]
        )
        sound = np.flatnonzero((count >= 0.6 * foot.shape[1]) & (heights > 0.2) & (heights < 200.0))
        if not len(sound):
            return []
        order = sound[np.argsort(self._heads(ups[sound], heights[sound]).costs, kind="stable")]
        return [(ups[k], float(heights[k])) for k in order[:_REFINED]]

    def refine(self, ups: Floats, heights: Floats) -> tuple[Floats, Floats, Floats]:
        """Refine K levels by damped Gauss-Newton on (tilt about two axes, log height), reweighted for the Cauchy loss.

        Returns the costs (K,), the up directions (K, 3) and the heights (K,).
        """
        ups, heights, heads = ups.copy(), heights.copy(), self._heads(ups, heights)
        costs, damping, active = heads.costs, np.full(len(ups), 1e-3), np.arange(len(ups))
        for _ in range(30):
            J = self.jacobian(ups[active], heads)
            weighted = (J * cauchy_weights(heads.squares)[:, None, None]).reshape(len(active), 3, -1)
            H = weighted @ J.reshape(len(active), 3, -1).transpose(0, 2, 1)
            g = weighted @ heads.residual.reshape(len(active), -1, 1)
            damped = H * (1.0 + damping[active, None, None] * np.eye(3)) + 1e-12 * np.eye(3)
            step = -np.linalg.solve(damped, g)[:, :, 0]
            moved = self._move(ups[active], heights[active], np.clip(step, -0.5, 0.5))
            there = self._heads(*moved)
            new, old = there.costs, costs[active]
            better = new < old
            heads = heads.replaced(there, better)
            ups[active[better]], heights[active[better]], costs[active[better]] = (
                moved[0][better],
                moved[1][better],
                new[better],
            )
            damping[active] *= np.where(better, 0.2, 5.0)
            on = np.where(better, old - new >= 1e-7 * old, damping[active] <= 1e6)
            if not on.any():
                break
            active, heads = active[on], heads.take(on)
        return costs, ups, heights

    @staticmethod
    def _move(ups: Floats, heights: Floats, step: Floats) -> tuple[Floats, Floats]:
        a, b = _find_perpendiculars(ups)
        moved = ups + step[:, :1] * a + step[:, 1:2] * b
        return moved / np.linalg.norm(moved, axis=1, keepdims=True), heights * np.exp(step[:, 2])


def _find_perpendiculars(ups: Floats) -> tuple[Floats, Floats]:
    """Return two directions (K, 3) at right angles to unit vectors (K, 3) and to each other."""
    x, y, z = ups.T
    zero = np.zeros(len(ups))
    a = np.where(np.abs(x) < 0.6, (zero, z, -y), (y, -x, zero))
    a /= np.sqrt((a**2).sum(axis=0))
    b = y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]
    return a.T, np.array(b).T
