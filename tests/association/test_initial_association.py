"""What the registrations of the ground say of cameras in space, and which pairs are searched for what."""

import numpy as np
import pytest

from passerby.association.graph import Edge
from passerby.association.ground.registration import Registration
from passerby.association.initial_association import _hypothesis
from passerby.core.cameras import Pose
from passerby.geometry.rotations import angle_between
from passerby.geometry.single_view import Level
from support.scenes.people_and_rigs import looking_at

POSES = looking_at((9.0, -3.0, 3.0), (0.0, 0.0, 1.0)), looking_at((-2.0, -8.0, 5.5), (0.5, 0.0, 0.5))


def own_level(pose: Pose, scale: float) -> Level:
    """The camera above its own ground, in metres of its own that are `scale` to a true one."""
    return Level(pose.R_cw[:, 2], scale * float(pose.centre[2]), 0.0)


def own_ground(pose: Pose, scale: float) -> tuple[complex, complex]:
    """The camera's ground is `turn * world + shift`, x + iy."""
    axes = own_level(pose, scale).R_lc @ pose.R_cw
    turn = scale * complex(axes[0, 0], axes[1, 0])
    return turn, -turn * complex(*pose.centre[:2])


@pytest.mark.parametrize("scales", [(1.0, 1.0), (1.2, 1.2), (0.9, 1.15)])
def test_the_motion_of_the_grounds_is_that_of_the_cameras_in_space(scales: tuple[float, float]) -> None:
    """The baseline is in metres between the two cameras' own."""
    (a, b), levels = POSES, [own_level(pose, scale) for pose, scale in zip(POSES, scales, strict=True)]
    (turn_a, shift_a), (turn_b, shift_b) = (own_ground(pose, scale) for pose, scale in zip(POSES, scales, strict=True))
    none, turn = np.zeros(0, np.int64), turn_b / turn_a
    guess = Registration(turn, shift_b - turn * shift_a, 0.0, 100.0, 80, 0.7, 0j, none, none, np.zeros(0))
    edge = Edge(0, 1, guess, 0.2, 0.9, True)
    found = _hypothesis(edge, *levels)
    R_ba = b.R_cw @ a.R_cw.T
    assert angle_between(found.R_ba, R_ba) < 1e-6
    np.testing.assert_allclose(found.t_ba, np.sqrt(scales[0] * scales[1]) * (b.t_cw - R_ba @ a.t_cw), atol=1e-9)
    assert _hypothesis(edge, levels[0], None) is None
