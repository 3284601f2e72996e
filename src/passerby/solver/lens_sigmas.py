"""What the sightings say of refined lenses, and their uncertainty with what is stated of them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.symmetric import inverse_of
from passerby.solver.optimizer.least_squares import NormalEquations, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.systematic import ConsiderParameters
from passerby.solver.uncertainty import downweight

BOXES_MISLEAD = 1.25
"""Lenses follow what boxes are off by alike more than poses do. What boxes alone say of right focal lengths and principal
points is off by 1.1 of its sigmas, root mean square over simulated scenes and rendered films, by up to 1.5 of them in one
preset: docs/results/limits.md."""

BOXES_COUNT_LESS = 2.5
"""Stated lenses count against boxes as if these misled by so many sigmas, so that right ones stay: with what boxes
do mislead by, refining right focal lengths made the rig of a simulated scene (basketball, seed 0) 3.7 times worse, with this
less than twice. Over 30 scenes whose stated focal lengths are off as stated ones are (seeds from 113600) it costs 7 % of the
accuracy."""

MOST_EXCESS = 30.0
"""What sightings are off by alike makes priors of the lenses count more by this at most."""


@dataclass(frozen=True, eq=False)
class LensEvidence:
    """What the sightings alone say of the lenses' unknowns, (C, L) each."""

    seen: Floats
    """Where they would put them."""
    sd: Floats
    """How well, with the common error of boxes."""
    prior_weight: Floats
    """How many times more the priors must count against residuals that count as independent, and do not know what they are
    off by alike."""


def lens_evidence(
    problem: PeopleProblem, state: AdjustmentState, inflation: float, of_joints: float | None, held: ConsiderParameters
) -> LensEvidence:
    """What the sightings alone say of the lenses at an optimum; the priors, as they were linearised, are taken off again.

    Args:
        problem: the person model, lenses refined.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
        of_joints: the same of joints; None where there are none.
        held: the parts of the lenses that are not refined.
    """
    assert problem.lens_core is not None
    weighted = partial(downweight, inflation=inflation, of_joints=of_joints)
    terms = replace(problem, lens_weight=np.ones(())).terms(state, jacobians=True)
    at = lens_places(problem.n_cameras, problem.layout.camera_size, problem.n_lens)
    prior = 1 / (problem.lens_core**2 + (0.0 if problem.lens_normal else state.lens**2))
    if problem.lens_far is not None:
        prior = prior + 1 / problem.lens_far**2

    def measure_information(weighed: list[Term]) -> tuple[Floats, Floats, Floats]:
        """The inverse of the normal equations; the share of what is known that sightings say, and their information."""
        inverse = inverse_of(NormalEquations(problem.layout, weighed).reduce().H)
        share = np.clip(1 - prior * np.diag(inverse)[at], 1e-3, 1.0)
        return inverse, share, share / np.diag(inverse)[at]

    inverse, share, information = measure_information([weighted(term) for term in terms])
    effect = measure_information([downweight(term, 1.0) for term in terms])[2] / information
    alike = ConsiderParameters.of_boxes(problem, state), held
    moved = np.concatenate([one.moved(inverse, problem, terms, weighted) for one in alike], axis=1)
    biased = (moved[at] ** 2).sum(axis=2)
    seen = state.lens * (1 + problem.lens_weight / effect * prior / information)
    random, total = np.sqrt(1 / information), np.sqrt(1 / information + biased / share**2)
    # Where nothing of a lens is stated, its principal point turns with the vertical, and that depends on how upright
    # people are.
    boxes = by_boxes(problem)
    counted = np.where(boxes | problem.lens_normal, BOXES_COUNT_LESS, 1.0)[:, None]
    misled = np.where(boxes & (not problem.lens_normal), BOXES_MISLEAD, 1.0)[:, None]
    excess = np.clip((counted * total / random) ** 2, 1.0, MOST_EXCESS)
    return LensEvidence(seen, misled * total, effect * excess)


def by_boxes(problem: PeopleProblem) -> NDArray[np.bool_]:
    """(C,) cameras whose sightings are boxes alone: joints fix a lens by geometry, not by how tall people seem."""
    return np.asarray(np.bincount(problem.joints.camera, minlength=problem.n_cameras) == 0)


def lens_places(n_cameras: int, camera_size: int, n_lens: int) -> NDArray[np.int64]:
    """(C, L) places of the lenses' unknowns among the shared ones."""
    return np.asarray((np.arange(n_cameras)[:, None] + 1) * camera_size - n_lens + np.arange(n_lens))


def refined_sigmas(
    seen: LensEvidence, core: Floats, lens: Floats, far: Floats | None = None, *, normal: bool = False
) -> Floats:  # fmt: skip
    """(C, L) root mean square errors of the lenses `lens`.

    Args:
        seen: what the sightings say.
        core: (C, L) scales of the Cauchy distributions of the stated lenses.
        lens: (C, L) the lenses found, as changes of the stated ones.
        far: (C, L) standard deviations that their tails fall with; None: they do not.
        normal: whether `core` has standard deviations of normal distributions.
    """
    if normal:
        return np.asarray(1 / np.sqrt(1 / seen.sd**2 + 1 / core**2))
    out, far = np.zeros_like(lens), np.full_like(lens, np.inf) if far is None else far
    for c, u in itertools.product(*map(range, lens.shape)):
        out[c, u] = posterior_sd(*(float(each[c, u]) for each in (seen.seen, seen.sd, core, lens, far)))
    return out


def posterior_sd(seen: float, seen_sd: float, core: float, at: float, far: float = np.inf) -> float:
    """Root mean square distance from `at` of a value that is seen as `seen` +- `seen_sd` and is Cauchy distributed about 0, its
    tails times those of a normal distribution of the standard deviation `far`.
    """
    fine = np.linspace(-1, 1, 2001)
    grid = np.unique(np.concatenate([seen + 6 * seen_sd * fine, 20 * core * fine]))
    density = np.exp(-0.5 * ((grid - seen) / seen_sd) ** 2 - 0.5 * (grid / far) ** 2) / (core**2 + grid**2)
    return float(np.sqrt(np.trapezoid(density * (grid - at) ** 2, grid) / np.trapezoid(density, grid)))
