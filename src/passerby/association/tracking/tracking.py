"""Tracking in one camera: the detections of a static camera are joined to tracklets, each of one person for some time.

A tracklet that changes person spoils every later step. A short tracklet does little harm: later steps join tracklets. So a link
between two boxes must be better than the best alternative by a margin, and must be found both forwards and backwards in time.
Where people cross and identities are unclear, the tracklets end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from passerby.association.tracking.embedding_model import EmbeddingSimilarity, learn_similarity
from passerby.association.tracking.linking import LinkCosts, agreed_links
from passerby.association.tracking.splitting import SplittingOptions, sample_interval_s, split_tracklets
from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes

Mask = NDArray[np.bool_]

SAME_BOX = 0.7
"""Intersection over union above which two boxes of one frame are one person detected twice. Two people so close together look
like one."""


@dataclass(frozen=True)
class TrackingOptions:
    """Options of `track`. Raises `InputError` for a value out of range. Costs are in -2 log likelihood."""

    max_gap_s: float = 1.0
    """Longest gap of a tracklet, seconds: after a second a walker may be anywhere within a body height of the predicted
    position. At low frame rates the next frame is always tried."""
    max_speed: float = 3.5
    """Largest speed, body heights per second: 6 m/s, faster than people run among others."""
    margin: float = 6.0
    """Increase of the best assignment's cost without a link, from which the link is kept: a likelihood ratio of 20."""
    unlinked_cost: float = 16.0
    """Cost of leaving a tracklet and a box unlinked: one box in ten is missed, and one new person or false box is expected in
    each picture of some hundred square body heights."""
    min_boxes: int = 3
    """Least number of boxes of a tracklet: two false boxes lie near each other by chance, three in a row rarely."""

    def __post_init__(self) -> None:
        for name in ("max_gap_s", "max_speed", "margin", "unlinked_cost", "min_boxes"):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= 0:
                raise InputError(f"tracking: {name} = {value} is out of range: give a number above 0")


def track(boxes: Boxes, fps: float, options: TrackingOptions | None = None) -> Boxes:
    """Join the detections of one camera to tracklets.

    Constant velocity in a Kalman filter (SORT: Bewley et al., ICIP 2016). Boxes of low score may continue a tracklet but not
    begin one (ByteTrack: Zhang et al., ECCV 2022). Embeddings are weighted by their discriminability in this recording.

    Args:
        boxes: N boxes in any order; identities are ignored.
        fps: frames per second of the frame numbers.
        options: the defaults where None.

    Returns:
        The same rows in the same order. The identity is the tracklet's number, from 0 in the order of the first boxes, or -1
        for a box of no tracklet. Raises `InputError` for an fps that is not above 0.
    """
    options = options or TrackingOptions()
    interval = sample_interval_s(boxes.frame, fps)
    costs = LinkCosts(
        max_gap_s=max(options.max_gap_s, interval),
        max_speed=options.max_speed,
        margin=options.margin,
        unlinked=options.unlinked_cost,
    )
    usable, weak = _score_classes(boxes.score)
    # Sorted by all columns of a box, so that the order of the rows has no effect, not even on the numbers.
    order = np.lexsort((*boxes.ltwh.T, boxes.score, boxes.frame))
    rows = order[_without_duplicates(boxes, usable)[order]]
    part, weak = boxes.take(rows), weak[rows]
    number = _agreed_tracklets(part, weak, fps, costs, None)
    if part.embedding is not None:
        similarity = learn_similarity(replace(part, identity=number))
        if similarity is not None:
            number = _agreed_tracklets(part, weak, fps, costs, similarity)
    divided = split_tracklets(
        replace(part, identity=number), fps, SplittingOptions(max_gap_s=options.max_gap_s, cross_check=False)
    )
    identity = np.full(len(boxes), UNKNOWN)
    identity[rows] = _renumbered(divided, options.min_boxes)
    return replace(boxes, identity=identity)


def _agreed_tracklets(part: Boxes, weak: Mask, fps: float, costs: LinkCosts, similarity: EmbeddingSimilarity | None) -> Ints:
    """Return the numbers (N,) of the chains of links that are found both forwards and backwards."""
    here, there = agreed_links(part, part.frame / fps, weak, costs, similarity)
    graph = coo_array((np.ones(len(here)), (here, there)), shape=(len(part), len(part)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _renumbered(boxes: Boxes, min_boxes: int) -> Ints:
    """Renumber tracklets (N,) from 0 in the order of the first boxes; -1 for tracklets of fewer than `min_boxes` boxes."""
    _, inverse, count = np.unique(boxes.identity, return_inverse=True, return_counts=True)
    long_enough = count[inverse] >= min_boxes
    numbers = np.full(len(count), UNKNOWN)
    order = np.lexsort((np.arange(len(boxes)), boxes.frame))
    firsts, place = np.unique(inverse[order][long_enough[order]], return_index=True)
    numbers[firsts[np.argsort(place)]] = np.arange(len(firsts))
    return np.asarray(numbers[inverse], dtype=np.int64)


def _score_classes(score: Floats) -> tuple[Mask, Mask]:
    """Return masks (N,) of the boxes that are used, and of the boxes that are too weak to begin a tracklet.

    Detectors differ in the range of their scores, and some write 1 for all. So the thresholds are relative to the range of the
    given scores. For a detector with a threshold of its own, at most a few per cent of the boxes are below a tenth of this
    range, and most of them are false.
    """
    if len(score) == 0:
        return np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.bool_)
    low, high = np.percentile(score, (5.0, 95.0))
    return score >= low + 0.1 * (high - low), score < low + 0.5 * (high - low)


def _without_duplicates(boxes: Boxes, usable: Mask) -> Mask:
    """Remove from the mask (N,) of usable boxes those that overlap one of higher score (or equal score and larger area)."""
    keep = np.array(usable)
    area = boxes.ltwh[:, 2] * boxes.ltwh[:, 3]
    order = np.lexsort((*boxes.ltwh.T, -area, -boxes.score, boxes.frame))
    order = order[usable[order]]
    for rows in np.split(order, np.flatnonzero(np.diff(boxes.frame[order])) + 1):
        if len(rows) < 2:
            continue
        double = np.triu(overlaps(boxes.ltwh[rows], boxes.ltwh[rows]) > SAME_BOX, k=1)
        if double.any():
            for place in range(len(rows)):
                if keep[rows[place]]:
                    keep[rows[double[place]]] = False
    return keep


def overlaps(a: Floats, b: Floats) -> Floats:
    """Compute the intersection over union (N, M) of boxes (N, 4) and (M, 4): left, top, width, height."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum((a[:, :2] + a[:, 2:])[:, None], (b[:, :2] + b[:, 2:])[None])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    return np.asarray(common / (np.prod(a[:, 2:], axis=1)[:, None] + np.prod(b[:, 2:], axis=1)[None] - common))
