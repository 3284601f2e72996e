"""Do the files of two cameras change places while they film? A recorder that swaps two of its channels writes such files.

At that moment no person's box continues in its own file, and the boxes of each file continue in the other one. Detections
without identities show this as well; where there are identities, a box that continues in its own file keeps its identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.observations import CameraObservations, extents_of
from passerby.core.synchronisation import USUAL_FPS
from passerby.findings.finding import Finding, notice
from passerby.geometry.groups import rows_of_equal
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

LONGEST_STEP_S = 0.5
"""Frames farther apart are not compared: people are elsewhere by then."""
FARTHEST_S = 5.0
"""Between the moments at which it happens in two files: recorders begin their files so much apart at most."""
NEAR, NEAR_A_SECOND, RATIO = 0.15, 1.0, 0.2
"""A box continues another one within so much of its height, and so much more a second (a fast walk), at a size that differs
by less than this logarithm: the noise of a detector is within it."""
FEWEST_SEEN, MOST_CONTINUED, LEAST_EXCHANGED = 2, 0.34, 0.5
"""Boxes on both sides of such a moment, and the shares of them that continue in their own file at most, in the other at least;
as many continue between most frames of a file."""
OTHER_MOMENTS = 200
"""Moments of a recording at which fewer boxes must continue in the other file than at the exchange."""
CERTAIN, LIKELY = 8, 5
"""Boxes of both files that continue in the other one: enough for an error of the input, and for a notice. In 72 right simulated
scenes (three presets, 2.5 to 10 frames a second, seeds 400 to 423, up to 20 % of boxes missing; in a third of them two cameras
turn at one time) there are 4 at most, in two of those with turns. Exchanged at half time, 45 have 8 or more, 55 have 5
or more."""


@dataclass(frozen=True)
class ExchangedStreams:
    """Two cameras, and since when the file of each shows what the other one sees."""

    cameras: tuple[str, str]
    frames: tuple[int, int]
    """First frame after the exchange, of each camera's own."""
    seconds: tuple[float, float] | None
    """The same in seconds of its own recording; None where no frame rate is known."""
    boxes: int
    """How many continue in the other file."""

    @property
    def certain(self) -> bool:
        """Whether chance is excluded."""
        return self.boxes >= CERTAIN


def faults_of_exchanged_streams(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Pairs of cameras whose files change places, beyond chance."""
    faults = []
    for one in exchanged_streams(readings):
        if one.certain:
            (first, second), (frame, other) = one.cameras, one.frames
            at = f"frame {frame}" if frame == other else f"frame {frame} of {first} and {other} of {second}"
            since = "" if one.seconds is None else f" ({one.seconds[0]:.1f} s)"
            keep = "the part before it or after it"
            if one.seconds is not None:
                keep = f"one part of both: until_s = {int(one.seconds[0])} keeps the part before it"
            faults.append(
                f"{scene.place}: cameras {first} and {second} are exchanged from {at}{since} on: {one.boxes} boxes of their "
                f"last frames continue in the other camera's file, and they do not in their own; exchange the rest of the two "
                f"files, or use {keep}"
            )
    return faults


def notices_of_exchanged_streams(readings: Sequence[CameraInput]) -> list[Finding]:
    """Pairs of cameras whose files seem to change places."""
    return [
        notice("streams_seem_exchanged", *one.cameras, frames=list(one.frames), boxes=one.boxes)
        for one in exchanged_streams(readings)
        if not one.certain
    ]


def exchanged_streams(readings: Sequence[CameraInput]) -> list[ExchangedStreams]:
    """The pairs of cameras whose files change places, each at the moment that most boxes indicate."""
    shown = {reading.name: one for reading in readings if (one := _collect_boxes(reading.seen, reading.fps)) is not None}
    cut = {name: one for name, one in shown.items() if len(one.cuts)}
    found = []
    for first, second in combinations(cut, 2):
        a, b = cut[first], cut[second]
        best = (0, 0, 0)
        for k in a.cuts.tolist():
            for j in b.cuts[np.abs(b.seconds[b.cuts] - a.seconds[k]) <= FARTHEST_S].tolist():
                best = max(best, (_count_exchanged(a, k, b, j), k, j))
        boxes, k, j = best
        if boxes >= LIKELY and boxes > _count_at_other_times(a, k, b, j):
            timed = all(reading.fps is not None for reading in readings if reading.name in (first, second))
            at = (float(a.seconds[k + 1]), float(b.seconds[j + 1]))
            frames = (int(a.frames[k + 1]), int(b.frames[j + 1]))
            found.append(ExchangedStreams((first, second), frames, at if timed else None, boxes))
    return found


def _count_at_other_times(a: _Shown, k: int, b: _Shown, j: int) -> int:
    """The most boxes that continue in the other file at any other moment, the files that far apart in time.

    People who stand still, or cameras side by side, have boxes at the same places of both images all the time.
    """
    later = b.seconds[j] - a.seconds[k]
    moments = np.unique(np.linspace(0, len(a.frames) - 2, OTHER_MOMENTS).round().astype(np.int64))
    moments = moments[np.abs(a.seconds[moments] - a.seconds[k]) > LONGEST_STEP_S]
    wanted = a.seconds[moments] + later
    near = np.clip(np.searchsorted(b.seconds, wanted), 0, len(b.frames) - 2)
    pairs = zip(moments.tolist(), near.tolist(), (np.abs(b.seconds[near] - wanted) < LONGEST_STEP_S).tolist(), strict=True)
    return max((_count_exchanged(a, moment, b, other) for moment, other, found in pairs if found), default=0)


@dataclass(frozen=True, eq=False)
class _Shown:
    """What one camera's file shows, frame by frame."""

    frames: Ints
    """(F,) those with people, ascending."""
    seconds: Floats
    """(F,) of them, of the camera's own recording."""
    begin: Ints
    """(F + 1,) where the boxes of each frame begin."""
    box: Floats
    """(N, 3) centre and height, pixels, in the order of the frames."""
    cuts: Ints
    """Indices of frames after which people do not continue."""

    def of(self, k: int) -> Floats:
        """(n, 3) the boxes of one frame, by its index."""
        return self.box[self.begin[k] : self.begin[k + 1]]


def _collect_boxes(seen: CameraObservations, fps: float | None) -> _Shown | None:
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
    before, after = rows_of_equal(number + 1, number)
    step = np.diff(seconds)
    identity = np.asarray(part.identity)[order]
    same = (identity[before] == identity[after]) | (np.minimum(identity[before], identity[after]) < 0)
    near = same & _find_continuing(box[before], box[after], step[number[before]])
    held = _count_continuing(number, before[near], after[near], len(frames))
    fewer = np.minimum(count[:-1], count[1:])
    if np.median(held / fewer) < LEAST_EXCHANGED:
        return None  # boxes seldom continue in this file, so that it means nothing where they do not
    cuts = np.flatnonzero((step <= LONGEST_STEP_S) & (fewer >= FEWEST_SEEN) & (held <= MOST_CONTINUED * fewer))
    return _Shown(frames, seconds, np.append(begin, len(box)), box, cuts)


def _count_continuing(number: Ints, before: Ints, after: Ints, frames: int) -> Ints:
    """(F - 1,) how many boxes of each frame continue in the next one, from the pairs of boxes that agree."""
    out = np.bincount(number[np.unique(before)], minlength=frames)[:-1]
    return np.minimum(out, np.bincount(number[np.unique(after)], minlength=frames)[1:])


def _find_continuing(before: Floats, after: Floats, seconds: Floats | float) -> Bools:
    """Whether boxes (..., 3) may be the same people `seconds` later."""
    height = np.minimum(before[..., 2], after[..., 2])
    apart = np.hypot(before[..., 0] - after[..., 0], before[..., 1] - after[..., 1])
    alike = np.abs(np.log(before[..., 2] / after[..., 2])) < RATIO
    return np.asarray(alike & (apart < (NEAR + NEAR_A_SECOND * seconds) * height))


def _count_exchanged(a: _Shown, k: int, b: _Shown, j: int) -> int:
    """How many boxes of both files continue in the other one after the frames with these indices; 0 where too few do."""
    total = 0
    for before, after in ((a.of(k), b.of(j + 1)), (b.of(j), a.of(k + 1))):
        step = max(float(a.seconds[k + 1] - a.seconds[k]), float(b.seconds[j + 1] - b.seconds[j]))
        near = _find_continuing(before[:, None], after[None], step)
        both = min(int(near.any(axis=1).sum()), int(near.any(axis=0).sum()))
        if both < LEAST_EXCHANGED * min(near.shape):
            return 0
        total += both
    return total
