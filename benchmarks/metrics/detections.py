"""How well people are found: which of them, and how well the edges of their boxes fit.

Calibration lives on the edges: the lower one is where somebody stands, the upper one how tall they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from metrics.tracklets import overlapping
from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import Boxes

EDGES = ("left", "top", "right", "bottom")
MAD_TO_SD = 1.4826
"""Median absolute deviation to standard deviation, of a normal distribution."""


@dataclass(frozen=True)
class BoxScore:
    """Found boxes against true ones; shares are None where there is nothing to take a share of."""

    true: int
    found: int
    agreeing: int
    """Pairs of a true and a found box that overlap enough, each box in one pair at most."""
    errors: Floats
    """(agreeing, 4) found less true left, top, right, bottom edge, in heights of the true box; right and down are positive."""

    @property
    def recall(self) -> float | None:
        """Agreeing boxes / true boxes."""
        return self.agreeing / self.true if self.true else None

    @property
    def precision(self) -> float | None:
        """Agreeing boxes / found boxes."""
        return self.agreeing / self.found if self.found else None

    @property
    def bias(self) -> Floats:
        """(4,) median error of each edge; nan without agreeing boxes."""
        return np.asarray(np.median(self.errors, axis=0)) if self.agreeing else np.full(4, np.nan)

    @property
    def spread(self) -> Floats:
        """(4,) scatter of each edge about its bias, as a standard deviation from the median; nan without agreeing boxes."""
        if not self.agreeing:
            return np.full(4, np.nan)
        return np.asarray(MAD_TO_SD * np.median(np.abs(self.errors - self.bias), axis=0))

    def share_off(self, by: float) -> float | None:
        """Share of the agreeing boxes of which any edge is off by more than this many heights."""
        return float((np.abs(self.errors) > by).any(axis=1).mean()) if self.agreeing else None


def score_boxes(cameras: Iterable[tuple[Boxes, Boxes]], iou: float = 0.5) -> BoxScore:
    """Score the boxes of one or several cameras; who they are does not matter.

    In every frame, true and found boxes are paired so that their overlaps are largest as a whole.

    Args:
        cameras: found and true boxes of each.
        iou: smallest intersection over union of a pair.

    Raises:
        InputError: an overlap that is not above 0 and at most 1.
    """
    if not 0 < iou <= 1:
        raise InputError(f"score of boxes: iou = {iou}: give a number above 0 and at most 1")
    n_true = n_found = 0
    errors = [np.zeros((0, 4))]
    for found, truth in cameras:
        found, truth = (boxes.take(np.argsort(boxes.frame, kind="stable")) for boxes in (found, truth))
        rows, columns = paired(truth, found, iou)
        n_true, n_found = n_true + len(truth), n_found + len(found)
        errors.append((_edges(found.ltwh[columns]) - _edges(truth.ltwh[rows])) / truth.ltwh[rows, 3:])
    all_errors = np.concatenate(errors)
    return BoxScore(n_true, n_found, len(all_errors), all_errors)


def paired(truth: Boxes, found: Boxes, iou: float) -> tuple[Ints, Ints]:
    """(K,) rows of the true and of the found boxes, both sorted by frame, that stand for each other."""
    rows, columns, overlap = overlapping(truth, found, iou)
    mine, theirs = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(truth.frame[rows])) + 1):
        own, i = np.unique(rows[part], return_inverse=True)
        other, j = np.unique(columns[part], return_inverse=True)
        value = np.zeros((len(own), len(other)))
        value[i, j] = overlap[part]
        a, b = linear_sum_assignment(-value)
        real = value[a, b] > 0
        mine.append(own[a[real]])
        theirs.append(other[b[real]])
    return np.concatenate(mine), np.concatenate(theirs)


def _edges(ltwh: Floats) -> Floats:
    """(N, 4) left, top, right, bottom."""
    return np.concatenate([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]], axis=1)
