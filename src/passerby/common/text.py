"""Words and names in messages.

How values look in a notebook. The drawing stands far above the values, so the package's head hands it down.
"""

from __future__ import annotations

import difflib
import re
import reprlib
from collections.abc import Callable, Sequence
from typing import Any

LISTED = 50
"""So many names are listed in a message: a site has hundreds of cameras."""
Drawing = Callable[[object], str]
_drawing: list[Drawing] = []


def nearest(key: str, known: list[str]) -> str:
    """The remedy for a misspelt name."""
    same = [name for name in known if name.casefold() == key.casefold()]
    close = same or difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else f"there are {listed(known)}"


def listed(names: Sequence[str]) -> str:
    """Names in a message, the first of very many."""
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")


def shortened(value: Any) -> str:
    """A value as a message shows it; quick even where a few bytes of YAML stand for endless lists."""
    short = reprlib.Repr()
    short.maxlevel, short.maxlist, short.maxdict, short.maxstring, short.maxlong = 3, 16, 8, 90, 40
    short.maxother = 90
    text = short.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def shortened_text(text: str, most: int = 100) -> str:
    """Text out of a file as a message shows it, without quotes."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


_NUMBER = re.compile(r"[0-9]+")


def natural_key(text: str) -> tuple[str | int, ...]:
    """A key that sorts cam2 before cam10, and capitals with small letters."""
    parts = re.split(r"([0-9]+)", text.casefold())
    return tuple(int(part) if index % 2 else part for index, part in enumerate(parts))


def set_drawing(drawing: Drawing) -> None:
    """Say what draws values as HTML."""
    _drawing[:] = [drawing]


def html_of(value: object) -> str | None:
    """A value as HTML; None, at which a notebook prints its text, where nothing draws."""
    return _drawing[0](value) if _drawing else None
