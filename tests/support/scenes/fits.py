"""Descents of the person-model solver, step by step."""

from __future__ import annotations

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.solver.initialisation import Initialisation, select_initial_rig
from passerby.solver.people import PeopleOptions
from passerby.solver.refinement import Fit, refine_rig
from support.scenes.people_and_rigs import without_poses


def started(
    rig: Rig, seen: Observations, options: PeopleOptions, cues: ScaleCues | None = None, rng: np.random.Generator | None = None
) -> Initialisation:
    """What the solver knows before it has any pose."""
    return Initialisation.prepare(without_poses(rig), seen, cues or ScaleCues(), options, rng or np.random.default_rng(0))


def fitted(rig: Rig, seen: Observations, options: PeopleOptions, cues: ScaleCues | None = None) -> Fit:
    """The optimum."""
    rng = np.random.default_rng(0)
    start = started(rig, seen, options, cues, rng)
    return refine_rig(start, select_initial_rig(start, options, rng).state, options, rng)
