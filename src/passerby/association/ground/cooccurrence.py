"""Samples of two cameras' ground tracks at the same time, for a lag between their clocks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from passerby.association.ground.ground_tracks import GroundTracks
from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import expanded_ranges


@dataclass(frozen=True, eq=False)
class TrackPair:
    """Tracks and appearance of two cameras before they are registered."""

    a: GroundTracks
    b: GroundTracks
    affinity: Floats | None = None
    """(T_a, T_b) log-likelihood ratio of tracklets showing one person rather than two, from their appearance."""

    def instants_of(self, encounters: int) -> int:
        """Return the approximate number of instants that have this number of encounters, at any lag."""
        crowd_a, crowd_b = (len(side) / max(1, len(side.instants[0])) for side in (self.a, self.b))
        return int(np.ceil(encounters / max(crowd_a * crowd_b, 1.0)))


@dataclass(frozen=True, eq=False)
class TrackletPairs:
    """The P pairs of tracklets that N encounters belong to."""

    a: Ints
    """(P,) tracklet numbers of camera a."""
    b: Ints
    """(P,) tracklet numbers of camera b."""
    of_encounter: Ints
    """(N,) the pair of each encounter."""

    def __len__(self) -> int:
        return len(self.a)

    @cached_property
    def size(self) -> Ints:
        """(P,) number of encounters."""
        return np.bincount(self.of_encounter, minlength=len(self))

    @cached_property
    def _sorted(self) -> tuple[Ints, Ints]:
        order = np.argsort(self.of_encounter, kind="stable")
        return order, np.concatenate([[0], np.cumsum(self.size)])

    def encounters_of(self, pair: int) -> Ints:
        """Return the rows of a pair's encounters."""
        order, first = self._sorted
        return order[first[pair] : first[pair + 1]]

    def summed(self, values: Floats) -> Floats:
        """Sum values (N,) over each pair's encounters: (P,)."""
        return np.asarray(np.bincount(self.of_encounter, values, len(self)), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class SynchronousPairs:
    """The N encounters: every combination of a sample of camera a and a sample of camera b at the same time."""

    tracks: TrackPair
    lag: int
    """Time of camera b's clock minus that of camera a's, grid steps."""
    a: Ints
    """(N,) rows of camera a's tracks."""
    b: Ints
    """(N,) rows of camera b's tracks."""
    thinned: bool = False
    """Whether instants were left out."""

    def __len__(self) -> int:
        return len(self.a)

    @cached_property
    def tracklets(self) -> TrackletPairs:
        """The pairs of tracklets to which the encounters belong."""
        in_a, in_b = self.tracks.a.tracklet, self.tracks.b.tracklet
        n_b = int(in_b.max(initial=0)) + 1
        key, which = np.unique(in_a[self.a] * n_b + in_b[self.b], return_inverse=True)
        return TrackletPairs(key // n_b, key % n_b, which.ravel())


def find_synchronous_pairs(tracks: TrackPair, lag: int, most_instants: int | None = None, stretch: int = 1) -> SynchronousPairs:
    """Find the encounters of two cameras.

    Args:
        tracks: tracks of both cameras.
        lag: time of camera b's clock minus that of camera a's, grid steps.
        most_instants: largest number of instants. If more have people in both cameras, stretches are taken at even steps.
        stretch: neighbouring instants in a stretch. Tracklets can be matched only by several samples of both.
    """
    (steps_a, low_a, n_a), (steps_b, low_b, n_b) = tracks.a.instants, tracks.b.instants
    in_b = np.searchsorted(steps_b, steps_a + lag)
    in_a = np.flatnonzero(np.append(steps_b, np.iinfo(np.int64).max)[in_b] == steps_a + lag)
    thinned = most_instants is not None and len(in_a) > most_instants
    if most_instants is not None and len(in_a) > most_instants:
        together = min(stretch, most_instants)
        begins = np.linspace(0, len(in_a) - together, most_instants // together).astype(np.int64)
        in_a = in_a[(begins[:, None] + np.arange(together)).ravel()]
    in_b = in_b[in_a]
    low_a, n_a, low_b, n_b = low_a[in_a], n_a[in_a], low_b[in_b], n_b[in_b]
    count = n_a * n_b
    instant, within = expanded_ranges(np.zeros_like(count), count)
    return SynchronousPairs(
        tracks, lag, low_a[instant] + within // n_b[instant], low_b[instant] + within % n_b[instant], thinned
    )
