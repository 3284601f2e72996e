"""Tables of columns: rows are taken and joined in all columns alike."""

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Columns, Floats, Ints


@dataclass(frozen=True, eq=False)
class Table(Columns):
    number: Ints
    place: Floats
    speed: Floats | None = None


FULL = Table(np.arange(4), np.arange(8.0).reshape(4, 2), np.arange(4) / 2)


def test_rows():
    taken = FULL.take(np.array([3, 1]))
    assert (taken.number.tolist(), taken.place.tolist(), taken.speed.tolist()) == ([3, 1], [[6, 7], [2, 3]], [1.5, 0.5])
    assert (FULL.take(FULL.number > 2).number.tolist(), FULL.take(slice(1, 3)).number.tolist()) == ([3], [1, 2])
    assert Table(FULL.number, FULL.place).take(np.array([0])).speed is None


def test_joined():
    joined = Table.joined([FULL.take(slice(0, 1)), FULL.take(slice(2, 4))])
    assert (joined.number.tolist(), joined.speed.tolist()) == ([0, 2, 3], [0, 1, 1.5])
    assert Table.joined([FULL, Table(FULL.number, FULL.place)]).speed is None


@dataclass(frozen=True, eq=False)
class Named(Columns):
    number: Ints
    names: tuple[str, ...] = ()


def test_a_tuple_is_shared_by_all_rows():
    table = Named(np.array([1, 0, 1]), ("a", "b"))
    assert (table.take(np.array([0])).names, Named.joined([table, table]).names) == (("a", "b"), ("a", "b"))
    assert len(Named.joined([table, table]).number) == 6
