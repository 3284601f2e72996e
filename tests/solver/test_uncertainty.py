"""Sigmas: free of the world's placement, smaller with more evidence, and true."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from passerby.core.cameras import Pose, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.core.scale_cues import CameraHeight, ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import exp_rotation, fit_plane_similarity, log_rotation
from passerby.solver import uncertainty
from passerby.solver.cues import POPULATION_BIAS
from passerby.solver.gauge import SCALE, TILT_X, TILT_Y, VAGUE, Free, held_system
from passerby.solver.initialisation import Initialisation, select_initial_rig
from passerby.solver.optimizer.least_squares import NormalEquations, Stopping, Term, minimise
from passerby.solver.people import PeopleOptions
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import TIME, PeopleProblem
from passerby.solver.refinement import refine_rig
from passerby.solver.systematic import LOWER_EDGE, ConsiderParameters
from passerby.solver.uncertainty import (
    MODEL_EXCESS,
    TIME_EXCESS,
    USUAL_COUNTS,
    USUAL_EFFECT,
    RigCovariance,
    design_effect,
    rig_covariance,
    sums_left,
)
from support.scenes.people_and_rigs import part, simulated, solve, without_poses

QUICK = PeopleOptions(coarse_people=100)


@pytest.fixture(scope="module")
def optimum() -> tuple[PeopleProblem, AdjustmentState]:
    """A problem of the solver at its optimum, a camera height among its cues."""
    truth = simulated("terrace", seconds=6.0)
    cues = ScaleCues(camera_heights=(CameraHeight("C2", float(truth.rig["C2"].centre[2]), 0.02),))
    rng = np.random.default_rng(0)
    start = Initialisation.prepare(without_poses(truth.rig), part(truth.observations), cues, QUICK, rng)
    fit = refine_rig(start, select_initial_rig(start, QUICK, rng).state, QUICK, rng)
    return fit.model.problem, fit.result.state


def moved(state: AdjustmentState, yaw: float, shift: tuple[float, float]) -> AdjustmentState:
    """The same scene in a world turned about the vertical and shifted along the ground."""
    turn = exp_rotation(np.array([0.0, 0.0, yaw]))
    bodies = state.people.copy()
    bodies[:, :2] = bodies[:, :2] @ turn[:2, :2].T + shift
    return replace(state, R=state.R @ turn.T, centre=state.centre @ turn.T + [*shift, 0.0], people=bodies)


def covariance(problem: PeopleProblem, state: AdjustmentState, inflation: float = 1.0, scale: float = 0.02) -> RigCovariance:
    return rig_covariance(problem.terms(state, jacobians=True), problem, state, inflation, scale)


def test_placement_is_noticed_by_no_residual_and_no_sigma(optimum: tuple[PeopleProblem, AdjustmentState]) -> None:
    problem, state = optimum
    yaw, shift = 1.1, (40.0, -25.0)
    other = moved(state, yaw, shift)
    before, after = (sum(term.cost() for term in problem.terms(s, jacobians=False)) for s in (state, other))
    assert after == pytest.approx(before, rel=1e-9)
    here, there = covariance(problem, state), covariance(problem, other)
    turn = np.eye(6)
    turn[:3, :3] = exp_rotation(np.array([0.0, 0.0, yaw]))
    np.testing.assert_allclose(there.metric, turn @ here.metric @ turn.T, rtol=1e-4, atol=1e-4 * here.metric.max())
    np.testing.assert_allclose(there.shape, turn @ here.shape @ turn.T, rtol=1e-4, atol=1e-4 * here.shape.max())
    assert there.vertical_deg == pytest.approx(here.vertical_deg, rel=1e-4)
    assert there.scale == pytest.approx(here.scale, rel=1e-4)


def test_covariances_are_symmetric_and_positive(optimum: tuple[PeopleProblem, AdjustmentState]) -> None:
    found = covariance(*optimum)
    for blocks in (found.metric, found.shape):
        assert blocks.shape == (4, 6, 6)
        np.testing.assert_allclose(blocks, blocks.transpose(0, 2, 1), atol=1e-12)
        assert (np.linalg.eigvalsh(blocks) > -1e-9 * np.abs(blocks).max()).all()
        assert (np.einsum("cii->ci", blocks) > 0).all()
    # The metric world knows all the shape does not, and scale, vertical and ground besides.
    for c in range(4):
        metric, shape = found.sigma(c), found.shape_sigma(c)
        assert metric.position_m > shape.position_m
        assert metric.orientation_deg > shape.orientation_deg


def test_inflation_and_scale_go_where_they_belong(optimum: tuple[PeopleProblem, AdjustmentState]) -> None:
    plain, inflated, vague = covariance(*optimum), covariance(*optimum, inflation=9.0), covariance(*optimum, scale=0.2)
    for c in range(4):
        ratio = inflated.shape_sigma(c).position_m / plain.shape_sigma(c).position_m
        assert 1.5 < ratio < 3.05
        assert vague.shape_sigma(c).position_m == pytest.approx(plain.shape_sigma(c).position_m)
        assert vague.sigma(c).position_m > 1.5 * plain.sigma(c).position_m
    assert vague.scale == pytest.approx(0.2, rel=0.01)
    # What is stated holds as soon as it is more than the adjustment's own 2.2 %.
    assert covariance(*optimum, scale=0.03).scale == pytest.approx(0.03, rel=0.1)
    assert plain.scale >= 0.02


def test_a_vertical_that_may_lean_any_way_and_a_scale_likewise_are_unknown() -> None:
    for freedom, kind in ((TILT_X, "vertical"), (TILT_Y, "vertical"), (SCALE, "scale")):
        for sigma, unknown in ((0.9 * VAGUE, False), (1.1 * VAGUE, True)):
            of_freedoms = np.diag(np.full(7, 1e-6))
            of_freedoms[freedom, freedom] = sigma**2
            assert uncertainty._with_vague(Free(), of_freedoms) == Free(**{kind: unknown})


def test_sigmas_of_distances_and_clocks_are_those_of_sampled_rigs() -> None:
    """Cameras that err by far more here than there, together and each on its own, against many draws of their errors."""
    rng = np.random.default_rng(3)
    centre = np.array([[0.0, 0.0, 3.0], [8.0, 1.0, 2.5], [2.0, 9.0, 4.0]])
    root = rng.normal(size=(18, 18)) * np.repeat([1e-3, 1e-2, 3e-2], 6)[:, None]
    drawn = centre + (rng.normal(size=(40_000, 18)) @ root.T).reshape(-1, 3, 6)[:, :, :3]
    sampled = np.linalg.norm(drawn[:, :, None] - drawn[:, None], axis=-1).std(axis=0)
    np.testing.assert_allclose(uncertainty._distance_sigmas(root @ root.T, centre), sampled, rtol=0.03, atol=1e-9)
    # An error that all clocks have in common is none; each camera's own adds to the first camera's.
    size, own = TIME + 1, np.array([0.01, 0.03, 0.05])
    covariance, clocks = 7.0 * np.eye(3 * size), np.arange(3) * size + TIME
    covariance[np.ix_(clocks, clocks)] = 2.0**2 + np.diag(own**2)
    expected = TIME_EXCESS * np.array([0.0, *np.hypot(own[1:], own[0])])
    np.testing.assert_allclose(uncertainty._time_sigmas(covariance, size, 3), expected, atol=1e-9)


def test_lower_edges_of_boxes_move_cameras_as_their_consider_parameter_says(
    optimum: tuple[PeopleProblem, AdjustmentState],
) -> None:
    problem, state = optimum
    terms, share = problem.terms(state, jacobians=True), 0.005
    weighted = partial(uncertainty.downweight, inflation=1.0)
    H = NormalEquations(problem.layout, [weighted(term) for term in terms]).reduce().H
    system, _ = held_system(H, state, problem.camera_size)
    sigma = ConsiderParameters.of_boxes(problem, state).moved(system.inverse(), problem, terms, weighted)
    predicted = sigma[np.arange(problem.n_cameras) * problem.camera_size + 5, 0] * share / LOWER_EDGE
    s = problem.sightings
    down = np.linalg.pinv(s.bottom_tangent)[:, :, 1] * (share * s.extent_px)[:, None]
    bottom = (s.bottom + down) / np.linalg.norm(s.bottom + down, axis=1, keepdims=True)
    tangent = s.bottom_tangent - (s.bottom_tangent @ bottom[:, :, None]) * bottom[:, None]
    longer = replace(s, bottom=bottom, bottom_tangent=tangent, extent_px=(1 + share) * s.extent_px)
    lowered = replace(problem, sightings=longer, expected_px=problem.scale_px)
    before, after = (minimise(one, state, Stopping(50, 1e-9)).state for one in (problem, lowered))
    found = after.centre[:, 2] - before.centre[:, 2]
    np.testing.assert_allclose(found, predicted, atol=0.2 * np.abs(predicted).max())
    assert np.abs(found).max() > 0.002


def some(observations: Observations, identities: int, frames: int = 10**9) -> Observations:
    """The first identities and frames only."""
    seen = {}
    for name, camera in observations.cameras.items():
        boxes = camera.boxes
        seen[name] = CameraObservations(boxes.take((boxes.identity <= identities) & (boxes.frame <= frames)))
    return Observations(seen, observations.fps)


def test_sums_that_places_and_cameras_take_up_are_not_left() -> None:
    """Three cameras see two people for four stretches: 48 sums, 16 of which are places and 18 cameras."""
    every = np.array([(camera, person, stretch) for camera in range(3) for person in range(2) for stretch in range(4)])
    assert sums_left(np.repeat(every, 5, axis=0)) == 48 - 16 - 18
    assert sums_left(every[every[:, 2] == 0]) == 0
    assert sums_left(every[:0]) == 0


@pytest.mark.parametrize("size", [1.0, 1e-4])
def test_residuals_alike_within_a_stretch_tell_as_much_as_one_of_them(size: float) -> None:
    """Whatever their size. Independent ones tell all that they could."""
    rng = np.random.default_rng(0)
    alike, each = 500, 6
    key = np.repeat(np.column_stack([np.arange(alike), np.zeros(alike, int)]), each, axis=0)
    residual = size * np.repeat(rng.normal(size=(alike, 2)), each, axis=0)
    assert uncertainty._design_effect(Term(residual), key) == pytest.approx(each)
    assert uncertainty._design_effect(Term(size * rng.normal(size=residual.shape)), key) == pytest.approx(1.0, abs=0.1)


def test_the_usual_design_effect_counts_against_the_sums_that_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a short recording it is all that counts; of a long one it counts for as many sums as it is said to."""
    truth = simulated("terrace", seconds=30.0)
    other = USUAL_EFFECT + 1.0
    shares = []
    for frames in (30, 300):
        seen = some(truth.observations, 4, frames)
        rng = np.random.default_rng(0)
        start = Initialisation.prepare(without_poses(truth.rig), seen, ScaleCues(), QUICK, rng)
        fit = refine_rig(start, select_initial_rig(start, QUICK, rng).state, QUICK, rng)
        terms = fit.model.problem.terms(fit.result.state, jacobians=False)
        effects = []
        for usual in (USUAL_EFFECT, other):
            monkeypatch.setattr(uncertainty, "USUAL_EFFECT", usual)
            effects.append(design_effect(fit.model, start.evidence, terms) / MODEL_EXCESS)
        shares.append(effects[1] - effects[0])
        assert frames > 30 or effects == pytest.approx([USUAL_EFFECT, other])
    left = USUAL_COUNTS / shares[1] - USUAL_COUNTS
    assert shares[0] == pytest.approx(1.0)
    assert left == pytest.approx(round(left), abs=1e-6)
    # Four cameras, four people and eight stretches: fewer where somebody is out of view.
    assert 50 < left <= 2 * 4 * 4 * 8 - 2 * 4 * 8 - 6 * 4


def typical_sigma(solution: Solution) -> float:
    return float(np.median([camera.shape_position_sigma_mm for camera in solution.figures.cameras]))


@pytest.mark.slow
def test_sigmas_shrink_with_more_people_and_longer_scenes() -> None:
    truth = simulated("terrace", seconds=20.0)
    sigmas = [
        typical_sigma(solve(truth.rig, some(truth.observations, people, frames), options=QUICK))
        for people, frames in ((2, 50), (7, 50), (7, 100))
    ]
    assert sigmas[1] < 0.75 * sigmas[0]
    assert sigmas[2] < 0.9 * sigmas[1]


def poses_of(rig: Rig) -> list[Pose]:
    return [camera.pose for camera in rig if camera.pose is not None]


def placed(rig: Rig, truth: Rig) -> list[Pose]:
    """The estimate after the best turn about the vertical and shift along the ground."""
    estimate, true = (np.array([pose.centre for pose in poses_of(r)]) for r in (rig, truth))
    fit = fit_plane_similarity(estimate[:, :2], true[:, :2], with_scale=False)
    turn = exp_rotation(np.array([0.0, 0.0, fit.yaw]))
    return [pose.moved(turn, np.array([*fit.translation, 0.0])) for pose in poses_of(rig)]


def grown(rig: Rig, factor: float) -> Rig:
    """The world in which the same pictures are of people so many times as tall."""
    poses = (Pose.from_centre(pose.R_cw, factor * pose.centre) for pose in poses_of(rig))
    return Rig(tuple(replace(camera, pose=pose) for camera, pose in zip(rig, poses, strict=True)))


@pytest.mark.slow
def test_errors_over_many_small_scenes_are_what_the_sigmas_say() -> None:
    """Neither too bold nor so timid that a sigma would say nothing. The people of a scene are taller or shorter than the
    population by as much as groups are, which is one of the things that the sigmas of the metric world speak of.
    """
    shape, metric, turned = [], [], []
    for seed in range(12):
        scene = simulated("terrace", seconds=5.0, seed=100 + seed)
        true_rig = grown(scene.rig, float(np.exp(np.random.default_rng(seed).normal(0, POPULATION_BIAS))))
        solution = solve(scene.rig, part(scene.observations), options=QUICK)
        found = compare(solution.rig, true_rig).similarity.position_mm
        shape += [found[camera.name] / camera.shape_position_sigma_mm for camera in solution.figures.cameras]
        for camera, pose, true in zip(solution.rig, placed(solution.rig, true_rig), poses_of(true_rig), strict=True):
            assert camera.sigma is not None
            metric.append(np.linalg.norm(pose.centre - true.centre) / camera.sigma.position_m)
            turned.append(np.degrees(np.linalg.norm(log_rotation(pose.R_cw @ true.R_cw.T))) / camera.sigma.orientation_deg)
    for ratio, least in ((shape, 0.4), (metric, 0.4), (turned, 0.15)):
        assert np.mean(np.array(ratio) < 3) > 0.95
        assert least < np.sqrt(np.mean(np.square(ratio))) < 1.4
