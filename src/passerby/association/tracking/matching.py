"""Significant links of the best one-to-one assignment, for sparse tables in which few links are possible."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN


def clear_matches(n: int, first: Ints, second: Ints, cost: Floats, margin: float) -> tuple[Ints, Ints]:
    """Return the links of the least-cost assignment without which the best assignment is worse by a margin.

    The best assignment without a link is searched among the rows and columns that could exchange partners with it: those that
    compete for one of its two ends, and those that compete with these. All others keep their partners, so that time and memory
    grow with the number of links, not with the square of the number of rows.

    Args:
        n: number of rows and of columns of the table of costs.
        first: (L,) rows of the links.
        second: (L,) columns of the links; no link occurs twice.
        cost: (L,) costs of the links, below 0. A row or a column without a link costs nothing.
        margin: increase of the cost without a link, from which the link is significant.

    Returns:
        (K,) rows, ascending, and (K,) columns of the significant links.
    """
    if not len(first):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    partner = _best_partners(n, first, second, cost)
    by_row = csr_array((cost, (first, second)), shape=(n, n))
    by_column = csr_array((cost, (second, first)), shape=(n, n))
    matched = np.flatnonzero(partner >= 0)
    owner = np.full(n, UNKNOWN)
    owner[partner[matched]] = matched
    row = matched[[_worse_without(row, partner, owner, by_row, by_column) >= margin for row in matched.tolist()]]
    return row, partner[row]


def _best_partners(n: int, first: Ints, second: Ints, cost: Floats) -> Ints:
    """Return the column (n,) of each row in the assignment of least cost, -1 for none."""
    rows, columns = np.concatenate([first, np.arange(n)]), np.concatenate([second, n + np.arange(n)])
    # Every row may stay unlinked, in a column of its own. All costs are raised by one constant: entries of 0 are not stored.
    raised = np.concatenate([cost, np.zeros(n)]) - cost.min() + 1.0
    row, column = min_weight_full_bipartite_matching(csr_array((raised, (rows, columns)), shape=(n, 2 * n)))
    partner = np.full(n, UNKNOWN)
    partner[row[column < n]] = column[column < n]
    return partner


def _worse_without(row: int, partner: Ints, owner: Ints, by_row: csr_array, by_column: csr_array) -> float:
    """Return the increase of the least cost without the link of a row; `owner` (n,) is the row of each column."""
    column = int(partner[row])
    rivals = _neighbours(by_column, np.array([column]))
    rows = _neighbours(by_column, _neighbours(by_row, rivals))
    columns = _neighbours(by_row, rows)
    columns = columns[(owner[columns] < 0) | np.isin(owner[columns], rows)]
    table = by_row[rows][:, columns].toarray()
    best = table[linear_sum_assignment(table)].sum()
    table[np.searchsorted(rows, row), np.searchsorted(columns, column)] = 0.0
    return float(table[linear_sum_assignment(table)].sum() - best)


def _neighbours(table: csr_array, rows: Ints) -> Ints:
    """Return the columns in which any of the rows has an entry, ascending."""
    parts = [table.indices[table.indptr[row] : table.indptr[row + 1]] for row in rows.tolist()]
    return np.unique(np.concatenate(parts)).astype(np.int64)
