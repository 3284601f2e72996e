"""Residuals of cues, floor plans and bodies: how a rig follows them, and what it would measure without those stated."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from passerby.core.scale_cues import FloorPlan, PlannedCamera, PlannedPoint
from passerby.geometry.plan_fit import ScalePrior
from passerby.geometry.rotations import exp_rotation
from passerby.geometry.triangulation import PointObservations, retract_poses
from passerby.people.model import GAIT_SHARE, Noise, Priors
from passerby.solver.bodies_world import _placed
from passerby.solver.body_segments import GROUND_SD_M, HIP_SHARE, Bodies, BodyScale
from passerby.solver.body_vertical import BodyVertical
from passerby.solver.cue_leverage import freed_measurements
from passerby.solver.cue_terms import CueRows, WorldRows
from passerby.solver.optimizer.least_squares import Layout, NormalEquations, Stopping, minimise
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.plan_rows import MEETS_GROUND, PlanRows, plan_rows
from support.scenes.exact_sightings import poses_of, standing
from support.scenes.people_and_rigs import ring

RIG, LAYOUT, UNIT = ring(4), Layout(4, 7, 1), 0.02
R, CENTRE = poses_of(RIG)
PAIR = (0, 2)
METRES = float(np.linalg.norm(CENTRE[PAIR[0]] - CENTRE[PAIR[1]]))


def exact(cues: CueRows | None, instants: int = 60) -> tuple[PeopleProblem, AdjustmentState]:
    """People of known heights, seen without any error: at the true state only cues have residuals."""
    rng = np.random.default_rng(0)
    person, heights = np.arange(instants) % 8, rng.normal(1.72, 0.06, 8)
    ground, high = rng.uniform(-2, 2, (instants, 2)), GAIT_SHARE * heights[np.arange(instants) % 8]
    sightings = replace(standing(RIG, ground, high), has_foot=np.zeros(4 * instants))
    unseen = PointObservations(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0))
    problem = PeopleProblem(
        4, sightings, unseen, person, 0, heights, np.full(8, 1e-4), np.ones(instants), Noise(loss=1e3),
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

    def freed(sd: float, cues: CueRows) -> np.ndarray:
        problem, state = exact(distance(1.0, sd))
        normal = NormalEquations(problem.layout, problem.terms(state, jacobians=True))
        return freed_measurements(cues, state, problem.layout, normal, 1.0)

    (metres, sigma), (others_metres, others_sigma) = (freed(sd, distance(1.0, sd))[0] for sd in (0.02, 0.2))
    assert (metres, others_metres) == pytest.approx((METRES, METRES))
    assert sigma == pytest.approx(others_sigma, rel=0.02)
    assert freed(1e-5, distance(1.0, 1e-5))[0, 1] == np.inf
    assert freed(1e-5, CueRows()).shape == (0, 2)


SPOTS = {"door": (1.5, -0.5), "drain": (-1.0, 1.8)}


def on_plan(xy: np.ndarray) -> tuple[float, float]:
    return float(xy[0] / UNIT), float(-xy[1] / UNIT)


def rows() -> PlanRows:
    """Two cameras and two points, each seen by three cameras, placed where they are."""
    cameras = tuple(PlannedCamera(name, on_plan(RIG[name].centre), 0.05) for name in ("C1", "C3"))
    points = tuple(
        PlannedPoint(
            name, on_plan(np.array(at)),
            {camera: tuple(RIG[camera].project(np.array([[*at, 0.0]]))[0]) for camera in ("C1", "C2", "C4")}, 0.05,
        )
        for name, at in SPOTS.items()
    )  # fmt: skip
    found = plan_rows(FloorPlan("plan", UNIT, 0.002, cameras, points), RIG)
    settled = found.settle(*poses_of(RIG), ScalePrior())
    assert settled.settled.used.all()
    return settled


def state_of(R: np.ndarray, centre: np.ndarray) -> AdjustmentState:
    return AdjustmentState(R, centre, np.zeros(4), np.zeros(1), np.zeros(0), np.zeros((0, 4)), np.zeros((0, 3)))


def residual(plan: PlanRows, state: AdjustmentState) -> float:
    (term,) = plan.terms(state, LAYOUT)
    return float(term.residual[0, 0])


def derivatives(plan: PlanRows, state: AdjustmentState) -> tuple[np.ndarray, np.ndarray]:
    """(4, 7) by cameras, as the term says and by central differences, the latter without slack."""
    (term,) = plan.terms(state, LAYOUT)
    steps = 1e-5 * np.eye(24).reshape(24, 4, 6)
    ends = [
        [residual(plan, state_of(*retract_poses(state.R, state.centre, sign * step))) for step in steps] for sign in (1, -1)
    ]
    return term.by_shared[0, 0, :28].reshape(4, 7), (np.subtract(*ends) / 2e-5).reshape(4, 6)


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.25])
def test_the_residual_is_how_much_larger_the_rig_is_than_its_plan(factor: float) -> None:
    turn = exp_rotation(np.array([0.0, 0.0, 0.7]))
    moved = state_of(R @ turn.T, factor * CENTRE @ turn.T + [30.0, -20.0, 0.0])
    plan = rows()
    assert residual(plan, moved) * plan.sigma == pytest.approx(np.log(factor), abs=1e-6)
    measured, stated = plan.span(moved.R, moved.centre)
    assert measured / stated == pytest.approx(factor)


def test_the_residual_follows_poses_as_its_derivatives_say() -> None:
    off = np.random.default_rng(0).normal(0, [0.01] * 3 + [0.1] * 3, (4, 6))
    found, expected = derivatives(rows(), state_of(*retract_poses(R, CENTRE, off)))
    np.testing.assert_allclose(found[:, :6], expected, rtol=1e-4, atol=1e-4)
    assert (found[:, 6] == 0).all()
    assert np.abs(found[[0, 1, 3]]).max(axis=1).min() > 0.1
    assert np.abs(found[2, :3]).max() == 0, "of the third camera the place alone is known"


def test_a_ray_that_has_come_to_look_up_still_follows_its_camera() -> None:
    """As if it fell as little as rays do that meet the ground; on the plan it stays where it was."""
    plan = rows()
    up = R.copy()
    up[1] = exp_rotation(np.array([-0.6, 0.0, 0.0])) @ R[1]
    rays = np.einsum("nij,ni->nj", up[plan.rays.camera], plan.rays.bearing)
    assert (rays[plan.rays.camera == 1, 2] > -MEETS_GROUND).all()
    state = state_of(up, CENTRE)
    found, expected = derivatives(plan, state)
    np.testing.assert_allclose(found[1, 3:6], expected[1, 3:], rtol=1e-3, atol=1e-3)
    assert not plan.placements(up, CENTRE).sound[2 + np.flatnonzero(plan.rays.camera == 1)].any()


def test_a_plan_whose_unit_is_quite_wrong_fixes_no_scale() -> None:
    """Feet for metres: people who are known to a few per cent would have to be three times as tall."""
    plan = rows()
    known = ScalePrior(0.0, 0.05)
    for factor, wrong in ((1.05, False), (3.3, True), (1 / 3.3, True)):
        settled = replace(plan, settled=None).settle(R, factor * CENTRE, known)
        assert (settled.settled.wrong_unit is not None) == wrong
        assert np.isinf(settled.sigma) == wrong
        assert len(settled.terms(state_of(R, factor * CENTRE), LAYOUT)) == 1 - wrong


HALF, FLOOR_M, STATURE_M = 0.5, -0.6, 1.7
"""The rig's own unit is two metres; the floor lies a little below its origin."""
HIPS_M = FLOOR_M + HIP_SHARE * STATURE_M
BODIES = Bodies(np.zeros(8, int), np.arange(8), np.tile([[[1.0, 0.1, HALF * HIPS_M], [1.0, -0.1, HALF * HIPS_M]]], (8, 1, 1)),
                ("left_hip", "right_hip"))  # fmt: skip
DOUBLED = BodyScale(np.log(2.0), 0.1, 1, ("trunks",))
UPRIGHT = BodyVertical(np.array([0.0, 0.0, 1.0]), np.diag([1e-3, 4e-3]), np.eye(3)[:2], ("trunks",))


def state() -> AdjustmentState:
    """Three cameras and a joint, in the rig's own unit."""
    R, centre = poses_of(ring(3))
    joint = np.array([[1.0, 0.0, 0.5]])
    return AdjustmentState(R, HALF * centre, np.zeros(3), np.zeros(1), np.zeros(0), np.zeros((0, 4)), joint)


def placed(rows: CueRows | None, scale: BodyScale | None = DOUBLED) -> tuple[AdjustmentState, WorldRows]:
    return _placed(state(), np.arange(3), rows, BODIES, scale, UPRIGHT, np.zeros(1, int), np.array([STATURE_M]))


def test_the_height_of_a_camera_replaces_the_hips_and_leaves_the_scale_to_bodies() -> None:
    heights = CueRows(height_of=np.array([1, 2]), heights=np.array([[3.0, 0.01], [9.0, 1e3]]))
    found, world = placed(heights)
    apart = state().centre / HALF
    np.testing.assert_allclose(found.centre[1:] - found.centre[:1], apart[1:] - apart[:1])
    assert found.centre[1, 2] == pytest.approx(3.0, abs=1e-6)  # the other is next to unknown
    assert (world.scale_off, world.ground_sd_m) == (0.0, None)
    assert len(world.rows) == 3


@pytest.mark.parametrize("kind", ["lengths", "distances"])
def test_a_measured_length_keeps_the_size_of_the_rig_and_leaves_the_ground_to_hips(kind: str) -> None:
    found, world = placed(CueRows(**{kind: np.array([[2.0, 0.01]])}))
    by_hips = HALF * HIPS_M - HIP_SHARE * STATURE_M
    np.testing.assert_allclose(found.centre, state().centre - [0, 0, by_hips])
    assert (world.scale_off, world.ground_sd_m) == (pytest.approx(np.log(2.0)), GROUND_SD_M)


def test_rows_hold_each_freedom_as_surely_as_bodies_do_and_without_a_scale_hips_tell_no_ground() -> None:
    """A rig that grows, rises or tilts by one sigma has a residual of one."""
    found, world = placed(None)
    np.testing.assert_allclose(found.centre, state().centre / HALF - [0, 0, FLOOR_M])
    np.testing.assert_allclose(found.joints, state().joints / HALF - [0, 0, FLOOR_M])
    assert (world.people, world.scale_off, world.ground_sd_m) == (1, 0.0, GROUND_SD_M)
    middle = found.centre.mean(axis=0)
    grown, risen = found.centre + DOUBLED.sd * (found.centre - middle), found.centre + [0, 0, GROUND_SD_M]
    still = np.zeros((3, 3))
    off = [world.rows @ np.concatenate([centre - found.centre, still], axis=1).ravel() for centre in (grown, risen)]
    np.testing.assert_allclose(off, [[1, 0, 0, 0], [0, 0, 0, 1]], atol=1e-9)
    # Up tilts along x where the world turns about y.
    for axis, sd in ((1, np.sqrt(1e-3)), (0, np.sqrt(4e-3))):
        turn = sd * np.eye(3)[axis]
        tilted = np.cross(turn, found.centre - middle)
        residual = world.rows @ np.concatenate([tilted, -found.R @ turn], axis=1).ravel()
        assert np.linalg.norm(residual) == pytest.approx(1.0)
    found, world = placed(None, None)
    np.testing.assert_allclose(found.centre, state().centre)
    assert (world.trunk_m, world.people, world.ground_sd_m) == (None, 0, None)
    assert len(world.rows) == 2
