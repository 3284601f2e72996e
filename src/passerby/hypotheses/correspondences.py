"""Correspondences between one camera's sightings and people with positions by the other cameras."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import rows_of_equal
from passerby.hypotheses.pair_residuals import PairColumns
from passerby.people.body_centres import TriangulatedPeople
from passerby.people.sightings import Sightings

MOST_ROWS = 2000
"""Approximate largest number of sightings of a camera; of more, instants at even steps are taken. Of 75 hostile cases (motions,
cameras and later people in benchmarks/reliability, seed 106000) one wrong rig is accepted, the same as with twice as many."""
FOLLOWED = 3
"""A velocity is computed between the places this many observations of a person before and after; the noise of a place is
5 cm."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """K pairs of a sighting of one camera and a person that it may show; a sighting may have several."""

    own: Sightings
    people: TriangulatedPeople
    row: Ints
    """(K,) row of `own`, ascending."""
    person: Ints
    """(K,) row of `people`."""
    person_height_m: float
    given: bool
    """Whether the identities of the sightings are those of the people."""

    def __len__(self) -> int:
        return len(self.own)

    @cached_property
    def columns(self) -> PairColumns:
        """The inputs of the pairs' residuals."""
        return PairColumns.of(self.own, self.people, self.row, self.person, self.person_height_m)

    @cached_property
    def velocity(self) -> Floats:
        """(3, K) velocities of the pairs' people, metres an instant; 0 where neighbouring positions are missing."""
        return np.ascontiguousarray(_velocities(self.people)[self.person].T)

    def part(self, rows: NDArray[np.bool_]) -> Correspondences:
        """Select the marked sightings (M,)."""
        number = np.cumsum(rows) - 1
        kept = rows[self.row]
        return Correspondences(
            self.own.take(rows), self.people, number[self.row[kept]], self.person[kept], self.person_height_m, self.given
        )


def instants_compared(own: Sightings, others: Ints) -> Ints:
    """Return the instants at which a camera's sightings are compared with people, ascending; at even steps for `MOST_ROWS`.

    Args:
        own: sightings, in the order of their instants.
        others: instants at which other cameras saw a person, in any order.
    """
    instants = np.unique(own.step[np.isin(own.step, others)])
    count = np.searchsorted(own.step, instants, side="right") - np.searchsorted(own.step, instants)
    if count.sum() > MOST_ROWS:
        instants = instants[:: int(np.ceil(count.sum() / MOST_ROWS))]
    return np.asarray(instants)


def match_people(
    own: Sightings, people: TriangulatedPeople, person_height_m: float, *, given: bool, instants: Ints | None = None
) -> Correspondences:
    """Match a camera's sightings with the people of their instants.

    Args:
        own: sightings, in the order of their instants.
        people: positions of the people by the other cameras.
        person_height_m: typical standing height, metres.
        given: whether the identities of the sightings are those of the people.
        instants: result of `instants_compared`; None: it is computed from the people.
    """
    instants = instants_compared(own, people.instant) if instants is None else instants
    own = own.take(np.isin(own.step, instants))
    row, person = rows_of_equal(own.step, people.instant)
    if given:
        same = own.identity[row] == people.identity[person]
        row, person = row[same], person[same]
    used = np.unique(row)
    return Correspondences(own.take(used), people, np.searchsorted(used, row), person, person_height_m, given)


def _velocities(people: TriangulatedPeople) -> Floats:
    """Return the velocity (N, 3) of each person, metres an instant."""
    order = np.lexsort((people.instant, people.identity))
    identity, instant, place = people.identity[order], people.instant[order], people.place[order]
    rows = np.arange(len(order))
    first, last = np.maximum(rows - FOLLOWED, 0), np.minimum(rows + FOLLOWED, max(len(rows) - 1, 0))
    first = np.maximum(first, np.searchsorted(identity, identity, side="left"))
    last = np.minimum(last, np.searchsorted(identity, identity, side="right") - 1)
    span = instant[last] - instant[first]
    followed = (span > 0) & (span <= 4 * FOLLOWED)
    out = np.zeros_like(place)
    out[order] = np.where(followed[:, None], (place[last] - place[first]) / np.maximum(span, 1)[:, None], 0.0)
    return out
