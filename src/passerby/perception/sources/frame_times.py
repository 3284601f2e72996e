"""Times of a video's frames from a table beside it, as loggers write them (CSV): one row per frame, in order.

The table may have a heading, and other columns: frame numbers, names. Times are in seconds, milliseconds, microseconds or
nanoseconds, from any zero or since 1970, or ISO 8601.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.perception.pictures import VideoError
from passerby.perception.sources.file_times import parse_time
from passerby.perception.video_camera import EARLIEST, FileClock
from passerby.perception.video_probe import VARIABLE_CLOCK_FPS, VideoInfo

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT_OF_NAME = re.compile(
    r"(?:^|[^a-z])(?:(s|sec|seconds)|(ms|msec|milliseconds)|(us|usec|microseconds)|(ns|nsec|nanoseconds))\W*$"
)
_NAME_OF_TIME = re.compile(r"time|stamp|second|^t$|^pts|^ts", re.IGNORECASE)
LATEST = 4_102_444_800.0
"""The year 2100: later times are not seconds since 1970."""
TYPICAL_STEP_S = 1 / 30
"""Usual step between frames where no video states their rate. Units differ by factors of 1000."""
MISSED = 2
"""Difference between the numbers of frames of a container and of a logger that is accepted, at the end."""


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """Times at which the frames of a video were taken."""

    path: Path
    seconds: Floats
    """(N,) seconds from the first frame, ascending."""
    begin_s: float | None
    """Time of the first frame, seconds since 1970; None where the table has another zero."""

    def numbers(self) -> Ints:
        """Return frame numbers (N,) on the clock of variable rates."""
        return np.asarray(np.rint(self.seconds * VARIABLE_CLOCK_FPS), dtype=np.int64) + 1

    def renumbered(self, frame: Ints, camera: str) -> Ints:
        """Convert frames counted from 1 to the clock of variable rates. Raises `InputError` for one without a time."""
        outside = frame[(frame < 1) | (frame > len(self.seconds))]
        if len(outside):
            raise InputError(
                f"{self.path}: camera {camera}: has {len(self.seconds)} times, but there are people in frame {outside[0]}: one "
                "row per frame is needed, and frames are counted from 1"
            )
        return self.numbers()[frame - 1]


def read_frame_times(path: Path, step_s: float = TYPICAL_STEP_S) -> FrameTimes:
    """Read a table of times; the unit is that of its heading, or the one with frames about `step_s` apart.

    Raises `InputError` (file, row, value and fix) for a table that cannot be read or times that do not ascend.
    """
    rows = _rows(path)
    heading = [] if all(_number(cell) is not None for cell in rows[0]) else rows[0]
    body = rows[1:] if heading else rows
    if len(body) < 2:
        raise InputError(f"{path}: has {len(body)} times: one row per frame is needed")
    column = _column(heading, len(body[0]))
    parsed = [_number(row[column]) if column < len(row) else None for row in body]
    wrong = next((number for number, one in enumerate(parsed) if one is None), None)
    if wrong is not None:
        raise InputError(
            f"{path}: row {wrong + 1 + bool(heading)} ({shortened(','.join(body[wrong]))}) has no time in column {column + 1}: "
            "write a frame and its time, as 17,0.533"
        )
    values = np.array([one for one, _ in (found for found in parsed if found is not None)])
    iso = all(found[1] for found in parsed if found is not None)
    back = np.flatnonzero(np.diff(values) < 0)
    if len(back):
        row = int(back[0]) + 2 + bool(heading)
        raise InputError(f"{path}: row {row}: {values[back[0] + 1]:.15g} is before the time of the row above it: sort the rows")
    unit = 1.0 if iso else _unit(path, heading[column] if heading else "", values, step_s)
    begin_s = values[0] * unit
    return FrameTimes(path, (values - values[0]) * unit, float(begin_s) if EARLIEST <= begin_s < LATEST else None)


def apply_times(info: VideoInfo, times: FrameTimes) -> VideoInfo:
    """Return a video of constant rate with the times of a table.

    Raises `InputError` where it is not a single file of constant rate, or has another number of frames.
    """
    if info.pieces:
        raise VideoError(info.path, "is in pieces: times of frames are read for one video file; give video_times instead")
    if info.variable:
        raise VideoError(
            info.path, f"states the times of its frames itself, which are used: delete times, which names {times.path.name}"
        )
    count = len(times.seconds)
    if info.frames is not None and abs(info.frames - count) > MISSED:
        raise InputError(
            f"{times.path}: has {count} times, but {info.path.name} has {info.frames} frames: one row per frame is needed"
        )
    span = float(times.seconds[-1])
    if span <= 0:
        raise InputError(f"{times.path}: all its times are the same: one time per frame is needed")
    clock = info.clock if times.begin_s is None else FileClock(times.begin_s)
    average = (count - 1) / span
    return replace(
        info, clock_fps=VARIABLE_CLOCK_FPS, variable=True, average_fps=average, frames=count, seconds=span + 1 / average,
        clock=clock, stored_fps=info.clock_fps, frame_times=tuple(times.seconds.tolist()),
    )  # fmt: skip


def find_frame_times(video: Path) -> Path | None:
    """Find the table beside a video that has its name, or a general name if no other video is there; None without one."""
    names = [f"{video.stem}.csv", *(f"{video.stem}{joint}{word}.csv" for word in ("timestamps", "times") for joint in "_-.")]
    named = next((path for name in names if (path := video.with_name(name)).is_file()), None)
    if named is not None:
        return named
    videos = [path for path in video.parent.iterdir() if path.suffix.lower() == video.suffix.lower()]
    general = next((path for word in ("timestamps", "times") if (path := video.with_name(f"{word}.csv")).is_file()), None)
    return general if len(videos) == 1 else None


def _rows(path: Path) -> list[list[str]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            text = file.read()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): times of frames are needed here (CSV)") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not a table of times (CSV, UTF-8): {error}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError(f"{path}: is empty: one row per frame is needed")
    separator = next((one for one in (",", ";", "\t") if one in lines[-1]), " ")
    try:
        return [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=separator, skipinitialspace=True)]
    except csv.Error as error:
        raise InputError(f"{path}: is not a table of times (CSV): {error}") from None


def _number(cell: str) -> tuple[float, bool] | None:
    """Return a time, and whether it is ISO 8601; None where the cell is not a time."""
    found = parse_time(cell)
    return None if found is None else (found[0], found[1])


def _column(heading: Sequence[str], width: int) -> int:
    """Return the index of the column of times: by its name, else the second of several."""
    named = [number for number, name in enumerate(heading) if _NAME_OF_TIME.search(name)]
    return named[0] if named else min(1, width - 1)


def _unit(path: Path, name: str, values: Floats, step_s: float) -> float:
    """Return the seconds per unit of the values."""
    if found := _UNIT_OF_NAME.search(name.lower()):
        return tuple(UNITS.values())[next(number for number, one in enumerate(found.groups()) if one)]
    steps = np.diff(values)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if step <= 0:
        raise InputError(f"{path}: all its times are the same: one time per frame is needed")
    return min(UNITS.values(), key=lambda unit: abs(np.log(step * unit / step_s)))
