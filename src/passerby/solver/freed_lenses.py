"""A part of the lenses freed, all else of them held: where people put it, how surely, and how much better they fit then.

A wrong lens hides well while it is held: poses, slack and learnt noise take it up, so that neither the step of a linear model
nor its sigma is what it seems. Here the adjustment goes on with that part free, its noise learnt anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.people.model import Noise
from passerby.solver.initialisation import Fit, Initialisation
from passerby.solver.lens_sigmas import lens_evidence
from passerby.solver.lens_unknowns import HELD, LensPart, LensUnknowns
from passerby.solver.optimizer.least_squares import Stopping
from passerby.solver.refinement import (
    AGREE_SIGMAS,
    AdjustmentProblem,
    build_problem,
    learn_noise,
    minimise_problem,
    occlusion_weights,
    rig_of,
)
from passerby.solver.uncertainty import design_effect

# What a freed part may be off by, one standard deviation of a normal distribution: the logarithm of a focal length, and the
# principal point as a share of the picture's width.
FREED_FOCAL, FREED_POINT = 0.7, 0.25
# Evidence of a refit, person-instants and joints, spread evenly over all: a lens that is worth naming shows in so many.
PEOPLE, JOINTS = 1500, 6000
# Rounds of agreement, descent and learnt noise; the rays follow the lens in each.
ROUNDS = 4
_STOPPING = Stopping(12, 1e-4)


@dataclass(frozen=True, eq=False)
class FreedLens:
    """An optimum with a part of some lenses free."""

    part: LensPart
    cameras: tuple[int, ...]
    """Whose part is free; nobody's in the optimum that others are compared with."""
    change: Floats
    """(C, L) of the unknowns: the logarithm of the focal length, or the principal point in pixels."""
    sigma: Floats
    """(C, L) one sigma, with what boxes mislead by."""
    agreeing: int
    """Observations that agree."""
    noise: Noise
    """What they are off by."""
    inflation: float
    typical_px: float = 0.0
    joints: int = 0


def refit_freed(start: Initialisation, fit: Fit, part: LensPart, cameras: Sequence[int]) -> FreedLens:
    """Go on from an optimum that holds all lenses, with a part of some free.

    Args:
        start: what the optimum was computed from, no lens refined.
        fit: the optimum.
        part: "focal" or "principal_point".
        cameras: indices of the cameras whose part is free.
    """
    unknowns = LensUnknowns((part,))
    nothing = np.zeros((len(start.rig), unknowns.size))
    knowledge = replace(start.knowledge, lens_core=_freedom(start, unknowns, cameras), lens_normal=True)
    here = replace(start, unknowns=unknowns, stated=start.rig, lens=nothing, knowledge=knowledge).with_lenses(nothing)
    evidence = here.evidence
    blocks, joints = _spread(len(evidence.person), PEOPLE), _spread(evidence.n_joints, JOINTS)
    state, noise, whole = replace(rig_of(fit.result.state), lens=nothing), fit.noise, None
    for _ in range(ROUNDS):
        model = build_problem(
            here.evidence, state, noise, here.knowledge, share=_tolerance(here, noise), blocks=blocks, joints=joints,
            stance=fit.stance, whole=whole, rename=True,
        )  # fmt: skip
        result = minimise_problem(model, _STOPPING)
        state = rig_of(result.state)
        here = here.with_lenses(state.lens)
        judged = occlusion_weights(model, result.state, len(evidence.sightings))
        whole, noise = judged.weight, learn_noise(model, result, judged.broken)
    inflation = design_effect(model, here.evidence, model.problem.terms(result.state, jacobians=True))
    sigma = lens_evidence(model.problem, result.state, inflation).sd
    typ = float(np.hypot(noise.box_px, noise.centre * np.median(model.problem.scale_px))) if len(model.rows) else 0.0
    return FreedLens(part, tuple(cameras), state.lens, sigma, len(model.rows), noise, inflation, typ, len(model.joint_rows))


def _freedom(start: Initialisation, unknowns: LensUnknowns, cameras: Sequence[int]) -> Floats:
    """(C, L) standard deviations of the unknowns: wide for some cameras."""
    width = np.array([camera.lens.size[0] for camera in start.rig], dtype=np.float64)[:, None]
    scale, wide = (np.ones_like(width), FREED_FOCAL) if "focal" in unknowns.parts else (width, FREED_POINT)
    free = np.isin(np.arange(len(width)), list(cameras))[:, None]
    return np.asarray(np.broadcast_to(np.where(free, wide, HELD) * scale, (len(width), unknowns.size)))


def _tolerance(start: Initialisation, noise: Noise) -> float:
    """Within which share of its extent an observation agrees."""
    boxes, joints = len(start.evidence.sightings) > 0, start.evidence.n_joints > 0
    return AGREE_SIGMAS * max(noise.centre if boxes else 0.0, noise.joint if joints else 0.0)


def _spread(count: int, most: int) -> Ints:
    """Indices below `count`, at most so many, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.zeros(0, np.int64)
