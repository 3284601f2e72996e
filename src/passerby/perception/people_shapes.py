"""From the foreground to boxes of people: whole ones, ones in parts, and ones who hide each other."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.perception.crowds import divide_crowds, heads, profiles
from passerby.perception.foreground import Foreground
from passerby.perception.silhouettes import Silhouettes, expected, merge_silhouettes, silhouettes, upright
from passerby.perception.stature import Stature

ALONE = 1.0
"""Score of a person who stands alone and is as tall as expected."""
UNKNOWN_HEIGHT = 0.7
"""Score of an upright shape where it is not known how tall people are."""
USUAL = 0.12
"""Greatest deviation from the expected height, as a fraction, of a score of 1: the spread of people's heights is 5 %."""
UNUSUAL = 0.5
"""Score of a person who stands alone and has another height: leaning, jumping, or without the head."""
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
    if stature is not None:
        found = merge_silhouettes(found, stature)
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
    region = (found.label[top : top + high, left : left + wide] == row + 1).astype(np.uint8)
    contour, _ = profiles(region)
    several = len(heads(contour, high, person)) > 1
    if several or wide > WIDEST * person or ratio > HEIGHTS[1]:
        if ratio <= HEIGHTS[0] or wide <= 0.3 * person:
            return np.zeros((0, 4)), 0.0
        return divide_crowds(region, (int(left), int(top)), stature), DIVIDED
    if shaped and HEIGHTS[0] <= ratio:
        return box, ALONE if abs(ratio - 1.0) <= USUAL else UNUSUAL
    if border and high >= least_pixels and fill >= 0.3 and high > wide:
        return box, CUT
    if 0.4 <= ratio < HEIGHTS[0] and high >= least_pixels and fill >= 0.4:
        return box, SHORT
    return np.zeros((0, 4)), 0.0
