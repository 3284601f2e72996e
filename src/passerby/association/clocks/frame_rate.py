"""The frame rate of recordings that state none, from the distances that people walk between frames.

Only the tracking and the sampling of tracks depend on it, and a factor of two is accurate enough for these. No metric result
depends on it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from passerby.association.camera_tracklets import CameraTracklets, build_camera_tracklets
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Clock, Observations

WALKERS, WALKING_PACE = 70.0, 1.2
"""Percentile of people's speeds, and its usual value, metres per second: half of the people or more walk or stroll, the rest
stand. Where most people work in one place the value is 0.8, where many run 2.2."""
FAR_ENOUGH_M = 1.0
"""Displacement that is larger than the noise of ground positions."""
NEAR_HEIGHTS = 10.0
"""Largest distance of people, in camera heights: farther away, ground positions are too noisy."""
SLOWEST, FASTEST = 0.5, 60.0
"""Limits of the estimate, frames per second."""
TRIALS = 2.0, 10.0
"""Frames per second at which detections are tracked for a first estimate."""
_MIN_PAIRS = 30
UNKNOWN_RATE = 10.0
"""Frames per second that are assumed where people do not walk."""


def estimate_frame_rate(rig: Rig, observations: Observations, person_height_m: float, rng: np.random.Generator) -> float:
    """Estimate the frames per second from the pace of the people of all cameras.

    Detections are tracked at several rates. The estimate is taken that differs least from the rate of its tracking.

    Args:
        rig: names and lenses.
        observations: frame numbers are counted alike in all cameras.
        person_height_m: expected standing height, metres.
        rng: draws the people that levels are fitted to.
    """
    best, miss = UNKNOWN_RATE, np.inf
    for chosen in (*TRIALS, None):
        trial = best if chosen is None else chosen
        found = rate_of_walkers(
            [build_camera_tracklets(camera, observations[camera.name], Clock(trial), person_height_m, rng) for camera in rig]
        )
        if found is not None and abs(np.log(found / trial)) < miss:
            best, miss = found, abs(np.log(found / trial))
    return best


def rate_of_walkers(cameras: Sequence[CameraTracklets]) -> float | None:
    """Compute the frames per second from the people's pace; return None where too few people walk.

    The number of frames between two positions is increased until the displacements are large enough for a walk.

    Args:
        cameras: tracked and levelled at some rate; frame numbers are counted alike in all.
    """
    walks = [_walks(camera) for camera in cameras]
    longest = max((int(frame.max() - frame.min()) for _, frame, _ in walks if len(frame)), default=0)
    apart, rate = 1, None
    while apart <= longest:
        moved = np.concatenate([_moved(walk, apart) for walk in walks])
        if len(moved) < _MIN_PAIRS:
            break
        typical = float(np.percentile(moved, WALKERS))
        if typical >= FAR_ENOUGH_M:
            rate = WALKING_PACE * apart / typical
            break
        apart = max(apart + 1, round(1.25 * apart))
    return None if rate is None else float(np.clip(rate, SLOWEST, FASTEST))


def _walks(camera: CameraTracklets) -> tuple[Ints, Ints, NDArray[np.complex128]]:
    """Return (N,) tracklets, frames and positions on the camera's own ground, metres; tracklet after tracklet."""
    if camera.level is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.complex128)
    ground = camera.level.ground_positions(camera.bodies.bottom)
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(ground, axis=1) < NEAR_HEIGHTS * camera.level.height
    use = np.flatnonzero(near & (camera.bodies.identity >= 0))
    use = use[np.lexsort((camera.bodies.step[use], camera.bodies.identity[use]))]
    return camera.bodies.identity[use], camera.bodies.step[use], ground[use, 0] + 1j * ground[use, 1]


def _moved(walk: tuple[Ints, Ints, NDArray[np.complex128]], apart: int) -> Floats:
    """Return people's displacements over `apart` frames, metres, for each sighting with another one `apart` frames later."""
    tracklet, frame, place = walk
    if not len(frame):
        return np.zeros(0)
    stride = int(frame.max() - frame.min()) + apart + 1
    key = tracklet * stride + (frame - frame.min())
    later = np.minimum(np.searchsorted(key, key + apart), len(key) - 1)
    there = key[later] == key + apart
    return np.asarray(np.abs(place[later[there]] - place[there]))
