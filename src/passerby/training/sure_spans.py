"""Spans of time in which one identity is one person, and pairs of these people that are known to be different.

An identity's time is cut wherever its label may have moved to another person: if another person is near, if the place jumps,
and if two cameras have not confirmed it for too long. Each span becomes a separate person. A doubt in one camera makes no cut
while two other cameras confirm the person.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN
from passerby.geometry.groups import expanded_ranges, least_of_groups, rows_of_equal
from passerby.people.ground_positions import Places
from passerby.training.agreement import (
    AMBIGUOUS,
    BEHIND,
    DISPUTED,
    MISFIT,
    NEAR,
    NEAR_M,
    SURE,
    GeometricAgreement,
    pairs_within,
)

LONGEST_GAP_S = 0.6
"""Maximum time without confirmation in which a person keeps a label, unless pictures are farther apart. On a terrace where all
people wear the same vest and are detected by background subtraction, 24 of 1394 boxes were another person's with 1 s, and 10 of
1243 with this value."""
JUMP_M, JUMP_M_S = 0.4, 2.0
"""Maximum move of a person between two instants: the error of a position, and the speed of a slow run."""
SHORTEST_S = 1.5
"""Minimum length of a span. Accidental agreement is usually shorter: two people pass each other's rays within a second."""
DOUBT_S = 0.2
"""Boxes within this time of a doubtful box of the same camera are not used: labels move before geometry can detect it. Over six
calibrations of rendered videos 32 of 15150 boxes were wrong, 48 of 17426 without this rule."""
DOUBTS = (MISFIT, AMBIGUOUS, BEHIND, NEAR, DISPUTED)
FEWEST_INSTANTS = 5
"""Minimum number of a span's instants with two cameras or more."""
FEWEST_IN_CAMERA = 3
"""Minimum number of a span's confirmed instants in a camera; fewer may be a coincidence."""
FEWEST_TOGETHER = 3
"""Minimum number of common instants that show that two spans are two people."""


@dataclass(frozen=True, eq=False)
class PseudoLabels:
    """S people, each a span of one identity; N boxes."""

    span: Ints
    """(N,) rows of the spans for confirmed boxes, -1 for all others."""
    identity: Ints
    """(S,) identity of each span."""
    number: Ints
    """(S,) number of the span within its identity, from 1."""
    seconds: Floats
    """(S, 2) first and last time, seconds since the first instant."""
    apart: NDArray[np.bool_]
    """(S, S) whether two spans are known to be two people, who were seen at the same time in two places."""
    n_cameras: Ints
    """(S,) number of cameras of each span."""


def pseudo_labels(places: Places, agreed: GeometricAgreement) -> PseudoLabels:
    """Cut the confirmed boxes into spans of one identity each.

    Args:
        places: places of all boxes.
        agreed: results of the boxes by geometry.
    """
    span_of_group = _spans(places.step_s, agreed)
    span = np.full(len(places), -1)
    sure = agreed.reason == SURE
    span[sure] = span_of_group[agreed.group[sure]]
    span = _drop_passing(span, places, agreed)
    span[_find_near_doubt(places, agreed)] = -1
    span = _keep_shared_spans(span, places)
    kept, index = np.unique(span[span >= 0], return_inverse=True)
    renamed = np.full(int(span_of_group.max(initial=-1)) + 1, -1)
    renamed[kept] = np.arange(len(kept))
    span[span >= 0] = index.ravel()
    group_span = np.append(renamed, -1)[span_of_group]
    identity = np.zeros(len(kept), np.int64)
    ends = np.column_stack([np.full(len(kept), np.inf), np.full(len(kept), -np.inf)])
    rows = np.flatnonzero(span >= 0)
    identity[span[rows]] = places.identity[rows]
    np.minimum.at(ends[:, 0], span[rows], places.step[rows] * places.step_s)
    np.maximum.at(ends[:, 1], span[rows], places.step[rows] * places.step_s)
    number = np.array([1 + np.count_nonzero(identity[:k] == who) for k, who in enumerate(identity)], dtype=np.int64)
    seen = np.unique(np.column_stack([span, places.camera])[span >= 0], axis=0)
    n_cameras = np.bincount(seen[:, 0], minlength=len(kept)).astype(np.int64)
    return PseudoLabels(span, identity, number, ends, _find_separate(agreed, group_span, len(kept)), n_cameras)


def _spans(step_s: float, agreed: GeometricAgreement) -> Ints:
    """Number the runs of confirmed instants of one identity in which its label cannot have moved, (G,); others get -1."""
    sure = np.flatnonzero(agreed.sure & ~agreed.near)
    if not len(sure):
        return np.full(len(agreed.step), -1)
    first, second = sure[:-1], sure[1:]
    gap = (agreed.step[second] - agreed.step[first]) * step_s
    jump = np.linalg.norm(agreed.place[second] - agreed.place[first], axis=1)
    cut = agreed.identity[second] != agreed.identity[first]
    cut |= (gap > max(LONGEST_GAP_S, 1.5 * step_s) + 1e-9) | (jump > JUMP_M + JUMP_M_S * gap)
    near_before = np.concatenate([[0], np.cumsum(agreed.near)])
    cut |= near_before[second] > near_before[first]
    cut[~cut] = _may_have_met(agreed, first[~cut], second[~cut])
    number = np.concatenate([[0], np.cumsum(cut)])
    spans = np.full(len(agreed.step), -1)
    spans[sure] = number
    return spans


def _may_have_met(agreed: GeometricAgreement, first: Ints, second: Ints) -> NDArray[np.bool_]:
    """Return whether another person is near the straight path between two confirmed instants of a person, (K,).

    `first` and `second`: (K,) groups of the confirmed instants; the instants between them are unconfirmed.
    """
    missing = agreed.step[second] - agreed.step[first] - 1
    gap, nth = expanded_ranges(np.ones_like(missing), missing)
    met = np.zeros(len(first), dtype=np.bool_)
    if not len(gap):
        return met
    share = (nth / (missing[gap] + 1))[:, None]
    way = (1 - share) * agreed.place[first[gap]] + share * agreed.place[second[gap]]
    at = agreed.step[first[gap]] + nth
    order = np.argsort(agreed.step, kind="stable")
    k, place = rows_of_equal(at, agreed.step[order])
    other = order[place]
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(agreed.place[other] - way[k], axis=1) < NEAR_M
    near &= agreed.identity[other] != agreed.identity[first[gap[k]]]
    met[gap[k[near]]] = True
    return met


def _find_near_doubt(places: Places, agreed: GeometricAgreement) -> NDArray[np.bool_]:
    """Return whether a box is within `DOUBT_S` of a doubtful box of the same identity and camera, (N,)."""
    order = np.lexsort((places.step, places.camera, places.identity))
    order = order[places.identity[order] != UNKNOWN]
    reach = max(1, round(DOUBT_S / places.step_s))
    beside = np.zeros(len(places), dtype=np.bool_)
    doubtful = np.isin(agreed.reason, DOUBTS)
    for shift in range(1, reach + 1):
        a, b = order[:-shift], order[shift:]
        own = (places.identity[a] == places.identity[b]) & (places.camera[a] == places.camera[b])
        own &= places.step[b] - places.step[a] <= reach
        a, b = a[own], b[own]
        beside[a[doubtful[b]]] = True
        beside[b[doubtful[a]]] = True
    return beside


def _drop_passing(span: Ints, places: Places, agreed: GeometricAgreement) -> Ints:
    """Drop cameras with few instants of a span, instants with only one camera, and short spans, from the spans (N,)."""
    span = _keep_shared_spans(span, places)
    rows = np.flatnonzero(span >= 0)
    # An instant that has only one camera left is dropped.
    number = np.bincount(agreed.group[rows], minlength=len(agreed.step))
    rows = rows[number[agreed.group[rows]] > 1]
    alone = np.ones(len(span), dtype=np.bool_)
    alone[rows] = False
    span[alone] = -1
    instants = least_of_groups(agreed.group[rows], np.zeros(len(rows)))
    count = np.bincount(span[rows][instants], minlength=span.max(initial=-1) + 1)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, span[rows], places.step[rows])
    np.maximum.at(high, span[rows], places.step[rows])
    with np.errstate(invalid="ignore"):
        good = (count >= FEWEST_INSTANTS) & ((high - low + 1) * places.step_s >= SHORTEST_S - 1e-9)
    return np.where(np.append(good, True)[span], span, -1)


def _keep_shared_spans(span: Ints, places: Places) -> Ints:
    """Drop cameras with few instants of a span, and then spans with only one camera left, from the spans (N,)."""
    n_cameras = int(places.camera.max(initial=0)) + 1
    count = np.zeros((int(span.max(initial=-1)) + 1, n_cameras), dtype=np.int64)
    rows = np.flatnonzero(span >= 0)
    np.add.at(count, (span[rows], places.camera[rows]), 1)
    enough = count >= FEWEST_IN_CAMERA
    enough &= np.count_nonzero(enough, axis=1, keepdims=True) > 1
    of_nobody = np.zeros((1, n_cameras), dtype=np.bool_)
    return np.where(np.concatenate([enough, of_nobody])[span, places.camera], span, -1)


def _find_separate(agreed: GeometricAgreement, group_span: Ints, n_spans: int) -> NDArray[np.bool_]:
    """Return whether two spans have common instants and are far from each other at 90 % of them or more, (S, S)."""
    rows = np.flatnonzero(group_span >= 0)
    rows = rows[np.argsort(agreed.step[rows], kind="stable")]
    i, j = pairs_within(agreed.step[rows])
    a, b = group_span[rows[i]], group_span[rows[j]]
    far = np.linalg.norm(agreed.place[rows[i]] - agreed.place[rows[j]], axis=1) > NEAR_M
    together, distant = np.zeros((n_spans, n_spans)), np.zeros((n_spans, n_spans))
    np.add.at(together, (a, b), 1)
    np.add.at(distant, (a, b), far)
    return np.asarray((together >= FEWEST_TOGETHER) & (distant >= 0.9 * together))
