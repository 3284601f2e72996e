"""Test whether two cameras exchange their files during the recording, as with a recorder that swaps two of its channels.

At that moment, boxes do not continue in their own file, and the boxes of each file continue in the other one. Only positions in
the image are compared, no identities, so that detections suffice. The evidence is a likelihood ratio. The probability that a
box continues is the usual share of its file if it is the same person, and the share by chance if it is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.observations import CameraObservations, extents_of
from passerby.core.synchronisation import USUAL_FPS
from passerby.findings.finding import Finding, doubt
from passerby.geometry.groups import expanded_ranges, rows_of_equal
from passerby.scene.camera_input import CameraInput

LONGEST_STEP_S = 0.5
"""Maximum time between two frames that are compared: after a longer time, people are elsewhere."""
FARTHEST_S = 5.0
"""Maximum time between the moments of the exchange in the two files: recorders begin their files at most this far apart."""
NEAR, NEAR_A_SECOND, RATIO = 0.15, 1.0, 0.2
"""A box continues another one if its distance is below the first share of the height plus the second share per second (a fast
walk), and the logarithm of the size ratio is below the third value: the noise of a detector is within these limits."""
OTHER_MOMENTS = 200
"""Number of moments of two recordings at which the share by chance is counted. People who stand still, or cameras side by side,
have boxes at the same places of both images all the time."""
LEAST_ODDS = 1000.0
"""Minimum likelihood ratio for one exchange, divided by the number of moments tried. In 48 correct simulated scenes (those of
the coverage part, seeds 3012 to 3039 and 3100 to 3119: up to 6 % of noise and 20 % of wrong identities) it is 10 at most. With
two files exchanged it is above 1,000 in most of them: in all in which both cameras see three people or more."""


@dataclass(frozen=True)
class ExchangedStreams:
    """Two cameras, and the frames from which the file of each shows the view of the other."""

    cameras: tuple[str, str]
    frames: tuple[int, int]
    """First frame after the exchange, by each camera's own frame numbers."""
    boxes: int
    """Number of boxes that continue in the other file."""


def findings_of_exchanged_streams(readings: Sequence[CameraInput]) -> list[Finding]:
    """Return a doubt about each pair of cameras that exchange their files."""
    return [
        doubt("streams_seem_exchanged", *one.cameras, frames=list(one.frames), boxes=one.boxes)
        for one in find_exchanged_streams(readings)
    ]


def find_exchanged_streams(readings: Sequence[CameraInput]) -> list[ExchangedStreams]:
    """Find the pairs of cameras that exchange their files, each at the moment with the most evidence."""
    shown = {reading.name: one for reading in readings if (one := _Shown.of(reading.seen, reading.fps)) is not None}
    moments = {pair: _pair_cuts(shown[pair[0]], shown[pair[1]]) for pair in combinations(shown, 2)}
    needed = np.log(LEAST_ODDS * max(sum(len(k) for k, _ in moments.values()), 1))
    found = []
    for pair, (k, j) in moments.items():
        a, b = (shown[name] for name in pair)
        if not len(k):
            continue
        usual = min(a.usual, b.usual)
        chance = min(_share(*(part.sum() for part in _count_exchanged(a, *_other_moments(a, b)))), usual)
        boxes, count = _count_exchanged(a, k, b, j)
        evidence = _log_ratio(boxes, count, usual, chance)
        best = int(evidence.argmax())
        if evidence[best] > needed:
            frames = (int(a.frames[k[best] + 1]), int(b.frames[j[best] + 1]))
            found.append(ExchangedStreams(pair, frames, int(boxes[best])))
    return found


@dataclass(frozen=True, eq=False)
class _Shown:
    """The boxes of one camera's file, frame by frame."""

    frames: Ints
    """(F,) numbers of the frames with people, ascending."""
    seconds: Floats
    """(F,) times of these frames in the camera's own recording."""
    begin: Ints
    """(F + 1,) index of the first box of each frame, and the number of boxes."""
    box: Floats
    """(N, 3) centre and height, pixels, in the order of the frames."""
    usual: float
    """Share of boxes that continue in the next frame."""
    cuts: Ints
    """Indices of frames after which the share of boxes that continue is more likely by chance than usual."""

    @classmethod
    def of(cls, seen: CameraObservations, fps: float | None) -> _Shown | None:
        """Collect the boxes of a file, or the extents of its keypoints; None with fewer than two frames."""
        part = seen.boxes if len(seen.boxes) else seen.keypoints
        extent = extents_of(part)
        order = np.argsort(part.frame, kind="stable")
        order = order[(extent[order, 2:] > extent[order, :2]).all(axis=1)]
        frames, begin, count = np.unique(part.frame[order], return_index=True, return_counts=True)
        if len(frames) < 2:
            return None
        left, top, right, bottom = extent[order].T
        box = np.column_stack([0.5 * (left + right), 0.5 * (top + bottom), bottom - top])
        seconds = (frames - 1) / (fps or USUAL_FPS)
        number = np.repeat(np.arange(len(frames)), count)
        step = np.diff(seconds)
        compared = step <= LONGEST_STEP_S
        held, fewer = _count_continued(number, box, 1, np.append(step, np.inf), count)
        other, fewest = _count_continued(number, box, max(len(frames) // 2, 1), np.full(len(frames), np.median(step)), count)
        usual = _share(held[:-1][compared].sum(), fewer[:-1][compared].sum())
        chance = min(_share(other.sum(), fewest.sum()), usual)
        cut = compared & (_log_ratio(held[:-1], fewer[:-1], chance, usual) > 0)
        return cls(frames, seconds, np.append(begin, len(box)), box, usual, np.flatnonzero(cut))


def _count_continued(number: Ints, box: Floats, later: int, seconds: Floats, count: Ints) -> tuple[Ints, Ints]:
    """Count the boxes (F,) of each frame that continue `later` frames later, and the boxes (F,) that could.

    The frames after the last one are the first ones. `seconds` (F,) are the times to the later frames.
    """
    frames = len(count)
    before, after = rows_of_equal((number + later) % frames, number)
    near = _find_continuing(box[before], box[after], seconds[number[before]])
    of_before = np.bincount(number[np.unique(before[near])], minlength=frames)
    of_after = np.bincount(number[np.unique(after[near])], minlength=frames)
    return np.minimum(of_before, np.roll(of_after, -later)), np.minimum(count, np.roll(count, -later))


def _find_continuing(before: Floats, after: Floats, seconds: Floats | float) -> Bools:
    """Return whether boxes (..., 3) may be the same people `seconds` later."""
    height = np.minimum(before[..., 2], after[..., 2])
    apart = np.hypot(before[..., 0] - after[..., 0], before[..., 1] - after[..., 1])
    alike = np.abs(np.log(before[..., 2] / after[..., 2])) < RATIO
    return np.asarray(alike & (apart < (NEAR + NEAR_A_SECOND * seconds) * height))


def _share(hits: float, count: float) -> float:
    """Compute a share by Laplace's rule, which is never 0 or 1."""
    return float((hits + 1.0) / (count + 2.0))


def _log_ratio(hits: Ints, count: Ints, share: float, other: float) -> Floats:
    """Compute the log-likelihood ratio of `share` to `other`, for `hits` among `count`."""
    return np.asarray(hits * np.log(share / other) + (count - hits) * np.log((1.0 - share) / (1.0 - other)))


def _pair_cuts(a: _Shown, b: _Shown) -> tuple[Ints, Ints]:
    """Find frames (P,) of one file and (P,) of the other after which both have cuts, at moments that may be the same."""
    at, times = a.seconds[a.cuts], b.seconds[b.cuts]
    first = np.searchsorted(times, at - FARTHEST_S)
    own, other = expanded_ranges(first, np.searchsorted(times, at + FARTHEST_S, side="right") - first)
    return a.cuts[own], b.cuts[other]


def _other_moments(a: _Shown, b: _Shown) -> tuple[Ints, _Shown, Ints]:
    """Select frames (P,) of one file, evenly spaced; return them, the other file, and its frames (P,) at about these times."""
    k = np.unique(np.linspace(0, len(a.frames) - 2, OTHER_MOMENTS).round().astype(np.int64))
    return k, b, np.clip(np.searchsorted(b.seconds, a.seconds[k]), 0, len(b.frames) - 2)


def _count_exchanged(a: _Shown, k: Ints, b: _Shown, j: Ints) -> tuple[Ints, Ints]:
    """Count the boxes (P,) that continue in the other file after frames `k` and `j` (P,), and the boxes (P,) that could."""
    step = np.maximum(a.seconds[k + 1] - a.seconds[k], b.seconds[j + 1] - b.seconds[j])
    hits, count = np.zeros(len(k), np.int64), np.zeros(len(k), np.int64)
    for one, before, other, after in ((a, k, b, j + 1), (b, j, a, k + 1)):
        n, m = (np.diff(part.begin)[rows] for part, rows in ((one, before), (other, after)))
        pair, row = expanded_ranges(one.begin[before], n)
        item, column = expanded_ranges(other.begin[after][pair], m[pair])
        row, pair = row[item], pair[item]
        near = _find_continuing(one.box[row], other.box[column], step[pair])
        continued = (np.unique(np.column_stack([pair, side])[near], axis=0)[:, 0] for side in (row, column))
        hits += np.minimum(*(np.bincount(which, minlength=len(k)) for which in continued))
        count += np.minimum(n, m)
    return hits, count
