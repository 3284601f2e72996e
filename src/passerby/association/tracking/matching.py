"""Which links of the best one-to-one assignment are significant, where few of all links are possible."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN


def clear_matches(n: int, first: Ints, second: Ints, cost: Floats, margin: float) -> tuple[Ints, Ints]:
    """The links of the assignment of least cost without which the next best assignment is worse by a margin.

    The next best one is looked for among those who could take part in an exchange with the link: those that compete for one of
    its two ends, and those that compete with these. All others keep their partners, so that time and memory grow with the
    number of links, not with the square of their ends.

    Args:
        n: rows and columns of the table of costs.
        first: (L,) the links' rows.
        second: (L,) their columns; no link stands twice.
        cost: (L,) of the links, below 0: to leave a row or a column without a link costs nothing.
        margin: how much worse the assignment without a link must be for the link to stand.

    Returns:
        (K,) rows, ascending, and (K,) columns of the links that stand.
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
    """(n,) the column of each row in the assignment of least cost, -1 for none."""
    rows, columns = np.concatenate([first, np.arange(n)]), np.concatenate([second, n + np.arange(n)])
    # Every row may stay alone, in a column of its own. All are raised by one constant: an entry of 0 would be no entry.
    raised = np.concatenate([cost, np.zeros(n)]) - cost.min() + 1.0
    row, column = min_weight_full_bipartite_matching(csr_array((raised, (rows, columns)), shape=(n, 2 * n)))
    partner = np.full(n, UNKNOWN)
    partner[row[column < n]] = column[column < n]
    return partner


def _worse_without(row: int, partner: Ints, owner: Ints, by_row: csr_array, by_column: csr_array) -> float:
    """By how much the best assignment grows worse without the link of a row; `owner` (n,) is the row of each column."""
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
    """The columns in which any of the rows has an entry, ascending."""
    parts = [table.indices[table.indptr[row] : table.indptr[row + 1]] for row in rows.tolist()]
    return np.unique(np.concatenate(parts)).astype(np.int64)
