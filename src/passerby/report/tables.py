"""Tables that scroll in their own box, can be sorted, and can be copied as CSV; figures as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

LONG = 24
"""Rows beyond which a table scrolls up and down in its box too, and can be searched."""
MISSING = "–"
"""Stands where a figure is undefined."""
UNKNOWN = "unknown"
"""Stands where a figure has an infinite sigma: no evidence constrains it."""


@dataclass(frozen=True)
class Column:
    """The head of a column."""

    title: str
    unit: str = ""
    numeric: bool = True
    hint: str = ""
    """What the figures are, shown on hover and read out."""

    @property
    def csv(self) -> str:
        """The head in a CSV file."""
        return f"{self.title} {self.unit}".strip()


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One entry of a table."""

    shown: str
    value: str | float | None = None
    """What is sorted by and copied, in full precision; None: as shown, or nothing in a numeric cell."""
    kind: str = ""
    """Class of the cell: stands-out, for what stands out."""
    numeric: bool = False
    inner: str = ""
    """Class of what is shown within the cell; code: it is a name in code."""
    href: str = ""
    """Where it leads."""
    colour: str = ""
    """Of a dot before it."""
    bar: float | None = None
    """Length of a bar before it, per cent."""
    note: str = ""
    """In small letters after it."""
    why: bool = False
    """Whether the note is a reason, and stands below."""

    @property
    def exact(self) -> str:
        """What is sorted by and copied; a number with all its digits, as `calibration.json` has it."""
        value = self.value if self.value is not None or self.numeric else self.shown
        return "" if value is None else value if isinstance(value, str) else repr(value)


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table in a box that scrolls by itself; the first column names the row."""

    identifier: str
    """Unique on the page."""
    caption: str
    """What it holds, for those who cannot see it."""
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    sortable: bool = True
    """Whether its heads are buttons that sort it."""
    copy: bool = True
    """Whether a button copies it as CSV."""

    @property
    def long(self) -> bool:
        """Whether it scrolls up and down in its box too, and can be searched."""
        return len(self.rows) > LONG


def number(value: float | None, digits: int = 1, *, sign: bool = False, **more: Any) -> Cell:
    """A cell with a figure; a dash where it is undefined. `more`: as of `Cell`."""
    shown = f"{value:+.{digits}f}" if sign and value is not None and round(value, digits) != 0 else figure(value, digits)
    return Cell(shown=shown, value=value, numeric=True, **more)


def text(shown: str, value: str | None = None, **more: Any) -> Cell:
    """A cell with text. `more`: as of `Cell`."""
    return Cell(shown=shown, value=value, **more)


def share_cell(percent: float, digits: int) -> Cell:
    """A cell with a share as a bar and its figure."""
    return number(percent, digits, kind="pull-cell", bar=min(max(percent, 0.0), 100.0))


def figure(value: float | None, digits: int = 1, unit: str = "") -> str:
    """A figure as text; a dash where it is undefined."""
    # Adding zero turns -0.0 into 0.0.
    return MISSING if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def count(number: int, what: str, several: str | None = None) -> str:
    """`1 camera`, `2 cameras`."""
    return f"{number} {what if number == 1 else several or what + 's'}"


def list_names(names: Sequence[str]) -> str:
    """`A, B and C`."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1] if names else ""
