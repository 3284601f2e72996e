"""Metrics of re-identification by appearance: CMC rank-k and mean average precision, by the protocol of Market-1501.

Source: Zheng, Shen, Tian, Wang, Wang, Tian, "Scalable Person Re-identification: A Benchmark", ICCV 2015. For each query the
pictures of the gallery are sorted by their distance from it. Pictures of the same person by the same camera, and junk, are
ignored; distractors are wrong. Rank-k is the share of the queries with a right picture among the first k. The average precision
(AP) of a query is the mean, over the ranks of its right pictures, of the share of right pictures up to that rank. This is the
convention of current papers and of torchreid and fast-reid. The first MATLAB code of Market-1501 instead takes the area under
the curve of precision over recall, by trapezoids between those ranks. The results differ: for right pictures at ranks 1 and 3,
(1/1 + 2/3) / 2 = 0.833 here and (1 + (1/2 + 2/3) / 2) / 2 = 0.792 there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError

Flags = NDArray[np.bool_]
Distances = NDArray[np.floating[Any]]
DistanceRows = Callable[[int, int], Distances]
"""Function that returns the rows from one index up to another (excluded) of a table of distances (queries, gallery)."""

RANKS = (1, 5, 10)
JUNK = -1
"""A picture of the gallery that counts neither as right nor as wrong."""
AT_ONCE = 2_000_000
"""Number of distances that are sorted at once; at about 40 bytes each, 80 MB."""


@dataclass(frozen=True)
class RetrievalScore:
    """Result of a retrieval."""

    cmc: dict[int, float]
    """k -> rank-k, the share of the queries with a right picture among the first k, 0 to 1."""
    mean_average_precision: float
    """mAP, 0 to 1."""
    queries: int
    """Number of queries that count."""
    left_out: int
    """Number of queries without any right picture in the gallery; they do not count."""
    gallery: int
    """Number of pictures in the gallery, with junk and distractors."""

    @property
    def rank_1(self) -> float:
        """Share of the queries whose nearest picture is right."""
        return self.cmc[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values for JSON."""
        ranks = {f"rank_{k}": share for k, share in self.cmc.items()}
        return ranks | {"map": self.mean_average_precision, "queries": self.queries, "left_out": self.left_out,
                        "gallery": self.gallery}  # fmt: skip


def retrieval_score(
    distance: Distances | DistanceRows,
    query_person: Ints,
    query_camera: Ints,
    gallery_person: Ints,
    gallery_camera: Ints,
    ranks: Sequence[int] = RANKS,
    *,
    across: bool = False,
    apart: Flags | None = None,
) -> RetrievalScore:
    """Compute CMC and mAP; see the module.

    Args:
        distance: (Q, G), any numbers, smaller for more similar pictures; or a function that returns rows of them, so that they
            need not be in memory all at once. Equal distances are sorted by the order of the gallery.
        query_person: (Q,) numbers of people, from 0.
        query_camera: (Q,) numbers of cameras.
        gallery_person: (G,) numbers as in `query_person`; `JUNK`; any other number below 0 is a distractor.
        gallery_camera: (G,) numbers as in `query_camera`.
        ranks: the k of rank-k; 1 is added.
        across: ignore all pictures of the query's camera, not only those of the same person.
        apart: (P, P), by numbers of people, whether two are known to be different. Pictures of other people that may be the
            query's person are ignored. None: all people are known to be different.

    Raises `InputError` for columns that do not fit together, a query without a person, a rank below 1, a distance that is not a
    finite number, and queries without any right picture.
    """
    columns = [np.asarray(column, dtype=np.int64) for column in (query_person, query_camera, gallery_person, gallery_camera)]
    who, where, whom, by = columns
    ks = sorted({1, *ranks})
    _check(distance, columns, ks)
    rows_of = distance if callable(distance) else lambda low, high: distance[low:high]
    step = max(1, AT_ONCE // max(1, len(whom)))
    precisions, firsts = [np.zeros(0)], [np.zeros(0, np.int64)]
    for low in range(0, len(who), step):
        high = min(low + step, len(who))
        right = whom == who[low:high, None]
        same_camera = by == where[low:high, None]
        passed = (whom == JUNK) | (same_camera if across else same_camera & right)
        if apart is not None:
            unsure = ~apart[who[low:high, None], np.maximum(whom, 0)] & (whom >= 0)
            passed |= unsure & ~right
        precision, first = _rank_gallery(np.asarray(rows_of(low, high)), right & ~passed, passed)
        precisions.append(precision)
        firsts.append(first)
    precision, first = np.concatenate(precisions), np.concatenate(firsts)
    n = len(precision)
    if not n:
        raise InputError(
            f"none of {len(who)} queries has an image of the same person by another camera among the {len(whom)} of the "
            "gallery: give a gallery with the people that are searched for"
        )
    cmc = {k: float((first <= k).sum() / n) for k in ks}
    return RetrievalScore(cmc, float(precision.mean()), n, len(who) - n, len(whom))


def _rank_gallery(distance: Distances, right: Flags, passed: Flags) -> tuple[Floats, Ints]:
    """Compute average precision and rank (from 1) of the first right picture, for the queries of (N, G) that have one."""
    if distance.shape != right.shape:
        raise InputError(f"the distances have the shape {distance.shape}: {right.shape} is needed")
    if not np.isfinite(distance).all():
        raise InputError("a distance is not a finite number: check the embeddings")
    having = np.flatnonzero(right.any(axis=1))
    counted = np.where(passed[having], np.inf, distance[having])
    # Only the ranks of the few right pictures are needed: a sort of values is several times faster than a stable argsort.
    ascending = np.sort(counted, axis=1)
    precision, first = np.zeros(len(having)), np.zeros(len(having), dtype=np.int64)
    for row, query in enumerate(having.tolist()):
        places = np.flatnonzero(right[query])
        values = counted[row, places]
        rank = np.searchsorted(ascending[row], values) + 1
        ties = np.searchsorted(ascending[row], values, side="right") >= rank + 1
        for tied in np.flatnonzero(ties).tolist():
            rank[tied] += np.count_nonzero(counted[row, : places[tied]] == values[tied])
        rank.sort()
        precision[row] = (np.arange(1, len(rank) + 1) / rank).mean()
        first[row] = rank[0]
    return precision, first


def _check(distance: Distances | DistanceRows, columns: Sequence[Ints], ranks: Sequence[int]) -> None:
    """Raise `InputError` if the arguments do not fit together."""
    who, where, whom, by = columns
    if any(column.ndim != 1 for column in columns) or len(who) != len(where) or len(whom) != len(by):
        shapes = ", ".join(str(column.shape) for column in columns)
        raise InputError(
            f"people and cameras of queries and gallery have the shapes {shapes}: (Q,), (Q,), (G,), (G,) are needed"
        )
    if not callable(distance) and np.shape(distance) != (len(who), len(whom)):
        raise InputError(f"the distances have the shape {np.shape(distance)}: {(len(who), len(whom))} is needed")
    if len(who) and who.min() < 0:
        raise InputError(f"query {int(who.argmin())} has no person ({who.min()}): leave junk and distractors out of them")
    if ranks[0] < 1:
        raise InputError(f"rank {ranks[0]} does not exist: the first rank is 1")
