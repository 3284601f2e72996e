"""What two cameras' tracks would score by chance: the same crowds, walked at other times.

A detector that misses half of the people leaves a right registration with a quarter of what both cameras should see, which
crowds of strangers reach by chance where they are dense. So the tracks themselves tell what chance is worth: of one camera
they are walked backwards, or half a recording late (surrogate data: Theiler et al., Physica D 1992). Places, speeds, numbers
and gaps of the tracks stay as they are; only that the same people were there at the same time is gone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Ints

CLEAR_OF_CHANCE, CLEAR_SCORE, CLEAR_SHARE = 1.8, 20.0, 0.15
"""A registration is right that scores so much better than chance, with so many samples that agree, and so much of what both
cameras should see. Over the three simulated presets, 0 to 60 % of the boxes missing and tracklets cut every 2 to 4 s, no two
cameras that see different people reach all three (616 pairs with 1 to 20 people: up to 2.6 times chance with 14 samples, 1.4
times with 29). Two that see the same score at least 2.0 times chance in 40 s, and 1.1 to 4.7 times in 20 s."""
MOST_AMBIGUOUS = 0.6
"""Of the score: a runner-up of more says enough. Strangers' runner-ups have 0.4 and more."""


def make_surrogates(tracks: GroundTracks, max_lag_s: float) -> Iterator[GroundTracks]:
    """The tracks walked backwards and, where the recording is long enough for that to be another time, half of it late."""
    first, last = int(tracks.step[0]), int(tracks.step[-1])
    yield _timed(tracks, first + last - tracks.step, tracks.tracklet, velocity=-1.0)
    count = last - first + 1
    half = count // 2
    if half * STEP_S > 2.0 * max_lag_s:
        late = tracks.step - first + half
        # A tracklet that runs over the end of the recording goes on at its beginning, as another one.
        yield _timed(tracks, first + late % count, 2 * tracks.tracklet + (late >= count), velocity=1.0)


def _timed(tracks: GroundTracks, step: Ints, tracklet: Ints, velocity: float) -> GroundTracks:
    """The tracks at other times, sorted by them; velocities are multiplied."""
    order = np.argsort(step, kind="stable")
    return replace(
        tracks,
        step=step[order],
        tracklet=tracklet[order],
        position=tracks.position[order],
        velocity=velocity * tracks.velocity[order],
    )
