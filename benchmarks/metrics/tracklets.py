"""How well the tracklets of one camera follow its people: IDF1 and what goes with it.

IDF1 asks how much of each person one tracklet follows: true and found trajectories are matched one to one so that as many boxes
as possible agree (Ristani, Solera, Zou, Cucchiara, Tomasi, *Performance Measures and a Data Set for Multi-Target, Multi-Camera
Tracking*, ECCV workshops 2016). Switches, fragments and MOTA follow the boxes through time instead (CLEAR MOT: Bernardin and
Stiefelhagen, EURASIP JIVP 2008). Purity is what joining tracklets over cameras lives on: whether a tracklet is of one person.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes


@dataclass(frozen=True)
class TrackletScore:
    """Found tracklets against true ones; shares are None where there is nothing to take a share of."""

    idf1: float | None
    """2 agreeing boxes / (true boxes + found boxes), of the best one-to-one matching of trajectories."""
    idp: float | None
    """Agreeing boxes / found boxes."""
    idr: float | None
    """Agreeing boxes / true boxes."""
    mota: float | None
    """1 - (missed + false boxes + switches) / true boxes."""
    purity: float | None
    """Share of the found boxes on a person whose tracklet's commonest person is theirs."""
    switches: int
    """How often the tracklet that follows a person is another one than before."""
    fragments: int
    """How often a person who is followed is lost and found again."""
    tracklets: int
    people: int

    def to_dict(self) -> dict[str, Any]:
        """As plain values for JSON."""
        return dict(vars(self))


def score_tracklets(found: Boxes, truth: Boxes, iou: float = 0.5) -> TrackletScore:
    """Score the tracklets of one camera.

    Args:
        found: boxes with tracklet numbers; those of none (-1) do not count.
        truth: boxes with true identities; those of nobody (-1) do not count.
        iou: smallest intersection over union of a found box and the true box that it may stand for.

    Raises:
        InputError: an overlap that is not above 0 and at most 1; two boxes of one identity in one frame.
    """
    if not 0 < iou <= 1:
        raise InputError(f"score of tracklets: iou = {iou}: give a number above 0 and at most 1")
    found, truth = (_of_somebody(boxes, what) for boxes, what in ((found, "found"), (truth, "true")))
    rows, columns, overlap = overlapping(truth, found, iou)
    people, person = np.unique(truth.identity, return_inverse=True)
    numbers, tracklet = np.unique(found.identity, return_inverse=True)
    agreeing = coo_array((np.ones(len(rows)), (person[rows], tracklet[columns])), shape=(len(people), len(numbers))).toarray()
    right = float(agreeing[linear_sum_assignment(-agreeing)].sum())
    partner = _followed(truth, person, tracklet, rows, columns, overlap)
    matched = partner >= 0
    switches, fragments = _breaks(truth, person, np.where(matched, tracklet[partner] if len(found) else UNKNOWN, UNKNOWN))
    table = np.zeros_like(agreeing)
    np.add.at(table, (person[matched], tracklet[partner[matched]]), 1)
    n_matched, n_true, n_found = int(matched.sum()), len(truth), len(found)
    wrong = n_true + n_found - 2 * n_matched + switches
    return TrackletScore(
        idf1=_share(2 * right, n_true + n_found),
        idp=_share(right, n_found),
        idr=_share(right, n_true),
        mota=1.0 - wrong / n_true if n_true else None,
        purity=_share(float(table.max(axis=0, initial=0.0).sum()), n_matched),
        switches=switches,
        fragments=fragments,
        tracklets=len(numbers),
        people=len(people),
    )


def _share(part: float, whole: int) -> float | None:
    return part / whole if whole else None


def _of_somebody(boxes: Boxes, what: str) -> Boxes:
    """The boxes with an identity, by frame and identity."""
    boxes = boxes.take(boxes.identity != UNKNOWN)
    boxes = boxes.take(np.lexsort((boxes.identity, boxes.frame)))
    twice = np.flatnonzero((np.diff(boxes.frame) == 0) & (np.diff(boxes.identity) == 0))
    if len(twice):
        row = twice[0]
        raise InputError(f"frame {boxes.frame[row]} has the {what} identity {boxes.identity[row]} twice: nobody is seen twice")
    return boxes


def overlapping(truth: Boxes, found: Boxes, least: float) -> tuple[Ints, Ints, Floats]:
    """(K,) rows of both, which are sorted by frame, that share a frame and overlap enough, and (K,) by how much."""
    begin = np.searchsorted(found.frame, truth.frame)
    count = np.searchsorted(found.frame, truth.frame, side="right") - begin
    rows = np.repeat(np.arange(len(truth)), count)
    columns = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(len(rows))
    one, two = truth.ltwh[rows], found.ltwh[columns]
    low, high = np.maximum(one[:, :2], two[:, :2]), np.minimum(one[:, :2] + one[:, 2:], two[:, :2] + two[:, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=1)
    overlap = common / (np.prod(one[:, 2:], axis=1) + np.prod(two[:, 2:], axis=1) - common)
    use = overlap >= least
    return rows[use], columns[use], overlap[use]


def _followed(truth: Boxes, person: Ints, tracklet: Ints, rows: Ints, columns: Ints, overlap: Floats) -> Ints:
    """(N,) the found box that follows each true box, -1 for none: who was followed is followed on, the rest is matched best."""
    partner = np.full(len(truth), UNKNOWN)
    last: dict[int, int] = {}
    starts = np.flatnonzero(np.diff(truth.frame[rows])) + 1
    for part in np.split(np.arange(len(rows)), starts) if len(rows) else ():
        true_rows, found_rows = rows[part], columns[part]
        stays = np.flatnonzero(
            [last.get(int(person[t])) == int(tracklet[f]) for t, f in zip(true_rows, found_rows, strict=True)]
        )
        stays = stays[
            np.unique(found_rows[stays], return_index=True)[1]
        ]  # two may have been followed by it, one after the other
        partner[true_rows[stays]] = found_rows[stays]
        free = ~np.isin(true_rows, true_rows[stays]) & ~np.isin(found_rows, found_rows[stays])
        own, i = np.unique(true_rows[free], return_inverse=True)
        other, j = np.unique(found_rows[free], return_inverse=True)
        value = np.zeros((len(own), len(other)))
        value[i, j] = 1.0 + overlap[part][free]  # the most pairs first, then the largest overlaps
        for a, b in zip(*linear_sum_assignment(-value), strict=True):
            if value[a, b] > 0:
                partner[own[a]] = other[b]
        for t in np.unique(true_rows):
            if partner[t] >= 0:
                last[int(person[t])] = int(tracklet[partner[t]])
    return partner


def _breaks(truth: Boxes, person: Ints, tracklet: Ints) -> tuple[int, int]:
    """Switches and fragments of the tracklets (N,) that follow the true boxes, -1 for none."""
    order = np.lexsort((truth.frame, person))
    who, which = person[order], tracklet[order]
    seen = which >= 0
    same = np.diff(who[seen]) == 0
    switches = int((same & (np.diff(which[seen]) != 0)).sum())
    # Lost and found again: followed, not followed, followed.
    place = np.flatnonzero(seen)
    fragments = int((same & (np.diff(place) > 1)).sum())
    return switches, fragments
