"""Numbers out of a parsed file: what is in lists in lists, checked once for all formats.

Rotation vectors (Rodrigues) out of files.

A rig from the cameras of a file, with all their faults reported together.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.storage.safe_parsing import FileFaults, leaves

MOST_RADIANS = 1e3
"""A rotation vector is known to within a turn or a few; a longer one is another number's bytes, and OpenCV makes NaN of it."""


class NotNumbers(ValueError):
    """A value that is not the numbers that are needed; `infinite` where they are numbers, but not finite ones."""

    def __init__(self, *, infinite: bool = False) -> None:
        super().__init__("not finite" if infinite else "not these numbers")
        self.infinite = infinite


def finite_numbers(value: Any, shape: tuple[int, ...], *, nested: bool = False) -> Floats:
    """The numbers in a value, in their order, as an array of the shape; (-1,) takes any count, () is one number.

    Args:
        value: a number, or lists in lists.
        shape: of the result.
        nested: whether the lists must lie in each other as in the result; else their count alone matters.

    Raises `NotNumbers`.
    """
    flat = leaves(value)
    if any(type(number) not in (int, float) for number in flat):
        raise NotNumbers
    if not all(abs(number) <= sys.float_info.max for number in flat):
        raise NotNumbers(infinite=True)
    if (nested and not _is_nested(value, shape)) or (shape != (-1,) and len(flat) != math.prod(shape)):
        raise NotNumbers
    return np.array(flat, dtype=np.float64).reshape(shape)


def _is_nested(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether lists lie in each other as the shape says."""
    if not shape:
        return not isinstance(value, list)
    fits = isinstance(value, list) and shape[0] in (-1, len(value))
    return fits and all(_is_nested(item, shape[1:]) for item in value)


def rotation_of(vector: Floats, place: str = "") -> Floats:
    """(3, 3) rotation of a (3,) rotation vector, radians. Raises `InputError`, beginning with `place`, where it is none."""
    if not float(np.abs(vector).max()) <= MOST_RADIANS:
        raise InputError(f"{place}rotation is {np.asarray(vector).tolist()}: a Rodrigues vector in radians is needed")
    return exp_rotation(np.asarray(vector, dtype=np.float64).ravel())


def gather_rig(
    path: str | Path,
    cameras: Iterable[tuple[str, Callable[[], Camera]]],
    verdict: str | None = None,
    metadata: Mapping[str, str] | None = None,
) -> Rig:
    """The rig of the cameras that are read.

    Args:
        path: of the file, for messages.
        cameras: of each, its place in the file, and what reads it and raises `InputError` without the place.
        verdict: of the rig.
        metadata: of the rig.

    Raises:
        FileFaults: with the faults of all cameras that cannot be read.
        InputError: two cameras with one name.
    """
    found: list[Camera] = []
    faults: list[str] = []
    for place, read in cameras:
        try:
            found.append(read())
        except InputError as error:
            faults.append(f"{path}: {place}: {error}")
    if faults:
        raise FileFaults(faults)
    try:
        return Rig(tuple(found), verdict, dict(metadata or {}))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
