"""Samples of two cameras at one time, against brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.association.ground.cooccurrence import TrackPair, find_synchronous_pairs
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.geometry.single_view import Level
from support.scenes.walkers_on_plane import UP

SAMPLES = st.lists(st.tuples(st.integers(-6, 6), st.integers(0, 3)), max_size=15)


def tracks_of(samples: list[tuple[int, int]]) -> GroundTracks:
    step, tracklet = np.array(sorted(samples), dtype=np.int64).reshape(-1, 2).T
    none = np.zeros(len(step), dtype=np.complex128)
    return GroundTracks(Level(UP, 4.0, 0.0), Tolerance(), step, tracklet, none, none)


@given(first=SAMPLES, second=SAMPLES, lag=st.integers(-8, 8))
def test_all_that_are_at_one_time_meet(first: list[tuple[int, int]], second: list[tuple[int, int]], lag: int) -> None:
    tracks = TrackPair(tracks_of(first), tracks_of(second))
    met = find_synchronous_pairs(tracks, lag)
    wanted = np.argwhere(tracks.a.step[:, None] + lag == tracks.b.step)
    assert sorted(zip(met.a.tolist(), met.b.tolist(), strict=True)) == [tuple(row) for row in wanted.tolist()]
    pairs = met.tracklets
    assert (pairs.size.sum(), len(set(zip(pairs.a.tolist(), pairs.b.tolist(), strict=True)))) == (len(met), len(pairs))
    np.testing.assert_array_equal(pairs.a[pairs.of_encounter], tracks.a.tracklet[met.a])
    np.testing.assert_array_equal(pairs.b[pairs.of_encounter], tracks.b.tracklet[met.b])
    weight = np.arange(len(met), dtype=np.float64) + 1.0
    for number in range(len(pairs)):
        rows = pairs.encounters_of(number)
        np.testing.assert_array_equal(rows, np.flatnonzero(pairs.of_encounter == number))
        assert pairs.summed(weight)[number] == weight[rows].sum()


def test_fewer_instants_are_spread_evenly() -> None:
    always = tracks_of([(step, who) for step in range(100) for who in range(3)])
    met = find_synchronous_pairs(TrackPair(always, always), 4, 10)
    instants = np.unique(always.step[met.a])
    assert (len(instants), instants[0], instants[-1]) == (10, 0, 95)
    assert set(np.diff(instants)) <= {10, 11}
    assert (len(met), len(find_synchronous_pairs(TrackPair(always, always), 4, 1000))) == (10 * 3 * 3, 96 * 3 * 3)


@pytest.mark.parametrize("stretch", [1, 20])
def test_as_many_instants_as_are_wanted_are_all_taken(stretch: int) -> None:
    """Also where neighbours stay together and their number does not divide that of the instants; of one more, some are left."""
    always = tracks_of([(step, 0) for step in range(99)])
    every, some = (find_synchronous_pairs(TrackPair(always, always), 0, most, stretch) for most in (99, 98))
    np.testing.assert_array_equal(always.step[every.a], np.arange(99))
    assert (every.thinned, some.thinned, len(some) < 99) == (False, True, True)
    assert not find_synchronous_pairs(TrackPair(always, always), 0).thinned


def test_neighbours_stay_together_where_asked() -> None:
    always = tracks_of([(step, 0) for step in range(1000)])
    instants = always.step[find_synchronous_pairs(TrackPair(always, always), 0, 100, 20).a]
    np.testing.assert_array_equal(np.unique(np.diff(instants)), [1, 226])
    assert (len(instants), instants[0], instants[-1]) == (100, 0, 999)
    almost_all = always.step[find_synchronous_pairs(TrackPair(always, always), 0, 999, 20).a]
    assert len(np.unique(almost_all)) == len(almost_all) == 980


def test_instants_are_counted_by_their_crowd() -> None:
    sparse = tracks_of([(step, who) for step in range(0, 100, 2) for who in range(2)])
    crowded = tracks_of([(step, who) for step in range(100) for who in range(5)])
    assert TrackPair(sparse, crowded).instants_of(1000) == 100
