"""Do all of a camera's sightings tell the same, at all times? What agrees with the rig, by camera and stretch of the recording.

A rig that is wrong still finds sightings that agree with it by chance, and those that do not are set aside as mistaken. How
many are, and when, says what residuals cannot: a camera that moved half-way agrees before or after, and one whose identities
are another's agrees now and then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.solver.evidence import Evidence
from passerby.solver.refinement import AdjustmentProblem

STRETCHES = 8
"""Parts of a recording that are looked at one by one; each holds as many person-instants."""
MIN_IN_STRETCH = 15
"""Fewer sightings of a camera in a stretch say nothing."""
LEAST_AGREEING = 0.71
"""Of a right rig 97 to 100 % of each camera's sightings agree in ordinary scenes; 85 % where 30 % of the identities are wrong,
82 % in MultiviewX' nearest camera and with a false box under the name of nearly every person who is out of view, 73 % in a
scene of five people with 150 boxes a camera. Of rigs that are off by more than 0.5 m or 3 degrees 24 to 73 % do, in the camera
that is off, or more than `MOST_CHANGE` speaks. What other limits would do: docs/results/limits.md."""
MOST_CHANGE = 0.42
"""Between the stretch where most agrees and that where least does, it is at most 0.10 in ordinary scenes, 0.13 in the real
sets, 0.19 with false boxes under people's names; 0.48 to 1.0 where a camera moved, frames were lost, or a clock ran 4 % too
fast (1 % over a minute: 0.38, and a rig right to 33 mm)."""


@dataclass(frozen=True, eq=False)
class JointConsistency:
    """How much of what each of C cameras saw agrees with the rig."""

    seen: Ints
    """(C,) sightings of people and of joints that the others could confirm,"""
    agreeing: Ints
    """(C,) and those of them that agree."""
    by_time: Floats
    """(C, `STRETCHES`) share of the sightings of people that agree; NaN where there are too few."""

    def odd_stretch(self, camera: int) -> tuple[int, float, float] | None:
        """The stretch in which least of a camera agrees, its share and the largest one; None where they are much alike."""
        share = self.by_time[camera]
        if np.isfinite(share).sum() < 2 or np.nanmax(share) - np.nanmin(share) <= MOST_CHANGE:
            return None
        return int(np.nanargmin(share)), float(np.nanmin(share)), float(np.nanmax(share))

    def disagrees(self, camera: int) -> bool:
        """Whether so little of a camera agrees that it may be by chance."""
        return bool(self.agreeing[camera] < LEAST_AGREEING * self.seen[camera])


def joint_consistency(evidence: Evidence, model: AdjustmentProblem) -> JointConsistency:
    """What of the evidence is in the model of the last round."""
    n, s = evidence.n_cameras, evidence.sightings
    seen = np.bincount(s.camera, minlength=n) + np.bincount(evidence.joints.camera, minlength=n)
    agreeing = np.bincount(model.problem.sightings.camera, minlength=n) + np.bincount(model.problem.joints.camera, minlength=n)
    by_time = np.full((n, STRETCHES), np.nan)
    if len(s):
        agrees = np.zeros(len(s), dtype=bool)
        agrees[model.rows] = True
        edges = np.quantile(evidence.frame, np.linspace(0, 1, STRETCHES + 1))
        stretch = np.clip(np.searchsorted(edges, evidence.frame[s.block], side="right") - 1, 0, STRETCHES - 1)
        cell = s.camera * STRETCHES + stretch
        count = np.bincount(cell, minlength=n * STRETCHES)
        share = np.bincount(cell, agrees, minlength=n * STRETCHES) / np.maximum(count, 1)
        by_time = np.where(count >= MIN_IN_STRETCH, share, np.nan).reshape(n, STRETCHES)
    return JointConsistency(seen, agreeing, by_time)
