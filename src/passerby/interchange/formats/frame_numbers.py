"""Frame numbers from the names of pictures and files.

A name ends with its number, before its ending: `cam1_000012.jpg` is frame 12. What stands before the number is the same in all
names of one recording; where it is not, it is unknown which of several numbers counts, or whether the names are of several
recordings, and that is an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath

from passerby.common.errors import InputError
from passerby.common.text import shortened

LARGEST = 2**53
"""Above it a float64, which other tools keep numbers in, no longer tells whole numbers apart."""
_LAST_NUMBER = re.compile(r"(.*?)(\d+)$", re.DOTALL)


def frames_of_names(names: Iterable[str], place: str) -> Mapping[str, int]:
    """The frame of each name, with or without a file's ending.

    Args:
        names: of pictures or files, with their folders where these count.
        place: what a message begins with.

    Raises:
        InputError: a name does not end with a number; names differ in more than it; two names have one number.
    """
    found: dict[str, int] = {}
    name_of: dict[int, str] = {}
    first: tuple[str, str] | None = None
    for name in names:
        if name in found:
            continue
        path = PurePosixPath(name.replace("\\", "/"))
        match = _LAST_NUMBER.match(path.stem)
        if match is None or int(match[2]) > LARGEST:
            raise InputError(f"{place}: {shortened(name)} does not end with a frame number: name images as in cam1_000012.jpg")
        before = f"{path.parent}/{match[1]}"
        if first is not None and before != first[0]:
            raise InputError(
                f"{place}: {shortened(first[1])} and {shortened(name)} differ in more than the number at their end: "
                "give one camera's recording"
            )
        first = first or (before, name)
        frame = int(match[2])
        if frame in name_of:
            raise InputError(
                f"{place}: {shortened(name_of[frame])} and {shortened(name)} are both frame {frame}: give one camera's "
                "recording"
            )
        found[name], name_of[frame] = frame, name
    return found
