"""Scenes in which a detector looked at some frames only: every n-th of a video, or pictures that come at uneven times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.core.observations import CameraObservations
from passerby.simulation import SimulatedScene

LONGEST_STEP = 3
"""Pictures at uneven times are 1 to so many frames of the video's clock apart, at random: 17 to 50 a second of 50."""


def sampled(simulated: SimulatedScene, every: int, *, uneven: bool, rng: np.random.Generator) -> SimulatedScene:
    """The scene with what is seen in every `every`-th picture of each camera, from the first on; clocks are known.

    Args:
        simulated: a scene in which everybody is seen in every frame.
        every: 1 keeps all pictures.
        uneven: whether the pictures come at uneven times, other ones in each camera; else every frame is a picture.
        rng: draws those times.
    """
    cameras, true = {}, {}
    for name, seen in simulated.observations.cameras.items():
        frames = simulated.frames
        if uneven:
            frames = np.cumsum(rng.integers(1, LONGEST_STEP + 1, len(frames)))
        kept = [np.isin(part.frame, frames[::every]) for part in (seen.boxes, seen.keypoints)]
        cameras[name] = CameraObservations(seen.boxes.take(kept[0]), seen.keypoints.take(kept[1]))
        true[name] = simulated.true_identities[name][kept[0]]
    return replace(simulated, observations=replace(simulated.observations, cameras=cameras), true_identities=true)
