"""How values look in a notebook. The drawing stands far above the values, so the package's head hands it down."""

from __future__ import annotations

from collections.abc import Callable

Drawing = Callable[[object], str]
_drawing: list[Drawing] = []


def set_drawing(drawing: Drawing) -> None:
    """Say what draws values as HTML."""
    _drawing[:] = [drawing]


def html_of(value: object) -> str | None:
    """A value as HTML; None, at which a notebook prints its text, where nothing draws."""
    return _drawing[0](value) if _drawing else None
