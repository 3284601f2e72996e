"""Figures as text."""

from __future__ import annotations

from collections.abc import Sequence

MISSING = "–"
"""Stands where a figure is undefined."""
UNKNOWN = "unknown"
"""Stands where a figure has an infinite sigma: no evidence constrains it."""


def figure(value: float | None, digits: int = 1, unit: str = "") -> str:
    """A figure as text; a dash where it is undefined."""
    # Adding zero turns -0.0 into 0.0.
    return MISSING if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def count(number: int, what: str, several: str | None = None) -> str:
    """`1 camera`, `2 cameras`."""
    return f"{number} {what if number == 1 else several or what + 's'}"


def listed(names: Sequence[str]) -> str:
    """`A, B and C`."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1] if names else ""
