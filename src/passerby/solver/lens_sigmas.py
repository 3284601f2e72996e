"""Information of the sightings about refined lenses, and the lenses' uncertainty together with their priors."""

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
"""Factor on the sigmas of lenses from boxes only: common errors of boxes influence lenses more than poses. Right focal lengths
and principal points, estimated from boxes only, are wrong by 1.1 of their sigmas, root mean square over simulated scenes and
rendered films, by up to 1.5 of them in one preset: docs/results/limits.md."""

BOXES_COUNT_LESS = 2.5
"""Factor on the sigmas of lenses from boxes when priors are weighted against them, so that right stated lenses are kept. With
the actual errors of boxes as the factor, refining right focal lengths made the rig of a simulated scene (basketball, seed 0)
3.7 times worse, with this factor less than twice. Over 30 scenes whose stated focal lengths have usual errors (seeds from
113600) it costs 7 % of the accuracy."""

MOST_EXCESS = 30.0
"""Largest factor on the weight of the lens priors due to common errors of the sightings."""


@dataclass(frozen=True, eq=False)
class LensEvidence:
    """Estimate of the lenses' unknowns from the sightings alone, (C, L) each."""

    seen: Floats
    """Estimate from the sightings alone."""
    sd: Floats
    """Standard deviation of that estimate, with the common error of boxes."""
    prior_weight: Floats
    """Factor on the weight of the priors, because the residuals are weighted as independent and without common errors."""


def lens_evidence(
    problem: PeopleProblem, state: AdjustmentState, inflation: float, of_joints: float | None, held: ConsiderParameters
) -> LensEvidence:
    """Estimate the lenses from the sightings alone, at an optimum; the linearised priors are subtracted from it.

    Args:
        problem: the person model, lenses refined.
        state: its optimum.
        inflation: design effect of the sightings: factor on the covariance because they are not independent.
        of_joints: the same of joints; None without joints.
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
        """Return the inverse of the normal equations, the sightings' share of the information, and their information."""
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
    # Where nothing of a lens is stated, its principal point is correlated with the vertical, which depends on how upright
    # people are.
    boxes = by_boxes(problem)
    counted = np.where(boxes | problem.lens_normal, BOXES_COUNT_LESS, 1.0)[:, None]
    misled = np.where(boxes & (not problem.lens_normal), BOXES_MISLEAD, 1.0)[:, None]
    excess = np.clip((counted * total / random) ** 2, 1.0, MOST_EXCESS)
    return LensEvidence(seen, misled * total, effect * excess)


def by_boxes(problem: PeopleProblem) -> NDArray[np.bool_]:
    """Return whether a camera's sightings are boxes only (C,): joints determine a lens by geometry, not by people's heights."""
    return np.asarray(np.bincount(problem.joints.camera, minlength=problem.n_cameras) == 0)


def lens_places(n_cameras: int, camera_size: int, n_lens: int) -> NDArray[np.int64]:
    """Return the indices (C, L) of the lenses' unknowns among the shared ones."""
    return np.asarray((np.arange(n_cameras)[:, None] + 1) * camera_size - n_lens + np.arange(n_lens))


def refined_sigmas(
    seen: LensEvidence, core: Floats, lens: Floats, far: Floats | None = None, *, normal: bool = False
) -> Floats:  # fmt: skip
    """Return the root mean square errors (C, L) of the lenses `lens`.

    Args:
        seen: estimate from the sightings alone.
        core: (C, L) scales of the Cauchy distributions of the stated lenses.
        lens: (C, L) estimated lenses, as changes of the stated ones.
        far: (C, L) standard deviations of the normal distributions that limit the tails; None without a limit.
        normal: whether `core` holds standard deviations of normal distributions.
    """
    if normal:
        return np.asarray(1 / np.sqrt(1 / seen.sd**2 + 1 / core**2))
    out, far = np.zeros_like(lens), np.full_like(lens, np.inf) if far is None else far
    for c, u in itertools.product(*map(range, lens.shape)):
        out[c, u] = posterior_sd(*(float(each[c, u]) for each in (seen.seen, seen.sd, core, lens, far)))
    return out


def posterior_sd(seen: float, seen_sd: float, core: float, at: float, far: float = np.inf) -> float:
    """Return the root mean square distance from `at` of a value that is measured as `seen` +- `seen_sd`. Its prior is a Cauchy
    distribution of the scale `core` about 0, times a normal distribution of the standard deviation `far`.
    """
    fine = np.linspace(-1, 1, 2001)
    grid = np.unique(np.concatenate([seen + 6 * seen_sd * fine, 20 * core * fine]))
    density = np.exp(-0.5 * ((grid - seen) / seen_sd) ** 2 - 0.5 * (grid / far) ** 2) / (core**2 + grid**2)
    return float(np.sqrt(np.trapezoid(density * (grid - at) ** 2, grid) / np.trapezoid(density, grid)))
