"""Rows in groups against loops over groups, weights of robust losses against slopes of their costs, many small systems."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.symmetric import solve_symmetric
from passerby.geometry import groups

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("shape", [(), (2, 3)])
def test_sums_of_groups(shape):
    group, values = RNG.integers(0, 6, 50), RNG.standard_normal((50, *shape))
    expected = [values[group == g].sum(axis=0) for g in range(7)]
    np.testing.assert_allclose(groups.group_sums(group, values, 7), expected, atol=1e-12)
    np.testing.assert_array_equal(groups.group_sums(group[:0], values[:0], 4), np.zeros((4, *shape)))
    assert groups.group_sums(group[:0], values[:0], 0).shape == (0, *shape)


def test_medians_numbers_and_least_rows_of_groups_runs_equal_rows_and_ranges():
    group, values = np.concatenate([np.arange(5), RNG.integers(0, 5, 40)]), RNG.standard_normal(45)
    expected = [np.median(values[group == g]) for g in range(5)]
    np.testing.assert_allclose(groups.group_medians(group, values, 5), expected, atol=1e-15)
    a, b = RNG.integers(-2, 3, 60), RNG.integers(0, 4, 60)
    expected = np.unique(np.column_stack([a, b]), axis=0, return_inverse=True)[1].ravel()
    assert groups.group_numbers(a, b).tolist() == expected.tolist()
    assert groups.group_numbers(a[:0], b[:0]).tolist() == []
    inside = RNG.integers(0, 2, 40) > 0
    ends = [(first, last) for first in range(40) for last in range(first, 40) if inside[first : last + 1].all()]
    longest = [(a, b) for a, b in ends if (a, b + 1) not in ends and (a - 1, b) not in ends]
    assert groups.find_runs(inside) == longest
    assert groups.find_runs(inside[:0]) == []
    ascending, wanted = np.sort(RNG.integers(0, 8, 30)), RNG.integers(-1, 9, 20)
    pairs = [(i, j) for i, value in enumerate(wanted) for j in range(30) if ascending[j] == value]
    assert list(zip(*(rows.tolist() for rows in groups.rows_of_equal(wanted, ascending)), strict=True)) == pairs
    owner, number = groups.expanded_ranges(np.array([7, 3, 5]), np.array([2, 0, 3]))
    assert (owner.tolist(), number.tolist()) == ([0, 0, 2, 2, 2], [7, 8, 5, 6, 7])
    key = np.array([5, 1, 5, 1, 9])
    assert groups.least_of_groups(key, np.array([2.0, 3.0, 1.0, 4.0, 0.0])).tolist() == [1, 2, 4]
    assert groups.least_of_groups(key, np.zeros(5)).tolist() == [1, 0, 4]


AT = np.array([0.01, 0.5, 1.0, 2.4, 4.0, 7.0])


def slope(cost, at, step=1e-6):
    return (cost(at + step) - cost(at - step)) / (2 * step)


def test_weights_are_the_slopes_of_their_costs_and_the_cut_cost_no_longer_grows():
    np.testing.assert_allclose(
        groups.cauchy_weights((AT / 3) ** 2), slope(lambda r: 4.5 * np.log1p((r / 3) ** 2), AT) / AT, rtol=1e-6
    )
    cut = groups.compute_cut_cauchy_weights(AT**2, 3.0, 25.0)
    np.testing.assert_allclose(cut, slope(lambda r: 0.5 * groups.compute_cut_cauchy_cost(r**2, 3.0, 25.0), AT) / AT, rtol=1e-6)
    assert (cut > 0).tolist() == (AT < 5).tolist()
    huber = groups.huber_weights(AT, 2.5)
    assert huber[AT < 2.5].tolist() == [1.0] * 4
    np.testing.assert_allclose((huber * AT)[AT > 2.5], 2.5)


def test_a_third_of_outliers_does_not_move_the_scale():
    rng = np.random.default_rng(0)
    residuals = np.concatenate([2.0 * rng.standard_normal(6000), np.full(2000, 1e3)])
    assert groups.residual_scale(residuals[:6000], 0.1) == pytest.approx(2.0, rel=0.05)
    assert 2.0 < groups.residual_scale(residuals, 0.1) < 3.5
    assert groups.residual_scale(np.zeros(5), 0.1) == 0.1


@given(st.integers(0, 2**32 - 1), st.floats(-4.0, 4.0))
def test_solutions_are_those_of_each_system(seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(0, 1, (50, 3, 3))
    matrix = (root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)) * 10.0**power
    right = rng.normal(0, 1, (50, 3))
    entries = np.array([matrix[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))])
    expected = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    found = solve_symmetric(entries, right.T).T
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
