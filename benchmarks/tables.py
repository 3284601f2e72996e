"""Markdown tables and the note on the machine that stands above them."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path


@dataclass(frozen=True)
class Section:
    """One page of results."""

    name: str
    """File name without ending."""
    text: str


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table, columns padded so that it reads well as text too."""
    cells = [list(head), *([str(cell) for cell in row] for row in rows)]
    widths = [max(3, *(len(row[column]) for row in cells)) for column in range(len(head))]
    lines = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in cells]
    return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])


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
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("passerby", "numpy", "scipy"))
    return f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, {versions}."


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
