"""Points and camera positions with known coordinates, as CSV with a header or as TOML with the same keys.

`points.csv`: `camera,u,v,x,y[,z][,point][,sd_m]`, one row for a point in a camera. Rows with the same `point` (or, without it,
the same coordinates) describe one point. z is 0, the ground, if not stated. `points.toml` holds `[[points]]` tables.

`positions.csv`: `camera,x,y[,z][,sd_m]` in metres, or `camera,lat,lon[,alt][,sd_m]` in degrees and metres (WGS 84).
`positions.toml` holds `[[positions]]` tables. Other columns of a CSV are ignored; an unknown key of a TOML is an error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text, suggest_name
from passerby.core.scale_cues import GPS_SD_M, POINT_SD_M, POSITION_SD_M, KnownPoint, KnownPosition
from passerby.interchange.storage.safe_parsing import FileFaults, read_text, read_toml
from passerby.interchange.storage.text_formats import csv_rows

Row = tuple[str, Mapping[str, Any]]
"""The place of a row in its file ("line 3"), and its fields by key."""

POINT_KEYS = ("camera", "u", "v", "x", "y", "z", "point", "sd_m")
METRIC_KEYS, GEODETIC_KEYS = ("camera", "x", "y", "z", "sd_m"), ("camera", "lat", "lon", "alt", "sd_m")


LARGEST = 1e8
"""Largest permitted number of metres, pixels or degrees: grids of whole countries have up to ten million metres."""


def read_known_points(path: str | Path) -> tuple[KnownPoint, ...]:
    """Read points with known coordinates, and their pixels in the cameras.

    Raises `FileFaults` (an `InputError`) with all faults, each with its line, value and fix.
    """
    rows = _rows(Path(path), "points", POINT_KEYS, ("camera", "u", "v", "x", "y"))
    found: dict[object, KnownPoint] = {}
    first: dict[object, str] = {}
    faults: list[str] = []
    for place, row in rows:
        try:
            camera, xyz = _camera(row), np.array([_number(row, "x"), _number(row, "y"), _number(row, "z", 0.0)])
            pixel, sd = (_number(row, "u"), _number(row, "v")), _sd(row, POINT_SD_M)
            told = _text(row, "point")
            key: object = told if told else tuple(xyz.tolist())
            known = found.get(key)
            if known is None:
                found[key] = KnownPoint(told or str(len(found) + 1), xyz, {camera: pixel}, sd)
                first[key] = place
                continue
            if camera in known.pixels:
                raise InputError(
                    f"point {known.name} occurs a second time in camera {camera} (first on {first[key]}): delete one"
                )
            if not np.array_equal(known.xyz, xyz):
                raise InputError(
                    f"point {known.name} is at {xyz.tolist()}, but at {known.xyz.tolist()} on {first[key]}: correct one, or "
                    "give them different names"
                )
            found[key] = KnownPoint(known.name, xyz, {**known.pixels, camera: pixel}, min(sd, known.sd_m))
        except InputError as error:
            faults.append(f"{path}: {place}: {error}")
    if faults:
        raise FileFaults(faults)
    return tuple(found.values())


def read_known_positions(path: str | Path) -> tuple[tuple[KnownPosition, ...], bool]:
    """Read positions of cameras. Also return whether they are latitude, longitude and altitude.

    Raises `FileFaults` as `read_known_points` does.
    """
    rows = _rows(Path(path), "positions", tuple(dict.fromkeys(METRIC_KEYS + GEODETIC_KEYS)), ("camera",))
    geodetic = any("lat" in row or "lon" in row for _, row in rows)
    across, along, up = ("lat", "lon", "alt") if geodetic else ("x", "y", "z")
    found: dict[str, KnownPosition] = {}
    faults: list[str] = []
    for place, row in rows:
        try:
            camera = _camera(row)
            if camera in found:
                raise InputError(f"camera {camera} occurs a second time: delete one")
            known = np.array([_number(row, across), _number(row, along), _number(row, up, math.nan)])
            if geodetic and not (abs(known[0]) < 90 and abs(known[1]) <= 360):
                raise InputError(f"lat {known[0]:g}, lon {known[1]:g} is not a place on earth: give degrees, latitude first")
            found[camera] = KnownPosition(camera, known, _sd(row, GPS_SD_M if geodetic else POSITION_SD_M))
        except InputError as error:
            faults.append(f"{path}: {place}: {error}")
    if faults:
        raise FileFaults(faults)
    return tuple(found.values()), geodetic


def _rows(path: Path, table: str, keys: Sequence[str], needed: Sequence[str]) -> list[Row]:
    """Read the rows of a CSV or a TOML file. Raises `InputError` if there are none."""
    rows = _toml_rows(path, table, keys) if path.suffix.lower() == ".toml" else _csv_rows(path, keys, needed)
    if not rows:
        raise InputError(f"{path}: has no row: known {table} are needed")
    return rows


def _toml_rows(path: Path, table: str, keys: Sequence[str]) -> list[Row]:
    """Read the tables `[[table]]` of a TOML file."""
    content = read_toml(path, f"a list of known {table} (TOML or CSV)")
    listed = content.get(table)
    if not isinstance(listed, list) or not all(isinstance(row, dict) for row in listed):
        raise InputError(f"{path}: has no tables [[{table}]]: give one for each row, with the keys {', '.join(keys)}")
    rows = [(f"[[{table}]] {number}", row) for number, row in enumerate(listed, start=1)]
    faults = [
        f"{path}: {place}: unknown key {shortened(key)}: {suggest_name(key[:80], list(keys))}"
        for place, row in rows
        for key in row
        if key not in keys
    ]
    if faults:
        raise FileFaults(faults)
    return rows


def _csv_rows(path: Path, keys: Sequence[str], needed: Sequence[str]) -> list[Row]:
    """Read the lines below the header of a CSV file. Names of columns may be in upper or lower case."""
    names, rows = csv_rows(path, read_text(path, "a table with a header (CSV)"))
    header = [name.lower() for name in names]
    missing = [name for name in needed if name not in header]
    if missing:
        raise InputError(
            f"{path}: line 1: has no column {missing[0]}: give a header out of {', '.join(keys)} (it has "
            f"{shortened_text(', '.join(header)) or 'nothing'})"
        )
    return [
        (f"line {number}", {name: field for name, field in zip(header, line, strict=False) if name in keys and field})
        for number, line in rows
        if any(line)
    ]


def _text(row: Mapping[str, Any], key: str) -> str:
    """Return the name under a key; empty if the key is missing."""
    value = row.get(key, "")
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        raise InputError(f"{key} is {shortened(value)}: give a name in quotes")
    return str(value)


def _camera(row: Mapping[str, Any]) -> str:
    name = _text(row, "camera")
    if not name:
        raise InputError("camera is missing: name the camera")
    return name


def _number(row: Mapping[str, Any], key: str, otherwise: float | None = None) -> float:
    """Return the finite number under a key; `otherwise` if the key is missing."""
    if key not in row:
        if otherwise is None:
            raise InputError(f"{key} is missing: give a number")
        return otherwise
    value = row[key]
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) <= LARGEST:
        raise InputError(f"{key} is {str(value)[:40]!r}: a number from -{LARGEST:g} to {LARGEST:g} is needed")
    return number


def _sd(row: Mapping[str, Any], otherwise: float) -> float:
    """Return the standard deviation of a row in metres, above 0; `otherwise` if it is not stated."""
    value = _number(row, "sd_m", otherwise)
    if value <= 0:
        raise InputError(f"sd_m is {value:g}: give metres above 0")
    return value
