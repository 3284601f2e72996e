"""A floor plan as one residual: how much larger the rig is than its plan, and how that follows the cameras."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.scale_cues import FloorPlan, PlannedCamera, PlannedPoint
from passerby.geometry.plan_fit import ScalePrior
from passerby.geometry.rotations import exp_rotation
from passerby.geometry.triangulation import retract_poses
from passerby.solver.optimizer.least_squares import Layout
from passerby.solver.people_state import AdjustmentState
from passerby.solver.plan_rows import MEETS_GROUND, PlanRows, plan_rows
from support.scenes.exact_sightings import poses_of
from support.scenes.people_and_rigs import ring

RIG, LAYOUT, UNIT = ring(4), Layout(4, 7, 1), 0.02
SPOTS = {"door": (1.5, -0.5), "drain": (-1.0, 1.8)}


def on_plan(xy: np.ndarray) -> tuple[float, float]:
    return float(xy[0] / UNIT), float(-xy[1] / UNIT)


def rows() -> PlanRows:
    """Two cameras and two points, each of which three cameras see, placed where they are."""
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
    R, centre = poses_of(RIG)
    turn = exp_rotation(np.array([0.0, 0.0, 0.7]))
    moved = state_of(R @ turn.T, factor * centre @ turn.T + [30.0, -20.0, 0.0])
    plan = rows()
    assert residual(plan, moved) * plan.sigma == pytest.approx(np.log(factor), abs=1e-6)
    measured, stated = plan.span(moved.R, moved.centre)
    assert measured / stated == pytest.approx(factor)


def test_the_residual_follows_poses_as_its_derivatives_say() -> None:
    off = np.random.default_rng(0).normal(0, [0.01] * 3 + [0.1] * 3, (4, 6))
    found, expected = derivatives(rows(), state_of(*retract_poses(*poses_of(RIG), off)))
    np.testing.assert_allclose(found[:, :6], expected, rtol=1e-4, atol=1e-4)
    assert (found[:, 6] == 0).all()
    assert np.abs(found[[0, 1, 3]]).max(axis=1).min() > 0.1
    assert np.abs(found[2, :3]).max() == 0, "of the third camera the place alone is known"


def test_a_ray_that_has_come_to_look_up_still_follows_its_camera() -> None:
    """As if it fell as little as rays do that meet the ground; on the plan it stays where it was."""
    plan = rows()
    R, centre = poses_of(RIG)
    up = R.copy()
    up[1] = exp_rotation(np.array([-0.6, 0.0, 0.0])) @ R[1]
    rays = np.einsum("nij,ni->nj", up[plan.rays.camera], plan.rays.bearing)
    assert (rays[plan.rays.camera == 1, 2] > -MEETS_GROUND).all()
    state = state_of(up, centre)
    found, expected = derivatives(plan, state)
    np.testing.assert_allclose(found[1, 3:6], expected[1, 3:], rtol=1e-3, atol=1e-3)
    assert not plan.placements(up, centre).sound[2 + np.flatnonzero(plan.rays.camera == 1)].any()


def test_a_plan_whose_unit_is_quite_wrong_fixes_no_scale() -> None:
    """Feet for metres: people who are known to a few per cent would have to be three times as tall."""
    plan = rows()
    R, centre = poses_of(RIG)
    known = ScalePrior(0.0, 0.05)
    for factor, wrong in ((1.05, False), (3.3, True), (1 / 3.3, True)):
        settled = replace(plan, settled=None).settle(R, factor * centre, known)
        assert (settled.settled.wrong_unit is not None) == wrong
        assert np.isinf(settled.sigma) == wrong
        assert len(settled.terms(state_of(R, factor * centre), LAYOUT)) == 1 - wrong
