"""What the head of an image says: its size, when it was taken and by which camera (JPEG with Exif, PNG), without decoding it.

Exif 2.32 (CIPA DC-008): tags 0x0112 orientation, 0x010F make, 0x0110 model, 0x9003 DateTimeOriginal, 0x9011
OffsetTimeOriginal, 0x9291 SubSecTimeOriginal, 0xA405 focal length in 35 mm. An image may say anything: what is none of these
is passed over.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

from passerby.perception.sources.name_times import NamedTime

HEAD_BYTES = 1 << 18
"""Exif and the size lie within the first 64 KiB and one thumbnail."""
_SIZES = (*range(0xC0, 0xC4), *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))
_EXIF_IFD = 0x8769
_TEXT, _SHORT, _LONG = 2, 3, 4
_MOST_ENTRIES = 200
SHORTEST_MM, LONGEST_MM = 4, 2000


@dataclass(frozen=True)
class PictureHead:
    """What an image says of itself."""

    size: tuple[int, int] | None
    """(width, height) as it is shown; None where its kind is not read here."""
    taken: NamedTime | None = None
    focal_35mm: float | None = None
    device: str | None = None


@dataclass(eq=False)
class _Exif:
    content: bytes
    order: str = "<"
    values: dict[int, str | int] = field(default_factory=dict)

    def read(self) -> dict[int, str | int]:
        """Texts and whole numbers by tag."""
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
    """The head of an image. Raises `OSError` where the file cannot be read; nothing for one that is damaged."""
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
    return PictureHead(size, _taken(exif), float(focal) if known and isinstance(focal, int) else None, _device(exif))


def _segments(head: bytes) -> Iterator[tuple[int, bytes]]:
    """Marker and content of the segments before the first scan (ITU T.81)."""
    place = 2
    while place + 4 <= len(head) and head[place] == 0xFF:
        marker = head[place + 1]
        if marker == 0xDA:
            return
        (length,) = struct.unpack(">H", head[place + 2 : place + 4])
        yield marker, head[place + 4 : place + 2 + length]
        place += 2 + length


def _taken(exif: dict[int, str | int]) -> NamedTime | None:
    """When it was taken; None if unknown."""
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
