"""A rig seen from above, laid upon a plan: the similarity between both, its sigmas, and placements that contradict the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints

LEAST_PROBABLE = 1e-3
"""Residuals that are less probable by their sigmas contradict each other."""
SURE = 6.0
"""A placement is left out where no other one, left out in its place, explains the residuals within so many units of chi-squared
(odds of 20 to 1)."""
RIG_SHARE = 0.003
"""One sigma of a placement by the rig, as a share of the extent of all placements: what the rig's own shape is off by."""
HEIGHT_SD_M = 0.02
"""One sigma of the ground's height at a point: people's ground is flat to centimetres."""

UNKNOWN_SD = 1.0
"""Of the logarithm of a scale of which nothing is known."""


@dataclass(frozen=True, eq=False)
class Placements:
    """M places, each by a camera's own position or by one camera's ray to the ground; several rows may show one placement."""

    target: Floats
    """(M, 2) on the plan, metres."""
    place: Floats
    """(M, 2) in the rig's world, metres; NaN where a ray does not meet the ground."""
    group: Ints
    """(M,) rows with the same number show the same placement."""
    target_sd: Floats
    """(M,) of the plan's coordinates, metres; one value a placement."""
    covariance: Floats
    """(M, 2, 2) of the place by a click in the image, square metres."""
    along: Floats
    """(M, 2) how the place moves with the height of the ground there; 0 for a camera's own position."""
    rig_sd: Floats | None = None
    """(M,) of each coordinate by the rig itself, metres; None for a share of the extent (`RIG_SHARE`)."""

    @property
    def sound(self) -> Bools:
        """(M,) whether the place is known."""
        return np.asarray(np.isfinite(self.place).all(axis=1))

    @property
    def scale(self) -> float:
        """Lengths in the rig over lengths on the plan, roughly, whichever minority of the placements is wrong."""
        rows = np.flatnonzero(self.sound)
        first, second = rows[np.array(np.triu_indices(len(rows), 1))]
        stated, measured = (np.linalg.norm(xy[first] - xy[second], axis=1) for xy in (self.target, self.place))
        apart = (stated > 0) & (measured > 0)
        return float(np.exp(np.median(np.log(measured[apart] / stated[apart])))) if apart.any() else 1.0

    def mirrored(self) -> Self:
        """The same on the plan's mirror image."""
        return replace(self, target=self.target * (1.0, -1.0))

    def take(self, rows: Bools | Ints) -> Self:
        """Some of the rows."""
        return replace(
            self, target=self.target[rows], place=self.place[rows], group=self.group[rows], target_sd=self.target_sd[rows],
            covariance=self.covariance[rows], along=self.along[rows],
            rig_sd=None if self.rig_sd is None else self.rig_sd[rows],
        )  # fmt: skip

    def weights(self) -> Floats:
        """(2 M, 2 M) inverse of the covariance of all places: what rows of one placement have in common is not independent."""
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
    """place = R(yaw) scale target + shift, by least squares."""

    scale: float
    """Lengths in the rig over lengths on the plan."""
    yaw: float
    """From the plan to the rig, radians."""
    shift: Floats
    """(2,) metres of the rig."""
    scale_sd: float
    """Of the scale's logarithm, the plan's unit apart."""
    yaw_sd: float
    """Radians."""
    shift_sd: float
    """Of the middle of the placements, metres."""
    chi_squared: float
    freedom: int
    by_place: Floats
    """(2, 2 M) scale times (cosine, sine) of the yaw as a linear function of the places."""

    @property
    def factor(self) -> float:
        """How many times larger the residuals are than their sigmas; 1 where they are not."""
        return float(np.sqrt(max(1.0, self.chi_squared / self.freedom))) if self.freedom > 0 else 1.0

    def on_plan(self, places: Floats) -> Floats:
        """(N, 2) places of the rig on the plan, metres."""
        turn = np.array([[np.cos(self.yaw), -np.sin(self.yaw)], [np.sin(self.yaw), np.cos(self.yaw)]])
        return np.asarray((np.asarray(places) - self.shift) @ turn / self.scale)


def fit_plan(placements: Placements) -> PlanFit:
    """The similarity by generalised least squares.

    Raises `ValueError` for fewer than two placements, or placements on one spot.
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
    """Which rows are used, and what contradicts them."""

    used: Bools
    """(M,)"""
    suspects: tuple[int, ...] = ()
    """Groups that contradict each other, where it cannot be said which of them is wrong; they are used."""


@dataclass(frozen=True)
class ScalePrior:
    """What else is known of the scale of a rig: by it lengths in the rig, times the exponential of this, are true."""

    log_growth: float = 0.0
    sd: float = UNKNOWN_SD

    @property
    def is_known(self) -> bool:
        """Whether anything is."""
        return self.sd < UNKNOWN_SD


def choose_placements(placements: Placements, prior: ScalePrior) -> Choice:
    """The rows that agree with each other.

    One wrong placement after another, or one wrong row of a placement that several cameras see, is left out while the rest
    contradicts itself. With three placements the scale that people have decides which pair is right, if any. Where half of the
    placements or more would have to go, all are suspects: two of four that were swapped agree as well as the other two.
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
    """Whether all placements agree on the plan's mirror image, where the plan itself does not show which are wrong.

    Of three, one that is wrong by chance can make the triangle's mirror image.
    """
    if not choice.suspects or len(np.unique(placements.group[placements.sound])) < 4:
        return False
    image = choose_placements(placements.mirrored(), prior)
    return not image.suspects and bool((image.used == placements.sound).all())


def _removals(placements: Placements, rows: Ints) -> list[tuple[int, Ints]]:
    """(group, the rows that remain) without each placement, and without each row of one that several cameras show."""
    out = []
    for number in np.unique(placements.group[rows]).tolist():
        own = placements.group[rows] == number
        out.append((number, rows[~own]))
        if np.count_nonzero(own) > 1:
            out += [(number, rows[rows != row]) for row in rows[own]]
    return out


def _improbability(placements: Placements, prior: ScalePrior | None) -> float:
    """Chi-squared over what it exceeds with a probability of `LEAST_PROBABLE`."""
    fit = fit_plan(placements)
    if fit.freedom + (prior is not None) < 1:
        return 0.0
    from scipy.stats import chi2  # takes half a second to import, and most scenes have no plan

    return _chi_squared(fit, prior) / float(chi2.isf(LEAST_PROBABLE, fit.freedom + (prior is not None)))


def _excess(placements: Placements, prior: ScalePrior) -> float:
    """Chi-squared with the prior, less its expectation: comparable between different numbers of rows."""
    fit = fit_plan(placements)
    return _chi_squared(fit, prior) - (fit.freedom + 1)


def _chi_squared(fit: PlanFit, prior: ScalePrior | None) -> float:
    if prior is None:
        return fit.chi_squared
    off = np.log(fit.scale) + prior.log_growth
    return fit.chi_squared + float(off**2 / (prior.sd**2 + fit.scale_sd**2))
