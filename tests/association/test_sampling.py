"""Sampling on the grid of time, against lines that are known."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from passerby.association.sampling import STEP_S, InterpolatedSamples, interpolate_samples


def one(seconds: np.ndarray, values: NDArray[Any], **options: bool | float) -> InterpolatedSamples[NDArray[np.float64]]:
    """The samples of a single tracklet."""
    return interpolate_samples(np.zeros(len(seconds), np.int64), seconds, values, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("fps", [1.0, 5.0, 12.5, 29.97, 60.0])
def test_a_straight_line_is_found_exactly_at_any_frame_rate(fps: float) -> None:
    """Two tracklets, of which one begins late and runs otherwise."""
    seconds = np.concatenate([np.arange(0.3, 12, 1 / fps), np.arange(1000.1, 1020, 1 / fps)])
    tracklet = np.where(seconds > 500, 9, 4)
    start, rate = np.array([[3.0, -70.0], [1e3, 2.0]]), np.array([[1.3, 0.0], [-0.7, 5.0]])
    which = (tracklet == 9).astype(int)
    found = interpolate_samples(tracklet, seconds, start[which] + rate[which] * seconds[:, None])
    at, which = found.step * STEP_S, (found.tracklet == 9).astype(int)
    np.testing.assert_allclose(found.value, start[which] + rate[which] * at[:, None], atol=1e-6)
    np.testing.assert_allclose(found.rate, rate[which], atol=1e-6)
    for number in (4, 9):
        own, shown = at[found.tracklet == number], seconds[tracklet == number]
        # Every grid time within the tracklet, but for those near its ends where a slow camera has too few rows.
        inner = np.arange(np.ceil(shown[0] / STEP_S) + 3, np.floor(shown[-1] / STEP_S) - 2) * STEP_S
        assert np.isin(inner, own).all()
        assert (np.diff(own) > 0).all()
        assert own[0] >= shown[0]
        assert own[-1] <= shown[-1]


def test_complex_columns_are_two_real_ones() -> None:
    rng = np.random.default_rng(0)
    seconds, x = np.sort(rng.uniform(0, 20, 120)), rng.standard_normal((120, 2))
    real, plane = one(seconds, x), one(seconds, x[:, :1] + 1j * x[:, 1:])
    np.testing.assert_array_equal(plane.step, real.step)
    np.testing.assert_allclose(plane.value[:, 0], real.value[:, 0] + 1j * real.value[:, 1], atol=1e-9)
    np.testing.assert_allclose(plane.rate[:, 0], real.rate[:, 0] + 1j * real.rate[:, 1], atol=1e-9)


def test_a_sample_is_the_line_of_least_squares_through_the_rows_about_it() -> None:
    rng = np.random.default_rng(1)
    seconds, x = np.arange(0.0, 8.0, 0.1), rng.standard_normal(80)
    found = one(seconds, x[:, None])
    k = int(np.flatnonzero(found.step == 8)[0])
    near = np.abs(seconds - 4.0) < 0.5 + 1e-6
    slope, level = np.polyfit(seconds[near] - 4.0, x[near], 1)
    np.testing.assert_allclose([found.value[k, 0], found.rate[k, 0]], [level, slope], atol=1e-9)


def test_three_rows_are_needed_and_two_do_only_where_they_are_asked_to() -> None:
    seconds = np.array([0.8, 1.2])
    assert len(one(seconds, seconds[:, None]).step) == 0
    assert len(one(seconds[:1], seconds[:1, None], two_suffice=True).step) == 0
    found = one(seconds, 3 * seconds[:, None], two_suffice=True)
    assert found.step.tolist() == [2]
    np.testing.assert_allclose([found.value[0, 0], found.rate[0, 0]], [3.0, 3.0])
    three = np.array([0.8, 1.0, 1.2])
    assert one(three, three[:, None]).step.tolist() == [2]


@pytest.mark.parametrize(("pair", "there"), [((0.99, 1.01), False), ((0.7, 1.2), True)])
def test_two_rows_must_lie_on_either_side_and_far_apart(pair: tuple[float, float], there: bool) -> None:
    """Otherwise noise of the place becomes a large error of the pace."""
    seconds = np.concatenate([pair, np.arange(10.0, 20.0, 0.1)])
    tracklet = (seconds >= 10).astype(int)
    found = interpolate_samples(tracklet, seconds, seconds[:, None], two_suffice=True)
    assert (found.tracklet == 0).any() == there
