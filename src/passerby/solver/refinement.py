"""Refinement of a rough rig to the optimum of the person model, in rounds on all evidence.

Each round finds the sightings that agree with the rig, adjusts all unknowns, and estimates the noise of the sightings from the
residuals. The tolerance of agreement is wide in the first round and narrow in the last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from passerby.common.arrays import Floats
from passerby.core.figures import AdjustmentRound
from passerby.people.model import Noise
from passerby.people.standing import standing_instants
from passerby.solver.adjustment_problem import (
    AGREE_SIGMAS,
    AdjustmentProblem,
    RigState,
    build_problem,
    learn_noise,
    occlusion_weights,
    rig_of,
)
from passerby.solver.evidence import draw_blocks
from passerby.solver.initialisation import LEARNING_OF_CAMERA, Initialisation, PeopleOptions, people_for_all
from passerby.solver.optimizer.least_squares import Result, Stopping, minimise
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem

# Noise estimated from sightings that agree within a narrow tolerance is too small. Rounds continue while it grows by more than
# this factor, with at most so many additional rounds.
_GROWTH, _MORE_ROUNDS = 1.15, 4
# Largest number of additional rounds until the rays fit the refined lenses: the change in a round is about the square of that
# in the previous one.
_LENS_ROUNDS = 6
# The scale has converged if a better one lowers the cost by less than the first number (a seventh of a sigma). If not, it is
# changed by at most the second number, as a logarithm, and at most so many times.
_SCALE_CONVERGED, _MOST_RESCALED, _SCALE_ROUNDS = 0.01, 0.5, 5


@dataclass(frozen=True, eq=False)
class Fit:
    """The optimum of the person model, with its noise and stance."""

    model: AdjustmentProblem
    result: Result[AdjustmentState]
    noise: Noise
    stance: Floats
    start: Initialisation
    """The start it was computed from, with the refined lenses."""
    rounds: tuple[AdjustmentRound, ...] = ()


def refine_rig(start: Initialisation, state: RigState, options: PeopleOptions, rng: np.random.Generator) -> Fit:
    """Refine the rig in rounds on all evidence.

    Each round selects the sightings that agree, adjusts, estimates their noise, and finds the people who stand.
    """
    start = start.with_lenses(state.lens)
    evidence = start.evidence
    noise, stance, share = Noise(), np.ones(len(evidence.person)), 0.15
    whole: Floats | None = None
    rounds: list[AdjustmentRound] = []
    growing, number, for_lenses = False, 0, 0
    before: tuple[AdjustmentProblem, AdjustmentState] | None = None
    while True:
        last = number >= options.rounds - 1 and not (growing and number < options.rounds - 1 + _MORE_ROUNDS)
        part = number == 0 and not last
        most = people_for_all(evidence, options.learning_people, LEARNING_OF_CAMERA)
        blocks = draw_blocks(evidence, most, rng) if part else None
        joints = np.sort(rng.permutation(evidence.n_joints)[: options.learning_joints]) if part else None
        if number == 0:
            start = start.with_free("focal")
        model = build_problem(
            start.evidence, state, noise, start.knowledge, share=share, blocks=blocks, joints=joints, stance=stance,
            whole=whole, rename=number > 0,
        )  # fmt: skip
        if before is not None:
            model = model.near(*before)
        stopping = Stopping(options.max_iterations, options.tolerance) if last else Stopping(12, 1e-4)
        result = minimise(model.problem, model.state, stopping)
        if last:
            result = _at_best_scale(model.problem, result, stopping)
        state, before = rig_of(result.state), (model, result.state)
        rounds.append(
            AdjustmentRound(
                sightings=len(model.rows), renamed=model.renamed, joints=len(model.joint_rows),
                iterations=result.iterations, converged=result.converged, cost=result.cost,
            )
        )  # fmt: skip
        settled = start.unknowns.settled(state.lens - start.lens)
        start = start.with_lenses(state.lens).weighed(model, result)
        if not last:
            knowledge = start.knowledge.judged(state.heights, np.unique(model.problem.person))
            start = replace(start, knowledge=knowledge)
        if last and (settled or for_lenses == _LENS_ROUNDS):
            break
        if last:
            for_lenses += 1
            continue
        judged = occlusion_weights(model, result.state, len(evidence.sightings))
        whole = judged.weight
        assumed, noise = noise, learn_noise(model, result, judged.broken)
        growing = len(model.rows) > 0 and _typical(noise, model) > _GROWTH * _typical(assumed, model)
        stance = _stance(model, result.state, len(evidence.person))
        share = AGREE_SIGMAS * max(noise.centre if len(model.rows) else 0.0, noise.joint if evidence.n_joints else 0.0)
        number += 1
    return Fit(model, result, noise, stance, start, tuple(rounds))


def _at_best_scale(problem: PeopleProblem, result: Result[AdjustmentState], stopping: Stopping) -> Result[AdjustmentState]:
    """Repeat the minimisation from the best scale where the scale has not converged.

    Only people's heights and scale cues depend on the scale. Their part of the cost is so small compared with thousands of
    sightings that damped steps can end too early: in one case with two wrong lenses, people were 16 % too small.
    """
    for _ in range(_SCALE_ROUNDS):
        state = result.state

        def cost(log_scale: float, state: AdjustmentState = state) -> float:
            return sum(term.cost() for term in problem.scale_terms(state.scaled(float(np.exp(log_scale)))))

        best = minimize_scalar(cost, bounds=(-_MOST_RESCALED, _MOST_RESCALED), method="bounded")
        if cost(0.0) - best.fun < _SCALE_CONVERGED:
            break
        result = minimise(problem, state.scaled(float(np.exp(best.x))), stopping)
    return result


def _typical(noise: Noise, model: AdjustmentProblem) -> float:
    """Return one sigma of the centre of a box of median size, pixels."""
    return float(np.hypot(noise.box_px, noise.centre * np.median(model.problem.scale_px)))


def _stance(model: AdjustmentProblem, state: AdjustmentState, n_blocks: int) -> Floats:
    """Return 1 where a person may be standing, else 0, for all person-instants (N,); 1 for those not in the model."""
    out = np.ones(n_blocks)
    person = model.problem.person
    if len(person):
        extent = state.people[:, 3] - state.people[:, 2]
        out[model.blocks] = standing_instants(extent, state.heights[person], person)
    return out
