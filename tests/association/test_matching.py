from itertools import permutations

import numpy as np
import pytest

from passerby.association.tracking.matching import clear_matches


def least(table: np.ndarray) -> tuple[float, list[int]]:
    """Cost and columns of the best assignment of a table of costs, by trying all."""
    ways = permutations(range(len(table)))
    return min((float(sum(table[row, column] for row, column in enumerate(way))), list(way)) for way in ways)


def expected(table: np.ndarray, margin: float) -> list[tuple[int, int]]:
    best, way = least(table)
    out = []
    for row, column in enumerate(way):
        without = table.copy()
        without[row, column] = 0.0
        if table[row, column] < 0 and least(without)[0] - best >= margin:
            out.append((row, column))
    return out


def found(table: np.ndarray, margin: float) -> list[tuple[int, int]]:
    first, second = np.nonzero(table)
    rows, columns = clear_matches(len(table), first, second, table[first, second], margin)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def test_as_by_trying_all() -> None:
    rng = np.random.default_rng(0)
    seen = 0
    for _ in range(60):
        table = np.where(rng.random((5, 5)) < 0.6, -rng.exponential(4.0, (5, 5)), 0.0)
        assert found(table, 2.0) == expected(table, 2.0)
        seen += len(expected(table, 2.0))
    assert 60 < seen < 240


@pytest.mark.parametrize(
    ("table", "margin", "matches"),
    [
        ([[-5.0, -5.0], [-5.0, -5.0]], 1.0, []),
        ([[-5.0, -5.0], [-5.0, -3.0]], 1.0, [(0, 1), (1, 0)]),
        ([[-6.0, -5.0], [-5.0, 0.0]], 2.0, [(0, 1), (1, 0)]),
        (np.zeros((3, 3)), 1.0, []),
    ],
    ids=["two ways alike", "one is better", "the best link alone would leave the other two with nothing", "no links"],
)
def test_the_whole_decides(table: list[list[float]], margin: float, matches: list[tuple[int, int]]) -> None:
    assert found(np.array(table), margin) == matches


@pytest.mark.slow
def test_many_in_a_row_are_as_quickly_told() -> None:
    """Ten thousand who compete with their neighbours only: nothing of the size of their square is made."""
    n = 10_000
    row = np.arange(n)
    first, second = np.concatenate([row, row[1:]]), np.concatenate([row, row[:-1]])
    cost = np.concatenate([np.full(n, -5.0), np.full(n - 1, -4.0)])
    before, after = clear_matches(n, first, second, cost, 0.5)
    np.testing.assert_array_equal(before, row)
    np.testing.assert_array_equal(after, row)
