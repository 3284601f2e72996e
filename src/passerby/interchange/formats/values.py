"""Checks of values and camera names in files of other tools, with messages that state the remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable
from json import JSONDecodeError
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Pose
from passerby.interchange.numbers import NotNumbers, finite_numbers
from passerby.interchange.storage.safe_parsing import FLOAT, NotParsed, parse_json, parse_safe_yaml, parse_xml, read_text

ROTATION_TOLERANCE = 1e-3
"""Largest difference of a matrix's singular values from 1: files round to six digits, some to four. An accepted matrix is
replaced by the nearest rotation."""
FORBIDDEN_IN_FILES = re.compile(r"[^\w.+@ -]")
"""All characters except letters, digits, spaces and . _ + @ -"""
NO_DOT, LETTER = re.compile(r"[^.]"), re.compile(r"[A-Za-z]")
"""Permitted first characters of a name. Files that begin with a dot are hidden; an empty name does not match."""


class _Dumper(yaml.SafeDumper):
    """Dumper of plain YAML 1.1 that quotes texts that other readers, and `safe_parsing.Loader`, would take for a number."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))


def load_yaml(path: Path, kind: str) -> Any:
    """Read the first document of a YAML file. Raises `InputError` for a file that cannot be read or is not YAML."""
    return parse_yaml(path, read_text(path, f"{kind} (YAML)"))


def parse_yaml(path: Path, text: str) -> Any:
    """Parse the first document of YAML text; OpenCV's matrices become tables. `path` is for messages. Raises `InputError`."""
    try:
        return parse_safe_yaml(text)
    except NotParsed as error:
        raise InputError(f"{path}: {error}: is it another kind of file?") from None


def dump_yaml(value: Any) -> bytes:
    """Format plain values as YAML: keys in their order, lists of numbers on one line, ASCII (keeps Unicode's line ends)."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=1000).encode("ascii")


def matrix_data(values: dict[Any, Any], key: str) -> Any:
    """Return the numbers of a matrix that is stored with `rows`, `cols` and `data`; None if there is no such matrix."""
    matrix = values.get(key)
    return matrix.get("data") if isinstance(matrix, dict) else None


def load_json(path: Path, kind: str) -> Any:
    """Read a JSON file. Raises `InputError` for a file that cannot be read or is not JSON."""
    try:
        return parse_json(read_text(path, f"{kind} (JSON)"))
    except NotParsed as error:
        cause, told = error.__cause__, f"is not JSON: {error}"
        if isinstance(cause, JSONDecodeError):
            told = f"line {cause.lineno}: is not JSON: {cause.msg}"
        raise InputError(f"{path}: {told}: is it another kind of file?") from None


def table(place: str, value: Any, meaning: str) -> dict[Any, Any]:
    """Return `value` if it is a table (mapping). Raises `InputError`, which begins with `place`, if it is not."""
    if not isinstance(value, dict):
        raise InputError(f"{place}: holds no {meaning}: is it another kind of file?")
    return value


def numbers(place: str, values: dict[Any, Any], key: str, shape: tuple[int, ...]) -> Floats:
    """Return the finite numbers under `key` as an array of `shape`. Nested lists are flattened; (-1,) takes any count.

    Raises `InputError`, which begins with `place`.
    """
    wanted = "numbers are" if shape == (-1,) else f"{int(np.prod(shape))} numbers are" if shape else "a number is"
    if values.get(key) is None:
        raise InputError(f"{place}: {key} is missing: {wanted} needed")
    try:
        return finite_numbers(values[key], shape)
    except NotNumbers:
        raise InputError(f"{place}: {key} is {shortened(values[key])}: {wanted} needed, finite ones") from None


def attribute_numbers(element: ElementTree.Element, name: str, count: int, missing: float | None = None) -> Floats:
    """Read the finite numbers (count,) of an XML attribute, separated by spaces; each is `missing` if there is no attribute.

    Raises `InputError` without the place.
    """
    text = element.get(name)
    if text is None and missing is not None:
        return np.full(count, missing)
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.array([np.nan])
    if values.size != count or not np.isfinite(values).all():
        told = "missing" if text is None else shortened(text)
        raise InputError(f"<{element.tag}> {name} is {told}: {count} finite number{'s are' if count > 1 else ' is'} needed")
    return values


def load_xml(path: Path, kind: str, text: str | None = None) -> ElementTree.Element:
    """Read the root of an XML file, or of `text`. Raises `InputError` for a file that cannot be read or is not XML."""
    try:
        return parse_xml(read_text(path, kind) if text is None else text)
    except NotParsed as error:
        raise InputError(f"{path}: is not XML: {error}: {kind} is needed here") from None


def read_count(place: str, values: dict[Any, Any], key: str) -> int:
    """Return the whole number above 0 under `key`. Raises `InputError`, which begins with `place`."""
    value = float(numbers(place, values, key, ()))
    if value < 1 or value != int(value):
        raise InputError(f"{place}: {key} is {value:g}: a whole number above 0 is needed")
    return int(value)


def rotation(place: str, matrix: Floats) -> Floats:
    """Return the rotation nearest to a matrix (3, 3). Raises `InputError`, which begins with `place`, if none is near."""
    u, stretch, vt = np.linalg.svd(matrix)
    if np.abs(stretch - 1).max() > ROTATION_TOLERANCE or np.linalg.det(matrix) < 0:
        raise InputError(f"{place}: {shortened(matrix.tolist())} is not a rotation: orthonormal axes, right-handed, are needed")
    return np.asarray(u @ vt)


def rigid(place: str, matrix: Floats, metres: float) -> Pose:
    """Convert a transform (4, 4) `[R t; 0 1]`, world to camera, to a pose; `t` is scaled by `metres`. Raises `InputError`."""
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
        raise InputError(f"{place}: the last row is {matrix[3].tolist()}: 0, 0, 0, 1 is needed")
    return Pose(rotation(place, matrix[:3, :3]), metres * matrix[:3, 3])


def homogeneous(pose: Pose) -> Floats:
    """Return the transform (4, 4) from world to camera of a pose."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.R_cw, pose.t_cw
    return matrix


def padded(coefficients: Floats, length: int) -> list[float]:
    """Return distortion coefficients, filled with zeros up to `length`."""
    return [*coefficients.tolist(), *[0.0] * (length - coefficients.size)]


def tame_names(
    names: Iterable[str],
    forbidden: re.Pattern[str] = FORBIDDEN_IN_FILES,
    first: re.Pattern[str] = NO_DOT,
    prefix: str = "camera_",
) -> dict[str, str]:
    """Map each name to a safe name: forbidden characters become `_`. All safe names differ, even if letter case is ignored.

    If the first character does not match `first`, `prefix` is put before the name. Safe names stay unchanged, independent of
    the others, except names that differ from an earlier one only in case, because names may become file names.
    """
    names = list(names)
    tame: dict[str, str] = {}
    changing: list[tuple[str, str]] = []
    taken: set[str] = set()
    for name in names:
        safe = forbidden.sub("_", name).strip(" ")
        if safe == name and first.match(name) and name.casefold() not in taken:
            tame[name] = name
            taken.add(name.casefold())
        else:
            changing.append((name, safe if first.match(safe) else prefix + safe))
    for name, base in changing:
        unique, number = base, 2
        while unique.casefold() in taken:
            unique, number = f"{base}_{number}", number + 1
        tame[name] = unique
        taken.add(unique.casefold())
    return {name: tame[name] for name in names}
