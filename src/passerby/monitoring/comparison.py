"""Comparison of a rig with another estimate of it, to find the cameras whose pose relative to the others has changed.

Two estimates of a rig are compared up to a similarity. The similarity and the cameras that have moved are found together: these
are the cameras without which all the rest fits, at the least cost. A camera that was turned usually stays in its place, so that
a turn costs three unknowns, and a full move six. If most cameras have been turned, their places still show which ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.special import chdtri

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.rotations import exp_rotation, fit_similarity, log_rotation
from passerby.monitoring.evidence import POWER, TAILS, MotionTest, limit_of, score_of
from passerby.solver.gauge import SCALE, TILT_X, similarity_moves

FEWEST_STRETCHES = 2
"""Least number of stretches of a camera; a camera with fewer is left out."""
MARGIN = 9.2
"""Difference of costs below which an explanation without a camera's move remains possible: twice the logarithm of a likelihood
ratio of 100."""
EXHAUSTIVE = 729
"""Number of explanations up to which all are tried: six cameras. For larger rigs the most likely ones are extended step by
step."""
BEAM = 40
"""Number of explanations of each size that are extended."""
ALIGNMENTS = 3
"""Number of times that the similarity is found again, since each time it is found to first order."""

BY_CHANCE, LEAST_SHARE = 0.05, 0.2
"""Probability that a rig's sigmas are reduced too much by chance, and the least share of them that is used: 1 cm and 0.06
degrees in each direction if none are stated."""

RIDGE = 1e-10
"""Added to unit diagonals: it fixes undetermined unknowns, such as those of too many free cameras."""

STILL, TURNED, MOVED = 0, 1, 2
_FREED = {STILL: np.zeros(0, np.int64), TURNED: np.arange(3, 6), MOVED: np.arange(6)}
"""The free ones of a camera's six unknowns: centre, then rotation vector."""

Explanation = tuple[int, ...]
"""The state of each camera: `STILL`, `TURNED` or `MOVED`."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Poses of C of a rig's cameras by footage, up to a similarity."""

    cameras: Ints
    """(C,) indices of the cameras in the rig."""
    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    covariance: Floats
    """(6 C, 6 C) covariance after the best similarity: centre, then rotation vector in the camera's frame."""
    stretches: Ints
    """(C,) number of stretches (one person over some seconds) of each camera."""


@dataclass(frozen=True, eq=False)
class Displacement:
    """A camera that moved."""

    camera: int
    score: float
    others: tuple[int, ...]
    """Cameras that may have moved instead."""
    pose: Pose
    """The new pose, relative to the poses of the others in the rig."""
    pose_covariance: Floats
    """(6, 6) covariance of the new pose, from the footage and the poses of the others."""
    shift: Floats
    """(6,) change from the earlier pose."""
    covariance: Floats
    """(6, 6) covariance of `shift`."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Result of a comparison."""

    tests: tuple[MotionTest, ...]
    """Test of each camera of the rig."""
    moved: tuple[Displacement, ...]
    shift: Floats
    """(6 C,) changes of all cameras from their poses in the rig, after the best similarity of those at rest."""
    information: Floats
    """(6 C, 6 C) information on `shift`; 0 along similarities and for cameras that were left out."""


def compare(
    R: Floats, centre: Floats, before: tuple[Floats, Floats], estimate: Estimate, threshold: float
) -> Comparison:  # fmt: skip
    """Compare a rig with an estimate.

    Args:
        R: (C, 3, 3) the rig's rotations, world to camera.
        centre: (C, 3) the rig's centres, metres.
        before: (6 C,) changes of the cameras so far, relative to the rig's poses, and their covariance (6 C, 6 C).
        estimate: estimate of two or more of its cameras.
        threshold: score from which a camera has moved.
    """
    fit = _Fit(R[estimate.cameras], centre[estimate.cameras], before, estimate, threshold)
    best = (STILL,) * len(estimate.cameras)
    for _ in range(ALIGNMENTS):
        fit.align(best)
        costs = fit.explanations()
        found = min(costs, key=lambda one: (costs[one], one))
        if found == best:
            break
        best = found
    every = np.arange(len(R))
    own = (estimate.cameras[:, None] * 6 + np.arange(6)).ravel()
    shift, information = np.zeros(6 * len(R)), np.zeros((6 * len(R), 6 * len(R)))
    shift[own], information[np.ix_(own, own)] = fit.difference, fit.shape_information()
    tests = {int(camera): fit.test(best, k) for k, camera in enumerate(estimate.cameras)}
    moved = [fit.displacement(best, k, tests[int(c)].score, costs) for k, c in enumerate(estimate.cameras) if best[k] != STILL]
    return Comparison(
        tuple(tests.get(int(c)) or untestable(int(c)) for c in every), tuple(moved), shift, information
    )  # fmt: skip


def sigma_share(centre: Floats, covariance: Floats, estimate: Estimate) -> float:
    """Return an upper limit of a rig's errors, as a share of its sigmas, by the fit of its cameras' places to an estimate.

    Stated sigmas include the common errors of all cameras, scale and vertical, which a similarity removes. If none are stated,
    wide ones are assumed. Cameras that are turned stay in their places, and a rig with accurate places has accurate rotations.
    So the misfit of the places measures the rig: the share is the largest at which such a small misfit has a probability of at
    least `BY_CHANCE`.

    Args:
        centre: (C, 3) centres of the rig's cameras, metres.
        covariance: (6 C, 6 C) covariance of their poses, by the whole sigmas.
        estimate: estimate of some of them; with fewer than three the share is 1.
    """
    n = len(estimate.cameras)
    if n < 3:
        return 1.0
    own = centre[estimate.cameras]
    placed = fit_similarity(estimate.centre, own)
    places = (6 * np.arange(n)[:, None] + np.arange(3)).ravel()
    carry = np.kron(np.eye(n), placed.scale * placed.rotation)
    rows = (6 * estimate.cameras[:, None] + np.arange(3)).ravel()
    both = carry @ estimate.covariance[np.ix_(places, places)] @ carry.T + covariance[np.ix_(rows, rows)]
    moves = similarity_moves(np.tile(np.eye(3), (n, 1, 1)), own, own.mean(axis=0))[:, :3].reshape(-1, 7)
    widest = np.trace(both) / np.einsum("ij,ij->j", moves, moves)
    off = (placed.apply(estimate.centre) - own).ravel()
    weight = np.linalg.inv(both + (moves * widest) @ moves.T)
    along = weight @ moves
    misfit = float(off @ weight @ off - off @ along @ np.linalg.solve(moves.T @ along, along.T @ off))
    return float(np.clip(np.sqrt(max(misfit, 0.0) / chdtri(3 * n - 7, 1 - BY_CHANCE)), LEAST_SHARE, 1.0))


def untestable(camera: int) -> MotionTest:
    """Return the test of a camera without evidence."""
    return MotionTest(camera, 0.0, 0, np.zeros(6), (np.inf, np.inf), (np.inf, np.inf))


class _Fit:
    """The differences of C cameras, and the fits of explanations to them."""

    def __init__(self, R: Floats, centre: Floats, before: tuple[Floats, Floats], estimate: Estimate, threshold: float) -> None:
        self.R, self.centre, self.estimate, self.threshold = R, centre, estimate, threshold
        own = (estimate.cameras[:, None] * 6 + np.arange(6)).ravel()
        self.before, self.before_covariance = before[0][own], before[1][np.ix_(own, own)]
        self.about = centre.mean(axis=0)
        self.moves = similarity_moves(R, centre, self.about).reshape(-1, 7)
        self.seen_R, self.seen_centre, self.seen_covariance = estimate.R, estimate.centre, estimate.covariance
        self.freedom = TAILS * estimate.stretches / self._share() ** 2
        self._prepare()

    def _share(self) -> Floats:
        """Return the share (C,) of the footage in the variance of each camera's difference, the mean over its six directions.

        A few stretches of people have longer tails than a normal variable, also if the noise is well known; the earlier
        knowledge has not. The degrees of freedom of the sum of both grow with the square of the share's inverse (Satterthwaite
        1946, *Biometrics Bulletin* 2).
        """
        at = [slice(6 * k, 6 * k + 6) for k in range(len(self.R))]
        whole = self.seen_covariance + self.before_covariance
        return np.array([np.trace(np.linalg.solve(whole[own, own], self.seen_covariance[own, own])) / 6 for own in at])

    def _prepare(self) -> None:
        """Compute the differences and the normal equations for the present alignment of the estimate."""
        turned = [log_rotation(seen @ own.T) for seen, own in zip(self.seen_R, self.R, strict=True)]
        self.difference: Floats = np.column_stack([self.seen_centre - self.centre, turned]).ravel()
        covariance = self.seen_covariance + self.before_covariance
        # The covariance is not defined along similarities: a wide variance leaves them free.
        widest = np.trace(covariance) / np.einsum("ij,ij->j", self.moves, self.moves)
        self.weight = np.linalg.inv(covariance + (self.moves * widest) @ self.moves.T)
        design = np.concatenate([self.moves, np.eye(len(self.moves))], axis=1)
        self.normal = design.T @ self.weight @ design
        self.right = design.T @ self.weight @ (self.difference - self.before)
        self.total = float((self.difference - self.before) @ self.weight @ (self.difference - self.before))

    def align(self, explanation: Explanation) -> None:
        """Align the estimate with the rig's cameras that did not move."""
        for _ in range(ALIGNMENTS):
            step = self._solve_unknowns(self._columns(explanation))[:7]
            turn, scale = exp_rotation(step[TILT_X:SCALE]), float(np.exp(step[SCALE]))
            self.seen_centre = self.about + (self.seen_centre - self.about - step[:TILT_X]) @ turn / scale
            self.seen_R = self.seen_R @ turn
            carried = np.eye(6)
            carried[:3, :3] = turn.T / scale
            carry = np.kron(np.eye(len(self.R)), carried)
            self.seen_covariance = carry @ self.seen_covariance @ carry.T
            self._prepare()

    def _columns(self, explanation: Explanation) -> Ints:
        """Return the indices of an explanation's unknowns: seven of the similarity, and the free ones of the cameras."""
        return np.concatenate([np.arange(7), *(7 + 6 * k + _FREED[what] for k, what in enumerate(explanation))])

    def _solve_unknowns(self, columns: Ints) -> Floats:
        """Solve for the unknowns that fit best; undetermined ones get the smallest values."""
        normal = self.normal[np.ix_(columns, columns)]
        unit = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        whole = normal * unit[:, None] * unit + RIDGE * np.eye(len(columns))
        return np.asarray(unit * np.linalg.solve(whole, unit * self.right[columns]))

    def misfit(self, explanation: Explanation) -> float:
        """Return the squared residual of an explanation."""
        columns = self._columns(explanation)
        return self.total - float(self.right[columns] @ self._solve_unknowns(columns))

    def _limit(self, k: int, what: int) -> float:
        """Return the least gain at which a camera is taken as turned or moved; 0 for a camera at rest."""
        return limit_of(self.threshold, float(self.freedom[k]), len(_FREED[what])) if what else 0.0

    def explanations(self) -> dict[Explanation, float]:
        """Return explanations and their costs: the squared residual, plus the least gain of each freed camera."""
        n = len(self.R)
        limit = [[self._limit(k, what) for what in (STILL, TURNED, MOVED)] for k in range(n)]

        def cost(one: Explanation) -> float:
            return self.misfit(one) + sum(limit[k][what] for k, what in enumerate(one))

        if 3**n <= EXHAUSTIVE:
            return {one: cost(one) for one in product((STILL, TURNED, MOVED), repeat=n)}
        best = (STILL,) * n
        costs, last = {best: cost(best)}, [best]
        while last:
            grown = {
                (*one[:k], what, *one[k + 1 :]) for one in last for k in range(n) if not one[k] for what in (TURNED, MOVED)
            }
            least = min(costs.values())
            costs |= (fresh := {one: cost(one) for one in sorted(grown)})
            last = sorted(fresh, key=lambda one: (fresh[one], one))[:BEAM]
            if not fresh or min(fresh.values()) > least + MARGIN:
                break
        return costs

    def shape_information(self) -> Floats:
        """Return the information (6 C, 6 C) of the estimate alone, without similarities."""
        widest = np.trace(self.seen_covariance) / np.einsum("ij,ij->j", self.moves, self.moves)
        weight = np.linalg.inv(self.seen_covariance + (self.moves * widest) @ self.moves.T + 1e-12 * np.eye(len(self.moves)))
        along = weight @ self.moves
        return np.asarray(weight - along @ np.linalg.solve(self.moves.T @ along, along.T))

    def test(self, best: Explanation, k: int) -> MotionTest:
        """Test one camera, with the others as in the best explanation."""
        camera, stretches = int(self.estimate.cameras[k]), int(self.estimate.stretches[k])
        still, turned, moved = (self.misfit((*best[:k], what, *best[k + 1 :])) for what in (STILL, TURNED, MOVED))
        freedom = float(self.freedom[k])
        score = max(score_of(max(still - turned, 0.0), freedom, 3), score_of(max(still - moved, 0.0), freedom, 6))
        columns = self._columns((*best[:k], STILL, *best[k + 1 :]))
        own = 7 + 6 * k + np.arange(6)
        inverse = np.linalg.pinv(self.normal[np.ix_(columns, columns)], rcond=1e-12, hermitian=True)
        cross = self.normal[np.ix_(own, columns)]
        power = self.normal[np.ix_(own, own)] - cross @ inverse @ cross.T
        found = self._solve_unknowns(self._columns((*best[:k], MOVED, *best[k + 1 :])))
        at = 7 + sum(len(_FREED[what]) for what in best[:k])
        metres = self._find_detection_limit(power[:3, :3], k, MOVED)
        radians = self._find_detection_limit(power[3:, 3:], k, TURNED)
        degrees = float(np.degrees(radians[0])), float(np.degrees(radians[1]))
        return MotionTest(camera, score, stretches, found[at : at + 6], metres, degrees)

    def _find_detection_limit(self, power: Floats, k: int, what: int) -> tuple[float, float]:
        """Return the change noticed in 95 % of the cases along the middle one of three directions, and along the worst one."""
        needed = (np.sqrt(self._limit(k, what)) + POWER) ** 2
        values = np.linalg.eigvalsh(power)
        floor = 1e-9 * max(values[-1], 1e-300)
        worst, middle = (float(np.sqrt(needed / value)) if value > floor else np.inf for value in values[:2])
        return middle, worst

    def displacement(self, best: Explanation, k: int, score: float, costs: dict[Explanation, float]) -> Displacement:
        """Return the displacement of a camera, and the cameras that may have moved instead."""
        least = costs[best]
        without = {one: cost for one, cost in costs.items() if one[k] == STILL and cost < least + MARGIN}
        rivals = sorted(
            {int(self.estimate.cameras[j]) for one in without for j, what in enumerate(one) if what and not best[j]}
        )
        # The place of a turned camera helps to align the others, but its own displacement is estimated with a free place.
        free = (*best[:k], MOVED, *best[k + 1 :])
        columns = self._columns(free)
        at = 7 + sum(len(_FREED[what]) for what in best[:k])
        design = np.concatenate([self.moves, np.eye(len(self.moves))], axis=1)[:, columns]
        inverse = np.linalg.pinv(self.normal[np.ix_(columns, columns)], rcond=1e-12, hermitian=True)
        operator = (inverse @ design.T @ self.weight)[at : at + 6]
        shift = operator @ (self.difference - self.before)
        covariance = operator @ (self.seen_covariance + self.before_covariance) @ operator.T
        own = 6 * k + np.arange(6)
        others = self.before_covariance.copy()
        others[own], others[:, own] = 0.0, 0.0
        new = shift + self.before[own]
        pose = Pose.from_centre(exp_rotation(new[3:]) @ self.R[k], self.centre[k] + new[:3])
        return Displacement(
            int(self.estimate.cameras[k]), score, tuple(rivals), pose,
            operator @ (self.seen_covariance + others) @ operator.T, shift, covariance,
        )  # fmt: skip
