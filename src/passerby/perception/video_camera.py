"""Metadata of a video: make and model of the camera, focal length, creation time and timecode.

FFmpeg reads the metadata of the whole file. Phones write the focal length into the metadata of the video's track (QuickTime:
`moov`, `trak`, `meta`, `keys` and `ilst`), which FFmpeg ignores; they are read here. Metadata may contain any values: an
impossible focal length is ignored.

For the clock, FFmpeg returns `creation_time` from MP4 and MOV (`mvhd`, ISO 14496-12), Matroska (`DateUTC`) and others, and the
timecode from a track of its own (QuickTime's `tmcd`) or from the video stream.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

from av.container import InputContainer

FOCAL_KEYS = ("camera.focal_length.35mm_equivalent", "focallengthin35mmfilm", "focallengthin35mmformat")
"""Endings of the names of a 35 mm equivalent focal length, in lower case: of QuickTime, and of Exif as tools copy it."""
MAKE_KEYS, MODEL_KEYS = ("make", "manufacturer"), ("model",)
_PREFIXES = ("com.apple.quicktime.", "com.android.", "")
SHORTEST_MM, LONGEST_MM = 4.0, 2000.0
"""Range of 35 mm equivalents: fisheye lenses have 6 to 15, surveillance cameras with a zoom up to 1200."""
QUICKTIME = ("mov", "mp4", "m4a", "3gp", "3g2", "mj2")
_CONTAINERS = (b"moov", b"trak")
_DEEPEST = 2
_MOST_BOXES, _MOST_BYTES = 10_000, 1 << 16
"""Limits on the boxes that are read, and on the bytes of metadata of one track: a head of a few bytes may state any number."""
_TEXT, _FLOAT, _DOUBLE, _SIGNED, _UNSIGNED = 1, 23, 24, 21, 22
_LONGEST_NAME = 80
EARLIEST = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
"""Earlier times are invalid: clocks that were never set count from 1904, 1970 or 1980."""
DAY_S = 86400.0
_TIMECODE = re.compile(r"(\d\d):(\d\d):(\d\d)[:;.](\d+)")


@dataclass(frozen=True)
class RecordingCamera:
    """The camera that made a recording, according to the recording."""

    focal_35mm: float | None = None
    """Focal length, mm, of a lens with the same field of view over the diagonal of a 36 x 24 mm picture."""
    device: str | None = None
    """Make and model; for a camera with several lenses also the lens."""


def read_recording_camera(path: Path, container: InputContainer) -> RecordingCamera:
    """Read the metadata about the camera from an open video at `path`."""
    found = {name.lower(): value for name, value in container.metadata.items()}
    for stream in container.streams.video[:1]:
        found |= {name.lower(): value for name, value in stream.metadata.items()}
    if set(container.format.name.split(",")) & set(QUICKTIME):
        try:
            with path.open("rb") as file:
                found |= {name.lower(): value for name, value in _track_metadata(file).items()}
        except (OSError, ValueError, struct.error):
            pass  # FFmpeg can read the video; other parts of the file may be damaged
    return RecordingCamera(_focal(found), _device(found))


def _focal(found: Mapping[str, str]) -> float | None:
    """Return the 35 mm equivalent focal length; None where there is none, or an impossible one."""
    for name, text in found.items():
        if name.endswith(FOCAL_KEYS):
            try:
                value = float(text.strip().lower().removesuffix("mm"))
            except ValueError:
                continue
            if math.isfinite(value) and SHORTEST_MM <= value <= LONGEST_MM:
                return value
    return None


def _device(found: Mapping[str, str]) -> str | None:
    """Return make, model and lens; None where no model is stated."""

    def stated(names: tuple[str, ...]) -> str:
        keys = (prefix + name for prefix in _PREFIXES for name in names)
        return next((plain for key in keys if (plain := _clean_name(found.get(key, "")))), "")

    make, model, lens = stated(MAKE_KEYS), stated(MODEL_KEYS), stated(("camera.lens_model",))
    if not model:
        return None
    words = model if model.lower().startswith(make.lower()) else f"{make} {model}"
    # Phones put the phone's name before the lens's name.
    return f"{words}, {lens.removeprefix(model).strip()}" if lens.removeprefix(model).strip() else words


def _clean_name(text: str) -> str:
    """Return a name on one line without characters that control a terminal."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:_LONGEST_NAME]


def _track_metadata(file: BinaryIO) -> dict[str, str]:
    """Return names and values in the metadata of the tracks, numbers as text; of several tracks the first one's.

    Raises `ValueError` or `struct.error` for invalid boxes.
    """
    file.seek(0, 2)
    boxes = _Boxes(file)
    found: dict[str, str] = {}
    for kind, start, end in boxes.below(0, file.tell()):
        if kind == b"meta" and end - start <= _MOST_BYTES:
            file.seek(start)
            content = file.read(end - start)
            # QuickTime's box begins with its parts; that of ISO 14496-12 begins with four bytes of version and flags.
            found = (_items(content) or _items(content[4:])) | found
    return found


@dataclass(eq=False)
class _Boxes:
    """The boxes of a file (ISO 14496-12, QuickTime) that are in the heads of tracks."""

    file: BinaryIO
    count: int = 0

    def below(self, start: int, end: int, depth: int = 0) -> Iterator[tuple[bytes, int, int]]:
        """Yield kind, begin of the content and end of each box between two places; for containers, of the boxes in them.

        Metadata of the file itself, which FFmpeg reads, are skipped.
        """
        while start + 8 <= end and self.count < _MOST_BOXES:
            self.count += 1
            self.file.seek(start)
            size, kind = struct.unpack(">I4s", self.file.read(8))
            head = 8
            if size == 1:
                (size,), head = struct.unpack(">Q", self.file.read(8)), 16
            elif size == 0:
                size = end - start
            if size < head or start + size > end:
                raise ValueError("a box that is larger than what it lies in")
            if kind in _CONTAINERS and depth < _DEEPEST:
                yield from self.below(start + head, start + size, depth + 1)
            elif depth == _DEEPEST:
                yield kind, start + head, start + size
            start += size


def _parts(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of the boxes in some bytes; incomplete ones are left out."""
    place = 0
    while place + 8 <= len(content):
        size, kind = struct.unpack(">I4s", content[place : place + 8])
        if size < 8 or place + size > len(content):
            return
        yield kind, content[place + 8 : place + size]
        place += size


def _items(content: bytes) -> dict[str, str]:
    """Return the names (`keys`) and values (`ilst`) of a `meta` box; empty for another structure."""
    parts = dict(_parts(content))
    names = [name.decode("utf-8", "replace") for _, name in _parts(parts.get(b"keys", b"")[8:])]
    found = {}
    for kind, item in _parts(parts.get(b"ilst", b"")):
        (number,) = struct.unpack(">I", kind)
        data = dict(_parts(item)).get(b"data", b"")
        if 0 < number <= len(names) and len(data) > 8 and (text := _text(data)) is not None:
            found[names[number - 1]] = text
    return found


def _text(data: bytes) -> str | None:
    """Convert a value, after its type code, to text; None for types that are neither text nor numbers."""
    kind, value = int.from_bytes(data[1:4], "big"), data[8:]
    if kind == _TEXT:
        return value.decode("utf-8", "replace")
    if kind in (_SIGNED, _UNSIGNED):
        return str(int.from_bytes(value[:8], "big", signed=kind == _SIGNED))
    if kind == _FLOAT and len(value) == 4:
        return repr(struct.unpack(">f", value)[0])
    if kind == _DOUBLE and len(value) == 8:
        return repr(struct.unpack(">d", value)[0])
    return None


@dataclass(frozen=True)
class FileClock:
    """Times of the recording in a video file."""

    created_s: float | None = None
    """Creation time, seconds since 1970: the beginning of the recording or, for some makers, its end. Often whole seconds."""
    timecode_s: float | None = None
    """Timecode of the first frame, seconds of a day; exact to a frame. It may be the time of day, or count recorded frames."""


def read_file_clock(container: InputContainer, fps: float | None) -> FileClock:
    """Read the clock of an open video with `fps` frames per second; invalid times are ignored."""
    stated: dict[str, str] = {}
    for metadata in (container.metadata, *(stream.metadata for stream in container.streams)):
        stated = {key.lower(): value for key, value in metadata.items()} | stated
    return FileClock(_read_creation_time(stated), _timecode(stated.get("timecode", ""), fps))


def _read_creation_time(stated: Mapping[str, str]) -> float | None:
    try:
        time = datetime.fromisoformat(stated.get("creation_time", "").strip())
    except ValueError:
        return None
    seconds = (time if time.tzinfo is not None else time.replace(tzinfo=UTC)).timestamp()
    return seconds if seconds >= EARLIEST else None


def _timecode(text: str, fps: float | None) -> float | None:
    """Convert a timecode to seconds; frames are counted by the next whole rate (SMPTE ST 12), without the dropped numbers."""
    found = _TIMECODE.fullmatch(text.strip())
    if found is None or fps is None or fps <= 0:
        return None
    hours, minutes, seconds, frames = map(int, found.groups())
    rate = max(1, round(fps))
    if minutes > 59 or seconds > 59 or frames >= rate:
        return None
    count = ((hours * 60 + minutes) * 60 + seconds) * rate + frames
    if ";" in text:
        # Two frame numbers, at 59.94 four, are left out in each minute except every tenth.
        dropped, passed = 2 * round(rate / 30), hours * 60 + minutes
        count -= dropped * (passed - passed // 10)
    exact = Fraction(rate * 1000, 1001) if abs(fps - rate * 1000 / 1001) < 1e-3 * rate and abs(fps - rate) > 1e-4 else rate
    return float(count / Fraction(exact)) % DAY_S
