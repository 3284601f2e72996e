"""Where pieces lie in the time of a recording."""

import numpy as np
import pytest

from passerby.perception.sources.files import follow_at_once, gaps_between, place_by_names


@pytest.mark.parametrize("length", [10.0, 10.03, 9.7])
def test_pieces_that_follow_at_once_keep_doing_so(length: float) -> None:
    """Names leave fractions off; the recording has none of the jumps that these would make."""
    true = 1000.4 + length * np.arange(40)
    found = place_by_names(np.floor(true), np.full(40, length), 1.0)
    np.testing.assert_allclose(np.diff(found), length, atol=1e-9)
    assert np.abs(found - true).max() < (0.65 if length == 10 else 0.1)


def test_missing_pieces_do_not_shift_the_others() -> None:
    rng = np.random.default_rng(4)
    true = 1000.73 + 10.03 * np.arange(120)
    kept = np.sort(rng.choice(120, 100, replace=False))
    found = place_by_names(np.floor(true[kept]), np.full(100, 10.03), 1.0)
    error = found - true[kept]
    assert np.ptp(error) < 1e-6
    assert np.abs(error).max() < 0.1


def test_a_drifting_phase_is_followed_smoothly() -> None:
    """Lengths that are off by a thousandth: after 100 pieces the names say otherwise by a second."""
    true = 1000.2 + 10.01 * np.arange(400)
    found = place_by_names(np.floor(true), np.full(400, 10.0), 1.0)
    assert np.abs(found - true).max() < 0.5
    assert np.abs(np.diff(found) - 10.01).max() < 0.3


def test_a_break_begins_anew() -> None:
    true = np.concatenate([1000.5 + 10 * np.arange(5), 5003.9 + 10 * np.arange(5)])
    found = place_by_names(np.floor(true), np.full(10, 10.0), 1.0)
    assert np.abs(found - true).max() < 0.75
    gaps = gaps_between(found, np.full(10, 10.0))
    assert (gaps.count, gaps.longest_s) == (1, pytest.approx(5003.9 - 1050.5, abs=1.5))


def test_gaps_and_overlaps() -> None:
    gaps = gaps_between(np.array([0.0, 10.0, 25.0, 33.0]), np.full(4, 10.0))
    assert (gaps.count, gaps.seconds, gaps.longest_at_s) == (1, 5.0, 20.0)
    assert (gaps.overlaps, gaps.overlap_s, gaps.inside) == (1, 2.0, 0)
    assert gaps_between(np.array([0.0, 0.0, 10.0, 10.0]), np.full(4, 10.0)).inside == 2
    # Recorders that begin early cover no piece wholly.
    gaps = gaps_between(np.arange(0.0, 200.0, 8.0), np.full(25, 10.0), 1.0)
    assert (gaps.overlaps, gaps.overlap_s, gaps.inside, gaps.irregular) == (24, 48.0, 0, False)
    np.testing.assert_array_equal(follow_at_once(np.array([3.0, 4.0, 5.0])), [0.0, 3.0, 7.0])


@pytest.mark.parametrize("length", [6.0, 9.3])
@pytest.mark.parametrize("back_s", [17.0, 60.0])
def test_a_clock_that_is_set_back_puts_pieces_into_the_time_of_others(length: float, back_s: float) -> None:
    true = 1000.4 + length * np.arange(30)
    named = np.sort(np.floor(np.where(np.arange(30) < 15, true, true - back_s)))
    begins = place_by_names(named, np.full(30, length), 1.0)
    gaps = gaps_between(begins, np.full(30, length), 1.0)
    assert gaps.irregular
    assert gaps.overlap_s == pytest.approx(back_s, abs=2)
    assert back_s < 30 or 0.9 * back_s / length < gaps.inside <= 2 * back_s / length
    assert 1000.4 + 15 * length - back_s - 1.0 <= gaps.longest_overlap_at_s <= 1000.4 + 15 * length + 1.0
