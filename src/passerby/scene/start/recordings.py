"""Analysis of file names: recordings in pieces, chapters, and the names of the cameras.

Names that differ only by a counter may also be those of several cameras. So chapters must have one format, and if the files
state their times, each must begin when the one before it ends. Without such times, the naming scheme of a maker decides; or, in
the folder of one camera, a counter that begins at 0 or 1 and has no gaps.

Names of cameras are made from the names of files, and matched with the names in a calibration. The rules are few and simple, so
that a user can predict a name: see `camera_names` and `match_names`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path

from passerby.interchange.rig_toml import METADATA
from passerby.perception.sources.name_times import ChapterName, chapter_name, strip_chapter
from passerby.perception.video_probe import VideoInfo

Length = Callable[[Path], float | None]
"""Returns the duration of a video, seconds; None if it is unknown."""
_DATE_AND_TIME = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[ T_.\-]{0,3}(\d\d)[-_.:hH]?(\d\d)(?:[-_.:mM]?(\d\d))?(?!\d)"
)
_EPOCH = re.compile(r"(?<!\d)(1[4-9]\d{8})(\d{3})?(?!\d)")
"""A time in seconds, or in milliseconds, since 1970."""
_CLOCK = re.compile(r"(?:([01]\d|2[0-3])[-_.])?([0-5]\d)[-_.]([0-5]\d)")
"""A whole name that is a time: minutes and seconds, as Frigate writes them, or hours, minutes and seconds."""
_NUMBERS = re.compile(r"[\d\s._\-]*\d[\d\s._\-]*")
SLACK_S = 5.0
"""Maximum overlap of pieces, seconds: recorders cut at key frames, and some begin a piece before the last has ended."""
LOOKED_INTO = 8
"""Number of pieces whose lengths are read: a day has thousands."""
BREAK_S = 60.0
"""Maximum break between two videos that are pieces, seconds. Breaks between more than two may be longer, for example if only
movement is recorded."""
NUMBERED = 3
"""Minimum number of videos in a camera's folder that are pieces if their names have only numbers."""
Look = Callable[[Path], VideoInfo | None]
"""Returns the metadata of a video; None if it cannot be read."""
COMPANIONS = (".lrv", ".thm")
"""Endings of the files that action cameras write beside a video: a small copy of it, and an image."""
SAME_RATE = 1e-3
_WORD = re.compile(r"[^\s_.\-]+")


def start_of(stem: str) -> tuple[str, float] | None:
    """Split a name into the part without the time, and the time in seconds; None for a name without a time."""
    if clock := _CLOCK.fullmatch(stem):
        hours, minutes, seconds = (int(part or 0) for part in clock.groups())
        return "", 3600.0 * hours + 60.0 * minutes + seconds
    if found := _DATE_AND_TIME.search(stem):
        try:
            time = datetime(*(int(part or 0) for part in found.groups())).timestamp()  # type: ignore[arg-type]
        except (ValueError, OverflowError):
            return None
        return strip_chapter(_DATE_AND_TIME.sub("", stem).casefold()), time
    if found := _EPOCH.search(stem):
        return _EPOCH.sub("", stem).casefold(), int(found[1]) + int(found[2] or 0) / 1000.0
    return None


def time_in(stem: str) -> tuple[int, int] | None:
    """Return the begin and the end index of the time in a name; None for a name without a time."""
    found = _DATE_AND_TIME.search(stem) or _EPOCH.search(stem)
    return None if found is None or start_of(stem) is None else found.span()


def pieces_among(videos: Sequence[Path], length: Length) -> list[Path]:
    """Find videos that are pieces of one recording: names that differ only in the time, and each ends before the next begins.

    Videos of several cameras with times in their names, as phones write them, overlap, because they were filmed together.

    Args:
        videos: videos in one folder.
        length: returns the duration of a video; called only for the first `LOOKED_INTO` of each group.

    Returns:
        The pieces of the first such recording, in order; empty if there is none.
    """
    groups: dict[tuple[str, str], list[tuple[float, Path]]] = {}
    for path in videos:
        if found := start_of(path.stem):
            groups.setdefault((found[0], path.suffix.lower()), []).append((found[1], path))
    for group in groups.values():
        if _are_consecutive(sorted(group), length):
            return [path for _, path in sorted(group)]
    return []


def is_numbered_series(videos: Sequence[Path]) -> bool:
    """Return whether videos in one camera's folder have names of numbers only: 000, 001, 002."""
    return sum(_NUMBERS.fullmatch(path.stem) is not None for path in videos) >= NUMBERED


def _are_consecutive(group: Sequence[tuple[float, Path]], length: Length) -> bool:
    """Return whether each video of a group, sorted by time, has ended when the next begins."""
    known = [(start, seconds) for start, path in group[:LOOKED_INTO] if (seconds := length(path)) is not None]
    if len(known) < 2:
        return False
    breaks = [after - (start + seconds) for (start, seconds), (after, _) in pairwise(known)]
    apart = all(gap >= -min(SLACK_S, seconds / 2) for gap, (_, seconds) in zip(breaks, known, strict=False))
    return apart and (len(known) > 2 or breaks[0] <= max(BREAK_S, known[0][1]))


@dataclass(frozen=True)
class Chapters:
    """One recording of two chapters or more."""

    name: str
    paths: tuple[Path, ...]
    """The chapters in order."""
    pattern: str
    """Pattern that matches only the names of these chapters."""


def find_chapters(videos: Sequence[Path], look: Look, one_camera: bool) -> list[Chapters]:
    """Find the recordings in chapters among videos of one folder, in the order of the videos.

    Args:
        videos: videos in one folder.
        look: returns the metadata of a video; called for the first `LOOKED_INTO` chapters of each recording.
        one_camera: whether all videos are known to be of one camera.
    """
    groups = find_named_alike(videos)
    return [
        Chapters(names[0].recording, tuple(paths), f"{names[0].pattern}{paths[0].suffix}")
        for names, paths in groups
        if _is_one_recording(names, paths, look, one_camera)
    ]


def find_named_alike(videos: Sequence[Path]) -> list[tuple[list[ChapterName], list[Path]]]:
    """Group two or more videos whose names differ only by a counter, sorted by this counter."""
    groups: dict[tuple[str, str], list[tuple[int, Path, ChapterName]]] = {}
    for path in videos:
        if (name := chapter_name(path.stem)) is not None:
            groups.setdefault((name.pattern, path.suffix), []).append((name.chapter, path, name))
    ordered = [sorted(group, key=lambda one: one[:2]) for group in groups.values() if len(group) > 1]
    return [([name for *_, name in group], [path for _, path, _ in group]) for group in ordered]


def _is_one_recording(names: Sequence[ChapterName], paths: Sequence[Path], look: Look, one_camera: bool) -> bool:
    infos = [info for path in paths[:LOOKED_INTO] if (info := look(path)) is not None]
    if any(not _have_one_format(infos[0], info) for info in infos[1:]):
        return False
    if names[0].scheme:
        return True
    if (follow := _follow_by_clock(infos)) is not None:
        return follow
    numbers = [name.chapter for name in names]
    return one_camera and not names[0].numbers_cameras and numbers[0] <= 1 and numbers[-1] - numbers[0] == len(numbers) - 1


def _have_one_format(first: VideoInfo, second: VideoInfo) -> bool:
    same_rate = abs(first.average_fps / second.average_fps - 1) <= SAME_RATE or (first.variable and second.variable)
    return (first.size, first.codec) == (second.size, second.codec) and same_rate


def _follow_by_clock(infos: Sequence[VideoInfo]) -> bool | None:
    """Return whether each video begins when the one before it ends, by their stated times; None if these do not show it.

    A creation time is that of the beginning or that of the end; this depends on the camera.
    """
    stated = [(info.clock.created_s, info.seconds) for info in infos]
    known = [(created, seconds) for created, seconds in stated if created is not None and seconds is not None]
    if len(known) < max(2, len(infos)) or len({created for created, _ in known}) == 1:
        return None
    steps = [(after[0] - before[0], before[1], after[1]) for before, after in pairwise(known)]
    return any(all(abs(step - lengths[which]) <= SLACK_S for step, *lengths in steps) for which in (0, 1))


def set_aside_small_copies(videos: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Separate videos into those that are used and those that are small copies of others beside them."""
    held = set(videos)
    copies = [
        path
        for path in videos
        if (name := chapter_name(path.stem)) is not None
        and name.copy
        and any(path.with_name(f"G{kind}{path.name[2:]}") in held for kind in "HXS")
    ]
    return [path for path in videos if path not in copies], copies


def companions_note(files: Sequence[Path], copies: Sequence[Path]) -> list[str]:
    """Return one note about the files that a camera wrote beside its videos, if there are any."""
    found = [*copies, *(path for path in files if path.suffix.lower() in COMPANIONS)]
    if not found:
        return []
    more = ", ..." if len(found) > 3 else ""
    return [
        f"not used: {len(found)} small {'copies' if len(found) > 1 else 'copy'} or preview images beside the videos: "
        f"{', '.join(path.name for path in found[:3])}{more}"
    ]


def valid_name(text: str) -> str:
    """Replace characters that a camera's name cannot have (see `passerby.scene.scene.CAMERA_NAME`) by spaces."""
    name = re.sub(r"\s+", " ", re.sub(r"[^\w .+@-]", " ", text))
    name = name.lstrip(" .+").rstrip(" .") or "camera"
    return f"{name} camera" if name == METADATA else name


def camera_names(texts: Sequence[str]) -> list[str]:
    """Make one valid name from each text, all different.

    Words (separated by spaces, `_`, `-` and full stops) with which all texts begin, or end, are dropped, if the rest of each
    text has a letter: "walk_cam1_1080p" and "walk_cam2_1080p" become cam1 and cam2, "cam_1" and "cam_2" stay. A name that
    occurs again gets "-2", "-3", ...
    """
    whole = [valid_name(text) for text in texts]
    words = [list(_WORD.finditer(text)) for text in whole]
    first, last = _count_common_words(words)

    def without(first: int, last: int) -> list[str]:
        return [
            text[found[first].start() : found[len(found) - 1 - last].end()] if found else text
            for text, found in zip(whole, words, strict=True)
        ]

    names = without(first, last)
    while not _all_have_letters(names) and (first or last):
        first, last = (first - 1, last) if first else (0, last - 1)
        names = without(first, last)
    if not _all_have_letters(names) or (first, last) == (0, 0):
        names = whole
    return _make_unique([valid_name(name) for name in names])


def match_names(cameras: Sequence[str], others: Sequence[Sequence[str]], *, by_number: bool = True) -> dict[int, int]:
    """Match other items with cameras: map the index of a camera to the index of an item, each at most once.

    Args:
        cameras: The cameras' names.
        others: The names of each of the other items.
        by_number: Whether numbers in the names may match them.

    Items are matched by name; then by name without regard to capitals, spaces and `_ - .`; then by the last number in the name,
    if this gives every remaining camera an item of its own: cameras 1 to 4 are not matched with tables 0 to 3.
    """
    found: dict[int, int] = {}
    for same in (str, _simplify):
        found |= _match_names(same, cameras, others, found)
    numbered = _match_names(_find_last_number, cameras, others, found) if by_number else {}
    if len(found) + len(numbered) == len(cameras):
        found |= numbered
    return found


def _match_names(
    same: Callable[[str], object], cameras: Sequence[str], others: Sequence[Sequence[str]], known: dict[int, int]
) -> dict[int, int]:
    """Match names whose values of `same` are equal, not None, and unique on both sides."""
    ours: dict[object, list[int]] = {}
    theirs: dict[object, list[int]] = {}
    for index, name in enumerate(cameras):
        if index not in known:
            ours.setdefault(same(name), []).append(index)
    for index, names in enumerate(others):
        if index not in known.values():
            for key in {same(name) for name in names}:
                theirs.setdefault(key, []).append(index)
    pairs = {
        ours[key][0]: theirs[key][0]
        for key in ours
        if key is not None and len(ours[key]) == 1 and len(theirs.get(key, ())) == 1
    }
    return pairs if len(set(pairs.values())) == len(pairs) else {}


def _simplify(name: str) -> str:
    return re.sub(r"[\s_.\-]", "", name.casefold())


def _find_last_number(name: str) -> str | None:
    """Return the digits of the last number in a name, without leading zeros, as text: the number may be very long."""
    numbers = re.findall("[0-9]+", name)
    return numbers[-1].lstrip("0") if numbers else None


def _count_common_words(words: list[list[re.Match[str]]]) -> tuple[int, int]:
    """Count the words that all texts share at the beginning and at the end, so that at least one word of each text is left."""
    texts = [[word.group() for word in found] for found in words]
    if len(texts) < 2:
        return 0, 0
    spare = max(min(map(len, texts)) - 1, 0)
    first = last = 0
    while first < spare and len({text[first] for text in texts}) == 1:
        first += 1
    while last < spare - first and len({text[-1 - last] for text in texts}) == 1:
        last += 1
    return first, last


def _all_have_letters(names: Sequence[str]) -> bool:
    return all(any(character.isalpha() for character in name) for name in names)


def _make_unique(names: Sequence[str]) -> list[str]:
    """Append a number to names that occurred before; capitals are ignored, because names become file names."""
    found: list[str] = []
    taken: set[str] = set()
    for name in names:
        number, chosen = 1, name
        while chosen.casefold() in taken or (number > 1 and chosen in names):
            number += 1
            chosen = f"{name}-{number}"
        taken.add(chosen.casefold())
        found.append(chosen)
    return found
