"""Names for the types of arrays, and tables whose columns are arrays of equal length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
else:
    DataclassInstance = object

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
ABSENT = {"absent": True}
"""Metadata of a field that is left out of a file while it is None."""


def frozen(values: Floats) -> Floats:
    """Return a copy of the array that is read-only."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


UNFILLED: Any = None
"""Default of a column that has the type of an array but may be absent: code that reads the column fills it first."""


class Columns(DataclassInstance):
    """A table of N rows. Every field is a column (N, ...), None if the column is unknown, or a tuple that all rows share."""

    def take(self, rows: NDArray[np.generic] | slice) -> Self:
        """Return a table of the given rows (indices, a mask, or a slice)."""
        return type(self)(**{
            name: column[rows] if isinstance(column, np.ndarray) else column for name, column in self._columns().items()
        })  # fmt: skip

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenate the rows of tables. A column that is None in one of them becomes None; tuples are the first table's."""
        return cls(**{name: _joined([getattr(part, name) for part in parts]) for name in _names(cls)})

    def _columns(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in _names(type(self))}


@cache
def _names(table: type[DataclassInstance]) -> tuple[str, ...]:
    return tuple(item.name for item in fields(table))


def _joined(parts: list[Any]) -> Any:
    if any(part is None for part in parts):
        return None
    return parts[0] if isinstance(parts[0], tuple) else np.concatenate(parts)
