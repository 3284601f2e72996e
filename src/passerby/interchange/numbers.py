"""Numbers out of a parsed file: what is in lists in lists, checked once for all formats."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.interchange.storage.safe_parsing import leaves


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
