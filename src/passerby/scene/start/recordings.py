"""Recordings that a network video recorder has cut into pieces, known by the times in their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path

from passerby.perception.sources.chapter_names import without_chapter

Length = Callable[[Path], float | None]
"""Seconds that a video lasts; None where it does not tell."""

_DATE_AND_TIME = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[ T_.\-]{0,3}(\d\d)[-_.:hH]?(\d\d)(?:[-_.:mM]?(\d\d))?(?!\d)"
)
_EPOCH = re.compile(r"(?<!\d)(1[4-9]\d{8})(\d{3})?(?!\d)")
"""Seconds, or thousandths of seconds, since 1970."""
_CLOCK = re.compile(r"(?:([01]\d|2[0-3])[-_.])?([0-5]\d)[-_.]([0-5]\d)")
"""The whole name: minutes and seconds as Frigate has them, or hours before these."""
_NUMBERS = re.compile(r"[\d\s._\-]*\d[\d\s._\-]*")

SLACK_S = 5.0
"""Pieces may overlap so much: recorders cut at key frames, and some begin a piece before the last has ended."""
LOOKED_INTO = 8
"""Pieces whose lengths are looked at: a day has thousands."""
BREAK_S = 60.0
"""Between two videos that are two pieces. Of more than two, breaks may be longer, as where only movement is recorded."""
NUMBERED = 3
"""So many videos in a camera's folder with only numbers for names are pieces."""


def start_of(stem: str) -> tuple[str, float] | None:
    """What the time in a name leaves of it, and that time in seconds; None for a name without one."""
    if clock := _CLOCK.fullmatch(stem):
        hours, minutes, seconds = (int(part or 0) for part in clock.groups())
        return "", 3600.0 * hours + 60.0 * minutes + seconds
    if found := _DATE_AND_TIME.search(stem):
        try:
            time = datetime(*(int(part or 0) for part in found.groups())).timestamp()  # type: ignore[arg-type]
        except (ValueError, OverflowError):
            return None
        return without_chapter(_DATE_AND_TIME.sub("", stem).casefold()), time
    if found := _EPOCH.search(stem):
        return _EPOCH.sub("", stem).casefold(), int(found[1]) + int(found[2] or 0) / 1000.0
    return None


def time_in(stem: str) -> tuple[int, int] | None:
    """Where the time in a name begins and ends; None for a name without one."""
    found = _DATE_AND_TIME.search(stem) or _EPOCH.search(stem)
    return None if found is None or start_of(stem) is None else found.span()


def pieces_among(videos: Sequence[Path], length: Length) -> list[Path]:
    """Videos that are pieces of one recording: alike in name but for the time, and one over before the next begins.

    Videos of several cameras with the times in their names, as phones give them, overlap: they were filmed together.

    Args:
        videos: in one folder.
        length: of a video; asked of the first `LOOKED_INTO` of each group only.

    Returns:
        The pieces of the first such recording, in order; empty where there is none.
    """
    groups: dict[tuple[str, str], list[tuple[float, Path]]] = {}
    for path in videos:
        if found := start_of(path.stem):
            groups.setdefault((found[0], path.suffix.lower()), []).append((found[1], path))
    for group in groups.values():
        if _one_after_another(sorted(group), length):
            return [path for _, path in sorted(group)]
    return []


def is_numbered_series(videos: Sequence[Path]) -> bool:
    """Whether the videos in one camera's folder are called by numbers only: 000, 001, 002."""
    return sum(_NUMBERS.fullmatch(path.stem) is not None for path in videos) >= NUMBERED


def _one_after_another(group: Sequence[tuple[float, Path]], length: Length) -> bool:
    """Whether each video of a group, sorted by time, has ended when the next begins."""
    known = [(start, seconds) for start, path in group[:LOOKED_INTO] if (seconds := length(path)) is not None]
    if len(known) < 2:
        return False
    breaks = [after - (start + seconds) for (start, seconds), (after, _) in pairwise(known)]
    apart = all(gap >= -min(SLACK_S, seconds / 2) for gap, (_, seconds) in zip(breaks, known, strict=False))
    return apart and (len(known) > 2 or breaks[0] <= max(BREAK_S, known[0][1]))
