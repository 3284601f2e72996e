"""Cast shadows: the background seen through less light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from passerby.perception.background_statistics import Levels
from passerby.perception.pictures import Picture


@dataclass(frozen=True)
class ShadowOptions:
    """What counts as a shadow."""

    darkest: float = 0.4
    """Least ratio of a picture to its background: direct sun is seldom more than 60 % of the light."""
    lightest: float = 0.97
    chroma: float = 0.10
    """Greatest difference of the ratio between channels."""
    texture: float = 0.06
    """Greatest standard deviation of the ratio among neighbours: the ground's texture is seen through a shadow."""


UNIT = 128
"""Ratio 1 in the 8-bit pictures of ratios."""


def shadow_mask(picture: Picture, usual: Picture, mask: Levels, certain: Levels, options: ShadowOptions) -> Levels:
    """(H, W) 255 where a pixel of `mask` looks like its background `usual` in less light.

    Where the difference is not `certain`, a darker grey suffices: at the rim of a shadow the ratio is not smooth.
    """
    ratio = cv2.blur(cv2.divide(picture, np.maximum(usual, 1), scale=UNIT), (3, 3))
    blue, green, red = cv2.split(ratio)
    least, most = cv2.min(cv2.min(blue, green), red), cv2.max(cv2.max(blue, green), red)
    darker = cv2.inRange(most, options.darkest * UNIT, options.lightest * UNIT)
    grey = cv2.threshold(cv2.subtract(most, least), options.chroma * UNIT, 255, cv2.THRESH_BINARY_INV)[1]
    plain = green.astype(np.float32)
    mean = cv2.blur(plain, (5, 5))
    variance = cv2.blur(plain * plain, (5, 5)) - mean * mean
    smooth = np.where(variance < (options.texture * UNIT) ** 2, np.uint8(255), np.uint8(0))
    candidate = cast(Levels, darker) & cast(Levels, grey) & (smooth | ~certain) & mask
    return cast(Levels, cv2.morphologyEx(candidate, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)))
