"""Sample of the observations of identified people by all cameras: few enough to be drawn, spread over the recording."""

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
"""Approximate largest number of sightings that are fitted; these take half a second."""
ROW_OF_JOINTS = 4
"""Weight of a set of joints in this number: its fit takes as long as that of 4 boxes."""
STEP_S = 0.5
"""Time between instants of a thinned sample. People walk 0.7 m in it, so lines between positions still show the trajectory."""
STRETCHES = 8
"""If one instant every half second is still too many: the number of stretches without gaps, evenly spread, that are kept."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Observations of identified people at some instants by the cameras with poses."""

    rig: Rig
    """The cameras with poses that have observations, in the rig's order."""
    seen: Observations
    """Their boxes and joints; frames are those of `clock`."""
    clock: Clock
    timed: bool
    """Whether the frame rate is known; otherwise one frame counts as one second."""
    step_s: float
    """Median time between neighbouring instants, seconds."""


def clocks_of(contents: Contents) -> tuple[Mapping[str, Clock], bool]:
    """Return the clocks of the cameras, and whether the frame rate is known. If it is unknown, one frame counts as one second.

    A camera without a pose may have no clock.
    """
    if contents.clocks and all(name in contents.clocks for name in keep_observing_cameras(contents).names):
        return contents.clocks, True
    fps = contents.observations.fps
    return dict.fromkeys(contents.rig.names, Clock(fps or 1.0)), fps is not None


def keep_observing_cameras(contents: Contents) -> Rig:
    """Return the cameras that have a pose and observations."""
    posed = contents.rig.posed()
    seen = contents.observations.cameras
    used = [c for c in posed if c.name in seen and len(seen[c.name].boxes) + len(seen[c.name].keypoints)]
    return Rig(tuple(used))


def sample_observations(contents: Contents, most: int = MOST_SIGHTINGS) -> Sample | None:
    """Return a sample of the observations of identified people; None if no camera with a pose has any.

    If all instants are too many, the sample has one every half second; if these are too many, it has stretches of them.
    """
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
    """Return the sample at given frames (N,) of a clock, ascending; None if no camera has a pose and observations."""
    rig = keep_observing_cameras(contents)
    if not len(rig) or not len(frames):
        return None
    clocks, timed = clocks_of(contents)
    seen = {}
    for name in rig.names:
        clock, own = clocks[name], contents.observations[name]
        # Observations at an instant are interpolated from neighbours within this distance; one frame is added for rounding.
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
    """Return rows of ascending frames (N,) whose weights have a sum of about `most` or less."""
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
    """Find the rows with an identity within `reach` grid frames of a wanted frame, the first of each identity in a frame."""
    ends = clock.frames(grid.seconds(np.array([wanted[0] - reach, wanted[-1] + reach])))
    rows = np.flatnonzero((frame >= ends[0]) & (frame <= ends[1]) & (identity != UNKNOWN))
    at = grid.frames(clock.seconds(frame[rows]))
    after = np.searchsorted(wanted, at)
    before, after = wanted[np.maximum(after - 1, 0)], wanted[np.minimum(after, len(wanted) - 1)]
    rows = rows[np.minimum(np.abs(at - before), np.abs(at - after)) <= reach]
    return rows[once_in_frame(frame[rows], identity[rows])]


def _drop_embeddings(boxes: Boxes, rows: Ints) -> Boxes:
    """Return the given rows of the boxes without embeddings."""
    return Boxes(boxes.frame[rows], boxes.identity[rows], boxes.ltwh[rows], boxes.score[rows])
