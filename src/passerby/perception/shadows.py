"""Cast shadows: the background seen through less light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from passerby.common.arrays import Floats
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
    deepest: float = 0.75
    """Least ratio as a fraction of that of the recording's shadows, where it is known: at the feet the sky is hidden too."""
    faintest: float = 0.35
    """Greatest ratio, where that of the recording's shadows is known: so far towards no shadow. Thin ones are blurred."""


UNIT = 128
"""Ratio 1 in the 8-bit pictures of ratios."""
RIM = 7
"""Pixels: a shadow is grown by half of it, over its penumbra, where the ratio is not smooth."""
FAINT = 0.8
"""Shadows that take less of the light have no one tone: they are contact shadows, or come and go with the clouds."""
LEAST_PIXELS = 2000
"""So many pixels of shadow tell its tone."""
LEAST_SHARE = 0.5
"""Of those pixels that agree on the tone: under an overcast sky there is none, shadows fade out."""


@dataclass(frozen=True, eq=False)
class Shadows:
    """What is shadow in a picture."""

    mask: Levels
    """(H, W) 255 for shadow."""
    core: Levels
    """(H, W) the same without the rims."""
    ratio: Levels
    """(H, W, 3) ratio of the picture to its background, 128 for 1."""


def find_shadows(
    picture: Picture, usual: Picture, mask: Levels, certain: Levels, options: ShadowOptions, tone: Floats | None
) -> Shadows:
    """Which pixels of `mask` look like their background `usual` in less light.

    Where the difference is not `certain`, a darker grey suffices: at the rim of a shadow the ratio is not smooth.

    Args:
        picture: (H, W, 3).
        usual: (H, W, 3) the background in the same light.
        mask: (H, W) 255 for foreground.
        certain: (H, W) 255 where the difference is large.
        options: what counts as a shadow.
        tone: (3,) the ratio in this recording's shadows, by channel, where it is known: clothes that are grey like the ground
            have another.
    """
    ratio = cast(Levels, cv2.divide(picture, np.maximum(usual, 1), scale=UNIT))
    blue, green, red = cv2.split(ratio)
    least, most = cv2.min(cv2.min(blue, green), red), cv2.max(cv2.max(blue, green), red)
    darker = cast(Levels, cv2.inRange(most, options.darkest * UNIT, options.lightest * UNIT))
    grey = cast(Levels, cv2.threshold(cv2.subtract(most, least), options.chroma * UNIT, 255, cv2.THRESH_BINARY_INV)[1])
    plausible = darker & grey & mask
    if not plausible.any():
        return Shadows(plausible, plausible, ratio)
    if tone is None:
        plain = green.astype(np.float32)
        mean = cv2.blur(plain, (5, 5))
        variance = cv2.blur(plain * plain, (5, 5)) - mean * mean
        core = plausible & np.where(variance < (options.texture * UNIT) ** 2, np.uint8(255), np.uint8(0))
    else:
        low, high = options.deepest * tone * UNIT, (tone + options.faintest * (1.0 - tone)) * UNIT
        core = plausible & cast(Levels, cv2.inRange(ratio, low, high))
    # Seen at a grazing angle a shadow is a few rows high.
    core = cast(Levels, cv2.morphologyEx(core, cv2.MORPH_OPEN, np.ones((2, 4), np.uint8)))
    grown = cast(Levels, cv2.dilate(core, np.ones((RIM, RIM), np.uint8))) & plausible
    return Shadows(grown | (plausible & ~certain), core, ratio)


def shadow_tone(ratios: Sequence[Levels]) -> Floats | None:
    """(3,) the ratio, by channel, that most of the shadows' pixels (n, 3) have, 128 for 1; None without agreement."""
    pixels = np.concatenate([np.zeros((0, 3), np.uint8), *ratios]).astype(np.float64) / UNIT
    pixels = pixels[pixels[:, 1] < 0.9]
    if len(pixels) < LEAST_PIXELS:
        return None
    count, edges = np.histogram(pixels[:, 1], bins=50, range=(0.0, 1.0))
    peak = edges[np.argmax(np.convolve(count, np.ones(5), mode="same"))] + 0.01
    near = np.abs(pixels[:, 1] - peak) < 0.07
    if near.mean() < LEAST_SHARE or peak > FAINT:
        return None
    return np.asarray(np.median(pixels[near], axis=0))


def recover_foreground(body: Levels, shadow: Levels) -> Levels:
    """The body (H, W; 255) with what lies between two parts of it in a column of foreground: legs as grey as a shadow.

    A shadow has a part of a body above it, if any, or beside it; legs have one above and shoes below.
    """
    foreground = body | shadow
    rows = np.flatnonzero(shadow.any(axis=1))
    if len(rows) == 0:
        return body
    start, end = max(int(rows[0]) - 1, 0), min(int(rows[-1]) + 2, len(body))
    below_one, above_one = body[start:end].copy(), body[start:end].copy()
    allowed = foreground[start:end]
    for row in range(1, end - start):
        below_one[row] |= below_one[row - 1] & allowed[row]
        above_one[-1 - row] |= above_one[-row] & allowed[-1 - row]
    filled = body.copy()
    filled[start:end] |= below_one & above_one
    return filled


def without_slivers(body: Levels, shadow: Levels) -> Levels:
    """The body (H, W; 255) without what is left of shadows' rims: less than three pixels thick, and beside a shadow."""
    square = np.ones((3, 3), np.uint8)
    thin = body & ~cast(Levels, cv2.morphologyEx(body, cv2.MORPH_OPEN, square))
    return body & ~(thin & cast(Levels, cv2.dilate(shadow, np.ones((RIM, RIM), np.uint8))))
