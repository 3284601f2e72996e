"""The refinement: from a rough rig to the optimum of the person model, in rounds on all of the evidence.

Each round finds the sightings that agree with the rig, adjusts everything, and learns from the residuals how noisy the
sightings are. Rounds start tolerant and end strict.
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

# Noise that is learnt from what agrees within a tolerance is too small where that is narrow: rounds go on, by so many at most,
# while it grows by more than this factor.
_GROWTH, _MORE_ROUNDS = 1.15, 4
# Rounds more at most until the rays are those of the lenses found, where lenses are refined: the change in a round is about the
# square of that in the one before.
_LENS_ROUNDS = 6
# The scale has converged where a better one lowers the cost by less: a seventh of a sigma. Else it is changed by so much at
# most, as a logarithm, so many times.
_SCALE_CONVERGED, _MOST_RESCALED, _SCALE_ROUNDS = 0.01, 0.5, 5


@dataclass(frozen=True, eq=False)
class Fit:
    """The optimum."""

    model: AdjustmentProblem
    result: Result[AdjustmentState]
    noise: Noise
    stance: Floats
    start: Initialisation
    """What it was computed from, with the lenses found."""
    rounds: tuple[AdjustmentRound, ...] = ()


def refine_rig(start: Initialisation, state: RigState, options: PeopleOptions, rng: np.random.Generator) -> Fit:
    """Rounds on all of the evidence: who agrees, where is the optimum, how noisy is it, who stands."""
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
    """The optimum, found again from the best scale where the scale had not converged.

    Only people's heights and scale cues depend on it. Beside thousands of sightings they are so little that damped steps can
    end before: in one case with two wrong lenses people were 16 % too small.
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
    """What a box of middling size is off by, pixels."""
    return float(np.hypot(noise.box_px, noise.centre * np.median(model.problem.scale_px)))


def _stance(model: AdjustmentProblem, state: AdjustmentState, n_blocks: int) -> Floats:
    """(N,) who may be standing, over all person-instants of the evidence."""
    out = np.ones(n_blocks)
    person = model.problem.person
    if len(person):
        extent = state.people[:, 3] - state.people[:, 2]
        out[model.blocks] = standing_instants(extent, state.heights[person], person)
    return out
