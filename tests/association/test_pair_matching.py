"""Samples of two cameras at one time, their agreement, and motions voted for and fitted, against definitions and the truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.association.ground.cooccurrence import SynchronousPairs, TrackPair, find_synchronous_pairs
from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.association.ground.pair_matching import GroundMotion, agreement_of_pairs, fit_motion, match_tracklets
from passerby.association.sampling import STEP_S
from passerby.geometry.single_view import Level
from support.scenes.walkers_on_plane import UP, Station, seen_by, walkers

LEVEL = Level(UP, 4.0, 0.0)
SAMPLES = st.lists(st.tuples(st.integers(-6, 6), st.integers(0, 3)), max_size=15)


def tracks_of(samples: list[tuple[int, int]]) -> GroundTracks:
    step, tracklet = np.array(sorted(samples), dtype=np.int64).reshape(-1, 2).T
    none = np.zeros(len(step), dtype=np.complex128)
    return GroundTracks(LEVEL, Tolerance(), step, tracklet, none, none)


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


def test_some_instants_are_spread_evenly_and_neighbours_stay_together_where_asked() -> None:
    always = tracks_of([(step, who) for step in range(100) for who in range(3)])
    both = TrackPair(always, always)
    instants = np.unique(always.step[find_synchronous_pairs(both, 4, 10).a])
    assert (len(instants), instants[0], instants[-1]) == (10, 0, 95)
    assert set(np.diff(instants)) <= {10, 11}
    assert set(np.diff(np.unique(always.step[find_synchronous_pairs(both, 0, 40, 20).a]))) == {1, 61}
    for most, stretch in ((100, 1), (100, 30), (99, 1), (99, 30)):  # also where stretches do not divide the instants
        some = find_synchronous_pairs(both, 0, most, stretch)
        assert (some.thinned, len(some) < 900) == (most < 100, most < 100)


A, B = Station(0.4, -12.0 - 3.0j), Station(2.0, 9.0 + 5.0j, delay_s=0.7)
ON_THE_GRID = replace(B, delay_s=STEP_S)


def agreement_of(met: SynchronousPairs, row: int, motion: GroundMotion, factor: float) -> float:
    """By the definition: the squared Mahalanobis distance, from 1 down to -1."""
    covariance = np.zeros((2, 2))
    for tracks, index, turn in ((met.tracks.a, met.a[row], motion.turn), (met.tracks.b, met.b[row], 1.0)):
        ray = tracks.position[index] * turn
        along = np.array([ray.real, ray.imag]) / abs(ray)
        across = np.array([-along[1], along[0]])
        sigma = [part[index] * abs(turn) for part in tracks.sigma]
        covariance += sigma[0] ** 2 * np.outer(along, along) + sigma[1] ** 2 * np.outer(across, across)
    b = met.tracks.b
    there = b.position[met.b[row]] + b.velocity[met.b[row]] * (motion.lag_s - met.lag * STEP_S)
    apart = motion.turn * met.tracks.a.position[met.a[row]] + motion.shift - there
    d = np.array([apart.real, apart.imag])
    return max(1.0 - float(d @ np.linalg.solve(covariance, d)) / factor**2, -1.0)


@given(
    seed=st.integers(0, 1000), factor=st.sampled_from([0.5, 1.0, 2.5]), spread=st.sampled_from([1.0, 4.0, 20.0]),
    along=st.sampled_from([0.0, 0.02, 0.2]), across=st.sampled_from([0.0, 0.05]), scale=st.floats(0.8, 1.25),
)  # fmt: skip
def test_agreement_is_what_it_is_defined_as(seed, factor, spread, along, across, scale):
    rng = np.random.default_rng(seed)
    tolerance = Tolerance(floor_m=0.3, along=along, across=across, foot_m=0.02)

    def scattered(n: int) -> GroundTracks:
        place, velocity = rng.normal(0, spread, (2, n)), rng.normal(0, 1, (2, n))
        step, tracklet = np.sort(rng.integers(0, 3, n)), rng.integers(0, 3, n)
        return GroundTracks(LEVEL, tolerance, step, tracklet, place[0] + 1j * place[1], velocity[0] + 1j * velocity[1])

    met = find_synchronous_pairs(TrackPair(scattered(12), scattered(12)), 1)
    motion = GroundMotion(scale * np.exp(1.3j), complex(*rng.normal(0, 1, 2)), 0.5 + rng.uniform(-0.25, 0.25))
    wanted = [agreement_of(met, row, motion, factor) for row in range(len(met))]
    np.testing.assert_allclose(agreement_of_pairs(met, motion, factor), wanted, atol=1e-9)


def seen(b: Station) -> SynchronousPairs:
    rng = np.random.default_rng(3)
    people = walkers(5, rng)
    tracks_a, tracks_b = (seen_by(station, people, rng, noise_m=0.0, noise_share=0.0) for station in (A, b))
    return find_synchronous_pairs(TrackPair(tracks_a, tracks_b), round(b.delay_s / STEP_S))


def test_no_tracklets_match_under_a_motion_that_is_far_off() -> None:
    true = GroundMotion(*A.motion_to(B))
    assert match_tracklets(seen(B), replace(true, shift=true.shift + 200.0), 2.5) is None


@pytest.mark.parametrize(("b", "free_lag"), [(B, True), (ON_THE_GRID, True), (ON_THE_GRID, False)])
def test_the_true_motion_is_fitted_from_near_it(b: Station, free_lag: bool) -> None:
    met, true = seen(b), GroundMotion(*A.motion_to(b))
    found = GroundMotion(true.turn * np.exp(0.05j), true.shift + 0.8 - 0.5j, true.lag_s - (0.2 if free_lag else 0.0))
    for factor in (2.0, 1.0, 1.0, 1.0):
        matched = match_tracklets(met, found, factor)
        assert sorted(matched.tracklets_a.tolist()) == list(range(5))
        np.testing.assert_array_equal(matched.tracklets_a, matched.tracklets_b)
        found = fit_motion(met, matched, found, free_lag=free_lag)
    # Where people turn, the lines through their samples smooth the way by a few centimetres.
    assert abs(np.angle(found.turn / true.turn)) < np.deg2rad(0.4)
    assert abs(found.turn) == pytest.approx(1.0, abs=0.01)
    assert abs(found.turn * A.ground(0j) + found.shift - b.ground(0j)) < 0.1
    assert found.lag_s == (pytest.approx(true.lag_s, abs=0.05) if free_lag else true.lag_s)
