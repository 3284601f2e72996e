"""Statistics over rows of arrays: sums, medians and joins of groups without loops, robust weights and scales."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from passerby.common.arrays import Bools, Floats, Ints

_WIDE = 4
"""Number of columns from which one sparse product is faster than one sum per column. Both give the same bits."""
NORMAL_BY_MAD = 1.4826
"""Ratio of a normal variable's standard deviation to the median of its absolute value."""


def group_sums(group: Ints, values: NDArray[Any], n_groups: int) -> Floats:
    """Sum the rows of `values` (N, ...) by `group` (N,) to (G, ...), in the rows' order; 0 for a group without rows."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    if flat.shape[1] >= _WIDE:
        rows = np.arange(len(flat) + 1)
        member = scipy.sparse.csc_array((np.ones(len(flat)), group, rows), shape=(n_groups, len(flat)))
        return np.asarray(member @ np.ascontiguousarray(flat)).reshape(n_groups, *values.shape[1:])
    total = np.empty((n_groups, flat.shape[1]))
    for column in range(flat.shape[1]):
        total[:, column] = np.bincount(group, flat[:, column], n_groups)
    return total.reshape(n_groups, *values.shape[1:])


def group_medians(group: Ints, values: Floats, n_groups: int) -> Floats:
    """Return the medians (G,) of `values` (N,) by `group` (N,); every group must have a value.

    The median of an even number of values is the mean of the two in the middle.
    """
    order = np.lexsort((values, group))
    count = np.bincount(group, minlength=n_groups)
    first = np.cumsum(count) - count
    return np.asarray((values[order[first + (count - 1) // 2]] + values[order[first + count // 2]]) / 2)


def group_numbers(*columns: Ints) -> Ints:
    """Number the groups of equal rows of columns (N,), and return the number (N,) of each row's group.

    Groups are sorted by the first column, then the second, and so on. `np.unique` of rows takes twenty times as long.
    """
    order = np.lexsort(columns[::-1])
    new = np.zeros(len(order), bool)
    for column in columns:
        new[1:] |= np.diff(column[order]) != 0
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(new)
    return number


def least_of_groups(key: Ints, cost: NDArray[Any]) -> Ints:
    """Return for each key, in ascending order, the row (G,) of its smallest cost; the first row of equal costs."""
    order = np.lexsort((cost, key))
    return np.asarray(order[np.unique(key[order], return_index=True)[1]])


def expanded_ranges(first: Ints, count: Ints) -> tuple[Ints, Ints]:
    """Return all whole numbers of the ranges [first, first + count), both (N,), one range after the other.

    Returns:
        (M,) index of each number's range; (M,) the numbers.
    """
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(owner))


def find_runs(inside: Bools) -> list[tuple[int, int]]:
    """Find the runs of rows that are `inside` (N,), and return the first and the last row of each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))


def rows_of_equal(wanted: NDArray[Any], ascending: NDArray[Any]) -> tuple[Ints, Ints]:
    """Join two columns: find for each wanted value (N,), in order, the rows of an ascending column (K,) that equal it.

    Returns:
        (M,) rows of `wanted`; (M,) rows of `ascending`.
    """
    first = np.searchsorted(ascending, wanted)
    return expanded_ranges(first, np.searchsorted(ascending, wanted, side="right") - first)


def cauchy_weights(squares: Floats) -> Floats:
    """Return the Cauchy weights 1 / (1 + square) (N,) of residuals, from their squares (N,) in units of the loss's scale."""
    return np.asarray(1.0 / (1.0 + squares))


def huber_weights(lengths: Floats, scale: float) -> Floats:
    """Return the Huber weights (N,) of residuals from their lengths (N,): 1 up to `scale`, beyond it `scale` / length."""
    return np.minimum(1.0, scale / np.maximum(lengths, 1e-9))


def compute_cut_cauchy_cost(squares: Floats, scale: float, beyond: float) -> Floats:
    """Compute the Cauchy cost (N,) of squares (N,) in sigmas; constant beyond `beyond`, where it is another person."""
    return np.asarray(scale**2 * np.log1p(np.minimum(squares, beyond) / scale**2))


def compute_cut_cauchy_weights(squares: Floats, scale: float, beyond: float) -> Floats:
    """Compute the weights (N,) that belong to `compute_cut_cauchy_cost`: 0 beyond `beyond`."""
    return np.where(squares > beyond, 0.0, cauchy_weights(squares / scale**2))


def residual_scale(residuals: Floats, least: float) -> float:
    """Return the standard deviation of residuals (N,) around 0, from the median of their absolute values; at least `least`."""
    return max(NORMAL_BY_MAD * float(np.median(np.abs(residuals))), least)
