"""Cameras' names as other tools, and file systems, can bear them."""

from __future__ import annotations

import re
from collections.abc import Iterable

FORBIDDEN_IN_FILES = re.compile(r"[^\w.+@ -]")
"""Everything but letters, digits, spaces and . _ + @ -"""


def tame_names(names: Iterable[str], forbidden: re.Pattern[str] = FORBIDDEN_IN_FILES, prefix: str = "camera") -> dict[str, str]:
    """Each name with what is forbidden replaced by `_`; no two alike, not even where the case of letters does not count.

    Names that can stay do stay, whatever the others are. A name that would begin with a dot or be empty gets `prefix`.
    """
    names = list(names)
    tame = {name: _tamed(name, forbidden, prefix) for name in names}
    taken = {name.casefold() for name in names if tame[name] == name}
    for name in names:
        if tame[name] == name:
            continue
        base, number = tame[name], 2
        while tame[name].casefold() in taken:
            tame[name], number = f"{base}_{number}", number + 1
        taken.add(tame[name].casefold())
    return tame


def _tamed(name: str, forbidden: re.Pattern[str], prefix: str) -> str:
    replaced = forbidden.sub("_", name).strip(" ")
    return prefix + replaced if not replaced or replaced.startswith(".") else replaced
