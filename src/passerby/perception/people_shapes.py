"""From the foreground to boxes of people: whole people, people in parts, and people who occlude each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.geometry.groups import cauchy_weights, residual_scale
from passerby.perception.foreground import Foreground, Levels

ALONE = 1.0
"""Score of a person who stands alone and is as tall as expected."""
UNKNOWN_HEIGHT = 0.7
"""Score of an upright shape where the height of people is not known."""
USUAL = 0.12
"""Largest deviation from the expected height, as a fraction, for a score of 1: the spread of people's heights is 5 %."""
UNUSUAL = 0.5
"""Score of a person who stands alone and has another height: leaning, jumping, or without the head."""
DIVIDED = 0.6
SHORT = 0.35
"""Score of a shape that is too low for a standing person: crouching, or half hidden."""
CUT = 0.5
"""Score of a person who is cut by the picture's border."""
HEIGHTS = (0.8, 1.2)
"""Height of one standing person, as fractions of the expected height."""
WIDEST = 0.62
"""Largest width of one standing person, as a fraction of the expected height: a long stride seen from the side."""
LEAST_BOXES = 12
"""Fewer boxes do not determine a plane with three unknowns."""
ROUNDS = 20
TRIALS = 200
Labels = NDArray[np.int32]
CLOSING = 0.02
"""Height of the gaps that are closed, as a fraction of the picture's height: belts, and legs behind a rope."""
PART = 0.8
"""A region lower than this, as a fraction of the expected height, may be a part of a person."""
TALLEST = 1.15
"""Largest height of a person's parts together, as a fraction of the expected height."""
GAP = 0.25
"""Largest gap between two parts, as a fraction of the expected height."""
ASIDE = 0.2
"""Largest horizontal distance of the middles of two parts, as a fraction of the expected height."""
LEAST_HEIGHT = 0.04
"""Least height of a person, as a fraction of the picture's height."""
LEAST_PIXELS = 24
"""Least height of a person, pixels: a smaller one has no shape."""
ASPECTS = (1.2, 6.0)
"""Height over width of an upright person."""
FILLS = (0.25, 0.95)
"""Share of its box that a person's silhouette covers."""
PROMINENCE = 0.07
"""Prominence of a head over the shoulders or the neighbour beside it, as a fraction of the person's height: half of a head."""
APART = 0.15
"""Least distance between two heads, as a fraction of a person's height: less than the width of shoulders."""
TOLERANCE = 0.15
"""Tolerance of the height of a divided person, as a fraction: people's heights spread by 5 %, and a missing head is 13 %."""
BESIDE = 0.12
"""Distance from a cut, as a fraction of a person's height, within which feet may be the neighbour's."""
WIDTHS = (0.15, 0.65)
"""Width of one person, as a fraction of the expected height."""


def find_people(foreground: Foreground, stature: Stature | None, least_pixels: float) -> tuple[Floats, Floats]:
    """Find the people in a foreground: boxes (N, 4) and scores (N,), working pixels."""
    found = silhouettes(foreground.body, least_pixels)
    if len(found) == 0:
        return np.zeros((0, 4)), np.zeros(0)
    if stature is not None:
        found = merge_silhouettes(found, stature)
    ltwh = found.ltwh.astype(np.float64)
    shaped = find_upright(found, least_pixels)
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
    """Return the people (N, 4) in one region and their score."""
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


@dataclass(frozen=True, eq=False)
class Stature:
    """Height of an upright person's box as a function of its foot: for a camera above a plane it is linear in the picture.

    h = a + b x + c y, pixels, for the middle (x, y) of the box's bottom edge. This is exact for a pinhole camera whose vertical
    vanishing point is far away (Hoiem, Efros and Hebert, *Putting Objects in Perspective*, IJCV 2008, equation 4).
    """

    plane: Floats
    """(3,) a, b, c."""
    spread: float
    """Standard deviation of a person's height around it, as a fraction."""
    boxes: int
    """Number of boxes from which it was learnt."""

    def height(self, foot: Floats) -> Floats:
        """Return the expected heights (N,) of boxes whose bottom edges have the middles `foot` (N, 2), pixels; at least 1."""
        return np.asarray(np.maximum(self.plane[0] + foot @ self.plane[1:], 1.0))


def learn_stature(ltwh: Floats, rng: np.random.Generator) -> Stature | None:
    """Fit the stature that most of the boxes (N, 4) agree with; None where they are too few or do not agree."""
    if len(ltwh) < LEAST_BOXES:
        return None
    foot = np.column_stack([ltwh[:, 0] + 0.5 * ltwh[:, 2], ltwh[:, 1] + ltwh[:, 3]])
    height = ltwh[:, 3]
    centre, scale = foot.mean(axis=0), np.maximum(foot.std(axis=0), 1.0)
    normal = np.column_stack([np.ones(len(foot)), (foot - centre) / scale])
    plane = _consensus(normal, height, rng)
    for _ in range(ROUNDS):
        error = height / np.maximum(normal @ plane, 1.0) - 1.0
        weight = cauchy_weights((error / 0.1) ** 2) / np.maximum(normal @ plane, 1.0)
        # A weak prior on no slope, with the weight of a tenth of a box: without boxes at different places the slope is unknown.
        ridge = np.diag([0.0, 1.0, 1.0]) * 0.1 / np.median(height)
        rows = np.vstack([normal * weight[:, None], ridge])
        plane = np.linalg.lstsq(rows, np.concatenate([height * weight, np.zeros(3)]), rcond=None)[0]
    error = height / np.maximum(normal @ plane, 1.0) - 1.0
    near = np.abs(error) < 0.25
    if near.sum() < LEAST_BOXES or near.mean() < 0.4:
        return None
    slope = plane[1:] / scale
    spread = min(residual_scale(error[near], 0.03), 0.15)
    return Stature(np.array([plane[0] - slope @ centre, *slope]), spread, int(near.sum()))


def _consensus(design: Floats, height: Floats, rng: np.random.Generator) -> Floats:
    """Return the plane (3,) through three boxes that has most boxes near it (RANSAC)."""
    best, most = np.array([np.median(height), 0.0, 0.0]), -1.0
    for trial in range(TRIALS):
        if trial:
            rows = rng.choice(len(height), 3, replace=False)
            if abs(np.linalg.det(design[rows])) < 1e-3:
                continue
            plane = np.linalg.solve(design[rows], height[rows])
        else:
            plane = best
        expected = design @ plane
        if (expected < 0.2 * height).any():
            continue
        support = float(np.sum(cauchy_weights(((height / expected - 1.0) / 0.1) ** 2)))
        if support > most:
            best, most = plane, support
    return best


@dataclass(frozen=True, eq=False)
class Silhouettes:
    """The connected regions of a mask, working pixels."""

    label: Labels
    """(H, W) 0 for the background, else the index of a region plus 1."""
    ltwh: NDArray[np.int32]
    """(N, 4) bounding boxes."""
    area: NDArray[np.int32]
    """(N,) pixels."""

    def __len__(self) -> int:
        return len(self.area)


def silhouettes(mask: Levels, least_pixels: float) -> Silhouettes:
    """Return the regions of a mask (H, W; 0 or 255) large enough for a part of a person `least_pixels` tall or taller."""
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
    """Join regions that are parts of one person: one above the other, and together not taller than people are.

    A part is itself too low for a person; a belt, a scarf or a signpost separates it from the next.
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


def find_upright(found: Silhouettes, least_pixels: float) -> NDArray[np.bool_]:
    """Return which regions (N,) have the shape of one upright person, whole in the picture."""
    height, width = found.label.shape
    left, top, wide, high = found.ltwh.T
    fill = found.area / np.maximum(wide * high, 1)
    inside = (left > 1) & (top > 1) & (left + wide < width - 1) & (top + high < height - 1)
    aspect = high / np.maximum(wide, 1)
    shaped = (aspect >= ASPECTS[0]) & (aspect <= ASPECTS[1]) & (fill >= FILLS[0]) & (fill <= FILLS[1])
    return np.asarray(inside & shaped & (high >= least_pixels))


def least_height(rows: int, scale: float) -> float:
    """Return the least height of a person, pixels of a working picture of `rows` rows, `scale` times the whole picture."""
    return max(LEAST_HEIGHT * rows, LEAST_PIXELS * scale)


def feet(ltwh: Floats) -> Floats:
    """Return the middles of the bottom edges (N, 2)."""
    return np.column_stack([ltwh[:, 0] + 0.5 * ltwh[:, 2], ltwh[:, 1] + ltwh[:, 3]])


def expected(ltwh: Floats, stature: Stature) -> Floats:
    """Return the expected heights (N,) of people whose boxes stand at the places of these."""
    return stature.height(feet(ltwh))


def profiles(region: Levels) -> tuple[Floats, Floats]:
    """Return the first row, and one past the last, of every column of a region (H, W), (W,) each; H and 0 for empty columns."""
    inside = region > 0
    empty = ~inside.any(axis=0)
    top = np.where(empty, len(region), inside.argmax(axis=0))
    bottom = np.where(empty, 0, len(region) - inside[::-1].argmax(axis=0))
    return top.astype(np.float64), bottom.astype(np.float64)


def heads(top: Floats, low: float, height: float) -> np.ndarray:
    """Find the columns of heads in an upper contour (W,), rows; `low` is the lowest row, `height` that of a person."""
    # This import takes a third of the start time of a calibration without videos.
    from scipy.signal import find_peaks

    contour = np.concatenate([[-low], -np.minimum(top, low), [-low]])
    _, shape = find_peaks(contour, prominence=PROMINENCE * height, distance=max(APART * height, 1.0), plateau_size=1)
    return np.asarray((shape["left_edges"] + shape["right_edges"]) / 2.0 - 1.0)


def divide_crowds(region: Levels, corner: tuple[int, int], stature: Stature) -> Floats:
    """Find the people in a region who can be distinguished, each with head and feet.

    The region is cut at the lowest point of the upper contour between two heads. A part without the height of a person at its
    place is left out: its feet are hidden, or its head belongs to a person farther away.

    Args:
        region: (H, W) above 0 inside.
        corner: column and row of the region's first pixel in the picture.
        stature: expected height of people.

    Returns:
        (N, 4) boxes in the picture.
    """
    left, above = corner
    top, bottom = profiles(region)
    rows, columns = region.shape
    person = float(stature.height(np.array([[left + 0.5 * columns, above + rows]]))[0])
    peaks = heads(top, rows, person)
    if len(peaks) == 0:
        return np.zeros((0, 4))
    cuts = [0]
    for one, other in pairwise(peaks):
        between = np.arange(int(one) + 1, int(np.ceil(other)) + 1)
        lowest = top[between].max()
        flat = between[top[between] >= lowest - 0.02 * person]
        cuts.append(int(np.round(flat.mean())))
    cuts.append(columns)
    boxes = []
    for head, start, end in zip(peaks, cuts[:-1], cuts[1:], strict=True):
        box = _part(top, bottom, head, start, end, stature, (left, above))
        if box is not None:
            boxes.append(box)
    return np.array(boxes).reshape(-1, 4)


def _part(
    top: Floats, bottom: Floats, head: float, start: int, end: int, stature: Stature, corner: tuple[int, int]
) -> list[float] | None:
    """Return the box of the columns from `start` to `end`, if they contain one person."""
    left, above = corner
    filled = np.flatnonzero(bottom[start:end] > top[start:end])
    if len(filled) < 2:
        return None
    start, end = start + int(filled[0]), start + int(filled[-1]) + 1
    near = slice(max(int(head) - 1, 0), int(head) + 2)
    size = float(stature.height(np.array([[left + head, above + float(bottom.max())]]))[0])
    first = start if start == 0 else min(start + round(BESIDE * size), int(head))
    last = end if end == len(top) else max(end - round(BESIDE * size), int(head) + 1)
    upper, lower = float(top[near].min()), float(bottom[first:last].max())
    person = float(stature.height(np.array([[left + 0.5 * (start + end), above + lower]]))[0])
    if abs((lower - upper) / person - 1.0) > TOLERANCE or not WIDTHS[0] <= (end - start) / person <= WIDTHS[1]:
        return None
    return [left + start, above + upper, end - start, lower - upper]
