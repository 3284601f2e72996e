"""Which of a camera's boxes show a person well, and which of them to take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.perception.crops import is_recognisable
from passerby.perception.pictures import Picture

PER_PERSON = 24
"""Crops of one person by one camera: two dozen moments show front, side and back; more are nearly the same picture again."""
COVERED_IOU = 0.3
"""Overlap with a nearer person from which on a crop shows two people."""


def clear_boxes(frame: Ints, ltwh: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(N,) which of one camera's boxes show a person well: large enough, for the most part in the picture, and not hidden.

    Args:
        frame: (N,).
        ltwh: (N, 4) all boxes of the camera, pixels, those of unknown people too: they cover as well.
        size: of the pictures, width and height.

    Of two boxes that overlap by `COVERED_IOU` or more (intersection over union) the one whose foot is lower in the picture is
    the nearer to the camera.
    """
    shown: Picture = np.broadcast_to(np.uint8(0), (size[1], size[0], 3))
    order = np.argsort(frame, kind="stable")
    frames, boxes = frame[order], ltwh[order]
    covered = np.zeros(len(order), dtype=np.bool_)
    for step in range(1, len(order)):
        first = np.flatnonzero(frames[:-step] == frames[step:])
        if not len(first):
            break  # no frame has more boxes than that
        second = first + step
        near = _iou(boxes[first], boxes[second]) >= COVERED_IOU
        lower = _foot(boxes[first]) > _foot(boxes[second])
        covered[second[near & lower]] = True
        covered[first[near & ~lower]] = True
    clear = np.zeros(len(order), dtype=np.bool_)
    clear[order] = ~covered
    return np.asarray(clear & is_recognisable(shown, ltwh))


def spread(frame: Ints, person: Ints, usable: NDArray[np.bool_], at_most: int = PER_PERSON) -> Ints:
    """Rows, ascending, of at most so many boxes per person (N,), evenly spread over those that are usable, by frame.

    People below 0 are unknown and passed over.
    """
    rows = np.flatnonzero(usable & (person >= 0))
    rows = rows[np.lexsort((frame[rows], person[rows]))]
    _, first, count = np.unique(person[rows], return_index=True, return_counts=True)
    chosen = [
        rows[start + (2 * np.arange(min(n, at_most)) + 1) * n // (2 * min(n, at_most))]
        for start, n in zip(first.tolist(), count.tolist(), strict=True)
    ]
    return np.sort(np.concatenate([np.zeros(0, np.int64), *chosen]))


def _iou(a: Floats, b: Floats) -> Floats:
    """(N,) intersection over union of boxes (N, 4), pair by pair."""
    low = np.maximum(a[:, :2], b[:, :2])
    both = np.maximum(np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - low, 0.0).prod(axis=1)
    return np.asarray(both / (a[:, 2:].prod(axis=1) + b[:, 2:].prod(axis=1) - both))


def _foot(boxes: Floats) -> Floats:
    """(N,) lower edges, pixels."""
    return np.asarray(boxes[:, 1] + boxes[:, 3])
