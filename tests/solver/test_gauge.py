"""What no evidence constrains has an infinite sigma and a doubt of its own, and nothing else has."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.scale_cues import CameraDistance, CameraHeight, ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.solver.gauge import Free, HeldSystem, held_system, placement_freedoms, similarity_freedoms
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.optimizer.least_squares import NormalEquations
from passerby.solver.people import PeopleOptions
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import RigCovariance, rig_covariance
from support.scenes.exact_sightings import poses_of
from support.scenes.fits import fitted, started
from support.scenes.people_and_rigs import part, simulated, solve
from support.scenes.upper_bodies import SEGMENT_ENDS, in_turns, without_joints

Optimum = tuple[PeopleProblem, AdjustmentState]
QUICK = PeopleOptions(coarse_people=100, coarse_joints=600, max_joints=8000)
TRUTH = simulated("terrace", seconds=12.0)
UPPER = without_joints(TRUTH.observations)
LOOSE = without_joints(TRUTH.observations, SEGMENT_ENDS)


def distance(a: str, b: str, sd_m: float = 0.01) -> ScaleCues:
    metres = float(np.linalg.norm(TRUTH.rig[a].centre - TRUTH.rig[b].centre))
    return ScaleCues(distances=(CameraDistance((a, b), metres, sd_m),))


@pytest.fixture(scope="module")
def upper() -> Optimum:
    fit = fitted(TRUTH.rig, UPPER, QUICK)
    return fit.model.problem, fit.result.state


@pytest.fixture(scope="module")
def whole() -> Optimum:
    fit = fitted(TRUTH.rig, part(TRUTH.observations, boxes=False, keypoints=True), QUICK)
    return fit.model.problem, fit.result.state


def stating(problem: PeopleProblem, cues: ScaleCues) -> PeopleProblem:
    return replace(problem, cues=started(TRUTH.rig, UPPER, QUICK, cues).knowledge.cues)


def covariance(problem: PeopleProblem, state: AdjustmentState, scale: float) -> RigCovariance:
    return rig_covariance(problem.terms(state, jacobians=True), problem, state, 1.0, scale)


def cameras_alone(R: np.ndarray, centre: np.ndarray) -> AdjustmentState:
    return AdjustmentState(R, centre, np.zeros(len(R)), np.zeros(1), np.zeros(0), np.zeros((0, 4)), np.zeros((0, 3)))


def reduced(problem: PeopleProblem, state: AdjustmentState) -> np.ndarray:
    return NormalEquations(problem.layout, problem.terms(state, jacobians=True)).reduce().H


def sigmas(solution: Solution) -> np.ndarray:
    """(C, 2) of position, metres, and orientation, degrees."""
    return np.array([(c.sigma.position_m, c.sigma.orientation_deg) for c in solution.rig if c.sigma is not None])


def test_one_distance_fixes_the_scale_and_no_vertical() -> None:
    solution = solve(TRUTH.rig, LOOSE, distance("C1", "C2"), QUICK)
    assert solution.verdict == "doubtful"
    assert solution.reasons[0].startswith("nothing fixes the up direction and the height of the ground: ")
    assert np.isinf(sigmas(solution)).all()
    assert solution.figures.undetermined == ("vertical", "height of the ground")
    assert 0 < solution.figures.scale.relative_sigma < 0.01
    assert all(pair.sigma_m < 0.1 for pair in solution.figures.distances)
    found = compare(solution.rig, TRUTH.rig)  # of joints without noise
    assert found.similarity.mean_position_mm < 1e-3
    assert found.scale_ratio == pytest.approx(1, abs=1e-6)


def test_the_height_of_one_camera_fixes_no_scale(upper: Optimum) -> None:
    """The ground may lie anywhere below it."""
    problem, state = upper
    known = replace(problem, cues=None)
    height = CameraHeight("C1", float(state.centre[0, 2]), 0.01)
    for one, rank_lost in ((known, 4), (stating(problem, ScaleCues(camera_heights=(height,))), 3)):
        system, free = held_system(reduced(one, state), state, one.layout.camera_size)
        assert free == Free(scale=True, vertical=True, ground=True)
        assert system.null_vectors().shape[1] == rank_lost
        value = np.linalg.eigvalsh(system.matrix) / np.linalg.norm(system.matrix, 2)
        assert (value[:rank_lost] < 1e-11).all(), "null values lie far below all others"
        assert one is not known or value[rank_lost] > 1e-8


def test_the_scale_of_a_long_rig_is_known() -> None:
    """Its share is the smallest eigenvalue's, which falls with the third power of the number of cameras."""
    for cameras, share in ((20, 5.8e-8), (300, 2.3e-11)):
        system = HeldSystem(np.eye(1), np.ones(1), np.zeros((1, 3)), np.arange(6 * cameras), np.arange(cameras))
        assert 50 * 1.8e-14 < system.null_share < share / 5
    few = [HeldSystem(np.eye(1), np.ones(1), np.zeros((1, 3)), np.arange(6 * n), np.arange(n)).null_share for n in (2, 10)]
    assert few[0] == few[1] > 1e-11


def test_whole_people_leave_nothing_but_the_placement_unknown(whole: Optimum) -> None:
    """A shift along the ground and a turn about the vertical are null vectors of the normal matrix, a rise or pitch is none."""
    problem, state = whole
    H, size = reduced(problem, state), problem.layout.camera_size
    placement = placement_freedoms(state, len(H), size)
    tilted = placement.copy()
    tilted[5::size][: len(state.R), 0] = 0.01
    tilted[0::size][: len(state.R), 2] += 0.01
    costs = np.einsum("ik,ij,jk->k", placement, H, placement)
    assert (np.abs(costs) < 1e-6 * np.diag(H).max()).all()
    assert np.einsum("i,ij,j", tilted[:, 0], H, tilted[:, 0]) > 100 * np.abs(costs).max()
    system, free = held_system(H, state, size)
    assert not free
    assert system.null_vectors().shape[1] == 0
    value = np.linalg.eigvalsh(system.matrix)
    assert value[0] > 1e-8 * value[-1]
    plain = np.linalg.pinv(system.matrix, rcond=1e-13, hermitian=True) * system.scale[:, None] * system.scale
    np.testing.assert_array_equal(system.inverse(), plain)


def test_cameras_apart_from_the_others_have_no_say_in_how_far_the_rig_moved() -> None:
    """Whatever a freedom of the similarity, the cameras that hold it tell it alone, and tell it by the whole amount."""
    for fixed in (None, np.array([0, 1, 3])):
        freedoms = similarity_freedoms(cameras_alone(*poses_of(TRUTH.rig)), fixed)
        np.testing.assert_allclose(freedoms.along @ freedoms.moves, np.eye(7), atol=1e-9)
        by_camera = np.abs(freedoms.along.reshape(7, 4, 6)).sum(axis=(0, 2)) > 0
        assert by_camera.tolist() == [True, True, fixed is None, True]
    apart = cameras_alone(np.stack([np.eye(3)] * 2), np.array([[0.0, 0, 2], [3.0, 0, 2]]))
    _, free = held_system(np.diag(np.repeat([0.0, 1.0], [14, 1])), apart, 7)
    assert free == Free(True, True, True, (0, 1)), "nothing is between the two"


def test_priors_on_people_who_were_not_seen_and_a_scale_stated_to_no_better_than_itself_fix_nothing(upper: Optimum) -> None:
    problem, state = upper
    unseen = replace(problem, height_mean=np.full(50, 1.72), height_sd=np.full(50, 1e-3))
    found = covariance(unseen, replace(state, heights=np.full(50, 1.72)), 0.01)
    assert (found.scale, found.vertical_deg) == (np.inf, np.inf)
    metres = float(np.linalg.norm(state.centre[1] - state.centre[0]))
    for share, known in ((0.1, True), (20.0, False)):
        stated = stating(problem, ScaleCues(distances=(CameraDistance(("C1", "C2"), metres, share * metres),)))
        assert np.isfinite(covariance(stated, state, share).scale) == known


@pytest.mark.slow
def test_a_camera_that_hangs_by_pairs_alone_slides_along_its_baseline(monkeypatch: pytest.MonkeyPatch) -> None:
    """C4 shares joints with C3 only: how far it is from C3 is nowhere to be seen. The others see each other's points."""
    monkeypatch.setattr("passerby.solver.systematic.LENS_PRIORS", dict.fromkeys(LENS_PARTS, 0.0))  # exact lenses
    pairs = in_turns(UPPER, {"C1": [0], "C2": [0], "C3": [0, 1], "C4": [1]})
    solution = solve(TRUTH.rig, pairs, distance("C1", "C2"), QUICK)
    assert "the pose of camera C4 relative to the others is not determined: " in " ".join(solution.reasons)
    assert "camera C4" in solution.figures.undetermined
    shape = {c.name: c.shape_position_sigma_mm for c in solution.figures.cameras}
    assert shape.pop("C4") is None
    assert all(0 < sigma < 50 for sigma in shape.values())
    known = {tuple(pair.cameras): pair.sigma_m is not None for pair in solution.figures.distances}
    assert known == {pair: "C4" not in pair for pair in known}


def test_a_camera_without_evidence_leaves_the_others_as_sure_as_without_it(whole: Optimum) -> None:
    problem, state = whole
    joints, here = problem.joints, problem.sightings.camera != 3
    blind = replace(
        problem, joints=joints.take(joints.camera != 3), sightings=problem.sightings.take(here),
        whole=None if problem.whole is None else problem.whole[here],
        expected_px=None if problem.expected_px is None else problem.expected_px[here],
    )  # fmt: skip
    found = covariance(blind, state, 0.02)
    assert found.free == Free(cameras=(3,))
    assert np.isinf([found.sigma(3).position_m, found.shape_sigma(3).orientation_deg]).all()
    assert found.sigma(3).covariance is None
    seeing = covariance(problem, state, 0.02)
    for c in range(3):
        assert found.shape_sigma(c).position_m < 0.1
        assert found.sigma(c).position_m < 1.5 * seeing.sigma(c).position_m
    assert np.isfinite([found.scale, found.vertical_deg]).all()
