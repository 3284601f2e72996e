"""One camera's people sampled on the grid of time and as tracks on its ground, against walks that are known."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from passerby.association.ground.ground_tracks import GroundTracks, Tolerance, ground_tracks
from passerby.association.sampling import STEP_S, InterpolatedSamples, interpolate_samples
from passerby.geometry.single_view import Level
from support.scenes.walkers_on_plane import UP, bodies_at

HEIGHT = 4.0
LEVEL = Level(UP, HEIGHT, 0.0)
START, VELOCITY = 3.0 + 12.0j, 1.1 - 0.6j


def straight(seconds: np.ndarray) -> np.ndarray:
    return np.asarray(START + VELOCITY * seconds)


def tracks_of(tracklet: np.ndarray, seconds: np.ndarray, ground: np.ndarray, **options: object) -> GroundTracks:
    return ground_tracks(bodies_at(tracklet, seconds, ground, HEIGHT), LEVEL, **options)  # type: ignore[arg-type]


def assert_straight(found: GroundTracks) -> None:
    np.testing.assert_allclose(found.position, straight(found.step * STEP_S), atol=1e-8)
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=1e-7)


def of_one(seconds: np.ndarray, **options: object) -> GroundTracks:
    """Of one person who walks straight."""
    return tracks_of(np.zeros(len(seconds), int), seconds, straight(seconds), **options)


@pytest.mark.parametrize("fps", [2.0, 3.0, 5.0, 25.0, 30000 / 1001])
@pytest.mark.parametrize("begin", [0.0, 0.21, -7.3])
def test_a_straight_walk_is_met_exactly_at_every_grid_time(fps: float, begin: float) -> None:
    seconds = begin + np.arange(int(9 * fps)) / fps
    found = tracks_of(np.full(len(seconds), 5), seconds, straight(seconds))
    assert_straight(found)
    assert (found.tracklet == 5).all()
    wanted = np.arange(np.ceil(seconds[0] / STEP_S), np.floor(seconds[-1] / STEP_S) + 1)
    # At the very ends of a slow camera's tracklet fewer than three samples are near.
    assert set(wanted[1:-1]) <= set(found.step.tolist()) <= set(wanted)
    assert len(np.unique(found.step)) == len(found)


def test_within_a_gap_nothing_is_made_up_but_a_slow_camera_may_miss_a_box() -> None:
    seconds = np.arange(0, 12.01, 0.2)
    found = of_one(seconds[(seconds < 4.0) | (seconds > 8.0)])
    assert_straight(found)
    at = found.step * STEP_S
    assert not ((at > 4.3) & (at < 7.7)).any()
    assert {1.0, 3.5, 8.5, 11.0} <= set(at.tolist())
    slow = of_one(np.delete(np.arange(0, 12, 0.5), [5, 9, 14]))
    assert set(range(1, 23)) <= set(slow.step.tolist())
    assert_straight(slow)
    two = of_one(np.concatenate([np.arange(0, 4, 0.2), [5.9, 6.1], np.arange(8, 12, 0.2)]))
    assert 12 not in two.step, "two samples make no line"
    assert_straight(two)


@given(
    starts=st.lists(st.floats(-20, 20), min_size=1, max_size=5),
    lengths=st.lists(st.floats(0.1, 9), min_size=5, max_size=5),
    seed=st.integers(0, 100),
)
def test_tracklets_do_not_disturb_each_other(starts: list[float], lengths: list[float], seed: int) -> None:
    """All at once and in any order of the rows, they are what each is alone."""
    rng = np.random.default_rng(seed)
    rows = []
    for number, (start, length) in enumerate(zip(starts, lengths, strict=False)):
        seconds = start + np.arange(0, length, 0.2)
        ground = rng.uniform(-4, 4) + 8j + np.cumsum(rng.normal(0, 0.2, len(seconds)) + 1j * rng.normal(0, 0.2, len(seconds)))
        rows.append((np.full(len(seconds), 3 * number), seconds, ground))
    together = [np.concatenate(column) for column in zip(*rows, strict=True)]
    mixed = rng.permutation(len(together[0]))
    found = tracks_of(*(column[mixed] for column in together))
    assert (np.diff(found.step) >= 0).all()
    for tracklet, seconds, ground in rows:
        alone = tracks_of(tracklet, seconds, ground)
        own = found.tracklet == tracklet[0]
        np.testing.assert_array_equal(found.step[own], alone.step)
        np.testing.assert_allclose(found.position[own], alone.position, atol=1e-7)
        np.testing.assert_allclose(found.velocity[own], alone.velocity, atol=1e-6)


def test_short_tracklets_and_people_without_one_are_left_out() -> None:
    seconds = np.arange(0, 0.95, 0.1)
    long = np.arange(0, 3.05, 0.1)
    tracklet = np.concatenate([np.full(len(seconds), 0), np.full(len(long), 1), np.full(len(long), -1)])
    times = np.concatenate([seconds, long, long])
    assert set(tracks_of(tracklet, times, straight(times)).tracklet.tolist()) == {1}
    assert set(tracks_of(tracklet, times, straight(times), shortest_s=0.0).tracklet.tolist()) == {0, 1}


def test_feet_near_the_horizon_and_jumps_of_the_tracker_have_no_place() -> None:
    seconds = np.arange(0, 10, 0.2)
    numbers = np.zeros(len(seconds), int)
    near, far = (tracks_of(numbers, seconds, 1j * (metres + 1.4 * seconds)) for metres in (30.0, 300.0))
    assert (len(near) > 15, len(far)) == (True, 0)
    # A tracklet leaps over 20 m.
    found = tracks_of(numbers, seconds, straight(seconds) + np.where(seconds < 5.0, 0.0, 20.0j))
    assert (np.abs(found.velocity) < 12.0).all()
    assert {1.0, 9.0} <= set((found.step * STEP_S).tolist())
    assert 5.0 not in (found.step * STEP_S).tolist()


def test_a_camera_covers_the_ground_about_its_people_and_tolerates_more_far_away() -> None:
    seconds = np.arange(0, 9, 0.2)
    walked = straight(seconds)
    found = of_one(seconds)
    assert found.covers((found.position[:, None] + 0.9 * np.exp(2j * np.pi * np.arange(8) / 8)).ravel()).all()
    beside = walked + 4.0j * VELOCITY / abs(VELOCITY)
    assert not found.covers(np.concatenate([beside, walked[:1] - 40.0, walked[:1] + 40.0j])).any()
    nobody = tracks_of(np.zeros(0, int), np.zeros(0), np.zeros(0, complex))
    assert (len(nobody), nobody.position.dtype, nobody.velocity.dtype) == (0, np.complex128, np.complex128)
    assert not nobody.covers(walked).any()
    seconds, tolerance = np.arange(0, 20, 0.2), Tolerance(floor_m=0.2, along=0.05, across=0.01, foot_m=0.08)
    found = tracks_of(np.zeros(len(seconds), int), seconds, 1j * (5 + seconds), tolerance=tolerance)
    along, across = found.sigma
    reach = np.abs(found.position)
    np.testing.assert_allclose(along, 0.2 + 0.05 * reach + 0.08 * reach / HEIGHT)
    np.testing.assert_allclose(across, 0.2 + 0.01 * reach)


def sampled(seconds: np.ndarray, values: NDArray[Any], **options: bool | float) -> InterpolatedSamples[NDArray[np.float64]]:
    """The samples of a single tracklet."""
    return interpolate_samples(np.zeros(len(seconds), np.int64), seconds, values, **options)  # type: ignore[arg-type]


def test_a_sample_is_the_line_of_least_squares_through_the_rows_about_it() -> None:
    """Complex columns are two real ones."""
    rng = np.random.default_rng(1)
    seconds, x = np.arange(0.0, 8.0, 0.1), rng.standard_normal((80, 2))
    found, plane = sampled(seconds, x), sampled(seconds, x[:, :1] + 1j * x[:, 1:])
    k = int(np.flatnonzero(found.step == 8)[0])
    near = np.abs(seconds - 4.0) < 0.5 + 1e-6
    slope, level = np.polyfit(seconds[near] - 4.0, x[near, 0], 1)
    np.testing.assert_allclose([found.value[k, 0], found.rate[k, 0]], [level, slope], atol=1e-9)
    np.testing.assert_array_equal(plane.step, found.step)
    np.testing.assert_allclose(plane.value[:, 0], found.value @ [1, 1j], atol=1e-9)
    np.testing.assert_allclose(plane.rate[:, 0], found.rate @ [1, 1j], atol=1e-9)


def test_three_rows_are_needed_or_two_far_apart_where_they_are_asked_for() -> None:
    """Two rows on one side of a time, or near each other, would make a large error of the pace of noise of the place."""
    two, three = np.array([0.8, 1.2]), np.array([0.8, 1.0, 1.2])
    assert len(sampled(two, two[:, None]).step) == 0
    assert len(sampled(two[:1], two[:1, None], two_suffice=True).step) == 0
    found = sampled(two, 3 * two[:, None], two_suffice=True)
    assert found.step.tolist() == sampled(three, three[:, None]).step.tolist() == [2]
    np.testing.assert_allclose([found.value[0, 0], found.rate[0, 0]], [3.0, 3.0])
    for pair, there in (((0.99, 1.01), False), ((0.7, 1.2), True)):
        seconds = np.concatenate([pair, np.arange(10.0, 20.0, 0.1)])
        found = interpolate_samples((seconds >= 10).astype(int), seconds, seconds[:, None], two_suffice=True)
        assert (found.tracklet == 0).any() == there
