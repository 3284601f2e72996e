"""Where two cameras are likely to stand, by votes."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.ground.cooccurrence import TrackPair
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.association.ground.hough import hough_motion_candidates
from passerby.geometry.single_view import Level
from support.scenes.walkers_on_plane import UP, Station, Walker, seen_by, walkers

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
    assert (best.turn, best.lag_s) == (pytest.approx(1.0), 0.0)
    assert abs(best.shift - place) < CELL_M / 2


@pytest.mark.parametrize(
    ("place", "shift", "at_most"),
    [
        (np.where(np.arange(30) % 3 == 0, 4.0 + 2.0j, 4.0 + 2.0j + 96.0), 100.0 + 2.0j, CELL_M / 2),
        (0.75 + 0.75j + 2.1 * np.array([1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j]), 0.75 + 0.75j, 1e-5),
    ],
    ids=["of two rounds the one with more votes", "a spot in the middle of four votes, though it has none itself"],
)
def test_most_votes_decide(place: np.ndarray, shift: complex, at_most: float) -> None:
    best = hough_motion_candidates(TrackPair(strides(np.zeros(len(place))), strides(place)), 0.0, 1)[0]
    assert abs(best.shift - shift) < at_most


def test_likeness_makes_the_right_pairs_louder() -> None:
    """Two people walk as each other's mirror images: half a turn about the middle fits as well."""
    rng = np.random.default_rng(7)
    (one,) = walkers(1, rng)
    people = [one, Walker(one.seconds, -one.points)]
    a, b = Station(0.4, -12.0 - 3.0j), Station(2.2, 9.0 + 4.0j)
    tracks, turn = [seen_by(station, people, rng) for station in (a, b)], a.motion_to(b)[0]
    for alike, half_turns in ((np.eye(2), 0), (1.0 - np.eye(2), 1)):
        best = hough_motion_candidates(TrackPair(*tracks, 3.0 * (alike - 0.5)), 0.0, 1)[0]
        assert abs(np.angle(best.turn / turn * (-1.0) ** half_turns)) < np.deg2rad(6.0)


def test_recordings_that_never_overlap_have_no_motion() -> None:
    early = strides(np.zeros(10))
    pair = TrackPair(early, replace(early, step=early.step + 100))
    assert hough_motion_candidates(pair, 5.0, 6) == []
    assert hough_motion_candidates(pair, 48.0, 6) != []
