"""What a static camera sees when nobody is there: the usual colour of every pixel, and how much it varies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.perception.pictures import Picture

Levels = NDArray[np.uint8]

SHARE = 0.4
"""Share of the samples that must agree on a value: the ground is then found where people stand for up to half of the time,
as long as they differ from each other or move a little."""
ROWS = 32
"""Rows worked on at once: the memory stays small."""


def usual_colours(pictures: Sequence[Picture]) -> tuple[Picture, Levels]:
    """The most frequent colour of every pixel, and its noise.

    The colour is the centre of the shortest interval that holds `SHARE` of a channel's samples (an estimate of the mode:
    Grübel, Annals of Statistics 1988), among equals the one nearest to the median. The noise is the deviation that half of
    the samples keep to, as the standard deviation of a normal distribution: foliage in the wind has much, passers-by add
    little.

    Args:
        pictures: n pictures (H, W, 3) of one size.

    Returns:
        (H, W, 3) BGR, and (H, W, 3) standard deviations, grey levels times 8, at most 255.
    """
    height, width = pictures[0].shape[:2]
    colour = np.empty((height, width, 3), np.uint8)
    noise = np.empty((height, width, 3), np.uint8)
    for row in range(0, height, ROWS):
        rows = slice(row, min(row + ROWS, height))
        colour[rows], noise[rows] = _usual(np.stack([picture[rows] for picture in pictures]))
    return colour, noise


def _usual(samples: Picture) -> tuple[Levels, Levels]:
    """`usual_colours` of samples (n, ...), n first."""
    ordered = np.sort(samples, axis=0)
    count = len(ordered)
    held = max(int(np.ceil(SHARE * count)), 1)
    starts = count - held + 1
    spread = (ordered[held - 1 :] - ordered[:starts]).astype(np.int32)
    centre = ordered[(held - 1) // 2 : (held - 1) // 2 + starts].astype(np.int32)
    away = np.abs(centre - ordered[count // 2].astype(np.int32))
    best = np.argmin(spread * 256 + away, axis=0)
    usual = np.take_along_axis(centre, best[None], axis=0)[0]
    deviation = np.sort(np.abs(samples.astype(np.int16) - usual.astype(np.int16)), axis=0)
    half = 0.5 * (deviation[(count - 1) // 2] + deviation[count // 2]).astype(np.float32)
    # Values are rounded to whole grey levels: the mean deviation of the nearer half tells finer than its limit alone.
    nearer = deviation[: max(count // 2, 1)].mean(axis=0, dtype=np.float32)
    sigma = np.maximum(half / 0.6745, nearer / 0.3247)
    return usual.astype(np.uint8), np.minimum(np.rint(sigma * 8.0), 255).astype(np.uint8)


def local_contrast(picture: Picture) -> Levels:
    """(H, W, 3) half the range among a pixel's neighbours: by how many grey levels a shake of one pixel changes it."""
    kernel = np.ones((3, 3), np.uint8)
    return cast(Levels, cv2.morphologyEx(picture, cv2.MORPH_GRADIENT, kernel) // 2)
