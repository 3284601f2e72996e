"""Score of two cameras' tracks by chance, measured with the same tracks at other times.

Where a detector misses half of the people, a right registration has a quarter of the people that both cameras should see. Dense
crowds of different people reach this share by chance. So chance is measured with the tracks themselves: those of one camera are
reversed in time, or delayed by half a recording (surrogate data: Theiler et al., Physica D 1992). Positions, speeds, numbers
and gaps of the tracks stay the same; only the same people are no longer there at the same time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Ints

CLEAR_OF_CHANCE, CLEAR_SCORE, CLEAR_SHARE = 1.8, 20.0, 0.15
"""A registration is right if it exceeds three limits: the ratio of its score to chance, its score in samples that agree, and
the share of the people that both cameras should see. Over the three simulated presets, with 0 to 60 % of the boxes missing and
tracklets cut every 2 to 4 s, no two cameras that see different people exceed all three (616 pairs with 1 to 20 people: up to
2.6 times chance with 14 samples, 1.4 times with 29). Two cameras that see the same people score at least 2.0 times chance in
40 s, and 1.1 to 4.7 times in 20 s."""
MOST_AMBIGUOUS = 0.6
"""Share of the score. With a runner-up above it, chance is not measured: the guess is ambiguous. Runners-up of cameras that see
different people have 0.4 and more."""


def make_surrogates(tracks: GroundTracks, max_lag_s: float) -> Iterator[GroundTracks]:
    """Yield the tracks reversed in time and, if half the recording exceeds twice `max_lag_s`, delayed by this half."""
    first, last = int(tracks.step[0]), int(tracks.step[-1])
    yield _timed(tracks, first + last - tracks.step, tracks.tracklet, velocity=-1.0)
    count = last - first + 1
    half = count // 2
    if half * STEP_S > 2.0 * max_lag_s:
        late = tracks.step - first + half
        # A tracklet that passes the end of the recording continues at its beginning, with another number.
        yield _timed(tracks, first + late % count, 2 * tracks.tracklet + (late >= count), velocity=1.0)


def _timed(tracks: GroundTracks, step: Ints, tracklet: Ints, velocity: float) -> GroundTracks:
    """Return the tracks at other times, sorted by time, with velocities multiplied by a factor."""
    order = np.argsort(step, kind="stable")
    return replace(
        tracks,
        step=step[order],
        tracklet=tracklet[order],
        position=tracks.position[order],
        velocity=velocity * tracks.velocity[order],
    )
