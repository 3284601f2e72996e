"""Figures over seeds: a failure is infinitely far and never averaged away."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from paper.conditions import Outcome
from paper.spread import HEAD, quartiles, spread_cells


def outcome(mm):
    if math.isinf(mm):
        return Outcome("refused", "too little", 3, 4)
    return Outcome("accepted", "", 4, 4, mm, mm / 100, 2 * mm, mm / 50, 0.01)


@given(st.lists(st.floats(0.1, 1e6), min_size=1, max_size=12))
def test_quartiles_of_finite_figures_are_numpys(values):
    assert quartiles(values) == pytest.approx(np.quantile(values, (0.25, 0.5, 0.75)), rel=1e-12)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1, 2, 3, 4, math.inf], (2, 3, 4)),
        ([1, 2, 3, math.inf, math.inf], (2, 3, math.inf)),
        ([1, math.inf], (math.inf, math.inf, math.inf)),
        ([5, math.inf, math.inf], (math.inf, math.inf, math.inf)),
        ([math.inf], (math.inf, math.inf, math.inf)),
    ],
)
def test_failures_are_larger_than_anything(values, expected):
    assert quartiles(values) == expected


def test_one_failure_in_three_is_told_and_moves_the_median():
    shown = spread_cells([outcome(10.0), outcome(20.0), outcome(math.inf)])
    assert shown[0] == "20.0 mm 0.200°"
    assert shown[1] == "15.0 to fails"
    assert shown[2] == "fails"
    assert shown[-2:] == ["1 of 3", "2 accepted, 1 refused"]
    assert len(shown) == len(HEAD)


def test_where_half_of_the_seeds_fail_no_figure_stands():
    shown = spread_cells([outcome(10.0), outcome(math.inf)])
    assert shown[:-2] == ["fails"] * (len(HEAD) - 2)
    assert shown[-2] == "1 of 2"
