"""What a static camera sees when no person is there: the usual colour of every pixel, and how much it varies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.perception.pictures import Picture

Levels = NDArray[np.uint8]

ROUNDS = 2
"""How often the samples are halved: what is seen for more than half of the time wins, and where nothing is, what is seen for a
quarter of it and agrees the best."""
ROWS = 32
"""Rows worked on at once: the memory stays small."""


def usual_colours(pictures: Sequence[Picture]) -> tuple[Picture, Levels]:
    """The most frequent colour of every pixel, and its noise.

    The colour is the half-sample mode of a channel: the shortest interval that holds half of the samples, then half of those
    (Robertson and Cryer, *An Iterative Procedure for Estimating the Mode*, JASA 1974), and of these the middle one. The noise
    is the deviation that half of the samples keep to, as the standard deviation of a normal distribution: foliage in the wind
    has much, passers-by add little.

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
    ordered, count = np.sort(samples, axis=0), len(samples)
    middle = ordered[count // 2].astype(np.int32)
    for _ in range(ROUNDS):
        ordered = _shortest_half(ordered, middle)
    usual = ordered[(len(ordered) - 1) // 2]
    deviation = np.sort(np.abs(samples.astype(np.int16) - usual.astype(np.int16)), axis=0)
    half = 0.5 * (deviation[(count - 1) // 2] + deviation[count // 2]).astype(np.float32)
    # Values are rounded to whole grey levels: the mean deviation of the nearer half tells finer than its limit alone.
    nearer = deviation[: max(count // 2, 1)].mean(axis=0, dtype=np.float32)
    sigma = np.maximum(half / 0.6745, nearer / 0.3247)
    return usual, np.minimum(np.rint(sigma * 8.0), 255).astype(np.uint8)


def _shortest_half(ordered: Levels, middle: NDArray[np.int32]) -> Levels:
    """The half of samples (n, ...), ascending along n, that lies closest together; among equals the one nearest to `middle`."""
    held = max((len(ordered) + 1) // 2, 1)
    starts = len(ordered) - held + 1
    spread = (ordered[held - 1 :] - ordered[:starts]).astype(np.int32)
    away = np.abs(ordered[(held - 1) // 2 : (held - 1) // 2 + starts].astype(np.int32) - middle)
    best = np.argmin(spread * 256 + away, axis=0)
    rows = best[None] + np.arange(held).reshape(-1, *(1,) * best.ndim)
    return np.take_along_axis(ordered, rows, axis=0)


def local_contrast(picture: Picture) -> Levels:
    """(H, W, 3) half the range among a pixel's neighbours: by how many grey levels a shake of one pixel changes it."""
    kernel = np.ones((3, 3), np.uint8)
    return cast(Levels, cv2.morphologyEx(picture, cv2.MORPH_GRADIENT, kernel) // 2)
