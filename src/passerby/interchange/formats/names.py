"""Cameras' names as other tools, and file systems, can bear them."""

from __future__ import annotations

import re
from collections.abc import Iterable

FORBIDDEN_IN_FILES = re.compile(r"[^\w.+@ -]")
"""Everything but letters, digits, spaces and . _ + @ -"""


NO_DOT, LETTER = re.compile(r"[^.]"), re.compile(r"[A-Za-z]")
"""How a name may begin. Files that begin with a dot are hidden; an empty name begins with nothing."""


def tame_names(
    names: Iterable[str],
    forbidden: re.Pattern[str] = FORBIDDEN_IN_FILES,
    first: re.Pattern[str] = NO_DOT,
    prefix: str = "camera_",
) -> dict[str, str]:
    """Each name with what is forbidden replaced by `_`; no two alike, not even where the case of letters does not count.

    Each begins as `first` says; where it would not, `prefix` is put before it. Names that can stay do stay, whatever the others
    are, but for those that differ from an earlier one in case alone: they may become file names.
    """
    names = list(names)
    tame: dict[str, str] = {}
    changing: list[tuple[str, str]] = []
    taken: set[str] = set()
    for name in names:
        safe = forbidden.sub("_", name).strip(" ")
        if safe == name and first.match(name) and name.casefold() not in taken:
            tame[name] = name
            taken.add(name.casefold())
        else:
            changing.append((name, safe if first.match(safe) else prefix + safe))
    for name, base in changing:
        unique, number = base, 2
        while unique.casefold() in taken:
            unique, number = f"{base}_{number}", number + 1
        tame[name] = unique
        taken.add(unique.casefold())
    return {name: tame[name] for name in names}
