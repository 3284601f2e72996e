"""Values and camera names in files of other tools, checked, with errors a person can act on."""

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
"""Of `R R^T` from one: files round to six digits, some to four. What is accepted is made a rotation."""
FORBIDDEN_IN_FILES = re.compile(r"[^\w.+@ -]")
"""Everything but letters, digits, spaces and . _ + @ -"""
NO_DOT, LETTER = re.compile(r"[^.]"), re.compile(r"[A-Za-z]")
"""How a name may begin. Files that begin with a dot are hidden; an empty name begins with nothing."""


class _Dumper(yaml.SafeDumper):
    """Plain YAML 1.1, with quotes around text that other readers, and `untrusted.Loader`, would take for a number."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))


def load_yaml(path: Path, kind: str) -> Any:
    """The first document of a YAML file. Raises `InputError` for a file that cannot be read or is not YAML."""
    return parse_yaml(path, read_text(path, f"{kind} (YAML)"))


def parse_yaml(path: Path, text: str) -> Any:
    """The first document of YAML text, a matrix of OpenCV as a table; `path` is for messages. Raises `InputError`."""
    try:
        return parse_safe_yaml(text)
    except NotParsed as error:
        raise InputError(f"{path}: {error}: is it another kind of file?") from None


def dump_yaml(value: Any) -> bytes:
    """YAML text of plain values: keys as they come, lists of numbers on one line, ASCII (line ends of Unicode survive so)."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=1000).encode("ascii")


def matrix_data(values: dict[Any, Any], key: str) -> Any:
    """The numbers of a matrix that is stored with `rows`, `cols` and `data`; None where there is none."""
    matrix = values.get(key)
    return matrix.get("data") if isinstance(matrix, dict) else None


def load_json(path: Path, kind: str) -> Any:
    """The content of a JSON file. Raises `InputError` for a file that cannot be read or is not JSON."""
    try:
        return parse_json(read_text(path, f"{kind} (JSON)"))
    except NotParsed as error:
        cause, told = error.__cause__, f"is not JSON: {error}"
        if isinstance(cause, JSONDecodeError):
            told = f"line {cause.lineno}: is not JSON: {cause.msg}"
        raise InputError(f"{path}: {told}: is it another kind of file?") from None


def table(place: str, value: Any, meaning: str) -> dict[Any, Any]:
    """`value` as a table (mapping). Raises `InputError`, beginning with `place`, where it is none."""
    if not isinstance(value, dict):
        raise InputError(f"{place}: holds no {meaning}: is it another kind of file?")
    return value


def numbers(place: str, values: dict[Any, Any], key: str, shape: tuple[int, ...]) -> Floats:
    """The finite numbers under `key`, in `shape`; lists in lists count by their order, (-1,) takes any number of them.

    Raises `InputError`, beginning with `place`.
    """
    wanted = "numbers are" if shape == (-1,) else f"{int(np.prod(shape))} numbers are" if shape else "a number is"
    if values.get(key) is None:
        raise InputError(f"{place}: {key} is missing: {wanted} needed")
    try:
        return finite_numbers(values[key], shape)
    except NotNumbers:
        raise InputError(f"{place}: {key} is {shortened(values[key])}: {wanted} needed, finite ones") from None


def attribute_numbers(element: ElementTree.Element, name: str, count: int, missing: float | None = None) -> Floats:
    """(count,) the finite numbers of an XML attribute, separated by spaces; `missing` each where it is not there.

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
    """The root of an XML file, or of its text. Raises `InputError` for a file that cannot be read or is not XML."""
    try:
        return parse_xml(read_text(path, kind) if text is None else text)
    except NotParsed as error:
        raise InputError(f"{path}: is not XML: {error}: {kind} is needed here") from None


def read_count(place: str, values: dict[Any, Any], key: str) -> int:
    """A whole number above 0 under `key`. Raises `InputError`, beginning with `place`."""
    value = float(numbers(place, values, key, ()))
    if value < 1 or value != int(value):
        raise InputError(f"{place}: {key} is {value:g}: a whole number above 0 is needed")
    return int(value)


def rotation(place: str, matrix: Floats) -> Floats:
    """The rotation nearest to a (3, 3) matrix that is one but for rounding. Raises `InputError`, beginning with `place`."""
    u, stretch, vt = np.linalg.svd(matrix)
    if np.abs(stretch - 1).max() > ROTATION_TOLERANCE or np.linalg.det(matrix) < 0:
        raise InputError(f"{place}: {shortened(matrix.tolist())} is not a rotation: orthonormal axes, right-handed, are needed")
    return np.asarray(u @ vt)


def rigid(place: str, matrix: Floats, metres: float) -> Pose:
    """A (4, 4) transform `[R t; 0 1]` from world to camera as a pose; `t` times `metres`. Raises `InputError`."""
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
        raise InputError(f"{place}: the last row is {matrix[3].tolist()}: 0, 0, 0, 1 is needed")
    return Pose(rotation(place, matrix[:3, :3]), metres * matrix[:3, 3])


def homogeneous(pose: Pose) -> Floats:
    """(4, 4) transform from world to camera."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.R_cw, pose.t_cw
    return matrix


def padded(coefficients: Floats, length: int) -> list[float]:
    """Distortion coefficients with zeros up to `length`."""
    return [*coefficients.tolist(), *[0.0] * (length - coefficients.size)]


def tame_names(
    names: Iterable[str],
    forbidden: re.Pattern[str] = FORBIDDEN_IN_FILES,
    first: re.Pattern[str] = NO_DOT,
    prefix: str = "camera_",
) -> dict[str, str]:
    """Each name with what is forbidden replaced by `_`; no two alike, not even where the case of letters does not count.

    Each begins as `first` says; where it would not, `prefix` is put before it. Names that can stay do stay, whatever the others
    are, but for those that differ from an earlier one in case alone: they may become file names.
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
