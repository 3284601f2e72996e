"""Where a camera stood by people whose places are known: derivatives of what it sees, and a search without identities."""

from __future__ import annotations

import numpy as np

from passerby.calibration.diagnostics.correspondences import pose_residuals
from passerby.calibration.diagnostics.pose_change import LEAST_TOGETHER, _searched
from passerby.core.cameras import Pose
from passerby.geometry.rotations import angle_between, exp_rotation
from support.scenes.sightings_of_places import MOVED, PEOPLE, POSE, seen


def test_derivatives_by_the_pose_are_those_of_the_residuals() -> None:
    """By a rotation vector in the camera's frame, then the centre."""
    m, step = seen(POSE, count=40), 1e-6
    pairs = np.arange(len(m.row))
    by_pose = pose_residuals(m, MOVED, pairs)[2]
    for unknown, axis in enumerate(np.eye(6)):
        ends = []
        for sign in (-1.0, 1.0):
            turn, shift = exp_rotation(sign * step * axis[:3]), sign * step * axis[3:]
            ends.append(pose_residuals(m, Pose.from_centre(turn @ MOVED.R_cw, MOVED.centre + shift), pairs)[0])
        np.testing.assert_allclose(by_pose[:, :, unknown], (ends[1] - ends[0]) / (2 * step), rtol=1e-5, atol=1e-3)


def test_a_camera_that_was_turned_is_found_by_the_way_of_one_tracklet_whatever_its_number() -> None:
    far = Pose.from_centre(exp_rotation(np.array([0.1, 0.5, 0.1])) @ POSE.R_cw, POSE.centre)
    for number in (0, 7):
        part = seen(POSE, count=PEOPLE * 3 * LEAST_TOGETHER, noise=0.2, tracklet={2: number})
        assert min(np.degrees(angle_between(one.R_cw, POSE.R_cw)) for one in _searched(part, far)) < 0.5
