"""When a camera moved: the moment that parts the footage best into still and moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.monitoring.evidence import Baseline
from passerby.people.held_cameras import GroundPlane, fit_people
from passerby.people.resection import centre_first, weak_prior
from passerby.people.scores import cluster_scores
from passerby.people.sightings import Sightings, poses_of

GRID_S = 1.0
INFLATION = 6.0
"""Scores of neighbouring seconds are alike: a gain in likelihood counts for so much less than it says."""
WORSE = 4.0
"""Twice the loss in likelihood up to which a moment may be the right one: about 95 % of the cases."""


@dataclass(frozen=True)
class ChangePoint:
    """A time, and what it lies between."""

    seconds: float
    from_s: float
    until_s: float


def estimate_change_point(
    rig: Rig, seen: Sightings, camera: str, baseline: Baseline, ground: GroundPlane
) -> ChangePoint | None:
    """When a camera moved that moved once in the footage; None where nobody was seen by two cameras, so that nothing tells.

    Of each moment: how much better one new pose from then on explains what was seen than the old one (a likelihood ratio, the
    other cameras held where the baseline has them).
    """
    index = seen.names.index(camera)
    own = slice(6 * index, 6 * index + 6)
    rotation, centre = poses_of(rig, seen.names)
    if not (np.bincount(seen.block, minlength=seen.n_blocks) > 1).any():
        return None
    scores = cluster_scores(seen, fit_people(seen, rotation, centre, ground=ground), GRID_S)
    pull, information = scores.at(baseline.estimate()[0])[:, own], scores.information[:, own, own]
    times, first = np.unique(scores.start_s, return_index=True)
    # From each time to the end.
    late_pull = np.cumsum(np.add.reduceat(pull, first, axis=0)[::-1], axis=0)[::-1]
    late = np.cumsum(np.add.reduceat(information, first, axis=0)[::-1], axis=0)[::-1] + centre_first(weak_prior())
    gain: Floats = (late_pull * np.linalg.solve(late, late_pull[:, :, None])[:, :, 0]).sum(axis=1) / INFLATION
    best = int(np.argmax(gain))
    likely = np.flatnonzero(gain >= gain[best] - WORSE)
    # The camera was still where it had been at the instant before.
    return ChangePoint(
        float(times[best]), float(times[max(likely[0] - 1, 0)]), float(times[min(likely[-1] + 1, len(times) - 1)])
    )
