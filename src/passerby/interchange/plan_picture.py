"""Reading of the picture of a floor plan."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.errors import InputError
from passerby.interchange.storage.safe_parsing import file_bytes

LEAST_PX = 8
"""Shortest permitted side of the picture of a plan, pixels."""


def read_plan_picture(path: Path) -> NDArray[np.uint8]:
    """Read a picture (H, W, 3), BGR. Raises `InputError` for a file that is missing, or is no picture."""
    return decode_plan_picture(file_bytes(path, "a picture of the plan (PNG or JPEG)"), str(path))


def decode_plan_picture(content: bytes, place: str) -> NDArray[np.uint8]:
    """Decode a file's content to a picture (H, W, 3), BGR, turned as the file states (EXIF orientation).

    Raises `InputError`, which begins with `place`, for content that is no picture.
    """
    try:
        picture = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR) if content else None
    except cv2.error:
        picture = None
    if picture is None:
        raise InputError(f"{place}: is no picture that can be read: give a PNG or JPEG")
    if min(picture.shape[:2]) < LEAST_PX:
        raise InputError(f"{place}: is {picture.shape[1]} x {picture.shape[0]} pixels: give a picture of the plan")
    return np.asarray(picture, dtype=np.uint8)
