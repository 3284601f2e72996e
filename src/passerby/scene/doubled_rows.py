"""Rows that stand twice: one camera sees a person once in a frame, so one row of several is kept.

Trackers write such rows now and then, and files that were joined hold them. A few of them harm nothing; where they are the
rule, the ids are no identities (a class number, a counter that begins anew in every tile), and nothing can be kept of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.extents import extents_of
from passerby.core.observations import UNKNOWN, Boxes, Keypoints
from passerby.findings.finding import Finding, notice

Part = TypeVar("Part", Boxes, Keypoints)

MOST_DOUBLED = 0.05
"""Of all rows. At worst each second one that is kept is the wrong one: 2.5 % of the rows, where the calibration bears that
20 % of the identities are exchanged (simulated scenes, sigmas still right). An id that is no identity doubles far more: all
rows of one class number, in frames with two people or more, are half."""


@dataclass(frozen=True)
class DuplicateRows:
    """What was left out of the rows of one camera."""

    rows: int
    """Rows before."""
    second: int
    """Rows left out since the same identity has a better one in that frame,"""
    repeated: int
    """and rows without an identity that are the same as another row, number for number."""
    first: tuple[int, int]
    """Frame and identity of the first of them."""

    @property
    def is_rule(self) -> bool:
        """Whether there are too many for the ids to be identities."""
        return self.second + self.repeated > MOST_DOUBLED * self.rows

    def finding(self, place: str, *camera: str) -> Finding:
        """The notice of it; `place` is the file, which need not be a camera's."""
        frame, identity = self.first
        return notice(
            "duplicate_rows", *camera, place=place, doubled=self.second + self.repeated, rows=self.rows, frame=frame,
            identity=None if identity == UNKNOWN else identity, too_many=self.is_rule,
        )  # fmt: skip


def remove_duplicates(part: Part) -> tuple[Part, DuplicateRows | None]:
    """The rows with each identity once in a frame, in their order; and what was left out, None where nothing was.

    Of several rows of one identity in one frame that of the highest score is kept; among equals the one nearest to where the
    identity is in the frames before and after; among equals the first. Rows without an identity (-1) are all kept, but
    for those that repeat another one number for number.
    """
    score, extent = _scores(part), extents_of(part)
    known: NDArray[np.bool_] = part.identity > UNKNOWN
    keep = np.ones(len(part), dtype=bool)
    groups = _groups([part.frame[known], part.identity[known]], np.flatnonzero(known))
    crowded = np.zeros(len(part), dtype=bool)
    for rows in groups:
        crowded[rows] = True
    few = len(groups) <= max(100, 2 * MOST_DOUBLED * len(part))  # of more nothing is used: no need to choose well
    for rows in groups:
        best = rows[score[rows] == score[rows].max()]
        if len(best) > 1 and few:
            away = _away(part, extent, best, ~crowded)
            best = best[away == away.min()]
        keep[rows] = False
        keep[best[0]] = True
    second = int((~keep).sum())
    for rows in _groups([part.frame[~known], *_numbers(part)[~known].T], np.flatnonzero(~known)):
        keep[rows[1:]] = False
    if keep.all():
        return part, None
    out = np.flatnonzero(~keep)
    first = out[np.argmin(part.frame[out])]
    doubled = DuplicateRows(len(part), second, len(out) - second, (int(part.frame[first]), int(part.identity[first])))
    return part.take(np.flatnonzero(keep)), doubled


def _groups(keys: Sequence[NDArray[np.generic]], rows: Ints) -> list[Ints]:
    """The rows that have the same keys, (N,) each, where several have; each group in the rows' order."""
    if len(rows) < 2:
        return []
    order = np.lexsort(tuple(keys))
    same = np.ones(len(rows) - 1, dtype=bool)
    for key in keys:
        same &= key[order][1:] == key[order][:-1]
    return [np.sort(group) for group in np.split(rows[order], np.flatnonzero(~same) + 1) if len(group) > 1]


def _away(part: Boxes | Keypoints, extent: Floats, rows: Ints, single: NDArray[np.bool_]) -> Floats:
    """(K,) how far rows of one identity and frame are from where it is before and after, pixels; 0 where it is nowhere else."""
    frame, identity = part.frame[rows[0]], part.identity[rows[0]]
    own = np.flatnonzero(single & (part.identity == identity))
    before, after = own[part.frame[own] < frame], own[part.frame[own] > frame]
    ends = [end for end in (before[np.argmax(part.frame[before])] if len(before) else None,
                            after[np.argmin(part.frame[after])] if len(after) else None) if end is not None]  # fmt: skip
    if not ends:
        return np.zeros(len(rows))
    at = extent[ends[0]]
    if len(ends) == 2:
        share = (frame - part.frame[ends[0]]) / (part.frame[ends[1]] - part.frame[ends[0]])
        at = (1 - share) * at + share * extent[ends[1]]
    return np.asarray(np.abs(extent[rows] - at).sum(axis=1))


def _scores(part: Boxes | Keypoints) -> Floats:
    """(N,) confidence of each row; of joints the mean over all, so that more of them count for more."""
    if isinstance(part, Boxes):
        return part.score
    return np.asarray(part.score.mean(axis=1)) if part.score.shape[1] else np.zeros(len(part))


def _numbers(part: Boxes | Keypoints) -> Floats:
    """(N, K) all numbers of each row but frame and identity."""
    if isinstance(part, Boxes):
        return np.column_stack([part.ltwh, part.score])
    return np.column_stack([part.xy.reshape(len(part), 2 * len(part.joints)), part.score])
