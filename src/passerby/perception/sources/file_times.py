"""Times of a camera's files: from a table, a pattern of names, the usual names, or the heads of images.

Exif 2.32 (CIPA DC-008): tags 0x0112 orientation, 0x010F make, 0x0110 model, 0x9003 DateTimeOriginal, 0x9011
OffsetTimeOriginal, 0x9291 SubSecTimeOriginal, 0xA405 focal length in 35 mm. An image may contain any values: invalid ones are
ignored.
"""

from __future__ import annotations

import csv
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, suggest_name
from passerby.perception.pictures import VideoError
from passerby.perception.sources.files import ListedFiles, VideoSource
from passerby.perception.sources.name_times import NamedTime, NamePattern, find_usual_time

_NUMBER = re.compile(r"(\d+)(?!.*\d)")
"""The last number in a name."""
LONGEST_NUMBER = 9
HEAD_BYTES = 1 << 18
"""Exif and the size are within the first 64 KiB and one thumbnail."""
_SIZES = (*range(0xC0, 0xC4), *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))
_EXIF_IFD = 0x8769
_TEXT, _SHORT, _LONG = 2, 3, 4
_MOST_ENTRIES = 200
SHORTEST_MM, LONGEST_MM = 4, 2000


@dataclass(frozen=True, eq=False)
class FileTimes:
    """Beginnings of the files of a camera."""

    begin: Floats
    """(N,) seconds; wall time since 1970 where `wall`."""
    resolution_s: float
    wall: bool
    utc: bool
    """Whether wall time is known to be UTC."""
    numbered: bool = False
    """Whether they are computed from the numbers of pictures and the rate that the scene file states."""


def times_of(source: VideoSource, files: ListedFiles, heads: Sequence[PictureHead] | None = None) -> FileTimes | None:
    """Return the times at which the files were taken; None where they are not known.

    Args:
        source: the scene file's description of the video.
        files: the files.
        heads: heads of images that were read before; None: they are read here.

    Raises:
        InputError: the table lacks a file or has an invalid time; the pattern does not match all names; numbered images without
            a rate.
    """
    if source.times is not None:
        return _time_by_table(source.times, files.paths)
    if source.names is not None:
        return _time_by_names(_time_by_pattern(source, files.paths))
    usual = [find_usual_time(path) for path in files.paths]
    known = [one for one in usual if one is not None]
    if len(known) == len(usual) and (len(known) == 1 or len({one.seconds for one in known}) > 1):
        return _time_by_names(known)
    return None if files.kind == "videos" else _time_pictures(source, files, heads)


def _time_pictures(source: VideoSource, files: ListedFiles, heads: Sequence[PictureHead] | None) -> FileTimes:
    """Return the times of images without times in their names: from Exif, where all have it, else from their numbers."""
    found = [_find_last_number(path) for path in files.paths]
    numbers = [number for number in found if number is not None]
    numbered = len(numbers) == len(found) and len(set(numbers)) == len(numbers)
    if source.fps is None or not numbered:
        taken = [head.taken for head in heads or _heads(files.paths)]
        known = [one for one in taken if one is not None]
        if len(known) == len(taken) and len({one.seconds for one in known}) == len(known):
            return _time_by_names(known)
    if not numbered:
        raise VideoError(
            source.place,
            "its images have neither numbers of their own nor times: name them frame_000001.jpg, or give a table of their "
            "times (video_times)",
        )
    if source.fps is None:
        raise VideoError(
            source.place,
            f"has {len(files.paths)} numbered images, and their rate is not known: set fps (images per second that the numbers "
            "count), or give a table of their times (video_times)",
        )
    first = 1 if min(numbers) > 0 else 0
    return FileTimes((np.array(numbers, dtype=float) - first) / source.fps, 0.0, False, False, True)


def _heads(paths: Sequence[Path]) -> list[PictureHead]:
    out = []
    for path in paths:
        try:
            out.append(read_picture_head(path))
        except OSError:
            out.append(PictureHead(None))
    return out


def _find_last_number(path: Path) -> int | None:
    found = _NUMBER.search(path.stem)
    return int(found[1]) if found and len(found[1]) <= LONGEST_NUMBER else None


def _time_by_names(known: Sequence[NamedTime]) -> FileTimes:
    """Combine the times; the resolution is that of the coarsest name."""
    seconds = np.array([one.seconds for one in known])
    return FileTimes(seconds, max(one.resolution_s for one in known), True, all(one.utc for one in known))


def _time_by_pattern(source: VideoSource, paths: Sequence[Path]) -> list[NamedTime]:
    assert source.names is not None
    pattern = NamePattern(source.names)
    out = []
    for path in paths:
        time = pattern.time_of(path)
        if time is None:
            raise VideoError(
                path, f"its name is not built as video_names = {source.names!r} says: correct the pattern, or name other files"
            )
        out.append(time)
    return out


def _time_by_table(table: Path, paths: Sequence[Path]) -> FileTimes:
    """Read the times from a CSV: file name, seconds or ISO time; a first row without a time is a heading."""
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row and any(cell.strip() for cell in row)]
    except OSError as error:
        raise InputError(
            f"{table}: cannot be read ({error.strerror or error}): a table of times is needed here (CSV)"
        ) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{table}: is not a table of times (CSV, UTF-8): {error}") from None
    times: dict[str, tuple[float, bool, bool]] = {}
    for number, row in enumerate(rows, start=1):
        time = parse_time(row[1].strip()) if len(row) > 1 else None
        if time is None:
            if number == 1:
                continue
            raise InputError(
                f"{table}: row {number} ({shortened(','.join(row))}) is no file name with a time: write NAME,SECONDS or an ISO "
                "time, as frame_000001.jpg,2026-11-22T08:30:00.250"
            )
        times[Path(row[0].strip().replace("\\", "/")).name] = time
    missing = [path for path in paths if path.name not in times]
    if missing:
        told = suggest_name(missing[0].name, list(times)[:50])
        raise InputError(
            f"{table}: has no time of {missing[0].name} ({len(missing)} of {len(paths)} files are missing): {told}; add them, "
            "or name other files"
        )
    chosen = [times[path.name] for path in paths]
    walls = {wall for _, wall, _ in chosen}
    if len(walls) > 1:
        raise InputError(f"{table}: has seconds and dates: use one of them for all files")
    return FileTimes(np.array([time for time, _, _ in chosen]), 0.0, walls == {True}, all(utc for _, _, utc in chosen))


def parse_time(text: str) -> tuple[float, bool, bool] | None:
    """Return seconds, whether they are wall time, and whether that is UTC; None where the text is not a time."""
    try:
        seconds = float(text)
    except ValueError:
        pass
    else:
        return (seconds, False, False) if np.isfinite(seconds) else None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return None
    known = time.tzinfo is not None
    return (time if known else time.replace(tzinfo=UTC)).timestamp(), True, known


@dataclass(frozen=True)
class PictureHead:
    """Metadata in the head of an image."""

    size: tuple[int, int] | None
    """(width, height) as shown; None for image formats that are not read here."""
    taken: NamedTime | None = None
    focal_35mm: float | None = None
    device: str | None = None


@dataclass(eq=False)
class _Exif:
    content: bytes
    order: str = "<"
    values: dict[int, str | int] = field(default_factory=dict)

    def read(self) -> dict[int, str | int]:
        """Return texts and whole numbers by tag."""
        self.order = {b"II": "<", b"MM": ">"}[self.content[:2]]
        (first,) = struct.unpack(f"{self.order}I", self.content[4:8])
        self._directory(first)
        inner = self.values.get(_EXIF_IFD)
        if isinstance(inner, int):
            self._directory(inner)
        return self.values

    def _directory(self, at: int) -> None:
        (count,) = struct.unpack(f"{self.order}H", self.content[at : at + 2])
        for number in range(min(count, _MOST_ENTRIES)):
            start = at + 2 + 12 * number
            tag, kind, length, value = struct.unpack(f"{self.order}HHI4s", self.content[start : start + 12])
            if kind == _SHORT and length == 1:
                self.values[tag] = struct.unpack(f"{self.order}H", value[:2])[0]
            elif kind == _LONG and length == 1:
                self.values[tag] = struct.unpack(f"{self.order}I", value)[0]
            elif kind == _TEXT and length <= 256:
                (place,) = struct.unpack(f"{self.order}I", value)
                text = value[:length] if length <= 4 else self.content[place : place + length]
                self.values[tag] = text.split(b"\0")[0].decode("latin-1").strip()


def read_picture_head(path: Path) -> PictureHead:
    """Read the head of an image; it is empty for a damaged one. Raises `OSError` where the file cannot be read."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    try:
        if head[:8] == b"\x89PNG\r\n\x1a\n" and head[12:16] == b"IHDR":
            return PictureHead(struct.unpack(">II", head[16:24]))
        if head[:2] == b"\xff\xd8":
            return _jpeg(head)
    except (struct.error, KeyError, ValueError):
        pass
    return PictureHead(None)


def _jpeg(head: bytes) -> PictureHead:
    size: tuple[int, int] | None = None
    exif: dict[int, str | int] = {}
    for marker, content in _segments(head):
        if marker in _SIZES:
            height, width = struct.unpack(">HH", content[1:5])
            size = (width, height)
        elif marker == 0xE1 and content[:6] == b"Exif\0\0" and not exif:
            found = _Exif(content[6:])
            try:
                exif = found.read()
            except (struct.error, KeyError):
                exif = found.values
    orientation = exif.get(0x0112, 1)
    if size is not None and isinstance(orientation, int) and 5 <= orientation <= 8:
        size = size[::-1]
    focal = exif.get(0xA405)
    known = isinstance(focal, int) and SHORTEST_MM <= focal <= LONGEST_MM
    return PictureHead(size, _read_time(exif), float(focal) if known and isinstance(focal, int) else None, _device(exif))


def _segments(head: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield marker and content of the segments before the first scan (ITU T.81)."""
    place = 2
    while place + 4 <= len(head) and head[place] == 0xFF:
        marker = head[place + 1]
        if marker == 0xDA:
            return
        (length,) = struct.unpack(">H", head[place + 2 : place + 4])
        yield marker, head[place + 4 : place + 2 + length]
        place += 2 + length


def _read_time(exif: dict[int, str | int]) -> NamedTime | None:
    """Return the time at which it was taken; None if unknown."""
    try:
        time = datetime.strptime(str(exif.get(0x9003, "")), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    fraction, zone = str(exif.get(0x9291, "")), str(exif.get(0x9011, ""))
    shift = timedelta()
    if zone:
        try:
            shift = datetime.strptime(zone, "%z").utcoffset() or timedelta()
        except ValueError:
            zone = ""
    below = float(f"0.{fraction}") if fraction.isdigit() else 0.0
    resolution = 10.0 ** -len(fraction) if fraction.isdigit() else 1.0
    return NamedTime((time - shift).timestamp() + below, resolution, bool(zone))


def _device(exif: dict[int, str | int]) -> str | None:
    make, model = (" ".join(str(exif.get(tag, "")).split()) for tag in (0x010F, 0x0110))
    words = model if model.lower().startswith(make.lower()) else f"{make} {model}"
    return "".join(letter for letter in words if letter.isprintable())[:80] or None if model else None
