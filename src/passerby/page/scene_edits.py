"""Changes of the scene file by acts: comments and order stay, the new text is checked and written atomically.

A world frame by two clicks is a file with two points beside the scene file. Its name is a digest of its content, and only the
scene file states which file is used.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array, InlineTable, Table

from passerby.common.errors import InputError
from passerby.core.scale_cues import POINT_SD_M
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import NotParsed, parse_toml, read_text
from passerby.scene.scene import Scene

POINTS_FILE = "world-points-{}.csv"
PERSON_DIGITS, PIXEL_DIGITS = 3, 2
TABLE_OF = {
    "lengths": "scale",
    "people": "scale",
    "same": "association",
    "different": "association",
    "not_people": "association",
    "lines": "world",
    "checks": "scale",
}
"""The table that holds each list of tables."""

Pixel = tuple[float, float]


@dataclass(frozen=True)
class GroundClick:
    """A click on the ground, and its wanted position in the world."""

    point: str
    camera: str
    at: Pixel
    x: float
    """Metres along the world's x axis; y and z are 0."""


def version_of(path: Path) -> str:
    """Return a digest of the content of a scene file; empty if it cannot be read."""
    try:
        return hashlib.blake2b(path.read_bytes(), digest_size=10).hexdigest()
    except OSError:
        return ""


def text_of(path: Path) -> str:
    """Read the text of the scene file, with its own line endings. Raises `InputError` if it cannot be read."""
    read_text(path, "a scene file (TOML)")
    return path.read_bytes().decode("utf-8-sig")


def save_scene(path: Path, text: str) -> None:
    """Write a scene file atomically, after a check that it is a valid scene. Raises `InputError` before any change."""
    try:
        content = parse_toml(text.replace("\r\n", "\n"))
    except NotParsed as error:
        raise InputError(f"{path}: would be no TOML: {error}") from None
    Scene.of_content(content, path)
    write_text(path, text)


def add_length(
    text: str, metres: float, sd_m: float, points: Mapping[str, Sequence[Pixel]], key: str = "lengths"
) -> str:  # fmt: skip
    """Return the text with one more `[[scale.lengths]]`, or `[[scale.checks]]`: two ends in each camera, pixels."""
    document = _parse_scene(text)
    entry = tomlkit.table()
    entry["metres"] = metres
    entry["sd_m"] = sd_m
    marks = tomlkit.inline_table()
    for name, ends in points.items():
        marks[name] = _pixels(ends)
    entry["points"] = marks
    _append(document, "scale", key, entry)
    return tomlkit.dumps(document)


def add_person(text: str, camera: str, frame: int, at: Pixel, height_m: float, sd_m: float) -> str:
    """Return the text with one more `[[scale.people]]`: the person at a pixel of a camera's frame, and the height."""
    document = _parse_scene(text)
    entry = tomlkit.table()
    entry["camera"] = camera
    entry["frame"] = frame
    entry["at"] = [round(value, PIXEL_DIGITS) for value in at]
    entry["height_m"] = round(height_m, PERSON_DIGITS)
    entry["sd_m"] = sd_m
    _append(document, "scale", "people", entry)
    return tomlkit.dumps(document)


def add_identities(text: str, key: str, boxes: Sequence[tuple[str, int, Pixel]]) -> str:
    """Return the text with one more `[[association.same]]` or `different`: boxes by camera, frame and pixel."""
    document = _parse_scene(text)
    entry = tomlkit.table()
    entry["boxes"] = tomlkit.array()
    for camera, frame, at in boxes:
        one = tomlkit.inline_table()
        one.update({"camera": camera, "frame": frame, "at": _round_value(at)})
        entry["boxes"].append(one)
    entry["boxes"].multiline(True)
    _append(document, "association", key, entry)
    return tomlkit.dumps(document)


def add_not_a_person(text: str, camera: str, frame: int, at: Pixel) -> str:
    """Return the text with one more `[[association.not_people]]`."""
    document = _parse_scene(text)
    entry = tomlkit.table()
    entry.update({"camera": camera, "frame": frame, "at": _round_value(at)})
    _append(document, "association", "not_people", entry)
    return tomlkit.dumps(document)


def add_line(text: str, direction: str, points: Mapping[str, Sequence[Pixel]]) -> str:
    """Return the text with one more `[[world.lines]]`: two pixels in each camera."""
    document = _parse_scene(text)
    entry = tomlkit.table()
    entry["direction"] = direction
    entry["points"] = _write_marks(points)
    _append(document, "world", "lines", entry)
    return tomlkit.dumps(document)


def remove_entry(text: str, key: str, number: int) -> str:
    """Return the text without the table of this number, from 1, in one of the lists of tables of `TABLE_OF`."""
    document = _parse_scene(text)
    table = TABLE_OF[key]
    entries = document.get(table, {}).get(key, [])
    if not 1 <= number <= len(entries):
        raise InputError(f"[[{table}.{key}]] {number} is not there: it has {len(entries)}")
    del entries[number - 1]
    if not len(entries):
        del cast(Table, document[table])[key]
        if table == "world" and not len(cast(Table, document[table])):
            del document[table]
    return tomlkit.dumps(document)


def remove_camera(text: str, name: str) -> str:
    """Return the text with the table of a camera changed to comments at the end of the file."""
    document = _parse_scene(text)
    cameras = document.get("cameras", {})
    if name not in cameras:
        raise InputError(f"[cameras.{name}] is not there")
    alone = tomlkit.document()
    alone["cameras"] = {name: cameras[name].unwrap()}
    del cameras[name]
    lines = tomlkit.dumps(alone).strip().splitlines()
    kept = "\n".join(
        ["# Left out; remove the signs to use the camera again.", *(f"# {line}" for line in lines if line.strip())]
    )
    return f"{tomlkit.dumps(document).rstrip()}\n\n{kept}\n"


def add_excluded(text: str, camera: str, key: str, entry: Sequence[Any]) -> str:
    """Return the text with one more entry of a camera's `exclude` (corners, pixels) or `exclude_s` (begin and end, seconds)."""
    document = _parse_scene(text)
    table = _camera(document, camera)
    if key not in table:
        table[key] = tomlkit.array()
    if not isinstance(table[key], Array):
        raise InputError(f"[cameras.{camera}] {key} is no list: correct it in an editor first")
    table[key].append([_round_value(one) for one in entry])
    return tomlkit.dumps(document)


def remove_excluded(text: str, camera: str, key: str, number: int) -> str:
    """Return the text without the entry of this number, from 1, of a camera's `exclude` or `exclude_s`."""
    document = _parse_scene(text)
    table = _camera(document, camera)
    entries = table.get(key, [])
    if not 1 <= number <= len(entries):
        raise InputError(f"[cameras.{camera}] {key} {number} is not there: it has {len(entries)}")
    del entries[number - 1]
    if not len(entries):
        del table[key]
    return tomlkit.dumps(document)


def set_time_limit(text: str, camera: str, key: str, seconds: float) -> str:
    """Return the text with `from_s` or `until_s` of a camera set or replaced."""
    document = _parse_scene(text)
    _camera(document, camera)[key] = _round_value(seconds)
    return tomlkit.dumps(document)


def remove_time_limit(text: str, camera: str, key: str) -> str:
    """Return the text without `from_s` or `until_s` of a camera."""
    document = _parse_scene(text)
    table = _camera(document, camera)
    if key not in table:
        raise InputError(f"[cameras.{camera}] {key} is not there")
    del table[key]
    return tomlkit.dumps(document)


def set_world_points(text: str, points_file: str) -> str:
    """Return the text with `[world]` set by a file of points only; lines stay, except those that set the heading."""
    document = _parse_scene(text)
    table = tomlkit.table()
    table["points"] = points_file
    keep_lines(document.get("world"), table)
    if "world" in document:
        document["world"] = table
    else:
        if text.strip():
            document.add(tomlkit.nl())
        document["world"] = table
    return tomlkit.dumps(document)


def keep_lines(world: Any, table: Table) -> None:
    """Copy the lines of a `[world]` into another table, except those that set the heading."""
    lines = world.get("lines", []) if isinstance(world, Mapping) else []
    for one in lines:
        if one.get("direction") != "x":
            entry = tomlkit.table()
            entry.update(one.unwrap())
            table.setdefault("lines", tomlkit.aot()).append(entry)


def write_points(folder: Path, clicks: Sequence[GroundClick], sd_m: float = POINT_SD_M) -> str:
    """Write clicks on the ground as known points, and return the name of their file; the same clicks give the same name."""
    rows = [f"{one.point},{_field(one.camera)},{one.at[0]:.2f},{one.at[1]:.2f},{one.x:.4f},0,0,{sd_m:g}" for one in clicks]
    content = "\n".join(["point,camera,u,v,x,y,z,sd_m", *rows, ""])
    name = POINTS_FILE.format(hashlib.blake2b(content.encode(), digest_size=5).hexdigest())
    write_text(folder / name, content)
    return name


def _camera(document: tomlkit.TOMLDocument, name: str) -> Any:
    cameras = document.get("cameras", {})
    if name not in cameras:
        raise InputError(f"[cameras.{name}] is not there")
    return cameras[name]


def _round_value(value: Any) -> Any:
    """Round a number or a pixel as it is written to the file."""
    if isinstance(value, Sequence):
        return [round(float(one), PIXEL_DIGITS) for one in value]
    return round(float(value), PIXEL_DIGITS)


def _field(text: str) -> str:
    """Return text as a field of a CSV row, quoted if necessary."""
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"\n') else text


def _parse_scene(text: str) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(text)
    except TOMLKitError as error:
        raise InputError(f"the scene file is not TOML: {error}: correct it in an editor first") from None


def _append(document: tomlkit.TOMLDocument, name: str, key: str, entry: Table) -> None:
    """Add a table to `[[NAME.KEY]]`, which may be missing, or a list of inline tables."""
    entry.trivia.indent = "\n"  # an empty line before its header
    table: Any = document.get(name)
    if table is None:
        table = tomlkit.table(is_super_table=True)
        document[name] = table
    if key not in table:
        table[key] = tomlkit.aot()
    entries = table[key]
    if isinstance(entries, AoT):
        entries.append(entry)
        return
    if not isinstance(entries, Array):
        raise InputError(f"[{name}] {key} is no list of tables: write [[{name}.{key}]]")
    inline = tomlkit.inline_table()
    inline.update(entry.unwrap())
    entries.append(inline)


def _write_marks(points: Mapping[str, Sequence[Pixel]]) -> InlineTable:
    """Return the pixels of each camera as an inline table."""
    marks = tomlkit.inline_table()
    for name, ends in points.items():
        marks[name] = _pixels(ends)
    return marks


def _pixels(ends: Sequence[Pixel]) -> list[list[float]]:
    return [[round(float(value), PIXEL_DIGITS) for value in end] for end in ends]
