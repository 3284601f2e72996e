"""From the foreground to boxes of people: whole ones, ones in parts, and ones who hide each other."""

from __future__ import annotations

import numpy as np

from passerby.observations import Floats
from passerby.perception.crowds import divide
from passerby.perception.foreground import Foreground
from passerby.perception.silhouettes import Silhouettes, expected, silhouettes, upright
from passerby.perception.stature import Stature

ALONE = 1.0
"""Score of a person who stands alone and is as tall as expected."""
UNKNOWN_HEIGHT = 0.7
"""Score of an upright shape where it is not known how tall people are."""
DIVIDED = 0.6
SHORT = 0.35
"""Score of a shape that is too low for a standing person: crouching, or half hidden."""
CUT = 0.5
"""Score of a person who is cut by the picture's border."""
HEIGHTS = (0.8, 1.2)
"""Of one standing person, as fractions of the expected height."""
WIDEST = 0.62
"""Of one standing person, as a fraction of the expected height: a long stride seen from the side."""


def found_people(foreground: Foreground, stature: Stature | None, least_pixels: float) -> tuple[Floats, Floats]:
    """(N, 4) boxes and (N,) scores of the people in a foreground, working pixels."""
    found = silhouettes(foreground.body, least_pixels)
    if len(found) == 0:
        return np.zeros((0, 4)), np.zeros(0)
    ltwh = found.ltwh.astype(np.float64)
    shaped = upright(found, least_pixels)
    if stature is None:
        return ltwh[shaped], np.full(int(shaped.sum()), UNKNOWN_HEIGHT)
    boxes, scores = [], []
    person = expected(ltwh, stature)
    for row in range(len(found)):
        some, score = _people(found, row, bool(shaped[row]), float(person[row]), stature, least_pixels)
        boxes.append(some)
        scores.append(np.full(len(some), score))
    return np.concatenate(boxes), np.concatenate(scores)


def _people(
    found: Silhouettes, row: int, shaped: bool, person: float, stature: Stature, least_pixels: float
) -> tuple[Floats, float]:
    """(N, 4) people in one region and their score."""
    box = found.ltwh[row : row + 1].astype(np.float64)
    left, top, wide, high = found.ltwh[row]
    ratio = high / person
    fill = found.area[row] / (wide * high)
    rows, columns = found.label.shape
    border = left <= 1 or top <= 1 or left + wide >= columns - 1 or top + high >= rows - 1
    if shaped and HEIGHTS[0] <= ratio <= HEIGHTS[1] and wide <= WIDEST * person:
        return box, ALONE
    if border and high >= least_pixels and ratio <= HEIGHTS[1] and wide <= WIDEST * person and fill >= 0.3 and high > wide:
        return box, CUT
    if 0.4 <= ratio < HEIGHTS[0] and high >= least_pixels and wide <= WIDEST * person and fill >= 0.4:
        return box, SHORT
    if wide > 0.4 * person and ratio > HEIGHTS[0]:
        region = (found.label[top : top + high, left : left + wide] == row + 1).astype(np.uint8)
        return divide(region, (int(left), int(top)), stature), DIVIDED
    return np.zeros((0, 4)), 0.0
