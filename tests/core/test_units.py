"""Lengths in a wrong unit, by people's heights."""

import numpy as np
import pytest

from passerby.core.scale_cues import METRES, find_wrong_unit


@pytest.mark.parametrize(("unit", "times"), [("millimetres", 983.0), ("centimetres", 106.0), ("inches", 37.5), ("feet", 3.4)])
def test_a_unit_is_recognised_beside_the_error_of_peoples_heights(unit, times):
    wrong = find_wrong_unit(np.log(times), 0.05)
    assert wrong is not None
    assert wrong.unit == unit
    assert f"multiply them by {METRES[unit]:g}" in wrong.in_words


def test_metres_of_unusual_people_are_metres():
    """A class of children, or boxes that end at the knees: no unit is wrong."""
    for times in (0.5, 0.72, 1.0, 1.3, 2.0):
        assert find_wrong_unit(np.log(times), 0.05) is None


def test_yards_need_a_scale_that_is_well_known():
    assert find_wrong_unit(-np.log(0.9144), 0.045) is None
    wrong = find_wrong_unit(-np.log(0.9144), 0.01)
    assert wrong is not None
    assert wrong.unit == "yards"


def test_a_gross_factor_of_no_unit_is_wrong_all_the_same():
    wrong = find_wrong_unit(np.log(9.0), 0.05)
    assert wrong is not None
    assert wrong.unit is None
    assert "9 times as long" in wrong.in_words
