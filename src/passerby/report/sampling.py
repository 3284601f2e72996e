"""The people of some instants, with identities, as all cameras saw them: few enough to be drawn, spread over the recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Observations, once_in_frame
from passerby.core.synchronisation import (
    MAX_GAP_S,
    MAX_GAP_SAMPLES,
    find_common_time_steps,
    resample_to_common_steps,
    sampling_distance,
)
from passerby.report.contents import Contents

MOST_SIGHTINGS = 30_000
"""Sightings that are fitted at most, about: half a second of work."""
ROW_OF_JOINTS = 4
"""A set of joints takes as long as so many boxes."""
STEP_S = 0.5
"""People who walk are 0.7 m farther on by then, so that lines between places still show their way."""
STRETCHES = 8
"""Where every half second is too much: so many stretches without gaps, evenly spread."""


@dataclass(frozen=True, eq=False)
class Sample:
    """What the cameras with poses saw of identified people at some instants."""

    rig: Rig
    """The cameras with poses that were watched, in the rig's order."""
    seen: Observations
    """Their boxes and joints; frames are those of `clock`."""
    clock: Clock
    timed: bool
    """Whether the frame rate is known; else a frame stands for a second."""
    step_s: float
    """Between neighbouring instants, usually."""


def clocks_of(contents: Contents) -> tuple[Mapping[str, Clock], bool]:
    """The clocks of cameras that count, and whether the frame rate is known: where it is not, a frame stands for a second.

    A camera that has no pose may have no clock either.
    """
    if contents.clocks and all(name in contents.clocks for name in keep_observing_cameras(contents).names):
        return contents.clocks, True
    fps = contents.observations.fps
    return dict.fromkeys(contents.rig.names, Clock(fps or 1.0)), fps is not None


def keep_observing_cameras(contents: Contents) -> Rig:
    """The cameras with poses that saw anything."""
    posed = contents.rig.posed()
    seen = contents.observations.cameras
    used = [c for c in posed if c.name in seen and len(seen[c.name].boxes) + len(seen[c.name].keypoints)]
    return Rig(tuple(used))


def sample_observations(contents: Contents, most: int = MOST_SIGHTINGS) -> Sample | None:
    """All instants, or of longer recordings every half second, or stretches of it; None where there is nothing to see."""
    rig = keep_observing_cameras(contents)
    if not len(rig):
        return None
    clocks, _ = clocks_of(contents)
    watched = Observations({name: contents.observations[name] for name in rig.names})
    grid = find_common_time_steps(watched, clocks).clock
    frames, weights = [], []
    for name in rig.names:
        seen = watched[name]
        for rows, each in ((seen.boxes, 1), (seen.keypoints, ROW_OF_JOINTS)):
            known = rows.identity != UNKNOWN
            frames.append(np.rint(grid.frames(clocks[name].seconds(rows.frame[known]))).astype(np.int64))
            weights.append(np.full(len(frames[-1]), float(each)))
    instants, number = np.unique(np.concatenate(frames), return_inverse=True)
    if not len(instants):
        return None
    weight = np.bincount(number.ravel(), np.concatenate(weights)).astype(np.float64)
    chosen = _thin_rows(instants, weight, grid.fps, most)
    return sample_at(contents, grid, instants[chosen])


def sample_at(contents: Contents, grid: Clock, frames: Ints) -> Sample | None:
    """The people at given frames (N,), ascending, of a clock; None without a camera that has a pose and saw anything."""
    rig = keep_observing_cameras(contents)
    if not len(rig) or not len(frames):
        return None
    clocks, timed = clocks_of(contents)
    seen = {}
    for name in rig.names:
        clock, own = clocks[name], contents.observations[name]
        # A sample between two instants is interpolated from neighbours within this reach; one frame more for rounding.
        apart = sampling_distance(np.concatenate([own.boxes.frame, own.keypoints.frame]))
        reach = (max(MAX_GAP_SAMPLES * apart, MAX_GAP_S * clock.fps) + 1) * grid.fps / clock.fps + 1
        boxes, joints = (
            _find_near_rows(rows.frame, rows.identity, clock, grid, frames, reach) for rows in (own.boxes, own.keypoints)
        )
        seen[name] = CameraObservations(_drop_embeddings(own.boxes, boxes), own.keypoints.take(joints))
    sizes = {camera.name: camera.lens.size for camera in rig}
    at_grid = resample_to_common_steps(Observations(seen), clocks, sizes=sizes, grid=grid)
    kept = {
        name: CameraObservations(
            at_grid[name].boxes.take(np.isin(at_grid[name].boxes.frame, frames)),
            at_grid[name].keypoints.take(np.isin(at_grid[name].keypoints.frame, frames)),
        )
        for name in rig.names
    }
    step = float(np.median(np.diff(frames))) / grid.fps if len(frames) > 1 else STEP_S
    return Sample(rig, Observations(kept), grid, timed, step)


def _thin_rows(frames: Ints, weight: Floats, fps: float, most: int) -> Ints:
    """Rows of ascending frames (N,) that together weigh about `most` or less."""
    rows = np.arange(len(frames))
    if weight.sum() <= most:
        return rows
    bucket = (frames - frames[0]) // max(1, round(STEP_S * fps))
    rows = np.unique(bucket, return_index=True)[1].astype(np.int64)
    total = float(weight[rows].sum())
    if total <= most:
        return rows
    parts = np.array_split(rows, min(STRETCHES, len(rows)))
    return np.concatenate([part[: max(1, int(len(part) * most / total))] for part in parts])


def _find_near_rows(frame: Ints, identity: Ints, clock: Clock, grid: Clock, wanted: Ints, reach: float) -> Ints:
    """Rows with an identity, `reach` frames of the grid or less from a wanted one; the first of each identity in a frame."""
    ends = clock.frames(grid.seconds(np.array([wanted[0] - reach, wanted[-1] + reach])))
    rows = np.flatnonzero((frame >= ends[0]) & (frame <= ends[1]) & (identity != UNKNOWN))
    at = grid.frames(clock.seconds(frame[rows]))
    after = np.searchsorted(wanted, at)
    before, after = wanted[np.maximum(after - 1, 0)], wanted[np.minimum(after, len(wanted) - 1)]
    rows = rows[np.minimum(np.abs(at - before), np.abs(at - after)) <= reach]
    return rows[once_in_frame(frame[rows], identity[rows])]


def _drop_embeddings(boxes: Boxes, rows: Ints) -> Boxes:
    """Boxes without embeddings."""
    return Boxes(boxes.frame[rows], boxes.identity[rows], boxes.ltwh[rows], boxes.score[rows])
