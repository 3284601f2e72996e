"""Cameras registered by joints of people who move on the spot, and by nothing that only looks alike."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import passerby.association.joints.joint_graph as joint_graph
from passerby.association.associate import Tracklets
from passerby.association.graph import ViewGraph
from passerby.association.joints.joint_pairs import JointRegistration, SamePerson, register_joints
from passerby.association.joints.joint_tracks import GRID_S, joint_tracks, mirrored_order, swap_left_and_right
from passerby.calibration.calibrate import estimate_rig
from passerby.calibration.run import CalibrationRun
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import BODY_17, Clock, Keypoints, Observations
from passerby.evaluation.metrics import compare
from passerby.geometry.rotations import angle_between, direction_angle
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.solver.people import PeopleOptions
from support.scenes.people_on_spot import moving_on_spot, ring, seen
from support.tiers import thinned

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


def test_tracklets_are_kept_apart_and_whole_and_gaps_stay() -> None:
    a, b, nobody = moving(np.arange(1, 30), 0), moving(np.arange(10, 50), 3), moving(np.arange(1, 9), -1)
    tracks = joint_tracks(together(b, nobody, a), LENS, Clock(25.0))
    assert set(tracks.tracklet.tolist()) == {0, 3}
    assert len(tracks.step[tracks.rows(0)]) == len(joint_tracks(a, LENS, Clock(25.0)))
    assert (tracks.rows(1).start, len(joint_tracks(Keypoints.empty(), LENS, Clock(25.0)))) == (tracks.rows(1).stop, 0)
    seconds = joint_tracks(moving([1, 2, 3, 50, 51]), LENS, Clock(25.0)).step * GRID_S
    assert not ((seconds > 2.1 / 25) & (seconds < 48.9 / 25)).any()


def test_left_and_right_change_sides_in_the_named_tracklets_only():
    order = mirrored_order(BODY_17)
    assert ([BODY_17[k] for k in order[5:7]], order[0]) == (["right_shoulder", "left_shoulder"], 0)
    both = together(moving([1, 2], 0), moving([1, 2], 1))
    fixed = swap_left_and_right(both, np.array([False, True]))
    np.testing.assert_array_equal(fixed.xy, np.concatenate([both.xy[:2], both.xy[2:][:, order]]))


ONE, TWO, THREE = (np.array([[0.0, 0.0], *more]) for more in ([], [[1.2, 0.3]], [[1.2, 0.3], [-0.6, 1.1]]))
FPS = 25.0


def tracks_of(camera, joints, rng, **how):
    return joint_tracks(seen(camera, joints, rng, **how).keypoints, camera.lens, Clock(FPS))


def two_views(seed, places, *, strangers=False, moving=1.0, seconds=3.0, exchanged=False, late_frames=0, noise=None):
    """The registration of two cameras a quarter of a circle apart, and its true rotation and baseline."""
    rng = np.random.default_rng(seed)
    first, second, *_ = ring(4, rng)
    joints = moving_on_spot(places, seconds + 1.0, FPS, rng, moving=moving)
    others = moving_on_spot(places, seconds + 1.0, FPS, rng, moving=moving) if strangers else joints
    n = round(seconds * FPS)
    shown = (first, joints[:n], False), (second, others[late_frames : late_frames + n], exchanged)
    kept = {} if noise is None else {"noise": noise}
    tracks = [tracks_of(camera, own, rng, exchanged=swap, **kept) for camera, own, swap in shown]
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


@pytest.mark.slow
def test_strangers_are_never_joined():
    cases = [(seed, ONE, moving) for seed in range(7) for moving in (0.0, 0.3, 1.0)] + [(7, THREE, 0.3), (8, THREE, 1.0)]
    joined = [case for case in cases if two_views(case[0], case[1], strangers=True, moving=case[2], seconds=2.0)[0].used]
    assert not joined


@pytest.mark.parametrize("places", [ONE, THREE], ids=["one person", "three people"])
def test_people_who_stand_still_prove_nothing(places):
    """Their joints fit well, but a moment later just as well; so would those of anybody who stands alike."""
    found, _, _ = two_views(0, places, moving=0.0)
    assert not found.used
    assert found.gain < 0.2


def test_a_frozen_picture_and_clocks_that_differ_prove_nothing():
    """The joints fit as perfectly at any delay, so that there is no misfit to take away."""
    found, _, _ = two_views(0, ONE, moving=0.0, noise=0.0)
    assert (found.score, found.used) == (pytest.approx(1.0), False)
    assert not two_views(0, ONE, late_frames=20)[0].used


def test_people_are_mirrored_whose_left_and_right_are_exchanged_in_one_camera():
    """One person alone, then one of two, as a detector does with a person who is seen from behind."""
    found, R_ba, _ = two_views(0, ONE, exchanged=True)
    assert found.used
    assert [person.mirrored for person in found.people] == [True]
    assert np.degrees(angle_between(found.R_ba, R_ba)) < 8
    rng = np.random.default_rng(2)
    first, second, *_ = ring(4, rng)
    joints = moving_on_spot(TWO, 3.0, FPS, rng)
    here, plain, exchanged = (
        tracks_of(camera, joints, np.random.default_rng(7), exchanged=swap)
        for camera, swap in ((first, False), (second, False), (second, True))
    )
    for number in (0, 1):
        other = plain.tracklet == number
        rays = np.where(other[:, None, None], exchanged.rays, plain.rays)
        mixed = replace(plain, rays=rays, found=np.where(other[:, None], exchanged.found, plain.found))
        found = register_joints(0, 1, here, mixed, np.random.default_rng(0))
        assert {person.j: person.mirrored for person in found.people} == {number: True, 1 - number: False}


def test_the_same_seed_gives_the_same_bits():
    (one, _, _), (two, _, _) = two_views(1, ONE), two_views(1, ONE)
    np.testing.assert_array_equal(one.R_ba, two.R_ba)
    assert (one.score, one.gain, one.runner_up) == (two.score, two.gain, two.runner_up)


TURNS = Rotation.random(4, random_state=5).as_matrix()


def registration(a, b, *, gain=0.8, wrong=None, mirrored=False, lag_s=0.0):
    R_ba = TURNS[b] @ TURNS[a].T if wrong is None else Rotation.from_rotvec(wrong).as_matrix() @ TURNS[b] @ TURNS[a].T
    people = (SamePerson(0, 0, mirrored, 0.9, 3.0),)
    return JointRegistration(a, b, R_ba, np.array([1.0, 0, 0]), 0.9, gain, 0.0, people, 100, lag_s, used=True)


# Two pairs are sure, then what joins them, and last what closes the loop.
LOOP = [registration(0, 1, gain=0.9), registration(2, 3, gain=0.85), registration(1, 2), registration(0, 3, gain=0.6)]


WRONG = {"wrong": [0.0, 1.5, 0.0]}


@pytest.mark.parametrize(
    ("given", "used"),
    [
        (LOOP, [True] * 4),
        (LOOP[::-1], [True] * 4),
        # Contradicts better ones.
        ([registration(*two) for two in ((0, 1), (1, 2), (2, 3), (0, 2))] + [registration(0, 3, gain=0.55, **WRONG)],
         [True, True, True, True, False]),
        # Of two equally good neither is believed.
        ([registration(0, 1, gain=0.7), registration(1, 2), registration(0, 2, gain=0.69, **WRONG)], [False, True, False]),
    ],
)  # fmt: skip
def test_registrations_that_contradict_better_or_equal_ones_are_dropped(given, used):
    assert [one.used for one in joint_graph.consistent_registrations(given, 4)] == used


def test_groups_that_joints_join_bring_their_clocks():
    apart = ViewGraph((), ((0, 1), (2, 3)), np.array([0.0, 0.5, 0.0, -1.0]))
    graph = joint_graph.add_joint_edges(apart, [registration(1, 3, lag_s=0.3)])
    assert graph.groups == ((0, 1, 2, 3),)
    # Both see one event: time_3 = time_1 + lag, and time + offset is the same.
    assert graph.offset_s[1] == pytest.approx(graph.offset_s[3] + 0.3)
    np.testing.assert_allclose(graph.offset_s[[0, 1]], [0.0, 0.5])
    assert graph.offset_s[2] - graph.offset_s[3] == pytest.approx(1.0)
    assert joint_graph.add_joint_edges(apart, [replace(registration(1, 3), used=False)]) is apart


def test_the_tracklet_with_left_and_right_exchanged_is_the_odd_one():
    tracklets = Tracklets(np.arange(5), np.zeros(4), np.ones(4), (np.zeros(0, np.int64), np.zeros(0, np.int64)))
    found = [registration(0, 1, mirrored=True), registration(1, 2, mirrored=True), registration(2, 3)]
    assert joint_graph.find_mirrored_tracklets(tracklets, found).tolist() == [False, True, False, False]


def calibrated(rig, rng, shown, exchanged=()):
    """A rig found from people whose identities are unknown."""
    cameras = zip(rig, shown, strict=True)
    found = {camera.name: seen(camera, own, rng, exchanged=camera.name in exchanged) for camera, own in cameras}
    bare = Rig(tuple(Camera(camera.name, camera.lens) for camera in rig))
    files = {camera.name: {"keypoints": f"{camera.name}.json", "intrinsics": "rig.toml"} for camera in rig}
    scene = Scene.model_validate({"scene": {"name": "spot"}, "cameras": files, "association": {"mode": "combined"}})
    estimate = estimate_rig(CalibrationRun(scene, PeopleOptions()), SceneInputs(bare, Observations(found, FPS), ()))
    return estimate.solution, estimate.association


@pytest.mark.slow
@thinned("exchanged", [(), ("C3",)], ids=["as they are", "left and right exchanged in C3"])
def test_a_rig_from_one_person_on_the_spot(exchanged):
    rng = np.random.default_rng(3)
    rig = ring(4, rng)
    joints = moving_on_spot(np.zeros((1, 2)), 4.0, 25.0, rng)
    solution, association = calibrated(rig, rng, [joints] * 4, exchanged)
    error = compare(solution.rig, rig).similarity
    assert all(camera.pose is not None for camera in solution.rig)
    assert error.mean_position_mm < 60
    assert error.mean_orientation_deg < 1.0
    assert {pair.route for pair in association.figures.pairs} == {"joints"}
    assert "registered_by_keypoints" in [notice.code for notice in association.notices]


def test_cameras_that_see_different_people_on_the_spot_are_refused():
    rng = np.random.default_rng(4)
    rig = ring(2, rng)
    shown = [moving_on_spot(np.zeros((1, 2)), 4.0, 25.0, rng) for _ in rig]
    solution, association = calibrated(rig, rng, shown)
    assert solution.verdict == "refused"
    assert [(pair.route, pair.used) for pair in association.figures.pairs] in ([], [("joints", False)])
