"""People's trajectories over the ground as CSV, and true ground positions in the CSV of data sets and `passerby simulate`."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.observations import Clock
from passerby.core.trajectories import Trajectories
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import FileFaults, read_text
from passerby.interchange.storage.text_formats import csv_rows

HEADER = ("time_s", "frame", "id", "x_m", "y_m", "z_m", "sigma_m", "cameras")
LARGEST = 1e12
"""Largest permitted number. Frames, identities, seconds since 1970 and metres are far smaller."""
WHOLE = ("frame", "id", "cameras")
IDENTITY_NAMES = ("id", "person", "identity")


@dataclass(frozen=True, eq=False)
class GroundPositions:
    """M true positions of people on the ground. World: z up, ground at z = 0, metres."""

    frame: Ints
    """(M,) frame numbers."""
    identity: Ints
    """(M,) identities."""
    xy: Floats
    """(M, 2) x and y on the ground."""


def write_trajectories(path: str | Path, found: Trajectories) -> None:
    """Write one row for each person and instant, sorted by frame, then by identity; lengths are rounded to millimetres.

    x_m and y_m are the position on the ground, z_m is the height of the body's middle; sigma_m is empty where it is unknown;
    cameras is 0 where no camera saw the person. Raises `InputError` where `path` is not writable.
    """
    order = np.lexsort((found.identity, found.frame))
    columns = zip(
        found.time_s[order].tolist(), found.frame[order].tolist(), found.identity[order].tolist(), found.xyz[order].tolist(),
        found.sigma_m[order].tolist(), found.cameras[order].tolist(), strict=True,
    )  # fmt: skip
    lines = [
        f"{time:.4f},{frame},{identity},{_length(x)},{_length(y)},{_length(z)},{_length(sigma)},{cameras}\n"
        for time, frame, identity, (x, y, z), sigma, cameras in columns
    ]
    write_text(path, ",".join(HEADER) + "\n" + "".join(lines))


def _length(metres: float) -> str:
    """Format a length to the millimetre; empty if it is not finite. Adding zero converts -0.0 to 0.0."""
    return f"{round(metres, 3) + 0.0:.3f}" if math.isfinite(metres) else ""


def read_trajectories(path: str | Path) -> Trajectories:
    """Read a file of `write_trajectories`. Frames that are missing separate the stretches of a trajectory.

    Raises `FileFaults` (an `InputError`) that names file, line, value and fix.
    """
    header, lines = csv_rows(path, read_text(path, "trajectories of people (CSV)"))
    missing = [name for name in HEADER if name not in header]
    if missing:
        raise InputError(f"{path}: line 1: has no column {missing[0]}: give the trajectories.csv that `passerby track` wrote")
    rows, faults = [], []
    for number, line in lines:
        try:
            rows.append(_place(dict(zip(header, line, strict=False))))
        except InputError as error:
            faults.append(f"{path}: line {number}: {error}")
    if faults:
        raise FileFaults(faults)
    if not rows:
        raise InputError(f"{path}: has no row: no person was followed")
    table = np.array(rows)
    table = table[np.lexsort((table[:, 1], table[:, 2]))]
    identity, frame = table[:, 2].astype(np.int64), table[:, 1].astype(np.int64)
    again = np.flatnonzero((np.diff(identity) == 0) & (np.diff(frame) == 0))
    if len(again):
        raise InputError(f"{path}: person {identity[again[0]]} occurs twice in frame {frame[again[0]]}: delete one row")
    return Trajectories(
        identity, frame, table[:, 0], table[:, 3:6], table[:, 6], table[:, 7].astype(np.int64), _parts(identity, frame),
        _clock(Path(path), frame, table[:, 0]),
    )  # fmt: skip


def _place(line: dict[str, str]) -> tuple[float, ...]:
    """Parse the numbers of a row, in the order of `HEADER`. Raises `InputError` without the place."""
    numbers = []
    for name in HEADER:
        text = line.get(name, "").strip()
        value = math.nan
        with contextlib.suppress(ValueError):
            value = float(text)
        if not (math.isfinite(value) or (name == "sigma_m" and text == "")):
            raise InputError(f"{name} is {shortened(text)}: a finite number is needed")
        if math.isfinite(value) and not abs(value) <= LARGEST:
            raise InputError(f"{name} is {value:g}: no trajectory has such a number")
        if name in WHOLE and value != math.floor(value):
            raise InputError(f"{name} is {value:.12g}: a whole number is needed")
        numbers.append(value)
    return tuple(numbers)


def _parts(identity: Ints, frame: Ints) -> Ints:
    """Number the stretches (N,) of each identity from 1. Gaps separate them; rows are sorted by identity, then frame."""
    same = np.diff(identity) == 0
    usual = int(np.median(np.diff(frame)[same])) if same.any() else 1
    begins = np.concatenate([[True], ~same])
    new = np.concatenate([[True], ~same | (np.diff(frame) > usual)])
    count = np.cumsum(new)
    first = np.maximum.accumulate(np.where(begins, count, 0))
    return np.asarray(count - first + 1, dtype=np.int64)


def _clock(path: Path, frame: Ints, seconds: Floats) -> Clock:
    """Fit the clock that maps the frames (N,) to their times (N,), seconds."""
    spread = frame.max() - frame.min()
    if spread == 0:
        return Clock(1.0, float(seconds[0]) - float(frame[0] - 1))
    slope, at_zero = np.polyfit(frame, seconds, 1)
    if not slope > 0:
        raise InputError(f"{path}: time_s does not grow with frame: give the trajectories.csv that `passerby track` wrote")
    return Clock(float(1 / slope), float(at_zero + slope))


def read_ground_positions(path: str | Path) -> GroundPositions:
    """Read true ground positions: a header with frame, id (or person or identity), x_m and y_m; other columns are ignored.

    Raises `FileFaults` (an `InputError`) that names file, line, value and fix for a missing column, a field that is no finite
    number, a frame or an id that is not whole, and a person who occurs twice in a frame.
    """
    text = read_text(path, "a table of true ground positions (CSV)")
    header, rows = csv_rows(path, text)
    who = next((name for name in IDENTITY_NAMES if name in header), "id")
    wanted = ("frame", who, "x_m", "y_m")
    missing = [name for name in wanted if name not in header]
    if missing:
        raise InputError(
            f"{path}: line 1: has no column {missing[0]}: give a header with frame, id, x_m and y_m "
            f"(it has {shortened_text(', '.join(header)) or 'nothing'})"
        )
    places = [header.index(name) for name in wanted]
    values, faults = [], []
    seen: dict[tuple[float, float], int] = {}
    for number, row in rows:
        try:
            values.append(_row(row, places, wanted))
        except InputError as error:
            faults.append(f"{path}: line {number}: {error}")
            continue
        key = values[-1][0], values[-1][1]
        if key in seen:
            faults.append(
                f"{path}: line {number}: {who} {key[1]:.0f} occurs a second time in frame {key[0]:.0f} (first on line "
                f"{seen[key]}): delete one"
            )
        seen.setdefault(key, number)
    if faults:
        raise FileFaults(faults)
    if not values:
        raise InputError(f"{path}: has no row: true ground positions are needed")
    table = np.array(values)
    return GroundPositions(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:])


def _row(row: list[str], places: list[int], names: tuple[str, ...]) -> tuple[float, float, float, float]:
    """Parse frame, identity, x and y of a row. Raises `InputError` without the place."""
    if len(row) <= max(places):
        raise InputError(f"has {len(row)} columns, the header has more: complete the row")
    numbers = []
    for place, name in zip(places, names, strict=True):
        try:
            number = float(row[place])
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise InputError(f"{name} is {shortened(row[place].strip())}: a finite number is needed")
        if not abs(number) <= LARGEST:
            raise InputError(f"{name} is {number:g}: no position and no frame has such a number")
        if name not in ("x_m", "y_m") and number != math.floor(number):
            raise InputError(f"{name} is {number:.12g}: a whole number is needed")
        numbers.append(number)
    return numbers[0], numbers[1], numbers[2], numbers[3]
