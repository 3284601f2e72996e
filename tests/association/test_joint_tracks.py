"""Joints on the common grid of time."""

import numpy as np
import pytest

from passerby.association.joints.joint_tracks import GRID_S, joint_tracks, mirrored_order, swap_left_and_right
from passerby.core.cameras import Lens
from passerby.core.observations import BODY_17, Clock, Keypoints

LENS = Lens((640, 480), np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5))


def moving(frames, identity=0, score=0.9):
    """A body that moves one pixel to the right every frame."""
    frames = np.asarray(frames)
    shape = np.column_stack([np.linspace(0, 30, 17), np.linspace(0, 150, 17)]) + [200.0, 100.0]
    xy = shape + np.stack([frames, np.zeros(len(frames))], axis=-1)[:, None]
    return Keypoints(frames, np.full(len(frames), identity), xy, np.full((len(frames), 17), score))


def together(*parts):
    columns = ("frame", "identity", "xy", "score")
    return Keypoints(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))


@pytest.mark.parametrize("fps", [8.0, 25.0, 60.0])
def test_joints_are_where_they_were_at_each_grid_time(fps):
    tracks = joint_tracks(moving(np.arange(1, 61)), LENS, Clock(fps))
    assert len(tracks) == np.floor(59 / fps / GRID_S + 1e-9) + 1
    np.testing.assert_array_equal(np.diff(tracks.step), 1)
    frame = tracks.step * GRID_S * fps + 1
    pixel = LENS.project_rays(tracks.rays[:, 0])
    np.testing.assert_allclose(pixel, np.column_stack([200 + frame, np.full(len(frame), 100.0)]), atol=1e-6)


def test_nobody_is_carried_over_a_gap():
    tracks = joint_tracks(moving([1, 2, 3, 50, 51]), LENS, Clock(25.0))
    seconds = tracks.step * GRID_S
    assert not ((seconds > 2.1 / 25) & (seconds < 48.9 / 25)).any()


def test_tracklets_are_kept_apart_and_nobody_is_left_out():
    a, b, nobody = moving(np.arange(1, 30), 0), moving(np.arange(10, 50), 3), moving(np.arange(1, 9), -1)
    tracks = joint_tracks(together(b, nobody, a), LENS, Clock(25.0))
    assert set(tracks.tracklet.tolist()) == {0, 3}
    assert len(tracks.step[tracks.rows(0)]) == len(joint_tracks(a, LENS, Clock(25.0)))
    assert (tracks.rows(1).start, len(joint_tracks(Keypoints.empty(), LENS, Clock(25.0)))) == (tracks.rows(1).stop, 0)


def test_a_joint_is_found_where_both_neighbours_have_it():
    score = np.full((39, 17), 0.9)
    score[20, 5] = 0.1
    tracks = joint_tracks(moving(np.arange(1, 40), score=score), LENS, Clock(25.0))
    lost = tracks.step[~tracks.found[:, 5]] * GRID_S * 25 + 1
    assert len(lost)
    assert (np.abs(lost - 21) < 1).all()
    assert tracks.found[:, 6].all()


def test_left_and_right_change_sides_in_the_named_tracklets_only():
    order = mirrored_order(BODY_17)
    assert ([BODY_17[k] for k in order[5:7]], order[0]) == (["right_shoulder", "left_shoulder"], 0)
    both = together(moving([1, 2], 0), moving([1, 2], 1))
    fixed = swap_left_and_right(both, np.array([False, True]))
    np.testing.assert_array_equal(fixed.xy, np.concatenate([both.xy[:2], both.xy[2:][:, order]]))
