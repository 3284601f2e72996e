"""One camera's observations against where the other cameras see the people, and the pose that they fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from passerby.calibration.diagnostics.pair_residuals import PairColumns, residuals_at
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import rows_of_equal
from passerby.geometry.robust import cut_cauchy_cost, cut_cauchy_weights
from passerby.people.body_centres import BodyCentres, TriangulatedPeople
from passerby.people.resection import BEYOND, LOSS, STEPS, PoseFit, fit_pose

MOST_COST = float(cut_cauchy_cost(np.array(BEYOND), LOSS, BEYOND))
"""Of a sighting that shows somebody else."""
MOST_ROWS = 4000
"""Sightings of a camera at most: of more, even steps are taken."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """One camera's sightings, and to each all the people that it may show: K pairs."""

    own: BodyCentres
    people: TriangulatedPeople
    row: Ints
    """(K,) row of `own`, ascending."""
    person: Ints
    """(K,) row of `people`."""
    person_height_m: float
    given: bool
    """Whether the sightings' identities are the people's."""

    def __len__(self) -> int:
        return len(self.own)

    @cached_property
    def columns(self) -> PairColumns:
        """What residuals of the pairs need."""
        return PairColumns.of(self.own, self.people, self.row, self.person, self.person_height_m)

    def part(self, rows: NDArray[np.bool_]) -> Correspondences:
        """The sightings (M,) that are marked."""
        number = np.cumsum(rows) - 1
        kept = rows[self.row]
        return Correspondences(
            self.own.take(rows), self.people, number[self.row[kept]], self.person[kept], self.person_height_m, self.given
        )

    def zoomed(self, factor: float) -> Correspondences:
        """As they would be had the camera zoomed by a factor: by `factor` times the focal length of its lens.

        A point `d` of the camera frame is seen where the lens has `(factor d_x, factor d_y, d_z)`, its distortion included.
        """
        ray = self.own.ray / np.array([factor, factor, 1.0])
        length = np.linalg.norm(ray, axis=1)
        tangent = length[:, None, None] * self.own.tangent * np.array([factor, factor, 1.0])
        return replace(self, own=replace(self.own, ray=ray / length[:, None], tangent=tangent))


def instants_compared(own: BodyCentres, others: Ints) -> Ints:
    """The instants at which a camera's sightings are compared with people, ascending: of more than `MOST_ROWS`, even steps.

    Args:
        own: sightings, in the order of their instants.
        others: instants at which other cameras saw somebody, in any order.
    """
    instants = np.unique(own.instant[np.isin(own.instant, others)])
    count = np.searchsorted(own.instant, instants, side="right") - np.searchsorted(own.instant, instants)
    if count.sum() > MOST_ROWS:
        instants = instants[:: int(np.ceil(count.sum() / MOST_ROWS))]
    return np.asarray(instants)


def match_people(
    own: BodyCentres, people: TriangulatedPeople, person_height_m: float, *, given: bool, instants: Ints | None = None
) -> Correspondences:
    """A camera's sightings with the people of their instants.

    Args:
        own: sightings, in the order of their instants.
        people: by the other cameras.
        person_height_m: typical standing height, metres.
        given: whether the sightings' identities are the people's.
        instants: of `instants_compared`; None: they follow from the people.
    """
    instants = instants_compared(own, people.instant) if instants is None else instants
    own = own.take(np.isin(own.instant, instants))
    row, person = rows_of_equal(own.instant, people.instant)
    if given:
        same = own.identity[row] == people.identity[person]
        row, person = row[same], person[same]
    used = np.unique(row)
    return Correspondences(own.take(used), people, np.searchsorted(used, row), person, person_height_m, given)


@dataclass(frozen=True, eq=False)
class Costs:
    """What a pose makes of the sightings M."""

    cost: Floats
    """(M,) robust square in sigmas, at most `BEYOND`'s."""
    pair: Ints
    """(M,) the pair of the person that fits best."""


def pose_residuals(m: Correspondences, pose: Pose, pairs: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """Residuals (K, 2), their information (K, 2, 2), derivatives by the pose (K, 2, 6), squares (K,)."""
    found = residuals_at(m.columns.take(pairs), pose)
    across, both, down = found.information
    information = np.array([[across, both], [both, down]]).transpose(2, 0, 1)
    return found.residual.T, information, found.by_pose().transpose(2, 0, 1), found.square


def fit_costs(m: Correspondences, pose: Pose) -> Costs:
    """The costs under a pose, each sighting given to the person who fits best."""
    square = residuals_at(m.columns, pose).square
    first = _best_of_rows(m.row, square, len(m))
    return Costs(cut_cauchy_cost(square[first], LOSS, BEYOND), first)


def _best_of_rows(row: Ints, square: Floats, count: int) -> Ints:
    """(M,) of each of so many rows, ascending, the pair with the smallest square; of equal ones the first."""
    if len(row) == count:
        return np.arange(count)
    new = np.diff(row, prepend=-1) > 0
    least = np.minimum.reduceat(square, np.flatnonzero(new))
    number = np.cumsum(new) - 1
    best = np.flatnonzero(square == least[number])
    return np.asarray(best[np.diff(number[best], prepend=-1) > 0])


@dataclass(frozen=True, eq=False)
class PoseObservations:
    """What R sightings ask of a pose."""

    pairs: Ints
    """(R,)"""
    residual: Floats
    """(2, R) pixels."""
    weighed: Floats
    """(6, 2, R) derivatives by the unknowns, times information and robust weight."""
    by_unknowns: Floats
    """(6, 2, R) pixels by the unknowns: a rotation vector in the camera's frame, then the centre."""

    @property
    def by_pose(self) -> Floats:
        """(R, 2, 6) pixels by the unknowns."""
        return self.by_unknowns.transpose(2, 1, 0)

    @property
    def gradient(self) -> Floats:
        """(R, 6) of half the robust cost, uphill."""
        return np.asarray(np.einsum("ukr,kr->ru", self.weighed, self.residual))

    @property
    def information(self) -> Floats:
        """(R, 6, 6)"""
        return np.asarray(np.einsum("ukr,vkr->ruv", self.weighed, self.by_unknowns))

    def summed(self) -> tuple[Floats, Floats]:
        """(6,) gradient and (6, 6) information of all."""
        weighed = self.weighed.reshape(6, -1)
        return weighed @ self.residual.ravel(), weighed @ self.by_unknowns.reshape(6, -1).T


def resect_rows(
    m: Correspondences, rows: NDArray[np.bool_], start: Pose, *, widening: float = 1.0, steps: int = STEPS
) -> PoseFit[PoseObservations]:
    """A pose fitted to some of the sightings, each of the person who fits best by then."""
    every = bool(rows.all())
    used = np.arange(len(m.row)) if every else np.flatnonzero(rows[m.row])
    columns, row, count = m.columns if every else m.columns.take(used), m.row[used], int(np.count_nonzero(rows))

    def equations_at(pose: Pose, wide: float) -> PoseObservations:
        found = residuals_at(columns, pose)
        best = _best_of_rows(row, found.square, count)
        if len(best) < len(row):
            found = found.take(best)
        weight = cut_cauchy_weights(found.square, LOSS * wide, BEYOND * wide**2)
        across, both, down = weight * found.information
        by_unknowns = np.ascontiguousarray(found.by_pose().transpose(1, 0, 2))
        first, second = by_unknowns[:, 0], by_unknowns[:, 1]
        weighed = np.empty_like(by_unknowns)
        weighed[:, 0], weighed[:, 1] = across * first + both * second, both * first + down * second
        return PoseObservations(used[best], found.residual, weighed, by_unknowns)

    return fit_pose(start, equations_at, widening=widening, steps=steps)


def resect_correspondences(m: Correspondences, start: Pose) -> Pose:
    """The pose that a camera's sightings fit, near `start`."""
    return resect_rows(m, np.ones(len(m), dtype=bool), start, widening=4.0).pose
