"""Path of one camera: a pose and a focal length that may differ in a stretch of time, or change linearly between knots.

The path is fitted to the camera's observations of people with positions by the other cameras. The loss is Cauchy's, and
constant for observations that show another person.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import compute_cut_cauchy_cost, compute_cut_cauchy_weights, find_runs
from passerby.geometry.rotations import exp_rotation, log_rotation
from passerby.hypotheses.correspondences import Correspondences
from passerby.hypotheses.pair_residuals import PairColumns, PairResiduals, residuals_at
from passerby.people.resection import BEYOND, CENTRE_SD_M, LOSS, TURN_SD

TURN, SHIFT, FOCAL = slice(0, 3), slice(3, 6), slice(6, 7)
"""Columns of a change: a rotation vector in the camera's frame, the centre in the world, the logarithm of the focal length."""
MOVES, ZOOMS, TURNS = (0, 1, 2, 3, 4, 5), (6,), (0, 1, 2)
"""Columns that are free if a camera moves, zooms or turns."""
EVERY = (*MOVES, *ZOOMS)
WITH_CLOCK = (*EVERY, 7, 8)
"""Columns of a path's own unknowns: pose, focal length, and its clock's offset and rate."""
SIZE = 7
FOCAL_SD = 0.3
"""One standard deviation of the logarithm of a zoom, and of the error of a stated focal length, so that a wrong lens is not
taken for a motion."""
OFFSET_SD, RATE_SD = 1.0, 0.02
"""One standard deviation of a clock's offset, instants, and of its rate, so that a drifting clock is not taken for a motion. 25
for 24 frames per second is 0.04."""
PRIOR_SD = np.array([TURN_SD] * 3 + [CENTRE_SD_M] * 3 + [FOCAL_SD])
OWN_SD = np.array([*PRIOR_SD, OFFSET_SD, RATE_SD])
MOST_COST = 0.5 * float(compute_cut_cauchy_cost(np.array(BEYOND), LOSS, BEYOND))
"""Cost of an observation that shows another person, nats."""
STEPS, STEPS_WITHOUT = 12, 3
"""Largest number of steps of a fit, and of a fit without a fifth of the observations, which starts at the optimum of all."""
NEGLIGIBLE = 1e-4
"""A fit ends when the last step is predicted to lower the cost by less, nats: a hundredth of a standard deviation."""


@dataclass(frozen=True)
class Stretches:
    """Times in which a camera differs from the rest of the recording."""

    spans: tuple[tuple[float, float], ...]
    """First and last instant of each stretch, in order; minus infinity and infinity at the ends of the recording."""

    size = 1

    @classmethod
    def of(cls, instants: Ints | Floats, inside: Bools) -> Stretches:
        """Return the stretches of those of the instants (N,), in order, that are `inside` (N,)."""
        end = len(inside) - 1
        return cls(tuple(
            (-np.inf if first == 0 else float(instants[first]), np.inf if last == end else float(instants[last]))
            for first, last in find_runs(inside)
        ))  # fmt: skip

    @property
    def switches(self) -> int:
        """Number of times at which the camera changes."""
        return int(np.isfinite(self.spans).sum())

    def at(self, instants: Ints | Floats) -> Floats:
        """Return the basis (N, 1) at instants (N,): 1 inside a stretch, 0 outside."""
        inside = np.zeros(len(instants), dtype=bool)
        for first, last in self.spans:
            inside |= (instants >= first) & (instants <= last)
        return inside.astype(np.float64)[:, None]


NEVER = Stretches(())


@dataclass(frozen=True, eq=False)
class Knots:
    """Times between which a camera changes linearly; it has its mean pose where all of the basis is 0."""

    instant: Floats
    """(K + 1,) instants of the knots, ascending."""
    mean: Floats
    """(K + 1,) means of the hat functions over the observations."""

    @classmethod
    def even(cls, instants: Ints, pieces: int) -> Knots:
        """Divide the instants of the observations into pieces of equal length."""
        knots = cls(np.linspace(instants[0], instants[-1], pieces + 1), np.zeros(pieces + 1))
        return replace(knots, mean=knots._hats(instants).mean(axis=0))

    @property
    def size(self) -> int:
        """Number of functions in the basis: the hat functions add up to 1, so that one is determined by the others."""
        return len(self.instant) - 1

    def at(self, instants: Ints | Floats) -> Floats:
        """Return the basis (N, K) at instants (N,); it is constant before the first and after the last knot."""
        return np.asarray((self._hats(instants) - self.mean)[:, :-1])

    def _hats(self, instants: Ints | Floats) -> Floats:
        return np.column_stack([np.interp(instants, self.instant, row) for row in np.eye(len(self.instant))])


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A camera whose pose and focal length are functions of time."""

    pose: Pose
    """The camera's pose where the basis is 0."""
    log_focal: float = 0.0
    """Logarithm of the ratio of the focal length to that of the lens, where the basis is 0."""
    late: tuple[float, float] = (0.0, 0.0)
    """Offset of the camera's clock: it shows people of a later time by this, instants at `origin`, and instants an instant."""
    origin: float = 0.0
    """Instant to which `late` refers."""
    times: Stretches | Knots = NEVER
    change: Floats | None = None
    """(K, 7) coefficients of the basis: exp(turn) R_cw, centre + shift, focal length times exp(log_focal)."""

    @cached_property
    def coefficients(self) -> Floats:
        """(K, 7) `change`, or zeros."""
        return np.zeros((self.times.size, SIZE)) if self.change is None else self.change

    def changed(self, instants: Ints | Floats) -> Floats:
        """Return the change (N, 7) of the camera from its pose and focal length at instants (N,)."""
        return self.times.at(instants) @ self.coefficients

    def turns(self, instants: Ints | Floats) -> Floats | None:
        """Return the rotations (N, 3, 3) of the camera from its pose at instants (N,); None if it is never turned."""
        turn = self.coefficients[:, TURN]
        if not turn.any():
            return None
        amount = self.times.at(instants)
        if isinstance(self.times, Stretches):  # there are only two orientations
            return np.asarray(exp_rotation(np.vstack([np.zeros(3), turn]))[amount[:, 0].astype(np.int64)])
        return np.asarray(exp_rotation(amount @ turn))

    def constant(self, change: Floats) -> CameraPath:
        """Return a camera that has the pose and focal length of this one with a change (7,) all of the time."""
        pose = Pose.from_centre(exp_rotation(change[TURN]) @ self.pose.R_cw, self.pose.centre + change[SHIFT])
        return replace(self, pose=pose, log_focal=self.log_focal + float(change[6]), times=NEVER, change=None)

    def exchanged(self) -> CameraPath:
        """Exchange the camera of the stretch with that of the rest; the caller has to set `times` to the rest."""
        c = self.coefficients[0]
        back = -c
        return replace(self.constant(c), times=self.times, change=back[None])


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of K pairs along a path."""

    found: PairResiduals
    """Residuals in the frame of the path's own pose."""
    rotation: Floats | None
    """(K, 3, 3) rotations of the camera from this pose; None if it is never turned."""
    amount: Floats
    """(K, B) basis of the path."""
    velocity: Floats
    """(3, K) velocities of the people, metres an instant."""
    instant: NDArray[np.floating[Any]]
    """(K,) instants relative to the path's origin."""

    def take(self, pairs: Ints) -> Residuals:
        """Select the residuals of some of the pairs."""
        turned = None if self.rotation is None else self.rotation[pairs]
        return Residuals(self.found.take(pairs), turned, self.amount[pairs], self.velocity[:, pairs], self.instant[pairs])

    def by_change(self) -> tuple[Floats, Floats]:
        """Return the derivatives (2, 9, K) by the path's own unknowns, and (2, 7, K) by a change at the pair's time.

        A lens zoomed by f sees a point d of the camera's frame at the pixel where the lens sees `(f d_x, f d_y, d_z)`.
        """
        by_pose, R = self.found.by_pose(), self.rotation
        by_turn = by_pose[:, TURN]
        if R is None:
            by_focal = np.einsum("ajn,jn->an", self.found.by_at[:, :2], self.found.at[:2])[:, None]
        else:
            at = np.einsum("nij,jn->ni", R, self.found.at) * (1.0, 1.0, 0.0)
            by_focal = np.einsum("ajn,nij,ni->an", self.found.by_at, R, at, optimize=True)[:, None]
            by_turn = np.einsum("ajn,nij->ain", by_turn, R)
        by_late = np.einsum("ajn,jn->an", self.found.by_place, self.velocity)[:, None]
        own = np.concatenate([by_pose, by_focal, by_late, by_late * self.instant], axis=1)
        return own, np.concatenate([by_turn, by_pose[:, SHIFT], by_focal], axis=1)


def residuals_along(m: Correspondences, path: CameraPath) -> Residuals:
    """Compute the residuals of all pairs, each by the pose and focal length of its time."""
    own, amount = m.own, path.times.at(m.own.step)
    changed = amount @ path.coefficients
    focal = np.exp(path.log_focal + changed[:, 6])
    lengthened = np.column_stack([focal, focal, np.ones(len(focal))])
    ray = own.middle / lengthened
    length = np.linalg.norm(ray, axis=1)
    tangent = length[:, None, None] * own.middle_tangent * lengthened[:, None]
    grown = np.log(np.linalg.norm(tangent, axis=(1, 2)) / np.linalg.norm(own.middle_tangent, axis=(1, 2)))
    ray, R = ray / length[:, None], path.turns(own.step)
    if R is not None:
        ray, tangent = np.einsum("nji,nj->ni", R, ray), tangent @ R
    columns, row, late = m.columns, m.row, path.late[0] + path.late[1] * (own.step - path.origin)
    place = columns.place - changed[row, SHIFT].T + late[row] * m.velocity
    seen = PairColumns(
        ray.T[:, row], tangent.transpose(1, 2, 0)[:, :, row], place, columns.covariance,
        columns.variance, columns.size - grown[row],
    )  # fmt: skip
    turned = None if R is None else R[row]
    return Residuals(residuals_at(seen, path.pose), turned, amount[row], m.velocity, np.asarray(own.step[row] - path.origin))


def best_pairs(m: Correspondences, square: Floats) -> Ints:
    """Return, for each observation (M,), the pair with the person who fits best; of equal ones the first."""
    if len(m.row) == len(m):
        return np.arange(len(m))
    new = np.diff(m.row, prepend=-1) > 0
    least = np.minimum.reduceat(square, np.flatnonzero(new))
    number = np.cumsum(new) - 1
    best = np.flatnonzero(square == least[number])
    return np.asarray(best[np.diff(number[best], prepend=-1) > 0])


def costs_along(m: Correspondences, path: CameraPath) -> Floats:
    """Return the robust cost (M,) of each observation, nats, by the person who fits best."""
    square = residuals_along(m, path).found.square
    return 0.5 * compute_cut_cauchy_cost(square[best_pairs(m, square)], LOSS, BEYOND)


@dataclass(frozen=True, eq=False)
class Equations:
    """Contributions of M observations to the normal equations of a path's own pose and focal length."""

    gradient: Floats
    """(M, 7) gradient of the robust cost."""
    information: Floats
    """(M, 7, 7) information."""
    by_own: Floats
    """(M, 2, 7) derivatives of the residuals, pixels."""

    @classmethod
    def of(cls, m: Correspondences, path: CameraPath) -> Equations:
        """Compute the equations at a path."""
        all_pairs = residuals_along(m, path)
        best = all_pairs.take(best_pairs(m, all_pairs.found.square))
        J = best.by_change()[0][:, :SIZE]
        weighed = _weighed(best, J, 1.0)
        return cls(
            np.einsum("aun,an->nu", weighed, best.found.residual), np.einsum("aun,avn->nuv", weighed, J),
            J.transpose(2, 0, 1),
        )  # fmt: skip


def fit_path(
    m: Correspondences, start: CameraPath, parts: tuple[int, ...] = (), *, own: tuple[int, ...] = EVERY, widening: float = 1.0,
    steps: int = STEPS,
) -> CameraPath:  # fmt: skip
    """Fit a path to observations by Gauss-Newton with a robust loss, whose scale shrinks.

    Args:
        m: the camera's observations with the people of their instants.
        start: initial path; weak priors keep the pose near it, and the change near 0.
        parts: columns of the change that are free; the others stay as they are.
        own: columns of the path's own unknowns that are free.
        widening: initial scale of the loss, as a multiple of the usual one; it is halved at each step, down to 1.
        steps: largest number of steps.
    """
    fixed, free, K, path = np.array(own), np.array(parts, dtype=np.int64), start.times.size if parts else 0, start
    precision = np.concatenate([OWN_SD[fixed] ** -2.0, np.tile(PRIOR_SD[free] ** -2.0, K)])
    for step in range(steps):
        wide = max(1.0, widening / 2.0**step)
        every = residuals_along(m, path)
        at = every.take(best_pairs(m, every.found.square))
        here, there = at.by_change()
        changing = [at.amount[:, k] * there[:, free] for k in range(K)]
        J = np.ascontiguousarray(np.concatenate([here[:, fixed], *changing], axis=1))
        weighed = _weighed(at, J, wide)
        size = J.shape[1]
        normal = weighed.transpose(1, 0, 2).reshape(size, -1) @ J.transpose(1, 0, 2).reshape(size, -1).T
        gradient = np.einsum("aun,an->u", weighed, at.found.residual)
        turned = log_rotation(path.pose.R_cw @ start.pose.R_cw.T)
        away = np.concatenate([turned, path.pose.centre - start.pose.centre, [path.log_focal], path.late])[fixed]
        away = np.concatenate([away, path.coefficients[:K, free].ravel()])
        downhill = gradient + precision * away
        delta = -np.linalg.solve(normal + np.diag(precision), downhill)
        step_of_own = np.zeros(len(OWN_SD))
        step_of_own[fixed] = delta[: len(fixed)]
        path = _stepped(path, step_of_own, delta[len(fixed) :].reshape(K, len(free)), free)
        if wide == 1.0 and -0.5 * float(delta @ downhill) < NEGLIGIBLE:
            break
    return path


def _stepped(path: CameraPath, own: Floats, change: Floats, free: Ints) -> CameraPath:
    """Apply a step to a path."""
    pose = Pose.from_centre(exp_rotation(own[TURN]) @ path.pose.R_cw, path.pose.centre + own[SHIFT])
    coefficients = path.coefficients.copy()
    step = np.zeros_like(coefficients)
    step[: len(change), free] = change
    turn = log_rotation(exp_rotation(step[:, TURN]) @ exp_rotation(coefficients[:, TURN]))
    coefficients += step
    coefficients[:, TURN] = turn
    late = path.late[0] + float(own[7]), path.late[1] + float(own[8])
    return replace(path, pose=pose, log_focal=path.log_focal + float(own[6]), late=late, change=coefficients)


def _weighed(at: Residuals, J: Floats, wide: float) -> Floats:
    """Return derivatives (2, U, N) times information and robust weight; `wide` multiplies the usual scale of the loss."""
    across, both, down = compute_cut_cauchy_weights(at.found.square, LOSS * wide, BEYOND * wide**2) * at.found.information
    return np.array([across * J[0] + both * J[1], both * J[0] + down * J[1]])


def thinned(m: Correspondences, most: int) -> Correspondences:
    """Select about `most` pairs at most, by even steps of the observations."""
    step = int(np.ceil(len(m.row) / most))
    keep: Bools = np.arange(len(m)) % step == 0
    return m if step < 2 else m.part(keep)
