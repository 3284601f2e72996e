"""Lengths in a wrong unit, by people's heights."""

import numpy as np
import pytest

from passerby.core.scale_cues import METRES, find_wrong_unit


@pytest.mark.parametrize(
    ("unit", "times", "sigma"),
    [("millimetres", 983.0, 0.05), ("centimetres", 106.0, 0.05), ("inches", 37.5, 0.05), ("feet", 3.4, 0.05),
     ("yards", 1 / 0.9144, 0.01)],
)  # fmt: skip
def test_a_unit_is_recognised_beside_the_error_of_peoples_heights(unit, times, sigma):
    wrong = find_wrong_unit(np.log(times), sigma)
    assert wrong.unit == unit
    assert f"multiply them by {METRES[unit]:g}" in wrong.in_words


@pytest.mark.parametrize("times", [0.5, 0.72, 1.0, 1 / 0.9144, 1.3, 2.0])
def test_metres_of_unusual_people_are_metres(times):
    """A class of children, or boxes that end at the knees: no unit is wrong. Yards need a scale that is well known."""
    assert find_wrong_unit(np.log(times), 0.045) is None


def test_a_gross_factor_of_no_unit_is_wrong_all_the_same():
    wrong = find_wrong_unit(np.log(9.0), 0.05)
    assert wrong.unit is None
    assert "9 times as long" in wrong.in_words
