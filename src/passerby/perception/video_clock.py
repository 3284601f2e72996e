"""When a video file says that it was recorded: its creation time, and its timecode.

Both are metadata. FFmpeg hands `creation_time` on from MP4 and MOV (`mvhd`, ISO 14496-12), Matroska (`DateUTC`) and others, and
the timecode from a track of its own (QuickTime's `tmcd`) or from the video stream.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction

from av.container import InputContainer

EARLIEST = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
"""Clocks that were never set count from 1904, 1970 or 1980."""
DAY_S = 86400.0
_TIMECODE = re.compile(r"(\d\d):(\d\d):(\d\d)[:;.](\d+)")


@dataclass(frozen=True)
class FileClock:
    """What a video file says of the time of its recording."""

    created_s: float | None = None
    """Its creation time, seconds since 1970: when the recording began or, by some makers, ended. Often whole seconds."""
    timecode_s: float | None = None
    """Its first frame by the timecode, seconds of a day; exact to a frame. The clock may be that of the day, or count recorded
    frames."""


def read_file_clock(container: InputContainer, fps: float | None) -> FileClock:
    """The clock of an open video of so many frames per second; what cannot be a time is passed over."""
    stated: dict[str, str] = {}
    for metadata in (container.metadata, *(stream.metadata for stream in container.streams)):
        stated = {key.lower(): value for key, value in metadata.items()} | stated
    return FileClock(_created(stated), _timecode(stated.get("timecode", ""), fps))


def _created(stated: Mapping[str, str]) -> float | None:
    try:
        time = datetime.fromisoformat(stated.get("creation_time", "").strip())
    except ValueError:
        return None
    seconds = (time if time.tzinfo is not None else time.replace(tzinfo=UTC)).timestamp()
    return seconds if seconds >= EARLIEST else None


def _timecode(text: str, fps: float | None) -> float | None:
    """Seconds of a timecode; frames are counted by the next whole rate (SMPTE ST 12), and dropped numbers are none."""
    found = _TIMECODE.fullmatch(text.strip())
    if found is None or fps is None or fps <= 0:
        return None
    hours, minutes, seconds, frames = map(int, found.groups())
    rate = max(1, round(fps))
    if minutes > 59 or seconds > 59 or frames >= rate:
        return None
    count = ((hours * 60 + minutes) * 60 + seconds) * rate + frames
    if ";" in text:
        # Two frame numbers, at 59.94 four, are left out each minute but every tenth.
        dropped, passed = 2 * round(rate / 30), hours * 60 + minutes
        count -= dropped * (passed - passed // 10)
    exact = Fraction(rate * 1000, 1001) if abs(fps - rate * 1000 / 1001) < 1e-3 * rate and abs(fps - rate) > 1e-4 else rate
    return float(count / Fraction(exact)) % DAY_S
