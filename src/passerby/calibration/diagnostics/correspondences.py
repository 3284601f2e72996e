"""One camera's observations against where the other cameras see the people, and the pose that they fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import least_of_groups, rows_of_equal
from passerby.geometry.reprojection import pose_jacobian, project_near
from passerby.geometry.robust import cut_cauchy_cost, cut_cauchy_weights
from passerby.people.body_centres import BodyCentres, TriangulatedPeople
from passerby.people.resection import BEYOND, LOSS, STEPS, PoseEquations, PoseFit, fit_pose

MOST_COST = float(cut_cauchy_cost(np.array(BEYOND), LOSS, BEYOND))
"""Of a sighting that shows somebody else."""
MOST_ROWS = 4000
"""Sightings of a camera at most: of more, even steps are taken."""
SIZE_SD = 0.25
"""By how much (as a logarithm) the size of a box may differ from that of a person of middling height where it is."""


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
    row, person = m.row[pairs], m.person[pairs]
    d = (m.people.place[person] - pose.centre) @ pose.R_cw.T
    ray, tangent = m.own.ray[row], m.own.tangent[row]
    residual, by_d = project_near(ray, tangent, d)
    by_pose, by_point = pose_jacobian(by_d, d, np.broadcast_to(pose.R_cw, (len(d), 3, 3)))
    S = by_point @ m.people.covariance[person] @ by_point.transpose(0, 2, 1)
    S[:, 0, 0] += m.own.sigma_px[row] ** 2
    S[:, 1, 1] += m.own.sigma_px[row] ** 2
    information = np.asarray(np.linalg.inv(S), dtype=np.float64)
    square = np.einsum("ki,kij,kj->k", residual, information, residual)
    # Whoever is of the wrong size is another person.
    distance = np.maximum(np.linalg.norm(d, axis=1), 0.3)
    pixels = np.linalg.norm(tangent, axis=(1, 2)) / np.sqrt(2.0)
    size = np.log(m.own.extent_px[row] * distance / (pixels * m.person_height_m)) / SIZE_SD
    behind = np.einsum("ki,ki->k", ray, d) < 0.3 * distance
    return residual, information, by_pose, np.where(behind, 1e6, square + np.maximum(size**2 - 4.0, 0.0))


def fit_costs(m: Correspondences, pose: Pose) -> Costs:
    """The costs under a pose, each sighting given to the person who fits best."""
    square = pose_residuals(m, pose, np.arange(len(m.row)))[3]
    first = least_of_groups(m.row, square)
    return Costs(cut_cauchy_cost(square[first], LOSS, BEYOND), first)


@dataclass(frozen=True, eq=False)
class PoseObservations(PoseEquations):
    """What R sightings ask of a pose."""

    pairs: Ints
    """(R,)"""
    by_pose: Floats
    """(R, 2, 6) pixels by the unknowns."""


def resect_rows(
    m: Correspondences, rows: NDArray[np.bool_], start: Pose, *, widening: float = 1.0, steps: int = STEPS
) -> PoseFit[PoseObservations]:
    """A pose fitted to some of the sightings, each of the person who fits best by then."""

    def equations_at(pose: Pose, wide: float) -> PoseObservations:
        pairs = fit_costs(m, pose).pair[rows]
        residual, information, by_pose, square = pose_residuals(m, pose, pairs)
        weight = cut_cauchy_weights(square, LOSS * wide, BEYOND * wide**2)
        weighed = weight[:, None, None] * (by_pose.transpose(0, 2, 1) @ information)
        return PoseObservations((weighed @ residual[:, :, None])[:, :, 0], weighed @ by_pose, pairs, by_pose)

    return fit_pose(start, equations_at, widening=widening, steps=steps)


def resect_correspondences(m: Correspondences, start: Pose) -> Pose:
    """The pose that a camera's sightings fit, near `start`."""
    return resect_rows(m, np.ones(len(m), dtype=bool), start, widening=4.0).pose
