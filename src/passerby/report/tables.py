"""Tables that scroll in their own box and can be sorted and copied as CSV; figures as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

LONG = 24
"""Number of rows above which a table also scrolls vertically in its box and has a search field."""
MISSING = "–"
"""Text of an undefined figure."""
UNKNOWN = "unknown"
"""Text of a figure with an infinite sigma: no evidence constrains it."""


@dataclass(frozen=True)
class Column:
    """The head of a column."""

    title: str
    unit: str = ""
    numeric: bool = True
    hint: str = ""
    """Meaning of the figures, shown on hover and read by screen readers."""

    @property
    def csv(self) -> str:
        """The head in a CSV file."""
        return f"{self.title} {self.unit}".strip()


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One entry of a table."""

    shown: str
    value: str | float | None = None
    """Value for sorting and copying, in full precision; None: the shown text, or an empty value in a numeric cell."""
    kind: str = ""
    """Class of the cell; stands-out: the figure is conspicuous."""
    numeric: bool = False
    inner: str = ""
    """Class of the shown text within the cell; code: it is a name in code."""
    href: str = ""
    """Target of a link."""
    colour: str = ""
    """Colour of a dot before the text."""
    bar: float | None = None
    """Length of a bar before the text, per cent."""
    note: str = ""
    """Text in small letters after the text."""
    why: bool = False
    """Whether the note is a reason, which is placed below the text."""

    @property
    def exact(self) -> str:
        """The value for sorting and copying; a number has all its digits, as in `calibration.json`."""
        value = self.value if self.value is not None or self.numeric else self.shown
        return "" if value is None else value if isinstance(value, str) else repr(value)


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table in a box that scrolls by itself; the first column names the row."""

    identifier: str
    """Unique on the page."""
    caption: str
    """Description of the content for screen readers."""
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    sortable: bool = True
    """Whether the heads of its columns are buttons that sort it."""
    copy: bool = True
    """Whether a button copies it as CSV."""

    @property
    def long(self) -> bool:
        """Whether it also scrolls vertically in its box and has a search field."""
        return len(self.rows) > LONG


def number(value: float | None, digits: int = 1, *, sign: bool = False, **more: Any) -> Cell:
    """Return a cell with a figure, or with a dash if it is undefined. `more`: further fields of `Cell`."""
    shown = f"{value:+.{digits}f}" if sign and value is not None and round(value, digits) != 0 else figure(value, digits)
    return Cell(shown=shown, value=value, numeric=True, **more)


def text(shown: str, value: str | None = None, **more: Any) -> Cell:
    """Return a cell with text. `more`: further fields of `Cell`."""
    return Cell(shown=shown, value=value, **more)


def share_cell(percent: float, digits: int) -> Cell:
    """Return a cell with a share, per cent, as a bar and a figure."""
    return number(percent, digits, kind="pull-cell", bar=min(max(percent, 0.0), 100.0))


def figure(value: float | None, digits: int = 1, unit: str = "") -> str:
    """Write a figure as text; a dash if it is undefined."""
    # Adding zero turns -0.0 into 0.0.
    return MISSING if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def count(number: int, what: str, several: str | None = None) -> str:
    """Write a number with its noun: `1 camera`, `2 cameras`."""
    return f"{number} {what if number == 1 else several or what + 's'}"


def list_names(names: Sequence[str]) -> str:
    """Write a list of names: `A, B and C`."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1] if names else ""
