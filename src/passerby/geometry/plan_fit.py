"""Fit of a rig, seen from above, to a plan: the similarity, its sigmas, and placements that contradict the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints

LEAST_PROBABLE = 1e-3
"""Residuals whose probability, from their sigmas, is lower than this contradict each other."""
SURE = 6.0
"""Margin in units of chi-squared (odds of 20 to 1). A placement is left out only where leaving out any other placement instead
explains the residuals worse by this margin."""
RIG_SHARE = 0.003
"""One sigma of a placement due to the error of the rig's own shape, as a share of the extent of all placements."""
HEIGHT_SD_M = 0.02
"""One sigma of the ground's height at a point, metres: the ground that people walk on is flat to centimetres."""

UNKNOWN_SD = 1.0
"""Standard deviation of the logarithm of an unknown scale."""


@dataclass(frozen=True, eq=False)
class Placements:
    """M places, each from a camera's own position or from one camera's ray to the ground.

    Several rows may show one placement.
    """

    target: Floats
    """(M, 2) coordinates on the plan, metres."""
    place: Floats
    """(M, 2) coordinates in the rig's world, metres; NaN where a ray does not meet the ground."""
    group: Ints
    """(M,) rows with the same number show the same placement."""
    target_sd: Floats
    """(M,) standard deviation of the plan's coordinates, metres; one value per placement."""
    covariance: Floats
    """(M, 2, 2) covariance of the place due to the click in the image, square metres."""
    along: Floats
    """(M, 2) derivative of the place by the height of the ground there; 0 for a camera's own position."""
    rig_sd: Floats | None = None
    """(M,) standard deviation of each coordinate due to the rig, metres; None for a share of the extent (`RIG_SHARE`)."""

    @property
    def sound(self) -> Bools:
        """(M,) whether the place is known."""
        return np.asarray(np.isfinite(self.place).all(axis=1))

    @property
    def scale(self) -> float:
        """Approximate ratio of lengths in the rig to lengths on the plan; robust against a minority of wrong placements."""
        rows = np.flatnonzero(self.sound)
        first, second = rows[np.array(np.triu_indices(len(rows), 1))]
        stated, measured = (np.linalg.norm(xy[first] - xy[second], axis=1) for xy in (self.target, self.place))
        apart = (stated > 0) & (measured > 0)
        return float(np.exp(np.median(np.log(measured[apart] / stated[apart])))) if apart.any() else 1.0

    def mirrored(self) -> Self:
        """Return the same placements on the plan's mirror image."""
        return replace(self, target=self.target * (1.0, -1.0))

    def take(self, rows: Bools | Ints) -> Self:
        """Return the placements of these rows."""
        return replace(
            self, target=self.target[rows], place=self.place[rows], group=self.group[rows], target_sd=self.target_sd[rows],
            covariance=self.covariance[rows], along=self.along[rows],
            rig_sd=None if self.rig_sd is None else self.rig_sd[rows],
        )  # fmt: skip

    def weights(self) -> Floats:
        """Return the inverse (2 M, 2 M) of the covariance of all places; rows of one placement share some of their errors."""
        n, scale = len(self.place), self.scale
        extent = scale * float(np.ptp(self.target, axis=0).max()) if n else 0.0
        rig_sd = np.full(n, RIG_SHARE * extent) if self.rig_sd is None else self.rig_sd
        whole = np.zeros((2 * n, 2 * n))
        for i in range(n):
            whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = self.covariance[i] + rig_sd[i] ** 2 * np.eye(2)
        for number in np.unique(self.group):
            rows = np.flatnonzero(self.group == number)
            both = np.column_stack([2 * rows, 2 * rows + 1]).ravel()
            up = HEIGHT_SD_M * self.along[rows].ravel()
            common = np.outer(up, up) + (scale * float(self.target_sd[rows[0]])) ** 2 * np.tile(
                np.eye(2), (len(rows), len(rows))
            )
            whole[np.ix_(both, both)] += common
        return np.asarray(np.linalg.inv(whole))


@dataclass(frozen=True, eq=False)
class PlanFit:
    """The similarity `place = R(yaw) scale target + shift`, by least squares."""

    scale: float
    """Ratio of lengths in the rig to lengths on the plan."""
    yaw: float
    """Rotation from the plan to the rig, radians."""
    shift: Floats
    """(2,) translation, metres of the rig."""
    scale_sd: float
    """Standard deviation of the scale's logarithm, without the uncertainty of the plan's unit."""
    yaw_sd: float
    """Standard deviation of the yaw, radians."""
    shift_sd: float
    """Standard deviation of the middle of the placements, per coordinate, metres."""
    chi_squared: float
    freedom: int
    by_place: Floats
    """(2, 2 M) scale times (cosine, sine) of the yaw as a linear function of the places."""

    @property
    def factor(self) -> float:
        """Ratio of the residuals to their sigmas (square root of chi-squared per degree of freedom), at least 1."""
        return float(np.sqrt(max(1.0, self.chi_squared / self.freedom))) if self.freedom > 0 else 1.0

    def on_plan(self, places: Floats) -> Floats:
        """Map places (N, 2) of the rig to the plan, metres."""
        turn = np.array([[np.cos(self.yaw), -np.sin(self.yaw)], [np.sin(self.yaw), np.cos(self.yaw)]])
        return np.asarray((np.asarray(places) - self.shift) @ turn / self.scale)


def fit_plan(placements: Placements) -> PlanFit:
    """Fit the similarity by generalised least squares.

    Raises `ValueError` for fewer than two placements, or for placements at one place.
    """
    a, n = placements.target, len(placements.target)
    if len(np.unique(placements.group)) < 2 or np.ptp(a, axis=0).max() < 1e-6:
        raise ValueError("two placements that are apart are needed")
    middle = a.mean(axis=0)
    x, y = (a - middle).T
    A = np.zeros((2 * n, 4))
    A[0::2] = np.column_stack([x, -y, np.ones(n), np.zeros(n)])
    A[1::2] = np.column_stack([y, x, np.zeros(n), np.ones(n)])
    W = placements.weights()
    covariance = np.linalg.inv(A.T @ W @ A)
    solve = covariance @ A.T @ W
    b = placements.place.ravel()
    c = solve @ b
    scale = float(np.hypot(c[0], c[1]))
    along, across = c[:2] / scale**2, np.array([-c[1], c[0]]) / scale**2
    residual = b - A @ c
    turn = np.array([[c[0], -c[1]], [c[1], c[0]]])
    scale_variance, yaw_variance = (float(row @ covariance[:2, :2] @ row) for row in (along, across))
    return PlanFit(
        scale=scale, yaw=float(np.arctan2(c[1], c[0])), shift=c[2:] - turn @ middle,
        scale_sd=float(np.sqrt(scale_variance)), yaw_sd=float(np.sqrt(yaw_variance)),
        shift_sd=float(np.sqrt(np.trace(covariance[2:, 2:]) / 2)), chi_squared=float(residual @ W @ residual),
        freedom=2 * n - 4, by_place=solve[:2],
    )  # fmt: skip


@dataclass(frozen=True)
class Choice:
    """The rows that are used, and the placements that contradict each other."""

    used: Bools
    """(M,) whether the row is used."""
    suspects: tuple[int, ...] = ()
    """Groups that contradict each other, where the wrong one among them cannot be determined; they are used."""


@dataclass(frozen=True)
class ScalePrior:
    """Other knowledge of a rig's scale: true lengths are lengths in the rig times `exp(log_growth)`; `sd` is its sigma."""

    log_growth: float = 0.0
    sd: float = UNKNOWN_SD

    @property
    def is_known(self) -> bool:
        """Whether the prior holds any knowledge of the scale."""
        return self.sd < UNKNOWN_SD


def choose_placements(placements: Placements, prior: ScalePrior) -> Choice:
    """Choose the rows that agree with each other.

    While the remaining rows contradict each other, one more wrong placement is left out, or one wrong row of a placement that
    several cameras see. With three placements, the scale from the heights of people decides which pair is right, if any. Where
    half of the placements or more would be left out, all are suspects: two of four that were swapped agree as well as the
    other two.
    """
    used = placements.sound
    everything = np.unique(placements.group[used])
    while True:
        rows = np.flatnonzero(used)
        if len(np.unique(placements.group[rows])) < 2 or _improbability(placements.take(rows), None) < 1:
            return Choice(used)
        left = []
        for group, without in _removals(placements, rows):
            rest = placements.take(without)
            if len(np.unique(rest.group)) >= 2 and np.ptp(rest.target, axis=0).max() > 1e-6:
                left.append((_excess(rest, prior), group, without))
        left.sort(key=lambda one: (one[0], len(rows) - len(one[2])))
        if not left:
            return Choice(used, tuple(np.unique(placements.group[rows]).tolist()))
        best = left[0]
        rivals = [group for excess, group, _ in left if group != best[1] and excess < best[0] + SURE]
        if rivals:
            return Choice(used, tuple(sorted({best[1], *rivals})))
        if 2 * len(np.unique(placements.group[best[2]])) <= len(everything) or 2 * len(best[2]) < placements.sound.sum():
            return Choice(placements.sound, tuple(everything.tolist()))
        used = np.zeros(len(used), dtype=bool)
        used[best[2]] = True


def fits_mirrored(placements: Placements, choice: Choice, prior: ScalePrior) -> bool:
    """Return whether all placements agree on the plan's mirror image, where the plan does not show which of them are wrong.

    False for fewer than four placements: one wrong placement of three can give the mirror image of the triangle by chance.
    """
    if not choice.suspects or len(np.unique(placements.group[placements.sound])) < 4:
        return False
    image = choose_placements(placements.mirrored(), prior)
    return not image.suspects and bool((image.used == placements.sound).all())


def _removals(placements: Placements, rows: Ints) -> list[tuple[int, Ints]]:
    """Return (group, remaining rows) without each placement, and without each row of a placement that has several rows."""
    out = []
    for number in np.unique(placements.group[rows]).tolist():
        own = placements.group[rows] == number
        out.append((number, rows[~own]))
        if np.count_nonzero(own) > 1:
            out += [(number, rows[rows != row]) for row in rows[own]]
    return out


def _improbability(placements: Placements, prior: ScalePrior | None) -> float:
    """Return chi-squared over the value that it exceeds with a probability of `LEAST_PROBABLE`."""
    fit = fit_plan(placements)
    if fit.freedom + (prior is not None) < 1:
        return 0.0
    from scipy.stats import chi2  # imports in half a second, and most scenes have no plan

    return _chi_squared(fit, prior) / float(chi2.isf(LEAST_PROBABLE, fit.freedom + (prior is not None)))


def _excess(placements: Placements, prior: ScalePrior) -> float:
    """Return chi-squared with the prior minus its expectation: comparable between different numbers of rows."""
    fit = fit_plan(placements)
    return _chi_squared(fit, prior) - (fit.freedom + 1)


def _chi_squared(fit: PlanFit, prior: ScalePrior | None) -> float:
    if prior is None:
        return fit.chi_squared
    off = np.log(fit.scale) + prior.log_growth
    return fit.chi_squared + float(off**2 / (prior.sd**2 + fit.scale_sd**2))
