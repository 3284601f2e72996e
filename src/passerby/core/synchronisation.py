"""Interpolation of cameras with clocks of their own to common time steps: each person between neighbouring samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import (
    Boxes,
    CameraObservations,
    Clock,
    Keypoints,
    Observations,
    sampling_step,
)

USUAL_FPS = 5.0
"""Time steps per second where no frame rate is stated."""
MAX_GAP_SAMPLES, MAX_GAP_S = 2, 0.4
"""Longest gap over which a person is interpolated, in samples and in seconds, whichever is longer. In 0.4 s a walker deviates
some centimetres from a straight line (half of 1 m/s^2 times 0.2 s squared is 2 cm). For a slow camera one missed sample is the
shortest possible gap."""
ALIKE = 0.02
"""Sampling rates that differ by less than this share count as equal: 30 and 29.97 frames per second, or every sixth picture of
30 and every fifth of a phone's 25.2."""
MOST_BEND = 0.05
"""Largest difference of cubic and straight interpolation, as a share of a wand's length in the image: that of a turn of 0.63
radians from one sample to the next, for which the error of cubic interpolation is 0.4 % of the length."""
_ON_THE_INSTANT = 1e-6
"""A sample nearer than this to an instant, in steps of the grid, counts as on it: the difference is a rounding error."""


@dataclass(frozen=True, eq=False)
class _Samples:
    """Rows of which K samples at common instants are made: `(1 - share) * before + share * after`."""

    instant: Ints
    before: Ints
    after: Ints
    share: Floats


EVEN = 0.5
"""Samples are even where at least this share of their steps has the length of the shortest usual one. Otherwise they come at
irregular times, as a phone's pictures do."""
ON_STEPS, TOGETHER = 0.99, 0.9
"""Time steps are those of even samples where at least the first share of the samples of all cameras lies on them. Otherwise all
frames are time steps, if at least the second share of the samples near one of the reference camera has the same time as it:
then people were marked in the same frames of all cameras, at any intervals."""
LONG_STEP, NO_GAP = 90.0, 2.0
"""The distance between uneven samples is taken to be this percentile of their steps, so that there is a sample for nearly every
time step: a person without a sample at a time step counts as not seen. Steps longer than `NO_GAP` times the median are gaps
without people."""


@dataclass(frozen=True)
class TimeSteps:
    """The common time steps: every `every`-th frame of a clock, including frame `first`."""

    reference: Clock
    every: int = 1
    first: int = 1

    @property
    def clock(self) -> Clock:
        """The clock that counts the time steps: step 1 is frame `first`."""
        if self.every == 1:
            return self.reference
        return Clock(self.reference.fps / self.every, float(self.reference.seconds(np.array(self.first))))

    def frames(self, step: Ints) -> Ints:
        """Return the frames (N,) of the reference clock at time steps (N,)."""
        return self.first + (step - 1) * self.every


def sampling_distance(frame: Ints) -> int:
    """Return the number of frames between neighbouring samples where none is missing; for uneven ones the longer steps.

    Args:
        frame: (N,) frames with people in them, in any order; a frame may occur several times.
    """
    least = sampling_step(frame)
    steps = np.diff(np.unique(frame))
    if len(steps) == 0 or np.mean(steps == least) >= EVEN:
        return least
    return int(np.percentile(steps[steps <= NO_GAP * np.median(steps)], LONG_STEP, method="higher"))


def clocks_of(observations: Observations, names: Sequence[str]) -> dict[str, Clock]:
    """Return the clock of each named camera. Without clocks in the observations, all have one that starts at the same frame."""
    one = Clock(observations.fps or 1.0)
    return {name: observations.clocks.get(name, one) for name in names}


def find_common_time_steps(observations: Observations, clocks: Mapping[str, Clock]) -> TimeSteps:
    """Choose the time steps: the samples of the camera with most people among those of the usual sampling rate.

    Cameras are sampled at every frame, or at every n-th. Between its samples a camera sees no person, so samples of other
    cameras there would have no counterpart. The usual rate is the one that most cameras have (the slower one of equals). The
    slowest rate of all would discard what the other cameras share. The fastest would turn each sample of the others into
    several without new information. The chosen camera's own samples, and all that are whole samples apart from it, need no
    interpolation. Samples at the same times in all cameras need none either, even if uneven: then every frame is a time step.

    Args:
        observations: frame numbers are each camera's own.
        clocks: the clock of every camera.

    Raises:
        InputError: a camera has no clock, or a frame rate that is not above 0.
    """
    seen, frames = {}, {}
    for name, camera in observations.cameras.items():
        if name not in clocks:
            raise InputError(f"camera {name} has no clock: give its frame rate and its offset")
        clock = clocks[name]
        if not (np.isfinite(clock.fps) and clock.fps > 0 and np.isfinite(clock.offset_s)):
            raise InputError(
                f"camera {name} has the clock fps = {clock.fps}, offset = {clock.offset_s} s: fps above 0 is needed"
            )
        seen[name] = len(camera.boxes) + len(camera.keypoints)
        frames[name] = np.concatenate([camera.boxes.frame, camera.keypoints.frame])
    if not seen:
        raise InputError("there is no camera to synchronise")
    used = [name for name in seen if seen[name]] or list(seen)
    every = {name: sampling_distance(frames[name]) for name in used}
    rates = {name: clocks[name].fps / every[name] for name in used}
    alike = {fps: sum(abs(other - fps) < ALIKE * fps for other in rates.values()) for fps in rates.values()}
    usual = min(alike, key=lambda fps: (-alike[fps], fps))
    busiest = max((name for name in used if abs(rates[name] - usual) < ALIKE * usual), key=lambda name: seen[name])
    steps = TimeSteps(clocks[busiest], every[busiest], _find_common_phase(frames[busiest], every[busiest]))
    if steps.every > 1:
        at = {name: _convert_to_grid(np.unique(frames[name]), clocks[name], steps.reference) for name in used}
        on_steps = np.concatenate([(one - steps.first) % steps.every == 0 for one in at.values()])
        if np.mean(on_steps) < ON_STEPS and _are_sampled_together(at, busiest, steps.every):
            return TimeSteps(steps.reference)
    return steps


def _are_sampled_together(at: Mapping[str, Floats], reference: str, every: int) -> bool:
    """Check whether the cameras' samples, frames of the reference camera's clock, are at the same times as its own.

    Only samples within half a step of one of the reference camera count: elsewhere that camera saw no person, and the times
    cannot be compared.
    """
    own = at[reference]
    together = apart = 0
    for name, other in at.items():
        if name == reference:
            continue
        after = np.clip(np.searchsorted(own, other), 1, max(len(own) - 1, 1))
        distance = np.minimum(np.abs(other - own[after - 1]), np.abs(other - own[np.minimum(after, len(own) - 1)]))
        together += int(np.count_nonzero(distance == 0))
        apart += int(np.count_nonzero((distance > 0) & (distance <= every / 2)))
    return together > 0 and together >= TOGETHER * (together + apart)


def _find_common_phase(frame: Ints, step: int) -> int:
    """Return the first frame from 1 on that is whole steps from most of the frames (N,)."""
    return int(np.argmax(np.bincount((frame - 1) % step, minlength=1))) + 1


def resample_to_common_steps(
    observations: Observations,
    clocks: Mapping[str, Clock],
    *,
    sizes: Mapping[str, tuple[int, int]] | None = None,
    max_gap_samples: float = MAX_GAP_SAMPLES,
    max_gap_s: float = MAX_GAP_S,
    grid: Clock | None = None,
) -> Observations:
    """Convert observations to frame numbers that are the same instants in all cameras.

    A camera whose frames fall on the instants keeps its rows bit for bit, with new frame numbers. In other cameras each person
    is interpolated linearly between two neighbouring samples of the same identity. Only the instants nearest to one of these
    samples are filled, so that no sample counts twice, even of a slow camera. Rows of unknown identity cannot be interpolated
    and are left out there.

    Args:
        observations: people with identities that hold over time, at most one box and one set of joints for each identity in
            a camera's frame; frame numbers are each camera's own.
        clocks: the clock of every camera.
        sizes: width and height of the pictures, pixels. Where given, a box that the picture's border cuts off is not
            interpolated with another: the boxes between them would be cut off without touching the border.
        max_gap_samples: the largest distance of the two neighbours in samples of the camera,
        max_gap_s: and in seconds; the longer one counts.
        grid: the clock whose frames are the common time steps. None: that of `find_common_time_steps`.

    Returns:
        Boxes and joints at instants that are counted like the frames of that clock, which is every camera's clock in the
        result. The score of a joint is the lower one of the two, 0 where either was not found. Embeddings are those of the
        nearer sample.

    Raises:
        InputError: a camera without a clock, or a person who is twice in one frame of a camera.
    """
    grid = grid or find_common_time_steps(observations, clocks).clock
    cameras = {}
    for name, seen in observations.cameras.items():
        for kind, rows in (("boxes", seen.boxes), ("sets of keypoints", seen.keypoints)):
            _refuse_doubles(name, kind, rows.frame, rows.identity)
        clock = clocks[name]
        step = sampling_distance(np.concatenate([seen.boxes.frame, seen.keypoints.frame]))
        gap = max(max_gap_samples * step, max_gap_s * clock.fps) + _ON_THE_INSTANT
        size = None if sizes is None else sizes.get(name)
        cameras[name] = CameraObservations(
            _boxes_at(seen.boxes, clock, grid, gap, size), _keypoints_at(seen.keypoints, clock, grid, gap),
            _wands_at(seen.wands, clock, grid, gap),
        )  # fmt: skip
    return Observations(cameras, grid.fps, dict.fromkeys(cameras, grid))


def _refuse_doubles(camera: str, kind: str, frame: Ints, identity: Ints) -> None:
    known = identity >= 0
    frame, identity = frame[known], identity[known]
    order = np.lexsort((frame, identity))
    frame, identity = frame[order], identity[order]
    double = np.flatnonzero((np.diff(frame) == 0) & (np.diff(identity) == 0))
    if len(double):
        raise InputError(
            f"camera {camera}: identity {identity[double[0]]} has two {kind} in frame {frame[double[0]]}: "
            "a person occurs once in an image; keep one of them"
        )


def _convert_to_grid(frame: Ints, clock: Clock, grid: Clock) -> Floats:
    """Convert frames (N,) to fractional frames of the grid."""
    shift = (clock.offset_s - grid.offset_s) * grid.fps
    # Equal frame rates leave frame numbers whole; in a long recording the conversion to seconds and back would lose digits.
    at = frame + shift if clock.fps == grid.fps else 1.0 + (frame - 1.0) * (grid.fps / clock.fps) + shift
    near = np.round(at)
    return np.where(np.abs(at - near) < _ON_THE_INSTANT, near, at)


def _are_on_grid(at: Floats) -> bool:
    """Check whether all samples lie on time steps, so that none has to be interpolated."""
    return bool((at == np.round(at)).all())


def _samples(frame: Ints, identity: Ints, at: Floats, gap: float, apart: Bools | None) -> _Samples:
    """Choose the pairs of rows to interpolate, and their weights.

    Args:
        frame: (N,) the camera's frames.
        identity: (N,) identities or -1.
        at: (N,) the frames on the grid.
        gap: largest number of frames between neighbours.
        apart: (N,) whether a row must not be interpolated with another; None: no row.
    """
    rows = np.flatnonzero(identity >= 0)
    rows = rows[np.lexsort((frame[rows], identity[rows]))]
    before, after = rows, np.append(rows[1:], rows[-1:])
    joined = (identity[before] == identity[after]) & (frame[after] > frame[before]) & (frame[after] - frame[before] <= gap)
    if apart is not None:
        joined &= ~apart[before] & ~apart[after]
    # Row i covers the instants from its own time to before the next row's; without a joined next row, only its own time.
    first = np.ceil(at[before]).astype(np.int64)
    last = np.where(joined, np.ceil(at[after]).astype(np.int64) - 1, np.floor(at[before]).astype(np.int64))
    # Of the instants between two samples only the nearest to either is filled.
    nearest = np.floor(at + 0.5).astype(np.int64)
    low, high = np.minimum(last, nearest[before]), nearest[after]
    from_before = np.flatnonzero(first <= low)
    from_after = np.flatnonzero(joined & (high <= last) & (high > np.maximum(low, first - 1)))
    pair = np.concatenate([from_before, from_after])
    instant = np.concatenate([low[from_before], high[from_after]])
    before, after = before[pair], np.where(joined[pair], after[pair], before[pair])
    step = at[after] - at[before]
    share = np.divide(instant - at[before], step, out=np.zeros(len(pair)), where=step > 0)
    order = np.lexsort((identity[before], instant))
    return _Samples(instant[order], before[order], after[order], share[order])


def _boxes_at(boxes: Boxes, clock: Clock, grid: Clock, gap: float, size: tuple[int, int] | None) -> Boxes:
    at = _convert_to_grid(boxes.frame, clock, grid)
    if _are_on_grid(at):
        return Boxes(at.astype(np.int64), boxes.identity, boxes.ltwh, boxes.score, boxes.embedding)
    cut = None if size is None else ~boxes.inside(size)
    s = _samples(boxes.frame, boxes.identity, at, gap, cut)
    nearer = np.where(s.share < 0.5, s.before, s.after)
    embedding = None if boxes.embedding is None else boxes.embedding[nearer]
    return Boxes(s.instant, boxes.identity[s.before], _interpolate(boxes.ltwh, s), _take_lower_score(boxes.score, s), embedding)


def _keypoints_at(keypoints: Keypoints, clock: Clock, grid: Clock, gap: float) -> Keypoints:
    at = _convert_to_grid(keypoints.frame, clock, grid)
    if _are_on_grid(at):
        return Keypoints(at.astype(np.int64), keypoints.identity, keypoints.xy, keypoints.score, keypoints.joints)
    s = _samples(keypoints.frame, keypoints.identity, at, gap, None)
    return Keypoints(
        s.instant,
        keypoints.identity[s.before],
        _interpolate(keypoints.xy, s),
        _take_lower_score(keypoints.score, s),
        keypoints.joints,
    )


def _wands_at(wands: Keypoints, clock: Clock, grid: Clock, gap: float) -> Keypoints:
    """Interpolate wands at common time steps: cubic between four evenly spaced samples, as a line shortens turning wands.

    Where these samples are missing, or the wand turns too far from one sample to the next, the result has no wand.
    """
    at = _convert_to_grid(wands.frame, clock, grid)
    if _are_on_grid(at):
        return Keypoints(at.astype(np.int64), wands.identity, wands.xy, wands.score, wands.joints)
    s = _samples(wands.frame, wands.identity, at, gap, None)
    order = np.lexsort((wands.frame, wands.identity))
    place = np.argsort(order)
    first, last = (order[np.clip(place[row] + by, 0, len(order) - 1)] for row, by in ((s.before, -1), (s.after, 1)))
    nodes = np.stack([first, s.before, s.after, last])
    even = (np.ptp(np.diff(wands.frame[nodes], axis=0), axis=0) == 0) & (np.ptp(wands.identity[nodes], axis=0) == 0)
    x = s.share
    # Lagrange's polynomial through samples at -1, 0, 1 and 2.
    weights = [
        -x * (x - 1) * (x - 2) / 6,
        (x + 1) * (x - 1) * (x - 2) / 2,
        -(x + 1) * x * (x - 2) / 2,
        (x + 1) * x * (x - 1) / 6,
    ]
    cubic, straight = np.einsum("kn,knij->nij", weights, wands.xy[nodes]), _interpolate(wands.xy, s)
    line, bend = np.diff(cubic, axis=1)[:, 0], np.diff(cubic - straight, axis=1)[:, 0]
    slow = np.linalg.norm(bend, axis=1) < MOST_BEND * np.linalg.norm(line, axis=1)
    on_time = x < _ON_THE_INSTANT
    kept = np.flatnonzero(on_time | (even & slow))
    xy = np.where(on_time[:, None, None], wands.xy[s.before], cubic)
    return Keypoints(
        s.instant[kept], wands.identity[s.before][kept], xy[kept], _take_lower_score(wands.score, s)[kept], wands.joints
    )


def _interpolate(values: Floats, s: _Samples) -> Floats:
    share = s.share.reshape(-1, *[1] * (values.ndim - 1))
    # Not before + share * (after - before): a share of 0 must return the sample to the last bit.
    return np.asarray((1.0 - share) * values[s.before] + share * values[s.after])


def _take_lower_score(score: Floats, s: _Samples) -> Floats:
    """Return the lower score of the two samples; for a sample on an instant its own."""
    after = np.where(s.share > 0, s.after, s.before)
    return np.asarray(np.minimum(score[s.before], score[after]))
