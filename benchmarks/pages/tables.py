"""Tables of results in Markdown, the figures in their cells, and the note on the machine."""

from __future__ import annotations

import math
import os
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

PACKAGES = ("passerby", "numpy", "scipy", "poselib")
"""Whose versions decide over the last digits."""
WIDEST = 60
"""Characters that a column of a table is padded to: in a column of sentences most of the page would be spaces."""


@dataclass(frozen=True)
class Table:
    """A table of text; `str` gives its Markdown."""

    head: list[str]
    rows: list[list[str]]

    def __str__(self) -> str:
        """Markdown; columns are padded up to `WIDEST` characters."""
        cells = [self.head, *self.rows]
        widths = [min(WIDEST, max(3, *(len(row[column]) for row in cells))) for column in range(len(self.head))]
        lines = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in cells]
        return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])

    def choose(self, columns: Sequence[str] = (), rows: Mapping[str, str] | None = None) -> Table:
        """Some columns, all where none is named, of the rows whose cells begin with a regular expression by column.

        Raises:
            ValueError: a column does not exist exactly once, or no row is left.
        """
        places = [self._place(column) for column in columns] or range(len(self.head))
        rules = [(self._place(column), re.compile(rule)) for column, rule in (rows or {}).items()]
        kept = [row for row in self.rows if all(rule.match(row[place]) for place, rule in rules)]
        if self.rows and not kept:
            raise ValueError(f"no row of the table {' | '.join(self.head)} is as wanted: {rows}")
        return table([self.head[place] for place in places], [[row[place] for place in places] for row in kept])

    def _place(self, column: str) -> int:
        if self.head.count(column) != 1:
            raise ValueError(f"{self.head.count(column)} columns are named {column!r}")
        return self.head.index(column)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of cells that are written as text."""
    return Table(list(head), [[str(cell) for cell in row] for row in rows])


def number(value: float | None, digits: int = 1) -> str:
    """A figure, or a dash where it is undefined."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def errors(mm: float | None, degrees: float | None) -> str:
    """Position and orientation error."""
    return f"{number(mm)} mm {number(degrees, 3)}°"


def reached(values: Sequence[float | None], acceptable: Sequence[float], aim: Sequence[float]) -> str:
    """`aim`, `acceptable` or `missed`: the worst of the figures decides."""
    if any(value is None for value in values):
        return "**missed**"
    known = [value for value in values if value is not None]
    if all(value <= limit for value, limit in zip(known, aim, strict=True)):
        return "aim"
    return "acceptable" if all(value <= limit for value, limit in zip(known, acceptable, strict=True)) else "**missed**"


def yes(condition: bool) -> str:
    """Whether a goal is met."""
    return "yes" if condition else "**no**"


def load() -> float:
    """Mean number of running processes over the last minute."""
    return os.getloadavg()[0]


def machine_note() -> str:
    """What the figures were made on."""
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    return f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, {versions}."


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
