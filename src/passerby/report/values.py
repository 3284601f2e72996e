"""Reading what `calibration.json` holds without trusting that every key is there: older Passerbys wrote fewer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

MISSING = "–"
"""Stands where a figure is undefined."""
UNKNOWN = "unknown"
"""Stands where a figure has an infinite sigma: no evidence constrains it."""


def table_of(value: Any, *keys: str) -> Mapping[str, Any]:
    """The table that the keys lead to; an empty one where there is none."""
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value if isinstance(value, Mapping) else {}


def rows_of(value: Any) -> list[Mapping[str, Any]]:
    """The tables of a list; none where `value` is no list."""
    return (
        [row for row in value if isinstance(row, Mapping)] if isinstance(value, Sequence) and not isinstance(value, str) else []
    )


def number_of(value: Any) -> float | None:
    """A finite number, else None."""
    sound = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if sound else None


def texts_of(value: Any) -> list[str]:
    """The entries of a list as text; none where `value` is no list."""
    return [str(entry) for entry in value] if isinstance(value, Sequence) and not isinstance(value, str) else []


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
