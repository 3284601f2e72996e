"""Names of the chapters into which action cameras and recorders cut one recording.

- GoPro (community.gopro.com, "Camera File Naming Convention"): `GX010012`, `GX020012` are chapters 01 and 02 of recording 0012;
  GH with AVC, GX with HEVC, GS with two lenses, GL a small copy (LRV). Up to HERO5: `GOPR0345`, `GP010345`, `GP020345`.
- A counter of three digits or more at the end of a name: `name_001`, `name_002`; DJI's `DJI_0001`, and
  `DJI_20240501100305_0001_D`, where the time of the chapter stands before it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from glob import escape

from passerby.common.text import natural_key

_GOPRO = re.compile(r"G([HXSLP])(\d\d)(\d{4})", re.IGNORECASE)
_GOPRO_FIRST = re.compile(r"GOPR(\d{4})", re.IGNORECASE)
_COUNTER = re.compile(r"(.*?\D)(\d{3,6})(_[A-Z])?", re.IGNORECASE)
_DJI_COUNTER = re.compile(r"(?<=dji__)\d{4}(?=_[a-z]$|$)")
_CAMERA_WORD = re.compile(r"(?:^|[^a-z])(?:cam|camera|view|channel|ch|device|dev|kinect|c|v)[^a-z]*$", re.IGNORECASE)
"""Before a counter: it numbers cameras, unless times show chapters."""
_DIGIT = "[0-9]"


@dataclass(frozen=True)
class ChapterName:
    """A name that may be that of a chapter."""

    recording: str
    """What all chapters of the recording share, for people."""
    chapter: int
    pattern: str
    """Names of all its chapters, without the ending, for `glob`."""
    scheme: bool
    """Whether a maker's scheme says that names which differ in the chapter alone are chapters."""
    numbers_cameras: bool = False
    """Whether the counter may as well number cameras."""
    copy: bool = False
    """Whether it is the small copy of another file."""


def chapter_name(stem: str) -> ChapterName | None:
    """The chapter that a file's name without its ending states; None for a name without a counter."""
    if found := _GOPRO.fullmatch(stem):
        kind, chapter, number = found[1].upper(), int(found[2]), found[3]
        if kind == "P":
            return ChapterName(f"GOPR{number}", chapter, f"G[OP][P0-9][R0-9]{number}", True)
        return ChapterName(f"G{kind}{number}", chapter, f"G{kind}{_DIGIT * 2}{number}", True, copy=kind == "L")
    if found := _GOPRO_FIRST.fullmatch(stem):
        return ChapterName(f"GOPR{found[1]}", 0, f"G[OP][P0-9][R0-9]{found[1]}", True)
    if found := _COUNTER.fullmatch(stem):
        before, digits, behind = found[1], found[2], found[3] or ""
        name = f"{before}{behind}".strip(" _-.") or stem
        pattern = f"{escape(before)}{_DIGIT * len(digits)}{escape(behind)}"
        return ChapterName(name, int(digits), pattern, False, bool(_CAMERA_WORD.search(before)))
    return None


def without_chapter(rest: str) -> str:
    """What is left of a name without its time, in small letters, without DJI's counter of chapters."""
    return _DJI_COUNTER.sub("", rest)


def order_of(stem: str) -> tuple[tuple[str | int, ...], int]:
    """A key that sorts the chapters of GoPro's recordings behind each other, and other names as `natural_key`."""
    found = chapter_name(stem)
    if found is not None and found.scheme:
        return natural_key(found.recording), found.chapter
    return natural_key(stem), 0


def are_all_chapters(stems: Sequence[str]) -> bool:
    """Whether names in order are all chapters of one recording by a maker's scheme, and none between them is missing."""
    names = [name for stem in stems if (name := chapter_name(stem)) is not None and name.scheme]
    if len(names) < len(stems) or len({name.recording for name in names}) != 1:
        return False
    numbers = [name.chapter for name in names]
    return numbers[0] <= 1 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))
