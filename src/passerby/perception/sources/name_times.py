"""Information in names of files and folders: when a recording began, and which chapter of it a file is.

Usual names, each with its source:

- Frigate: `recordings/YYYY-MM-DD/HH/CAMERA/MM.SS.mp4`, in UTC (docs.frigate.video, configuration/record).
- Hikvision, Reolink, Synology, VLC and most others: date and time in the file's name, as `YYYYMMDDHHMMSS`, `YYYYMMDD-HHMMSS`,
  `YYYY-MM-DD HH-MM-SS`, `vlc-record-2026-01-31-08h30m00s-...`. If a name has a beginning and an end (Brickcom's
  `20140509-000500-001000_...`, Canon's `..._yyyymmdd_hhmmss_yyyymmdd_hhmmss`), the beginning is used.
- Dahua: `2026-01-31/001/dav/08/08.30.00-09.00.00[M][0@0][0].mp4`: the time in the file's name, the date in a folder's.
- `passerby record`, and others that write ISO 8601 with a Z behind it: in UTC (`20261122T083005.250Z.mkv`).
- Cloudvue, Xiaomi: seconds since 1970, in UTC (`2023-03-30/1680140457.mp4`, `2025060107/46M14S_1748735174.mp4`).

A name without a time zone is used as it is: times of one recorder are compared only with each other.

- GoPro (community.gopro.com, "Camera File Naming Convention"): `GX010012`, `GX020012` are chapters 01 and 02 of recording 0012;
  GH with AVC, GX with HEVC, GS with two lenses, GL a small copy (LRV). Up to HERO5: `GOPR0345`, `GP010345`, `GP020345`.
- A counter of three digits or more at the end of a name: `name_001`, `name_002`; DJI's `DJI_0001`, and
  `DJI_20240501100305_0001_D`, with the time of the chapter before it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from glob import escape
from pathlib import Path

from passerby.common.text import natural_key

_FRACTION = r"(?:[.,_]?(\d{3}))?"
_DATE_AND_TIME = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[ T_.\-]{0,3}(\d\d)[-_.:hH]?(\d\d)[-_.:mM]?(\d\d)"
    + _FRACTION
    + r"(?!\d)(Z(?![0-9A-Za-z]))?"
)
_EPOCH = re.compile(r"(?<!\d)(1[4-9]\d{8})(\d{3})?(?!\d)")
"""Seconds, or thousandths of seconds, since 1970."""
_DAY = re.compile(r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)(?!\d)")
_TIME_OF_DAY = re.compile(r"(?<!\d)([01]\d|2[0-3])[-_.]([0-5]\d)[-_.]([0-5]\d)(?!\d)")
_FRIGATE_FILE, _FRIGATE_HOUR = re.compile(r"([0-5]\d)\.([0-5]\d)"), re.compile(r"[01]\d|2[0-3]")
_FRIGATE_DAY = re.compile(r"(\d{4})-(\d\d)-(\d\d)")
DIRECTIVES = {
    "Y": r"\d{4}", "y": r"\d\d", "m": r"\d\d", "d": r"\d\d", "j": r"\d{3}", "H": r"\d\d", "I": r"\d\d", "M": r"\d\d",
    "S": r"\d\d", "f": r"\d{1,6}", "p": r"[AaPp][Mm]", "b": r"[A-Za-z]{3}", "z": r"(?:Z|[+-]\d\d:?\d\d)", "s": r"\d{10}",
}  # fmt: skip
"""Directives of `datetime.strptime` that a pattern may contain, and seconds since 1970."""
_GOPRO = re.compile(r"G([HXSLP])(\d\d)(\d{4})", re.IGNORECASE)
_GOPRO_FIRST = re.compile(r"GOPR(\d{4})", re.IGNORECASE)
_COUNTER = re.compile(r"(.*?\D)(\d{3,6})(_[A-Z])?", re.IGNORECASE)
_DJI_COUNTER = re.compile(r"(?<=dji__)\d{4}(?=_[a-z]$|$)")
_CAMERA_WORD = re.compile(r"(?:^|[^a-z])(?:cam|camera|view|channel|ch|device|dev|kinect|c|v)[^a-z]*$", re.IGNORECASE)
"""A word before a counter that counts cameras, unless times show that it counts chapters."""
_DIGIT = "[0-9]"


@dataclass(frozen=True)
class NamedTime:
    """A time found in a name."""

    seconds: float
    """Seconds since 1970, by the clock with which the names are written."""
    resolution_s: float
    """The true time is later by up to this: names have no fractions."""
    utc: bool
    """Whether that clock is known to be UTC."""


def find_usual_time(path: Path) -> NamedTime | None:
    """Return the time in a name of one of the usual forms; None for other names."""
    return _frigate(path) or _find_in_name(path.stem) or _find_in_folders(path)


def _frigate(path: Path) -> NamedTime | None:
    if len(path.parts) < 4:
        return None
    day, hour = _FRIGATE_DAY.fullmatch(path.parts[-4]), _FRIGATE_HOUR.fullmatch(path.parts[-3])
    file = _FRIGATE_FILE.fullmatch(path.stem)
    if day is None or hour is None or file is None:
        return None
    return _time([*day.groups(), hour[0], *file.groups()], utc=True)


def _find_in_name(stem: str) -> NamedTime | None:
    if found := _DATE_AND_TIME.search(stem):
        *parts, thousandths, zone = found.groups()
        return _time(parts, thousandths=thousandths, utc=zone is not None)
    if found := _EPOCH.search(stem):
        return NamedTime(int(found[1]) + int(found[2] or 0) / 1000.0, 0.001 if found[2] else 1.0, True)
    return None


def _find_in_folders(path: Path) -> NamedTime | None:
    """Return the time of day at the beginning of the name, with the date of the nearest folder that has one."""
    clock = _TIME_OF_DAY.match(path.stem)
    day = next((found for part in reversed(path.parts[:-1]) if (found := _DAY.search(part))), None)
    return None if clock is None or day is None else _time([*day.groups(), *clock.groups()])


def _time(parts: Sequence[str], thousandths: str | None = None, utc: bool = False) -> NamedTime | None:
    try:
        found = datetime(*map(int, parts), tzinfo=UTC)  # type: ignore[arg-type, misc]
    except ValueError:
        return None
    return NamedTime(found.timestamp() + int(thousandths or 0) / 1000.0, 0.001 if thousandths else 1.0, utc)


@dataclass(frozen=True)
class NamePattern:
    """Format of a recorder's file names: text, directives of `strptime`, and * for any text within one name."""

    text: str

    def __post_init__(self) -> None:
        """Check the pattern. Raises `ValueError` for a pattern without a time."""
        unknown = sorted({mark for mark in self.directives if mark not in DIRECTIVES})
        if unknown:
            raise ValueError(f"%{unknown[0]} is not known: use {', '.join('%' + mark for mark in DIRECTIVES)}")
        marks = set(self.directives)
        dated = ("Y" in marks or "y" in marks) and ("j" in marks or ({"m", "b"} & marks and "d" in marks))
        if "s" not in marks and not (dated and {"H", "I"} & marks):
            raise ValueError("tells no date and time: it needs %Y, %m, %d, %H, %M and %S, or %s (seconds since 1970)")
        if len(marks) < len(self.directives):
            raise ValueError("names one part of the time twice: write * in place of one of them")

    @property
    def directives(self) -> tuple[str, ...]:
        """The letters after each %."""
        return tuple(re.findall(r"%(.)", self.text.replace("%%", "")))

    def time_of(self, path: Path) -> NamedTime | None:
        """Return the time in the end of a path; None where the path does not match."""
        end = "/".join(path.parts[-1 - self.text.count("/") :])
        found = re.fullmatch(self._expression, end)
        if found is None:
            return None
        marks = self.directives
        if "s" in marks:
            return NamedTime(float(found[marks.index("s") + 1]), 1.0, True)
        try:
            time = datetime.strptime("\x1f".join(found.groups()), "\x1f".join("%" + mark for mark in marks))
        except ValueError:
            return None
        resolution = 1e-3 if "f" in marks else 1.0 if "S" in marks else 60.0 if "M" in marks else 3600.0
        seconds = time.timestamp() if time.tzinfo else time.replace(tzinfo=UTC).timestamp()
        return NamedTime(seconds, resolution, time.tzinfo is not None)

    @property
    def _expression(self) -> str:
        parts = re.split(r"(%.|\*)", self.text)
        made = []
        for part in parts:
            if part == "*":
                made.append("[^/]*")
            elif part == "%%":
                made.append("%")
            elif part.startswith("%") and len(part) == 2:
                made.append(f"({DIRECTIVES[part[1]]})")
            else:
                made.append(re.escape(part))
        return "".join(made)


@dataclass(frozen=True)
class ChapterName:
    """A name that may be the name of a chapter."""

    recording: str
    """Name of the recording, common to all its chapters, for messages."""
    chapter: int
    pattern: str
    """Pattern of the names of all its chapters, without the ending, for `glob`."""
    scheme: bool
    """Whether by a maker's scheme names that differ only in the chapter are chapters."""
    numbers_cameras: bool = False
    """Whether the counter may count cameras instead."""
    copy: bool = False
    """Whether it is the small copy of another file."""


def chapter_name(stem: str) -> ChapterName | None:
    """Return the chapter that a file's name without its ending states; None for a name without a counter."""
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


def strip_chapter(rest: str) -> str:
    """Remove DJI's counter of chapters from the rest of a name without its time, in lower case."""
    return _DJI_COUNTER.sub("", rest)


def order_of(stem: str) -> tuple[tuple[str | int, ...], int]:
    """Return a key that sorts the chapters of a GoPro recording in order, and other names as `natural_key`."""
    found = chapter_name(stem)
    if found is not None and found.scheme:
        return natural_key(found.recording), found.chapter
    return natural_key(stem), 0


def are_all_chapters(stems: Sequence[str]) -> bool:
    """Check whether names in order are all chapters of one recording by a maker's scheme, with none missing between them."""
    names = [name for stem in stems if (name := chapter_name(stem)) is not None and name.scheme]
    if len(names) < len(stems) or len({name.recording for name in names}) != 1:
        return False
    numbers = [name.chapter for name in names]
    return numbers[0] <= 1 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))
