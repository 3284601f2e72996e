"""The vertical, the camera's height and the ground plane from the people in one camera's view.

People are upright, stand on one plane and are about equally tall. In the camera's frame the ground is given by the up
direction n and the camera's height H: the foot ray b meets it at `H b / -(n . b)`; raised along n by a person's height, it
must project onto the box's top. Three unknowns, two residuals a box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats
from passerby.geometry.groups import cauchy_weights
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
    residual_90: float = 0.0
    """The misfit that 90 % of the bodies do not exceed."""

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
    starts = fit.starts()
    if not starts:
        return None
    best = min((fit.refine(up, height) for _, up, height in starts[:4]), key=lambda found: found[0])
    return fit.level(*best[1:])


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
    starts = fit.starts() if start is None else [(0.0, start.up, start.height)]
    if not starts:
        return None
    _, up, height = min((fit.refine(up, height) for _, up, height in starts[:4]), key=lambda found: found[0])
    return fit.level(up, height)


def keep_horizon(up: Floats, longer: float) -> Floats:
    """The up direction that keeps the horizon's line in the picture when the focal length grows by a factor."""
    moved = up * np.array([longer, longer, 1.0])
    return np.asarray(moved / np.linalg.norm(moved))


@dataclass(frozen=True, eq=False)
class _Heads:
    """Where N heads are predicted by a level."""

    residual: Floats
    """(2, N) misfit, shares of the extent; large for feet above the horizon."""
    sound: Bools
    """(N,) whose feet are below it."""
    per_reach: Floats
    """(N,) by how much the foot is farther off as its ray falls less steeply, metres,"""
    per_height: Floats
    """(N,) and as the camera is higher: for its logarithm, metres."""
    depth: Floats
    """(N,) of the head along its ray, metres."""

    @property
    def squares(self) -> Floats:
        """(N,) of the residuals, in units of the loss's scale."""
        return np.asarray((self.residual[0] ** 2 + self.residual[1] ** 2) / _SHARE**2)

    @property
    def cost(self) -> float:
        """Mean Cauchy cost."""
        return float(np.log1p(self.squares).mean())


class _Fit:
    """Residuals of one camera's people, as shares of their extent; `upright` leaves those across the picture out.

    All is linear in the rays, so that what tilts change are a few columns: products of each ray with each direction.
    """

    def __init__(
        self, top: Floats, bottom: Floats, tangent: Floats, body_m: Floats, foot_m: Floats, *, upright: bool = False
    ) -> None:
        self.body_m, self.foot_m = body_m, foot_m
        across, down = tangent[:, 0], tangent[:, 1]
        if upright:
            across = np.zeros_like(across)
        self.rows = np.concatenate([bottom, top, across, down])
        # Of the foot's ray: its square, along the head's ray, and in shares of the extent.
        self.square, self.along_top = np.einsum("ni,ni->n", bottom, bottom), np.einsum("ni,ni->n", top, bottom)
        self.seen = np.array([np.einsum("ni,ni->n", across, bottom), np.einsum("ni,ni->n", down, bottom)])

    def _project_along(self, direction: Floats) -> tuple[Floats, Floats, Floats]:
        """(N,) the foot's and (N,) the head's ray along a direction, and (2, N) the direction in shares of the extent."""
        foot, head, *seen = (self.rows @ direction).reshape(4, -1)
        return foot, head, np.array(seen)

    def level(self, up: Floats, height: float) -> Level:
        """The level with its misfits."""
        misfit = np.linalg.norm(self.residual(up, height), axis=1)
        return Level(up, height, float(np.median(misfit)), float(np.quantile(misfit, 0.9)))

    def residual(self, up: Floats, height: float) -> Floats:
        """(N, 2) misfit of the predicted highest points; large for feet above the horizon."""
        return self._heads(up, height).residual.T

    def _heads(self, up: Floats, height: float) -> _Heads:
        """The heads above the feet: the foot's ray goes down to the foot, and the body stands on it."""
        foot, head, seen = self._project_along(up)
        below = np.maximum(-foot, HORIZON)
        reach = (height - self.foot_m) / below
        far = np.sqrt(np.maximum(reach * (reach * self.square + 2 * self.body_m * foot) + self.body_m**2, 0.0))
        depth = np.maximum(reach * self.along_top + self.body_m * head, 0.05 * far + 1e-9)
        sound = -foot > HORIZON
        residual = np.where(sound, (reach * self.seen + self.body_m * seen) / depth, 3.0)
        return _Heads(residual, sound, reach / below, height / below, depth)

    def jacobian(self, up: Floats, heads: _Heads) -> Floats:
        """(3, 2, N) derivative of the residual by the steps of `_move`; 0 for feet above the horizon."""
        out = np.empty((3, *heads.residual.shape))
        for row, direction in enumerate(_find_perpendiculars(up)):
            foot, head, seen = self._project_along(direction)
            reach = heads.per_reach * foot
            along = reach * self.along_top + self.body_m * head
            out[row] = (reach * self.seen + self.body_m * seen - heads.residual * along) / heads.depth
        out[2] = heads.per_height * (self.seen - heads.residual * self.along_top) / heads.depth
        return np.where(heads.sound, out, 0.0)

    def starts(self) -> list[tuple[float, Floats, float]]:
        """Costs, up directions and heights to begin with, the lowest cost first: of all pitches and rolls those that have most
        feet below the horizon, each with the median over the people of the camera height that puts the head on its ray.
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
        """Mean Cauchy cost."""
        return self._heads(up, height).cost

    def refine(self, up: Floats, height: float) -> tuple[float, Floats, float]:
        """Damped Gauss-Newton on (tilt about two axes, log height), reweighted for the Cauchy loss."""
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
    """Two directions (3,) at right angles to a unit vector and to each other."""
    x, y, z = up
    a = np.array([0.0, z, -y]) if abs(x) < 0.6 else np.array([y, -x, 0.0])
    a /= np.sqrt(a @ a)
    return a, np.array([y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]])
