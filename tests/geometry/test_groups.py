"""Rows in groups against loops over the groups."""

import numpy as np
import pytest

from passerby.geometry.groups import expanded_ranges, group_medians, group_numbers, group_sums, least_of_groups, rows_of_equal

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("shape", [(), (2, 3)])
def test_sums_of_groups(shape):
    group, values = RNG.integers(0, 6, 50), RNG.standard_normal((50, *shape))
    expected = [values[group == g].sum(axis=0) for g in range(7)]
    np.testing.assert_allclose(group_sums(group, values, 7), expected, atol=1e-12)
    np.testing.assert_array_equal(group_sums(group[:0], values[:0], 4), np.zeros((4, *shape)))
    assert group_sums(group[:0], values[:0], 0).shape == (0, *shape)


def test_medians_of_groups():
    group, values = np.concatenate([np.arange(5), RNG.integers(0, 5, 40)]), RNG.standard_normal(45)
    np.testing.assert_allclose(group_medians(group, values, 5), [np.median(values[group == g]) for g in range(5)], atol=1e-15)


def test_numbers_of_equal_rows():
    a, b = RNG.integers(-2, 3, 60), RNG.integers(0, 4, 60)
    expected = np.unique(np.column_stack([a, b]), axis=0, return_inverse=True)[1].ravel()
    assert group_numbers(a, b).tolist() == expected.tolist()
    assert group_numbers(a[:0], b[:0]).tolist() == []


def test_rows_of_equal():
    ascending, wanted = np.sort(RNG.integers(0, 8, 30)), RNG.integers(-1, 9, 20)
    expected = [(i, j) for i, value in enumerate(wanted) for j in range(30) if ascending[j] == value]
    assert list(zip(*(rows.tolist() for rows in rows_of_equal(wanted, ascending)), strict=True)) == expected


def test_expanded_ranges_and_the_least_of_each_group():
    owner, number = expanded_ranges(np.array([7, 3, 5]), np.array([2, 0, 3]))
    assert (owner.tolist(), number.tolist()) == ([0, 0, 2, 2, 2], [7, 8, 5, 6, 7])
    key = np.array([5, 1, 5, 1, 9])
    assert least_of_groups(key, np.array([2.0, 3.0, 1.0, 4.0, 0.0])).tolist() == [1, 2, 4]
    assert least_of_groups(key, np.zeros(5)).tolist() == [1, 0, 4]
