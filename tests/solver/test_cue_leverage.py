"""What a rig would measure of a distance or a height that had not been stated: misstated cues pull their own cameras."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from passerby.geometry.triangulation import PointObservations
from passerby.people.model import GAIT_SHARE, Noise, Priors
from passerby.solver.cue_leverage import freed_measurements
from passerby.solver.cue_terms import CueRows
from passerby.solver.optimizer.least_squares import NormalEquations, Stopping, minimise
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from support.scenes.exact_sightings import poses_of, standing
from support.scenes.people_and_rigs import ring

RIG = ring(4)
R, CENTRE = poses_of(RIG)
PAIR = (0, 2)
METRES = float(np.linalg.norm(CENTRE[PAIR[0]] - CENTRE[PAIR[1]]))


def exact(cues: CueRows | None, instants: int = 60) -> tuple[PeopleProblem, AdjustmentState]:
    """People of known heights, seen without any error: at the true state only cues have residuals."""
    rng = np.random.default_rng(0)
    person, heights = np.arange(instants) % 8, rng.normal(1.72, 0.06, 8)
    ground, high = rng.uniform(-2, 2, (instants, 2)), GAIT_SHARE * heights[np.arange(instants) % 8]
    sightings = replace(standing(RIG, ground, high), has_foot=np.zeros(4 * instants))
    nobody = PointObservations(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0))
    problem = PeopleProblem(
        4, sightings, nobody, person, 0, heights, np.full(8, 1e-4), np.ones(instants), Noise(loss=1e3),
        Priors(stance_loss=1e3), cues,
    )  # fmt: skip
    people = np.column_stack([ground, np.zeros(instants), high])
    return problem, AdjustmentState(R, CENTRE, np.zeros(4), np.array([0.08]), heights, people, np.zeros((0, 3)))


def distance(factor: float, sd: float) -> CueRows:
    return CueRows(distance_between=np.array([PAIR]), distances=np.array([[factor * METRES, sd]]))


def height(factor: float, sd: float) -> CueRows:
    return CueRows(height_of=np.array([1]), heights=np.array([[factor * CENTRE[1, 2], sd]]))


@pytest.mark.parametrize(("stated", "metres"), [(distance, METRES), (height, float(CENTRE[1, 2]))])
@pytest.mark.parametrize("factor", [0.99, 1.02])
def test_a_misstated_cue_is_measured_as_if_it_had_not_been_stated(
    stated: Callable[[float, float], CueRows], metres: float, factor: float
) -> None:
    """It is stated so surely that what it is off by is nearly hidden; at the scale that the rig has, the truth comes back."""
    cues = stated(factor, 0.02)
    problem, true = exact(cues)
    found = minimise(problem, true, Stopping(50, 1e-12))
    state = found.state
    spread = [float(np.linalg.norm(centre - centre.mean(axis=0))) for centre in (state.centre, CENTRE)]
    scale = spread[0] / spread[1]
    kept = np.linalg.norm(state.centre[PAIR[0]] - state.centre[PAIR[1]]) if stated is distance else state.centre[1, 2]
    ((freed, sigma),) = freed_measurements(cues, state, problem.layout, found.normal, 1.0)
    off = abs(factor - 1)
    assert kept / metres == pytest.approx(factor, abs=0.1 * off)
    assert abs(kept / metres - scale) > 0.3 * off
    assert freed / metres == pytest.approx(scale, abs=0.05 * off)
    assert 0 < sigma < np.inf
    ((_, doubled),) = freed_measurements(cues, state, problem.layout, found.normal, 4.0)
    assert doubled == pytest.approx(2 * sigma)


def test_what_others_say_of_a_cue_is_as_sure_as_it_is_without_it() -> None:
    """However surely it is stated; where next to all of it is stated, nothing else is known of it."""
    sigmas = []
    for sd in (0.02, 0.2):
        problem, state = exact(distance(1.0, sd))
        normal = NormalEquations(problem.layout, problem.terms(state, jacobians=True))
        ((metres, sigma),) = freed_measurements(distance(1.0, sd), state, problem.layout, normal, 1.0)
        assert metres == pytest.approx(METRES)
        sigmas.append(sigma)
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.02)
    problem, state = exact(distance(1.0, 1e-5))
    normal = NormalEquations(problem.layout, problem.terms(state, jacobians=True))
    ((_, sigma),) = freed_measurements(distance(1.0, 1e-5), state, problem.layout, normal, 1.0)
    assert sigma == np.inf
    assert freed_measurements(CueRows(), state, problem.layout, normal, 1.0).shape == (0, 2)
