"""Rotation vectors (Rodrigues) out of files."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.geometry.rotations import exp_rotation

MOST_RADIANS = 1e3
"""A rotation vector is known to within a turn or a few; a longer one is another number's bytes, and OpenCV makes NaN of it."""


def rotation_of(vector: Floats, place: str = "") -> Floats:
    """(3, 3) rotation of a (3,) rotation vector, radians. Raises `InputError`, beginning with `place`, where it is none."""
    if not float(np.abs(vector).max()) <= MOST_RADIANS:
        raise InputError(f"{place}rotation is {np.asarray(vector).tolist()}: a Rodrigues vector in radians is needed")
    return exp_rotation(np.asarray(vector, dtype=np.float64).ravel())
