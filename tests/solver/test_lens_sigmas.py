"""What people alone say of lenses: the same whatever was stated of these."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.geometry.triangulation import PointObservations
from passerby.people.model import Noise
from passerby.solver.lens_sigmas import BOXES_COUNT_LESS, LensEvidence, lens_evidence
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.systematic import ConsiderParameters
from support.scenes.exact_sightings import poses_of, standing
from support.scenes.people_and_rigs import ring

UNKNOWNS = LensUnknowns(("focal", "principal_point"))
RIG = ring(4)


def exact(instants: int = 60) -> tuple[PeopleProblem, AdjustmentState]:
    """Eight people, each at many places, seen without any error."""
    rng = np.random.default_rng(0)
    person = np.arange(instants) % 8
    heights = rng.normal(1.72, 0.06, 8)
    ground = rng.uniform(-2, 2, (instants, 2))
    nothing = np.zeros((4, UNKNOWNS.size))
    sightings = replace(standing(RIG, ground, heights[person]), has_foot=np.zeros(4 * instants))
    nobody = PointObservations(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0))
    problem = PeopleProblem(
        4, UNKNOWNS.sightings(sightings, RIG, nothing), UNKNOWNS.points(nobody, RIG, nothing), person, 0, np.full(8, 1.72),
        np.full(8, 0.09), np.ones(instants), Noise(), lens_core=UNKNOWNS.core(RIG), lens_normal=True,
    )  # fmt: skip
    R, centre = poses_of(RIG)
    people = np.column_stack([ground, np.zeros(instants), heights[person]])
    state = AdjustmentState(R, centre, np.zeros(4), np.array([0.08]), heights, people, np.zeros((0, 3)), lens=nothing)
    return problem, state


def evidence_of(problem: PeopleProblem, state: AdjustmentState, held_sd: float = 0.0, inflation: float = 2.0) -> LensEvidence:
    """With held distortions that are off by 0.01 times `held_sd`."""
    held = ConsiderParameters.of_lenses(RIG, problem, state, UNKNOWNS.parts)
    return lens_evidence(problem, state, inflation, None, replace(held, root=held_sd * held.root))


@pytest.mark.parametrize("unknown", range(3))
def test_what_people_say_of_a_lens_does_not_go_by_what_was_stated_of_it(unknown: int) -> None:
    problem, state = exact()
    found = []
    for looser in (30.0, 100.0, 1e4):
        core = problem.lens_core.copy()
        core[1, unknown] *= looser
        found.append(evidence_of(replace(problem, lens_core=core), state).sd[1, unknown])
    np.testing.assert_allclose(found, found[-1], rtol=1e-3)


def test_priors_count_by_what_boxes_are_off_by_beyond_chance() -> None:
    """Hardly beyond it here: sixty instants leave much to chance, and the factor that boxes count less by is left."""
    problem, state = exact()
    excess = evidence_of(problem, state, inflation=1.0).prior_weight
    assert (excess >= BOXES_COUNT_LESS**2).all()
    np.testing.assert_allclose(excess, BOXES_COUNT_LESS**2, rtol=0.1)
    # Where sightings that follow one another count as independent, the priors count more, but hardly where other priors tell
    # (how high a principal point is, by how upright people are).
    weight = evidence_of(problem, state, inflation=2.0).prior_weight
    assert (weight[:, 0] > 1.7 * excess[:, 0]).all()
    assert (weight < 2 * excess).all()


def test_what_is_held_of_a_lens_adds_to_what_is_refined() -> None:
    problem, state = exact()
    alone, with_held = (evidence_of(problem, state, held_sd) for held_sd in (0.0, 100.0))
    assert (with_held.sd >= alone.sd).all()
    assert (with_held.sd[:, 0] > 1.05 * alone.sd[:, 0]).any(), "a distortion looks like a focal length where people walk"
    assert (with_held.prior_weight >= alone.prior_weight).all()


def test_a_wrong_person_far_beyond_a_picture_says_nothing_of_its_lens() -> None:
    problem, state = exact()
    before = ConsiderParameters.of_lenses(RIG, problem, state).columns["centres"]
    people = state.people.copy()
    people[0, :2] = (state.centre[0] + 8.0 * state.R[0, 0] + 0.3 * state.R[0, 2])[:2]  # nearly beside the first camera
    after = ConsiderParameters.of_lenses(RIG, problem, replace(state, people=people)).columns["centres"]
    own = (problem.sightings.block == 0) & (problem.sightings.camera == 0)
    assert np.abs(before[own]).max() > 0
    assert not after[own].any()
    others = problem.sightings.block > 0
    np.testing.assert_array_equal(after[others], before[others])
