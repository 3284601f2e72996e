"""Sigmas: free of the world's placement, smaller with more evidence, and true."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from passerby.common.arrays import Bools, Floats
from passerby.core.cameras import Pose, Rig
from passerby.core.measuring import measure_change
from passerby.core.observations import CameraObservations, Observations
from passerby.core.scale_cues import CameraHeight, ScaleCues
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import angle_between, exp_rotation, fit_plane_similarity
from passerby.solver import uncertainty
from passerby.solver.cues import POPULATION_BIAS
from passerby.solver.gauge import SCALE, TILT_X, TILT_Y, Free, held_system
from passerby.solver.measuring_uncertainty import measuring_uncertainty
from passerby.solver.optimizer.least_squares import NormalEquations, Stopping, Term, minimise
from passerby.solver.people import PeopleOptions
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import TIME, PeopleProblem
from passerby.solver.systematic import LOWER_EDGE, ConsiderParameters
from support.scenes.exact_sightings import poses_of
from support.scenes.fits import fitted
from support.scenes.people_and_rigs import part, ring, simulated, solve

Optimum = tuple[PeopleProblem, AdjustmentState]
QUICK = PeopleOptions(coarse_people=100)


@pytest.fixture(scope="module")
def optimum() -> Optimum:
    """A problem of the solver at its optimum, a camera height among its cues."""
    truth = simulated("terrace", seconds=6.0)
    cues = ScaleCues(camera_heights=(CameraHeight("C2", float(truth.rig["C2"].centre[2]), 0.02),))
    fit = fitted(truth.rig, part(truth.observations), QUICK, cues)
    return fit.model.problem, fit.result.state


def moved(state: AdjustmentState, yaw: float, shift: tuple[float, float]) -> AdjustmentState:
    """The same scene in a world turned about the vertical and shifted along the ground."""
    turn = exp_rotation(np.array([0.0, 0.0, yaw]))
    bodies = state.people.copy()
    bodies[:, :2] = bodies[:, :2] @ turn[:2, :2].T + shift
    return replace(state, R=state.R @ turn.T, centre=state.centre @ turn.T + [*shift, 0.0], people=bodies)


def covariance(
    problem: PeopleProblem, state: AdjustmentState, inflation: float = 1.0, scale: float = 0.02
) -> uncertainty.RigCovariance:
    return uncertainty.rig_covariance(problem.terms(state, jacobians=True), problem, state, inflation, scale)


def test_placement_is_noticed_by_no_residual_and_no_sigma(optimum: Optimum) -> None:
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


def test_covariances_are_positive_and_inflation_and_scale_go_where_they_belong(optimum: Optimum) -> None:
    found, inflated, vague = covariance(*optimum), covariance(*optimum, inflation=9.0), covariance(*optimum, scale=0.2)
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
        assert 1.5 < inflated.shape_sigma(c).position_m / shape.position_m < 3.05
        assert vague.shape_sigma(c).position_m == pytest.approx(shape.position_m)
        assert vague.sigma(c).position_m > 1.5 * metric.position_m
    assert vague.scale == pytest.approx(0.2, rel=0.01)
    # What is stated holds as soon as it is more than the adjustment's own 2.2 %.
    assert covariance(*optimum, scale=0.03).scale == pytest.approx(0.03, rel=0.1)
    assert found.scale >= 0.02


def test_a_vertical_that_may_lean_any_way_and_a_scale_likewise_are_unknown() -> None:
    for freedom, kind in ((TILT_X, "vertical"), (TILT_Y, "vertical"), (SCALE, "scale")):
        for sigma, unknown in ((0.5, False), (2.0, True)):
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
    expected = uncertainty.TIME_EXCESS * np.array([0.0, *np.hypot(own[1:], own[0])])
    np.testing.assert_allclose(uncertainty._time_sigmas(covariance, size, 3), expected, atol=1e-9)


def test_lower_edges_of_boxes_move_cameras_as_their_consider_parameter_says(optimum: Optimum) -> None:
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


@pytest.mark.parametrize("size", [1.0, 1e-4])
def test_residuals_alike_within_a_stretch_tell_as_much_as_one_of_them(size: float) -> None:
    """Whatever their size. Independent ones tell all that they could; sums that places and cameras take up are not left."""
    rng = np.random.default_rng(0)
    alike, each = 500, 6
    key = np.repeat(np.column_stack([np.arange(alike), np.zeros(alike, int)]), each, axis=0)
    residual = size * np.repeat(rng.normal(size=(alike, 2)), each, axis=0)
    assert uncertainty._design_effect(Term(residual), key) == pytest.approx(each)
    assert uncertainty._design_effect(Term(size * rng.normal(size=residual.shape)), key) == pytest.approx(1.0, abs=0.1)
    # Three cameras see two people for four stretches: 48 sums, 16 for places and 18 for cameras.
    every = np.array([(camera, person, stretch) for camera in range(3) for person in range(2) for stretch in range(4)])
    assert uncertainty.sums_left(np.repeat(every, 5, axis=0)) == 48 - 16 - 18
    assert uncertainty.sums_left(every[every[:, 2] == 0]) == uncertainty.sums_left(every[:0]) == 0


def test_the_usual_design_effect_counts_against_the_sums_that_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a short recording it is all that counts; of a long one it counts for as many sums as it is said to."""
    truth = simulated("terrace", seconds=30.0)
    both, shares = (uncertainty.USUAL_EFFECT, uncertainty.USUAL_EFFECT + 1.0), []
    for frames in (30, 300):
        fit = fitted(truth.rig, some(truth.observations, 4, frames), QUICK)
        terms = fit.model.problem.terms(fit.result.state, jacobians=False)
        effects = []
        for usual in both:
            monkeypatch.setattr(uncertainty, "USUAL_EFFECT", usual)
            effects.append(uncertainty.design_effect(fit.model, fit.start.evidence, terms) / uncertainty.MODEL_EXCESS)
        shares.append(effects[1] - effects[0])
        assert frames > 30 or effects == pytest.approx(both)
    left = uncertainty.USUAL_COUNTS / shares[1] - uncertainty.USUAL_COUNTS
    assert shares[0] == pytest.approx(1.0)
    assert left == pytest.approx(round(left), abs=1e-6)
    # Four cameras, four people and eight stretches: fewer where somebody is out of view.
    assert 50 < left <= 2 * 4 * 4 * 8 - 2 * 4 * 8 - 6 * 4


@pytest.mark.slow
def test_sigmas_shrink_with_more_people_and_longer_scenes() -> None:
    truth, sigmas = simulated("terrace", seconds=20.0), []
    for people, frames in ((2, 50), (7, 50), (7, 100)):
        cameras = solve(truth.rig, some(truth.observations, people, frames), options=QUICK).figures.cameras
        sigmas.append(float(np.median([camera.shape_position_sigma_mm for camera in cameras])))
    assert sigmas[1] < 0.75 * sigmas[0]
    assert sigmas[2] < 0.9 * sigmas[1]


def placed(rig: Rig, truth: Rig) -> list[Pose]:
    """The estimate after the best turn about the vertical and shift along the ground."""
    fit = fit_plane_similarity(poses_of(rig)[1][:, :2], poses_of(truth)[1][:, :2], with_scale=False)
    turn = exp_rotation(np.array([0.0, 0.0, fit.yaw]))
    return [camera.pose.moved(turn, np.array([*fit.translation, 0.0])) for camera in rig]


@pytest.mark.slow
def test_errors_over_many_small_scenes_are_what_the_sigmas_say() -> None:
    """Neither too bold nor too timid. The people of a scene are taller or shorter than others by as much as groups are."""
    shape, metric, turned = [], [], []
    for seed in range(12):
        scene = simulated("terrace", seconds=5.0, seed=100 + seed)
        true_rig = scene.rig.moved(
            np.eye(3), np.zeros(3), float(np.exp(np.random.default_rng(seed).normal(0, POPULATION_BIAS)))
        )
        solution = solve(scene.rig, part(scene.observations), options=QUICK)
        found = compare(solution.rig, true_rig).similarity.position_mm
        shape += [found[camera.name] / camera.shape_position_sigma_mm for camera in solution.figures.cameras]
        for camera, pose, true in zip(solution.rig, placed(solution.rig, true_rig), true_rig, strict=True):
            metric.append(np.linalg.norm(pose.centre - true.centre) / camera.sigma.position_m)
            turned.append(np.degrees(angle_between(pose.R_cw, true.pose.R_cw)) / camera.sigma.orientation_deg)
    for ratio, least in ((shape, 0.4), (metric, 0.4), (turned, 0.15)):
        assert np.mean(np.array(ratio) < 3) > 0.95
        assert least < np.sqrt(np.mean(np.square(ratio))) < 1.4


RIG = ring(4)
PLACES = np.random.default_rng(3).uniform(-2.0, 2.0, (60, 2))
CENTRE_M, TURN_RAD = 0.03, 0.004


def covariance_of(n_cameras: int) -> Floats:
    """Of cameras that are off each for itself, with exact lenses."""
    one = np.zeros(uncertainty.COMPLETE)
    one[:3], one[3:6] = CENTRE_M**2, TURN_RAD**2
    return np.diag(np.tile(one, n_cameras))


def off(rig: Rig, rng: np.random.Generator) -> Rig:
    """A rig that is off by as much."""
    cameras = []
    for camera in rig:
        R = exp_rotation(TURN_RAD * rng.standard_normal((1, 3)))[0] @ camera.pose.R_cw
        cameras.append(replace(camera, pose=Pose.from_centre(R, camera.centre + CENTRE_M * rng.standard_normal(3))))
    return Rig(tuple(cameras))


def measured(rig: Rig, covariance: Floats | None = None, places: Floats = PLACES, seen: Bools | None = None, groups=()):
    """By cameras that see people at all places unless said otherwise."""
    covariance = covariance_of(len(rig)) if covariance is None else covariance
    seen = np.ones((len(rig), len(places)), dtype=bool) if seen is None else seen
    return measuring_uncertainty(rig, covariance, places, seen, 1.75, Free(), *([groups] if groups else []))


def test_cameras_measure_no_farther_than_people_were_that_they_saw() -> None:
    """People behind a wall are in their pictures by geometry alone; so far away, they would be measured poorly."""
    places = np.concatenate([PLACES, PLACES * 1.5 + (0.0, 12.0)])
    seen = np.arange(len(places)) < len(PLACES) * np.ones((4, 1))
    alone = measured(RIG)
    assert measured(RIG, places=places, seen=seen) == alone
    two = measured(RIG, places=places, seen=seen & [[1], [1], [0], [0]], groups=[(0, 1), (2, 3)])
    assert set(two.cameras) == {*RIG.names[:2]}
    assert measured(RIG, places=places).ground.p90_mm > 3 * alone.ground.p90_mm


def test_measuring_sigmas_are_those_of_rigs_that_are_off_by_as_much() -> None:
    found, rng = measured(RIG), np.random.default_rng(1)
    changes = [measure_change(RIG, off(RIG, rng), PLACES) for _ in range(60)]
    for kind in ("points", "ground"):
        distances = [getattr(one, kind) for one in changes if one is not None and getattr(one, kind)]
        rms = np.sqrt(np.mean([np.square(one.median_mm) for one in distances]))
        assert rms == pytest.approx(getattr(found, kind).median_mm, rel=0.25)


def test_points_that_only_cameras_at_one_place_see_are_not_measured() -> None:
    twice = Rig((RIG.cameras[0], replace(RIG.cameras[0], name="again")))
    assert measured(twice) is None
    assert 0 < measured(Rig((*twice.cameras, RIG.cameras[1]))).points.median_mm < 1000


def test_groups_measure_by_themselves_whatever_is_known_of_their_relative_pose() -> None:
    """The second pair of cameras is off by a metre as a whole."""
    shared = np.zeros((4, 4))
    shared[2:, 2:] = 1.0
    whole = covariance_of(4) + np.kron(shared, np.diag([1.0, 1.0, *np.zeros(uncertainty.COMPLETE - 2)]))
    groups = [(0, 1), (2, 3)]
    found = measured(RIG, whole, groups=groups)
    for group in groups:
        own = Rig(tuple(RIG.cameras[c] for c in group))
        alone = measured(own)
        for name in own.names:
            assert found.cameras[name].points.median_mm == pytest.approx(alone.cameras[name].points.median_mm, rel=1e-6)
    assert measured(RIG, whole).points.median_mm > 5 * found.points.median_mm
