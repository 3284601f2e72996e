"""Where a camera stood by people whose places are known: derivatives of what it sees, and a search without identities."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.calibration.diagnostics.correspondences import pose_residuals
from passerby.calibration.diagnostics.pose_change import LEAST_TOGETHER, MIDDLE_GAIN, _searched, best_stretch
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


def brute_stretch(costs: np.ndarray) -> float:
    """Least cost over all pairs of poses and all stretches, those in the middle with what they have to gain more."""
    n, count = costs.shape
    best = np.inf
    for a in range(n):
        for b in range(n):
            for first in range(count + 1 if a != b else 0):
                for last in range(first, count + 1):
                    middle = 0 < first < last < count
                    inside = costs[b, first:last].sum() - costs[a, first:last].sum() + 2 * MIDDLE_GAIN * middle
                    best = min(best, costs[a].sum() + inside)
    return float(best)


@pytest.mark.parametrize("seed", range(8))
def test_the_stretch_is_the_best_of_all_pairs_of_poses_and_all_stretches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = rng.uniform(0.0, 25.0, (3, 24))
    begin, end = sorted(rng.choice(25, 2, replace=False).tolist())
    costs[1, begin:end] *= 0.2
    main, other, stretch = best_stretch(costs)
    rows = np.flatnonzero(stretch)
    assert (np.diff(rows) == 1).all()
    middle = bool(len(rows)) and not stretch[0] and not stretch[-1]
    cost = np.where(stretch, costs[other], costs[main]).sum() + 2 * MIDDLE_GAIN * middle
    assert cost == pytest.approx(brute_stretch(costs))


@pytest.mark.parametrize(("begin", "end"), [(0, 8), (16, 24), (8, 16)])
def test_a_pose_that_fits_a_part_of_the_time_is_told_with_just_that_part(begin: int, end: int) -> None:
    costs = np.full((2, 24), 10.0)
    costs[0, begin:end], costs[1, begin:end] = 25.0, 1.0
    costs[1, :begin], costs[1, end:] = 25.0, 25.0
    main, other, stretch = best_stretch(costs, swap=False)
    assert (main, other, np.flatnonzero(stretch).tolist()) == (0, 1, list(range(begin, end)))
