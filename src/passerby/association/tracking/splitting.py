"""Splitting of tracklets that may change person: the motion jumps, the person was hidden for long, or appearance changes.

It works on the tracklets of any tracker. A tracklet that is cut in two loses little; one that changes person spoils later
steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.association.tracking.linking import LinkCosts, agreed_links
from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes, Vectors, sampling_step

Mask = NDArray[np.bool_]

GROWTH_PER_S = 1.0
"""Change of the logarithm of a box's size per second: a person who runs towards a camera 3 m away."""
WINDOWS = (8, 32, 128)
"""Boxes on either side whose mean embeddings are compared: short windows find short stretches, long ones weak changes."""
FEWEST = 4
"""Least number of boxes on the shorter side of a change of appearance."""
SURE = 8.0
"""Squared distance of two means, as a multiple of its expected value by their spread, above which it is significant. Pure noise
gives 1; even in only four dimensions it reaches 8 at one place in a million."""
TELLING = 3.0
"""The same between tracklets seen at once, in the median. Below it embeddings do not distinguish people and are not used."""
PERSON_CHANGE = 0.5
"""Least squared change of the mean embedding, as a share of the squared distance between people seen at once. A person who
turns round changes it by less."""


@dataclass(frozen=True)
class SplittingOptions:
    """Options of `split_tracklets`. Raises `InputError` for a value out of range."""

    max_gap_s: float = 1.0
    """Longest time between two boxes of a tracklet, seconds; at low frame rates neighbouring samples are never cut by it."""
    max_speed: float = 3.5
    """Largest speed, body heights per second: 6 m/s."""
    position_slack: float = 0.4
    """Body heights that a box may jump in addition, by noise or because half of the person is hidden."""
    size_ratio: float = 1.6
    """Largest sudden change of the box's size (root of the area); a person who crouches changes by less."""
    cross_check: bool = True
    """Cut also where this package's own tracking significantly links a box of one tracklet to a box of another."""

    def __post_init__(self) -> None:
        for name, least in (("max_gap_s", 0.0), ("max_speed", 0.0), ("position_slack", 0.0), ("size_ratio", 1.0)):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= least:
                raise InputError(f"splitting of tracklets: {name} = {value} is out of range: give a number above {least:g}")


def sample_interval_s(frame: Ints, fps: float) -> float:
    """Return the seconds between neighbouring samples (`sampling_step`). Raises `InputError` for a wrong fps."""
    if not np.isfinite(fps) or fps <= 0:
        raise InputError(f"tracking: fps = {fps}: give the frames per second of the frame numbers, a number above 0")
    return sampling_step(frame) / fps


def find_motion_links(boxes: Boxes, fps: float, options: SplittingOptions | None = None) -> tuple[Ints, Ints]:
    """Link boxes of tracklets by this package's own tracking: rows (L,) and the rows (L,) that continue them.

    Links depend on motion alone, not on the tracklets: splitting does not change them. Arguments as of `split_tracklets`.
    """
    options = options or SplittingOptions()
    order = np.lexsort((boxes.frame, boxes.identity))
    order = order[boxes.identity[order] != UNKNOWN]
    rows = boxes.take(order)
    costs = LinkCosts(max_gap_s=max(options.max_gap_s, sample_interval_s(boxes.frame, fps)))
    here, there = agreed_links(rows, rows.frame / fps, np.zeros(len(rows), dtype=np.bool_), costs, None)
    by_row = np.argsort(order[here])
    return order[here[by_row]], order[there[by_row]]


def split_tracklets(
    boxes: Boxes, fps: float, options: SplittingOptions | None = None, links: tuple[Ints, Ints] | None = None
) -> Boxes:
    """Split the tracklets of one camera where they may change person.

    Args:
        boxes: N boxes in any order, with tracklet numbers; -1 for boxes of no tracklet.
        fps: frames per second of the frame numbers.
        options: the defaults where None.
        links: result of `find_motion_links`, if it is known.

    Returns:
        The same rows in the same order. The first stretch of a tracklet keeps its number, the others get new ones above the
        largest; -1 stays. Raises `InputError` for an fps that is not above 0.
    """
    options = options or SplittingOptions()
    interval = sample_interval_s(boxes.frame, fps)
    order = np.lexsort((boxes.frame, boxes.identity))
    order = order[boxes.identity[order] != UNKNOWN]
    if len(order) == 0:
        return boxes
    rows = boxes.take(order)
    begins = np.concatenate([[True], np.diff(rows.identity) != 0])
    max_gap_s = max(options.max_gap_s, interval)
    cut = _motion_cuts(rows, fps, max_gap_s, options) & ~begins
    if options.cross_check:
        place = np.empty(len(boxes), dtype=np.int64)
        place[order] = np.arange(len(order))
        here, there = find_motion_links(boxes, fps, options) if links is None else links
        cut |= _contradicted(rows.identity, place[here], place[there]) & ~begins
    if rows.embedding is not None:
        stretch = np.cumsum(begins | cut)
        cut |= _appearance_cuts(rows.frame, stretch, rows.embedding)
    stretch = np.cumsum(begins | cut) - 1
    numbers = np.where(begins, rows.identity, UNKNOWN)[begins | cut]
    fresh = numbers == UNKNOWN
    numbers[fresh] = rows.identity.max() + 1 + np.arange(fresh.sum())
    identity = np.array(boxes.identity)
    identity[order] = numbers[stretch]
    return replace(boxes, identity=identity)


def find_continuations(boxes: Boxes, links: tuple[Ints, Ints]) -> tuple[Ints, Ints]:
    """Find tracklets of one camera that significantly continue as others: a user's tracker lost the person for a moment.

    Args:
        boxes: boxes with tracklet numbers; -1 for boxes of no tracklet.
        links: result of `find_motion_links`.

    Returns:
        (K,) tracklets and (K,) the tracklets that continue them.
    """
    here, there = links
    before, after = boxes.identity[here], boxes.identity[there]
    known = boxes.take(boxes.identity != UNKNOWN)
    n = int(known.identity.max(initial=-1)) + 1
    first, last = np.full(n, np.iinfo(np.int64).max), np.full(n, np.iinfo(np.int64).min)
    np.minimum.at(first, known.identity, known.frame)
    np.maximum.at(last, known.identity, known.frame)
    use = (boxes.frame[here] == last[before]) & (boxes.frame[there] == first[after]) & (before != after)
    return before[use], after[use]


def _motion_cuts(rows: Boxes, fps: float, max_gap_s: float, options: SplittingOptions) -> Mask:
    """Return a mask (N,) of the rows (sorted by tracklet and frame) that cannot be the person of the row before.

    A jump counts only if it lasts: the step from the last row but one, and the step to the next row, must be jumps too. So a
    single misplaced box does not cut a tracklet.
    """
    seconds = rows.frame / fps
    jumps = {}
    for reach in (1, 2):
        jumps[reach] = np.ones(len(rows), dtype=np.bool_)
        jumps[reach][reach:] = _jumps(rows.ltwh[:-reach], rows.ltwh[reach:], seconds[reach:] - seconds[:-reach], options)
        jumps[reach][reach:] |= rows.identity[reach:] != rows.identity[:-reach]
    onwards = np.append(jumps[2][1:], True)
    other_next = np.append(rows.identity[1:] != rows.identity[:-1], True)
    other_before = np.ones(len(rows), dtype=np.bool_)
    other_before[2:] = rows.identity[2:] != rows.identity[:-2]
    lasting = jumps[1] & (jumps[2] | other_before) & (onwards | other_next)
    gap = np.zeros(len(rows), dtype=np.bool_)
    gap[1:] = np.diff(seconds) > max_gap_s * (1 + 1e-9)
    return np.asarray(lasting | gap)


def _contradicted(identity: Ints, here: Ints, there: Ints) -> Mask:
    """Return a mask (N,) of rows (sorted by tracklet and frame) before which links lead from or to another tracklet.

    The links are by motion alone; changes of appearance are found by `_appearance_cuts`. A single wrongly numbered box, between
    two that agree, does not cut a tracklet.

    Args:
        identity: (N,) tracklet of each row.
        here: (L,) rows.
        there: (L,) rows that continue them.
    """
    after, before = np.full(len(identity), -1), np.full(len(identity), -1)
    after[here], before[there] = there, here
    stays = (after < 0) | (identity[after] == identity)
    stayed = (before < 0) | (identity[before] == identity)
    changes = (identity[here] != identity[there]) & stayed[here] & stays[there]
    cut = np.zeros(len(identity) + 1, dtype=np.bool_)
    cut[here[changes] + 1] = True
    cut[there[changes]] = True
    return cut[:-1]


def _jumps(before: Floats, after: Floats, dt: Floats, options: SplittingOptions) -> Mask:
    """Check (M,) whether boxes `after` (M, 4) differ too much in position or size from those `before`, dt seconds earlier.

    The smallest motion of three points is used (middle of the top edge, centre, middle of the bottom edge): of a half-hidden
    person one of them stays.
    """
    height = np.maximum(before[:, 3], after[:, 3])
    across = np.abs((after[:, 0] + after[:, 2] / 2) - (before[:, 0] + before[:, 2] / 2))
    places = [np.abs((after[:, 1] + part * after[:, 3]) - (before[:, 1] + part * before[:, 3])) for part in (0.0, 0.5, 1.0)]
    moved = np.hypot(across, np.min(places, axis=0)) / height
    grown = np.abs(np.log(after[:, 2:]) - np.log(before[:, 2:])).min(axis=1)
    area = np.abs((np.log(after[:, 2:]) - np.log(before[:, 2:])).mean(axis=1))
    too_far = moved > options.max_speed * dt + options.position_slack
    # Both width and height have to change: for a half-hidden person only one of them shrinks.
    resized = np.minimum(area, 2 * grown) > np.log(options.size_ratio) + GROWTH_PER_S * dt
    return np.asarray(too_far | resized)


def _appearance_cuts(frame: Ints, stretch: Ints, embedding: Vectors) -> Mask:
    """Return a mask (N,) of rows (sorted by stretch and frame) at which the mean embedding changes as between people."""
    cut = np.zeros(len(frame), dtype=np.bool_)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(stretch)) + 1])
    ends = np.append(starts[1:], len(frame))
    between = _between_people(frame, stretch - stretch[0], embedding, starts)
    if between is None:
        return cut
    for start, end in zip(starts, ends, strict=True):
        known = start + np.flatnonzero(np.abs(embedding[start:end]).max(axis=1) > 0)
        if len(known) >= 2 * FEWEST:
            cut[known[_change_points(embedding[known], PERSON_CHANGE * between)]] = True
    return cut


def _between_people(frame: Ints, stretch: Ints, embedding: Vectors, starts: Ints) -> float | None:
    """Return the squared distance of the mean embeddings of people seen at once, minus the noise: the median over pairs.

    It is 0 where too few people are seen at once, and None where the embeddings do not distinguish people.
    """
    known = (np.abs(embedding).max(axis=1, initial=0.0) > 0).astype(np.float64)
    count = np.add.reduceat(known, starts)
    mean = np.add.reduceat(embedding.astype(np.float64), starts, axis=0) / np.maximum(count, 1.0)[:, None]
    order = np.lexsort((stretch, frame))
    one, two = order[:-1], order[1:]
    at_once = frame[one] == frame[two]
    pairs = np.unique(np.stack([stretch[one[at_once]], stretch[two[at_once]]], axis=1), axis=0)
    pairs = pairs[(count[pairs] >= FEWEST).all(axis=1)]
    if len(pairs) == 0:
        return 0.0
    noise = _noise_of_means(mean, count)
    distance = np.sum((mean[pairs[:, 0]] - mean[pairs[:, 1]]) ** 2, axis=1)
    explained = noise[pairs].sum(axis=1)
    if np.median(distance / np.maximum(explained, 1e-12)) < TELLING:
        return None
    return max(float(np.median(distance - explained)), 0.0)


def _noise_of_means(mean: Floats, count: Floats) -> Floats:
    """Return the expected squared errors (...,) of means (..., D) of unit vectors, whose variance is 1 - |mean|^2."""
    spread = np.maximum(1.0 - np.sum(mean**2, axis=-1), 1e-6) * count / np.maximum(count - 1.0, 1.0)
    return np.asarray(spread / np.maximum(count, 1.0))


def _change_points(embedding: Vectors, least: float) -> list[int]:
    """Find the rows of a tracklet's embeddings (n, D) at which another person begins, by repeated splits at the clearest."""
    sums = np.concatenate([np.zeros((1, embedding.shape[1])), np.cumsum(embedding, axis=0, dtype=np.float64)])
    found: list[int] = []
    parts = [(0, len(embedding))]
    while parts:
        start, end = parts.pop()
        place = _clearest_change(sums[start : end + 1], least)
        if place is not None:
            found.append(start + place)
            parts += [(start, start + place), (start + place, end)]
    return found


def _clearest_change(sums: Floats, least: float) -> int | None:
    """Find the place at which the mean of the embeddings changes most significantly; return None if it changes nowhere.

    Args:
        sums: (n + 1, D) sums of the first 0 to n embeddings, plus any constant.
        least: least squared distance of the means.
    """
    n = len(sums) - 1
    place = np.arange(FEWEST, n - FEWEST + 1)
    if len(place) == 0:
        return None
    best = np.zeros(len(place))
    for window in WINDOWS:
        low, high = np.maximum(place - window, 0), np.minimum(place + window, n)
        before, after = (place - low).astype(np.float64), (high - place).astype(np.float64)
        mean_before = (sums[place] - sums[low]) / before[:, None]
        mean_after = (sums[high] - sums[place]) / after[:, None]
        distance = np.sum((mean_before - mean_after) ** 2, axis=1)
        explained = _noise_of_means(mean_before, before) + _noise_of_means(mean_after, after)
        sure = (distance > SURE * explained) & (distance - explained > least)
        best = np.maximum(best, np.where(sure, distance / explained, 0.0))
    top = int(np.argmax(best))
    return int(place[top]) if best[top] > 0 else None
