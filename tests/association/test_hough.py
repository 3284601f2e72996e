"""Where two cameras are likely to stand, by votes."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.association.ground.cooccurrence import TrackPair
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.association.ground.hough import SAME_LAG_S, hough_motion_candidates
from passerby.association.sampling import STEP_S
from passerby.geometry.single_view import Level
from support.scenes.walkers_on_plane import UP, Station, Walker, seen_by, walkers

A = Station(0.4, -12.0 - 3.0j)
CELL_M = 1.5


def strides(position: np.ndarray) -> GroundTracks:
    """One person a step, all walking along x."""
    n = len(position)
    tolerance = Tolerance(floor_m=0.1, along=0.0, across=0.0)
    return GroundTracks(
        Level(UP, 4.0, 0.0), tolerance, np.arange(n), np.zeros(n, dtype=np.int64), position.astype(np.complex128),
        np.full(n, 3.0 + 0.0j),
    )  # fmt: skip


@pytest.mark.parametrize("place", [0j, 30.0 - 60.0j, -420.0 + 300.0j])
def test_shifts_are_found_to_a_cell_however_far(place: complex) -> None:
    """They are counted on a torus of 64 cells; the round must be told as well."""
    rng = np.random.default_rng(1)
    shown = rng.uniform(-5, 5, 40) + 1j * rng.uniform(-5, 5, 40)
    best = hough_motion_candidates(TrackPair(strides(shown), strides(shown + place)), 0.0, 1)[0]
    assert best.turn == pytest.approx(1.0)
    assert best.lag_s == 0.0
    assert abs(best.shift - place) < CELL_M / 2


def test_of_two_rounds_the_one_with_more_votes_is_taken() -> None:
    shown = np.zeros(30)
    place = np.where(np.arange(30) % 3 == 0, 4.0 + 2.0j, 4.0 + 2.0j + 96.0)
    best = hough_motion_candidates(TrackPair(strides(shown), strides(place)), 0.0, 1)[0]
    assert abs(best.shift - (100.0 + 2.0j)) < CELL_M / 2


def test_a_spot_between_its_votes_has_a_shift() -> None:
    """Four votes in the far corners of the cells around one make it the highest, though it has none itself."""
    around = 0.75 + 0.75j + 2.1 * np.array([1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j])
    best = hough_motion_candidates(TrackPair(strides(np.zeros(4)), strides(around)), 0.0, 1)[0]
    assert abs(best.shift - (0.75 + 0.75j)) < 1e-5


def test_the_best_motion_is_the_true_one_and_the_rest_differ_from_it() -> None:
    rng = np.random.default_rng(2)
    b = Station(2.2, 9.0 + 4.0j, delay_s=2.0)
    people = walkers(6, rng)
    found = hough_motion_candidates(TrackPair(seen_by(A, people, rng), seen_by(b, people, rng)), 3.0, 5)
    turn, _, lag_s = A.motion_to(b)
    assert abs(np.angle(found[0].turn / turn)) < np.deg2rad(5.0)
    assert abs(found[0].lag_s - lag_s) <= STEP_S
    middle = A.ground(0j)
    assert abs(found[0].turn * middle + found[0].shift - b.ground(0j)) < 2 * CELL_M
    assert 1 < len(found) <= 5
    for other in found[1:]:
        again = abs(np.angle(other.turn / found[0].turn)) < np.deg2rad(20.0) and abs(other.lag_s - found[0].lag_s) <= SAME_LAG_S
        assert not again or abs(other.shift - found[0].shift) > 4.0


def test_likeness_makes_the_right_pairs_louder() -> None:
    """Two people walk as each other's mirror images: half a turn about the middle fits as well."""
    rng = np.random.default_rng(7)
    (one,) = walkers(1, rng)
    people = [one, Walker(one.seconds, -one.points)]
    b = Station(2.2, 9.0 + 4.0j)
    tracks_a, tracks_b = seen_by(A, people, rng), seen_by(b, people, rng)
    turn = A.motion_to(b)[0]
    for alike, half_turns in ((np.eye(2), 0), (1.0 - np.eye(2), 1)):
        best = hough_motion_candidates(TrackPair(tracks_a, tracks_b, 3.0 * (alike - 0.5)), 0.0, 1)[0]
        assert abs(np.angle(best.turn / turn * (-1.0) ** half_turns)) < np.deg2rad(6.0)


def test_recordings_that_never_overlap_have_no_motion() -> None:
    early = strides(np.zeros(10))
    late = GroundTracks(early.level, early.tolerance, early.step + 100, early.tracklet, early.position, early.velocity)
    assert hough_motion_candidates(TrackPair(early, late), 5.0, 6) == []
    assert hough_motion_candidates(TrackPair(early, late), 48.0, 6) != []
