"""Regions of several people: divided where each of them shows head and feet, else given up."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from passerby.common.arrays import Floats
from passerby.perception.background_statistics import Levels
from passerby.perception.stature import Stature

PROMINENCE = 0.07
"""Of a head over the shoulders or the neighbour beside it, as a fraction of the person's height: half of a head."""
APART = 0.15
"""Least distance between two heads, as a fraction of a person's height: less than the breadth of shoulders."""
TOLERANCE = 0.15
"""Of the height of a divided person, as a fraction: people's heights spread by 5 %, and a missing head is 13 %."""
BESIDE = 0.12
"""Of a person's height: so far from a cut the feet may be the neighbour's."""
WIDTHS = (0.15, 0.65)
"""Of one person, as a fraction of the expected height."""


def profiles(region: Levels) -> tuple[Floats, Floats]:
    """(W,) first and (W,) one past the last row of every column of a region (H, W); H and 0 for empty columns."""
    inside = region > 0
    empty = ~inside.any(axis=0)
    top = np.where(empty, len(region), inside.argmax(axis=0))
    bottom = np.where(empty, 0, len(region) - inside[::-1].argmax(axis=0))
    return top.astype(np.float64), bottom.astype(np.float64)


def heads(top: Floats, low: float, height: float) -> np.ndarray:
    """Columns of the heads in an upper contour (W,), rows; `low` is the lowest row, `height` that of a person."""
    # A third of the time that a calibration without videos takes to start.
    from scipy.signal import find_peaks

    contour = np.concatenate([[-low], -np.minimum(top, low), [-low]])
    _, shape = find_peaks(contour, prominence=PROMINENCE * height, distance=max(APART * height, 1.0), plateau_size=1)
    return np.asarray((shape["left_edges"] + shape["right_edges"]) / 2.0 - 1.0)


def divide_crowds(region: Levels, corner: tuple[int, int], stature: Stature) -> Floats:
    """The people in a region who can be distinguished, each with head and feet.

    The region is cut at the lowest point of the upper contour between two heads. A part that is not as tall as a person, where
    it stands, is left out: its feet are hidden, or its head belongs to a person farther away.

    Args:
        region: (H, W) above 0 inside.
        corner: column and row of the region's first pixel in the picture.
        stature: how tall people are.

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
    """The box of the columns from `start` to `end`, where they hold one person."""
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
