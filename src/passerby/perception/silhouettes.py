"""From a mask of the foreground to the regions that may be people."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.background_statistics import Levels
from passerby.perception.stature import Stature

Labels = NDArray[np.int32]

CLOSING = 0.02
"""Height of the gaps that are closed, as a fraction of the picture's height: belts, and legs behind a rope."""
PART = 0.8
"""Of the expected height: a lower region may be a part of a person."""
TALLEST = 1.15
"""Of the expected height: what people's parts together may have."""
GAP = 0.25
"""Of the expected height, between two parts."""
ASIDE = 0.2
"""Of the expected height: the middles of two parts are no farther apart from side to side."""
LEAST_HEIGHT = 0.04
"""Of a person, as a fraction of the picture's height."""
LEAST_PIXELS = 24
"""Of a person's height: less has no shape."""
ASPECTS = (1.2, 6.0)
"""Height over width of an upright person."""
FILLS = (0.25, 0.95)
"""Share of its box that a person's silhouette covers."""


@dataclass(frozen=True, eq=False)
class Silhouettes:
    """The connected regions of a mask, working pixels."""

    label: Labels
    """(H, W) 0 for the background, else the number of a region and 1."""
    ltwh: NDArray[np.int32]
    """(N, 4) bounding boxes."""
    area: NDArray[np.int32]
    """(N,) pixels."""

    def __len__(self) -> int:
        return len(self.area)


def silhouettes(mask: Levels, least_pixels: float) -> Silhouettes:
    """The regions of a mask (H, W; 0 or 255) that are large enough to be a part of a person at least `least_pixels` tall."""
    rows = max(round(CLOSING * mask.shape[0]), 3) | 1
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((rows, 3), np.uint8))
    _, label, measured, _ = cv2.connectedComponentsWithStats(closed, connectivity=8, ltype=cv2.CV_32S)
    stats = np.asarray(measured, np.int32)
    large = (stats[1:, cv2.CC_STAT_AREA] >= 0.05 * least_pixels**2) & (stats[1:, cv2.CC_STAT_HEIGHT] >= 0.2 * least_pixels)
    number = np.zeros(len(stats), np.int32)
    number[1:][large] = np.arange(1, large.sum() + 1)
    ltwh = stats[1:, [cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP, cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]][large]
    return Silhouettes(number[label], ltwh, stats[1:, cv2.CC_STAT_AREA][large])


def merge_silhouettes(found: Silhouettes, stature: Stature) -> Silhouettes:
    """The regions, those joined that are parts of one person: above each other, and together no taller than people are.

    A part is one that is itself too low for a person; a belt, a scarf or a signpost divides it from the next.
    """
    left, top, wide, high = found.ltwh.T.astype(np.float64)
    person = expected(found.ltwh.astype(np.float64), stature)
    owner = np.arange(len(found))
    for lower in np.argsort(-(top + high), kind="stable"):
        for upper in np.argsort(-(top + high), kind="stable"):
            if upper == lower or owner[upper] != upper or owner[lower] != lower or top[upper] >= top[lower]:
                continue
            gap, whole = top[lower] - (top[upper] + high[upper]), top[lower] + high[lower] - top[upper]
            right = min(left[upper] + wide[upper], left[lower] + wide[lower])
            common = right - max(left[upper], left[lower])
            aside = abs(left[upper] + 0.5 * wide[upper] - left[lower] - 0.5 * wide[lower])
            if high[upper] > PART * person[upper] and high[lower] > PART * person[lower]:
                continue
            if common < 0.5 * min(wide[upper], wide[lower]) or aside > ASIDE * person[lower] or gap > GAP * person[lower]:
                continue
            if not PART * person[lower] <= whole <= TALLEST * person[lower]:
                continue
            end = max(left[upper] + wide[upper], left[lower] + wide[lower])
            left[lower], high[lower], top[lower] = min(left[upper], left[lower]), whole, top[upper]
            wide[lower] = end - left[lower]
            owner[owner == upper] = lower
    keep = np.flatnonzero(owner == np.arange(len(found)))
    number = np.zeros(len(found) + 1, np.int32)
    number[1:] = np.searchsorted(keep, owner) + 1
    area = np.bincount(number[1:] - 1, weights=found.area, minlength=len(keep)).astype(np.int32)
    ltwh = np.column_stack([left, top, wide, high])[keep].astype(np.int32)
    return Silhouettes(number[found.label], ltwh, area)


def upright(found: Silhouettes, least_pixels: float) -> NDArray[np.bool_]:
    """(N,) which regions have the shape of one upright person, whole in the picture."""
    height, width = found.label.shape
    left, top, wide, high = found.ltwh.T
    fill = found.area / np.maximum(wide * high, 1)
    inside = (left > 1) & (top > 1) & (left + wide < width - 1) & (top + high < height - 1)
    aspect = high / np.maximum(wide, 1)
    shaped = (aspect >= ASPECTS[0]) & (aspect <= ASPECTS[1]) & (fill >= FILLS[0]) & (fill <= FILLS[1])
    return np.asarray(inside & shaped & (high >= least_pixels))


def least_height(rows: int, scale: float) -> float:
    """Working pixels: the least height of a person in a working picture of so many rows, `scale` times the whole picture."""
    return max(LEAST_HEIGHT * rows, LEAST_PIXELS * scale)


def feet(ltwh: Floats) -> Floats:
    """(N, 2) middles of the bottom edges."""
    return np.column_stack([ltwh[:, 0] + 0.5 * ltwh[:, 2], ltwh[:, 1] + ltwh[:, 3]])


def expected(ltwh: Floats, stature: Stature) -> Floats:
    """(N,) heights that people would have whose boxes stand where these do."""
    return stature.height(feet(ltwh))
