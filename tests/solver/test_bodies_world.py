"""A rig of joints alone in the world of the bodies it sees: what bodies place, and what is left to what was measured."""

import numpy as np
import pytest

from passerby.solver.bodies_world import _placed
from passerby.solver.body_segments import GROUND_SD_M, HIP_SHARE, Bodies, BodyScale
from passerby.solver.body_vertical import BodyVertical
from passerby.solver.cue_terms import CueRows, WorldRows
from passerby.solver.people_state import AdjustmentState
from support.scenes.exact_sightings import poses_of
from support.scenes.people_and_rigs import ring

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
    assert found.centre[1, 2] == pytest.approx(3.0, abs=1e-6)  # the other is hardly known
    assert (world.scale_off, world.ground_sd_m) == (0.0, None)
    assert len(world.rows) == 3


@pytest.mark.parametrize("kind", ["lengths", "distances"])
def test_a_measured_length_keeps_the_size_of_the_rig_and_leaves_the_ground_to_hips(kind: str) -> None:
    found, world = placed(CueRows(**{kind: np.array([[2.0, 0.01]])}))
    by_hips = HALF * HIPS_M - HIP_SHARE * STATURE_M
    np.testing.assert_allclose(found.centre, state().centre - [0, 0, by_hips])
    assert (world.scale_off, world.ground_sd_m) == (pytest.approx(np.log(2.0)), GROUND_SD_M)


def test_without_a_scale_hips_tell_no_ground() -> None:
    found, world = placed(None, None)
    np.testing.assert_allclose(found.centre, state().centre)
    assert (world.trunk_m, world.people, world.ground_sd_m) == (None, 0, None)
    assert len(world.rows) == 2


def test_rows_hold_each_freedom_as_surely_as_bodies_do() -> None:
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
