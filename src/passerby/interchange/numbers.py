"""Checks of values from parsed files, shared by all formats.

Numbers in nested lists, rotation vectors (Rodrigues), and a rig from the cameras of a file, with all their faults reported
together.
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
"""Largest component of a rotation vector. True ones have a few turns at most. Far larger values are bytes of other numbers, and
OpenCV converts them to NaN."""


class NotNumbers(ValueError):
    """A value that does not hold the numbers that are needed; `infinite` if it holds numbers that are not finite."""

    def __init__(self, *, infinite: bool = False) -> None:
        super().__init__("not finite" if infinite else "not these numbers")
        self.infinite = infinite


def finite_numbers(value: Any, shape: tuple[int, ...], *, nested: bool = False) -> Floats:
    """Convert the numbers in a value to an array of a shape, in their order.

    Args:
        value: a number, or nested lists of numbers.
        shape: shape of the result; (-1,) takes any count, () is one number.
        nested: whether the lists must be nested as in the result; otherwise only the count of numbers is checked.

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
    """Check whether lists are nested as the shape requires."""
    if not shape:
        return not isinstance(value, list)
    fits = isinstance(value, list) and shape[0] in (-1, len(value))
    return fits and all(_is_nested(item, shape[1:]) for item in value)


def rotation_of(vector: Floats, place: str = "") -> Floats:
    """Return the rotation (3, 3) of a rotation vector (3,) in radians. Raises `InputError`, which begins with `place`, for a
    vector that is too long or not finite.
    """
    if not float(np.abs(vector).max()) <= MOST_RADIANS:
        raise InputError(f"{place}rotation is {np.asarray(vector).tolist()}: a Rodrigues vector in radians is needed")
    return exp_rotation(np.asarray(vector, dtype=np.float64).ravel())


def gather_rig(
    path: str | Path,
    cameras: Iterable[tuple[str, Callable[[], Camera]]],
    verdict: str | None = None,
    metadata: Mapping[str, str] | None = None,
) -> Rig:
    """Read the cameras of a file into a rig.

    Args:
        path: path of the file, for messages.
        cameras: for each camera, its place in the file and a function that reads it. The function raises `InputError` without
            the place.
        verdict: verdict of the rig.
        metadata: metadata of the rig.

    Raises:
        FileFaults: the faults of all cameras that cannot be read.
        InputError: two cameras have the same name.
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
