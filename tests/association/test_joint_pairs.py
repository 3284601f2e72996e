"""Two cameras are registered by joints of people who move on the spot, and by nothing that only looks alike."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.joints import joint_pairs
from passerby.association.joints.joint_pairs import register_joints
from passerby.association.joints.joint_tracks import joint_tracks
from passerby.core.observations import Clock
from passerby.geometry.rotations import angle_between, direction_angle, exp_rotation
from support.scenes.people_on_spot import moving_on_spot, ring, seen

ONE = np.array([[0.0, 0.0]])
THREE = np.array([[0.0, 0.0], [1.2, 0.3], [-0.6, 1.1]])
FPS = 25.0


def two_views(seed, places, *, strangers=False, moving=1.0, seconds=3.0, exchanged=False, late_frames=0, noise=None):
    """The registration of two cameras a quarter of a circle apart, and its true rotation and baseline."""
    rng = np.random.default_rng(seed)
    first, second, *_ = ring(4, rng)
    joints = moving_on_spot(places, seconds + 1.0, FPS, rng, moving=moving)
    others = moving_on_spot(places, seconds + 1.0, FPS, rng, moving=moving) if strangers else joints
    n = round(seconds * FPS)
    shown = (first, joints[:n], False), (second, others[late_frames : late_frames + n], exchanged)
    kept = {} if noise is None else {"noise": noise}
    tracks = [
        joint_tracks(seen(camera, own, rng, exchanged=swap, **kept).keypoints, camera.lens, Clock(FPS))
        for camera, own, swap in shown
    ]
    R_ba = second.pose.R_cw @ first.pose.R_cw.T
    return register_joints(0, 1, *tracks, np.random.default_rng(seed)), R_ba, second.pose.t_cw - R_ba @ first.pose.t_cw


@pytest.mark.slow
@pytest.mark.parametrize("places", [ONE, THREE], ids=["one person", "three people"])
def test_people_who_move_on_the_spot_register_two_cameras(places):
    for seed in range(3):
        found, R_ba, t_ba = two_views(seed, places)
        assert found.used
        assert np.degrees(angle_between(found.R_ba, R_ba)) < 8
        assert np.degrees(direction_angle(found.t_ba, t_ba)) < 5
        assert len(found.people) == len(places)
        assert not any(person.mirrored for person in found.people)


def test_left_and_right_exchanged_in_one_camera_are_told():
    found, R_ba, _ = two_views(0, ONE, exchanged=True)
    assert found.used
    assert [person.mirrored for person in found.people] == [True]
    assert np.degrees(angle_between(found.R_ba, R_ba)) < 8


@pytest.mark.slow
def test_strangers_are_never_joined():
    cases = [(seed, ONE, moving) for seed in range(7) for moving in (0.0, 0.3, 1.0)] + [(7, THREE, 0.3), (8, THREE, 1.0)]
    joined = [case for case in cases if two_views(case[0], case[1], strangers=True, moving=case[2], seconds=2.0)[0].used]
    assert not joined


@pytest.mark.parametrize("places", [ONE, THREE], ids=["one person", "three people"])
def test_who_stands_still_proves_nothing(places):
    """His joints fit well, but a moment later just as well; so would those of anybody who stands alike."""
    found, _, _ = two_views(0, places, moving=0.0)
    assert not found.used
    assert found.gain < 0.2


def test_a_frozen_picture_and_clocks_that_differ_prove_nothing():
    """The joints fit as perfectly at any delay, so that there is no misfit to take away."""
    found, _, _ = two_views(0, ONE, moving=0.0, noise=0.0)
    assert (found.score, found.used) == (pytest.approx(1.0), False)
    assert not two_views(0, ONE, late_frames=20)[0].used


@pytest.mark.parametrize(
    ("turn_deg", "baseline", "contradicts"),
    [(40, (1, 0, 0), True), (0, (0, 1, 0), True), (0, (np.cos(np.radians(40)), np.sin(np.radians(40)), 0), True),
     (1, (1, 0.02, 0), False)],
    ids=["turned", "moved", "aside", "near"],
)  # fmt: skip
def test_hypotheses_contradict_each_other_by_rotation_or_by_baseline(turn_deg, baseline, contradicts):
    fit = joint_pairs._Fit(0, 0, False, np.eye(3), np.array([1.0, 0.0, 0.0]), 0.9)
    other = replace(fit, R_ba=exp_rotation(np.radians([0, turn_deg, 0])), t_ba=np.array(baseline))
    assert joint_pairs._contradict(other, fit) == contradicts


def test_each_person_is_told_as_mirrored_where_left_and_right_are_exchanged():
    """Of two people only one is exchanged in the second camera, as a detector does with one who is seen from behind."""
    rng = np.random.default_rng(2)
    first, second, *_ = ring(4, rng)
    joints = moving_on_spot(np.array([[0.0, 0.0], [1.2, 0.3]]), 3.0, FPS, rng)
    plain, exchanged = (
        [joint_tracks(seen(camera, joints, np.random.default_rng(7), exchanged=swap).keypoints, camera.lens, Clock(FPS))
         for camera in (first, second)]
        for swap in (False, True)
    )  # fmt: skip
    for number in (0, 1):
        other = plain[1].tracklet == number
        mixed = replace(plain[1], rays=np.where(other[:, None, None], exchanged[1].rays, plain[1].rays),
                        found=np.where(other[:, None], exchanged[1].found, plain[1].found))  # fmt: skip
        found = register_joints(0, 1, plain[0], mixed, np.random.default_rng(0))
        assert {person.j: person.mirrored for person in found.people} == {number: True, 1 - number: False}


def test_the_same_seed_gives_the_same_bits():
    (one, _, _), (two, _, _) = two_views(1, ONE), two_views(1, ONE)
    np.testing.assert_array_equal(one.R_ba, two.R_ba)
    assert (one.score, one.gain, one.runner_up) == (two.score, two.gain, two.runner_up)
