"""Stitching of one camera's tracklets that broke where a person was hidden or crossed another's trajectory.

The tracker decides frame by frame, and ends a tracklet where the decision is uncertain. Whole tracklets contain more
information: the person's motion before and after the gap, and the appearance in all boxes. If one tracklet begins soon after
another one has ended, the odds of one person against two are computed. Then the set of links with the largest total likelihood
is found (as in Huang, Wu, Nevatia, *Robust Object Tracking by Hierarchical Association of Detection Responses*, ECCV 2008). A
link is kept if the total would be clearly less likely without it. Stitched tracklets contain still more information, so this is
done in rounds.

Costs are -2 log likelihood and lengths are in body heights, as in `linking`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from passerby.association.correlation_clustering import find_overlaps
from passerby.association.tracking.embedding_model import HALF, similarity_of_halves
from passerby.association.tracking.linking import SHAPE_SD, START_SPEED_SD, TAIL, Tracks, first_seen, predict, update
from passerby.association.tracking.matching import clear_matches
from passerby.association.tracking.splitting import sample_interval_s
from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes
from passerby.geometry.groups import expanded_ranges

MEMORY_S = 2.0
"""Length of the end of a tracklet, seconds, from which position and velocity are filtered; older boxes have no effect."""
HIDDEN_S = 2.0
"""Mean time for which a person who comes back is out of sight; half of it changes little."""
GROWTH_SD_PER_S = 0.1
"""Standard deviation of the logarithms of height and width for each second of a gap: a walker 14 m from the camera who comes
straight towards it."""
TAIL_OF_MOTION = 6.0
"""Degrees of freedom of Student's t for position and velocity across a gap; 3 and 12 change little."""
ROUNDS = 3


@dataclass(frozen=True)
class StitchingOptions:
    """Options of `stitch_tracklets`. Raises `InputError` for a value out of range."""

    max_gap_s: float = 4.0
    """Longest time out of sight, seconds; after it a walker may be anywhere within two body heights: appearance must decide."""
    margin: float = 2.0
    """Increase of the best cost without a link from which it is kept: odds of 2.7 to 1. The tracker requires 20 to 1."""

    def __post_init__(self) -> None:
        for name in ("max_gap_s", "margin"):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= 0:
                raise InputError(f"stitching of tracklets: {name} = {value} is out of range: give a number above 0")


def stitch_tracklets(boxes: Boxes, fps: float, options: StitchingOptions | None = None) -> Boxes:
    """Join the tracklets of one camera that are most likely one person who was out of sight for a moment.

    Args:
        boxes: N boxes in any order, with tracklet numbers; -1 for boxes of no tracklet.
        fps: frames per second of the frame numbers.
        options: the defaults where None.

    Returns:
        The same rows in the same order; a tracklet has the number of the one that it continues. Raises `InputError` for an fps
        that is not above 0.
    """
    options = options or StitchingOptions()
    sample_interval_s(boxes.frame, fps)  # refuses a wrong fps
    # Sorted by all columns of a box, so that the order of the rows has no effect.
    order = np.lexsort((*boxes.ltwh.T, boxes.frame, boxes.identity))
    order = order[boxes.identity[order] != UNKNOWN]
    if not len(order):
        return boxes
    part = boxes.take(order)
    number = np.unique(part.identity, return_inverse=True)[1]
    for _ in range(ROUNDS):
        before, after = _links(replace(part, identity=number), fps, options)
        if not len(before):
            break
        n = int(number.max()) + 1
        graph = coo_array((np.ones(len(before)), (before, after)), shape=(n, n))
        number = connected_components(graph, directed=False)[1].astype(np.int64)[number]
    by_time = np.lexsort((part.identity, part.frame))
    groups, place = np.unique(number[by_time], return_index=True)
    first = np.zeros(number.max() + 1, dtype=np.int64)
    first[groups] = part.identity[by_time[place]]
    identity = np.array(boxes.identity)
    identity[order] = first[number]
    return replace(boxes, identity=identity)


def find_stitches(boxes: Boxes, fps: float, options: StitchingOptions | None = None) -> tuple[Ints, Ints]:
    """Find the same stitches as pairs of tracklets: (K,) tracklets and (K,) the tracklets that continue them."""
    rows = np.flatnonzero(boxes.identity != UNKNOWN)
    stitched = stitch_tracklets(boxes, fps, options).identity[rows]
    tracklets = np.unique(np.column_stack([boxes.identity[rows], stitched]), axis=0)
    begin = np.full(len(tracklets), np.iinfo(np.int64).max)
    np.minimum.at(begin, np.searchsorted(tracklets[:, 0], boxes.identity[rows]), boxes.frame[rows])
    order = np.lexsort((begin, tracklets[:, 1]))
    same = np.diff(tracklets[order, 1]) == 0
    return tracklets[order[:-1][same], 0], tracklets[order[1:][same], 0]


@dataclass(frozen=True, eq=False)
class _Ends:
    """States and times at which T tracklets begin and end."""

    first: Tracks
    """States at the beginning; their velocities are forwards in time too."""
    last: Tracks
    begin_s: Floats
    end_s: Floats

    @classmethod
    def of(cls, boxes: Boxes, seconds: Floats) -> _Ends:
        """Compute the ends of the tracklets 0 to T - 1."""
        last, first = _last_states(boxes, seconds), _last_states(boxes, -seconds)
        first.velocity[:] *= -1
        return cls(first, last, -first.time, last.time)


def _links(boxes: Boxes, fps: float, options: StitchingOptions) -> tuple[Ints, Ints]:
    """Find significant links: tracklets (K,), and the tracklets (K,) that continue them. Numbers are from 0 without a gap."""
    ends = _Ends.of(boxes, boxes.frame / fps)
    before, after = _candidates(ends.begin_s, ends.end_s, options.max_gap_s)
    cost = _motion_cost(ends, before, after) + 2 * np.log(_newcomers(boxes, ends)) + _look_cost(boxes, ends, before, after)
    likely = cost < 0
    return clear_matches(len(ends.begin_s), before[likely], after[likely], cost[likely], options.margin)


def _candidates(begin_s: Floats, end_s: Floats, max_gap_s: float) -> tuple[Ints, Ints]:
    """Find pairs (L,), (L,) of tracklets: the second begins within `max_gap_s` after the end of the first."""
    order = np.argsort(begin_s, kind="stable")
    low = np.searchsorted(begin_s[order], end_s, side="right")
    count = np.searchsorted(begin_s[order], end_s + max_gap_s * (1 + 1e-9), side="right") - low
    before, place = expanded_ranges(low, count)
    return before, order[place]


def _last_states(boxes: Boxes, seconds: Floats) -> Tracks:
    """Filter the states of the T tracklets at their last boxes; with negated times, at their first boxes."""
    order = np.lexsort((seconds, boxes.identity))
    seen = first_seen(boxes.take(order), seconds[order])
    starts = np.flatnonzero(np.diff(boxes.identity[order], prepend=-1))
    stops = np.append(starts[1:], len(order))
    recent = seen.time >= np.repeat(seen.time[stops - 1], stops - starts) - MEMORY_S
    begins = stops - np.add.reduceat(recent.astype(np.int64), starts)
    state = seen.take(begins)
    for step in range(1, int((stops - begins).max())):
        rows = np.flatnonzero(begins + step < stops)
        here = seen.take(begins[rows] + step)
        state.put(rows, update(predict(state.take(rows), here.time), here))
    return state


def _motion_cost(ends: _Ends, before: Ints, after: Ints) -> Floats:
    """Return the costs (L,) of position, velocity, size and time of continued tracklets, minus those of a new person.

    A new person appears anywhere, once in a body height squared and second, with any velocity. The position and velocity at
    which a tracklet begins, from its own boxes, are compared with those predicted from the tracklet before it.
    """
    old, new = ends.last.take(before), ends.first.take(after)
    gap = ends.begin_s[after] - ends.end_s[before]
    expected = predict(old, ends.begin_s[after])
    height = np.exp((old.shape[:, :1] + new.shape[:, :1]) / 2)
    off, turned = (new.centre - expected.centre) / height, (new.velocity - expected.velocity) / height
    pp, pv, vv = (expected.covariance + new.covariance * (1.0, -1.0, 1.0)).T
    determinant = pp * vv - pv**2
    squares = vv * (off**2).sum(axis=1) - 2 * pv * (off * turned).sum(axis=1) + pp * (turned**2).sum(axis=1)
    cost = (TAIL_OF_MOTION + 4) * np.log1p(squares / determinant / TAIL_OF_MOTION) + 2 * np.log(determinant)
    sd = np.hypot(np.array(SHAPE_SD) / 2, GROWTH_SD_PER_S * gap[:, None])
    cost += (TAIL + 1) * np.log1p(((new.shape - old.shape) / sd) ** 2 / TAIL).sum(axis=1)
    # The time out of sight is exponentially distributed.
    cost += 2 * gap / HIDDEN_S + 2 * np.log(HIDDEN_S) + 2 * np.log(2 * np.pi)
    spread = START_SPEED_SD**2 + new.covariance[:, 2]
    anybody = ((new.velocity / height) ** 2).sum(axis=1) / spread + 2 * np.log(spread)
    return np.asarray(cost - anybody)


def _newcomers(boxes: Boxes, ends: _Ends) -> float:
    """Return the density of new tracklets in a body height squared and second; it is an upper limit of that of new people.

    The area of the picture extends by a body height beyond the boxes, where people may appear too.
    """
    height = boxes.ltwh[:, 3]
    centre = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2
    low, high = (centre - height[:, None]).min(axis=0), (centre + height[:, None]).max(axis=0)
    area = float(np.prod(high - low) * np.mean(height**-2.0))
    seconds = float(np.ptp(np.concatenate([ends.begin_s, ends.end_s])))
    return len(ends.begin_s) / area / max(seconds, 1.0)


def _look_cost(boxes: Boxes, ends: _Ends, before: Ints, after: Ints) -> Floats:
    """Return the costs (L,) of the embeddings of whole tracklets; zeros where they do not distinguish people."""
    if boxes.embedding is None:
        return np.zeros(len(before))
    order = np.lexsort((boxes.frame, boxes.identity))
    starts = np.flatnonzero(np.diff(boxes.identity[order], prepend=-1))
    count = np.diff(np.append(starts, len(order)))
    long = count >= 2 * HALF
    middle = starts + np.where(long, count // 2, 0)
    places = np.stack([starts, middle], axis=1)[np.stack([long, np.ones_like(long)], axis=1)]
    sums = np.add.reduceat(boxes.embedding[order], places, axis=0, dtype=np.float64)
    late = np.cumsum(1 + long) - 1
    early = np.where(long[:, None], sums[np.maximum(late - 1, 0)], 0.0)
    one, two = find_overlaps(ends.begin_s, ends.end_s, 0.0)
    found = similarity_of_halves(early, sums[late], long, one, two)
    if found is None:
        return np.zeros(len(before))
    whole = early + sums[late]
    return found.cost_of_pairs(whole[before], whole[after])
