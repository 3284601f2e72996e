"""Registrations by joints that contradict each other, and what they make of cameras and people."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import passerby.association.joints.joint_graph as joint_graph
from passerby.association.associate import Tracklets
from passerby.association.graph import ViewGraph
from passerby.association.joints.joint_pairs import JointRegistration, SamePerson
from passerby.association.joints.joint_tracks import joint_tracks
from passerby.calibration.calibrate import estimate_rig
from passerby.calibration.run import CalibrationRun
from passerby.common.progress import silent
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Clock, Keypoints, Observations
from passerby.evaluation.metrics import compare
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.solver.people import PeopleOptions
from support.scenes.people_on_spot import moving_on_spot, ring, seen
from support.tiers import thinned

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


def test_only_cameras_that_are_apart_and_may_share_ground_are_tried(monkeypatch):
    """Cameras 0 and 1 are of one group, 3 sees nobody's joints, and 2 is no candidate of 1."""
    tried = []
    monkeypatch.setattr(joint_graph, "register_joints", lambda a, b, *_: tried.append((a, b)))
    rng = np.random.default_rng(0)
    camera, joints = ring(1, rng).cameras[0], moving_on_spot(np.zeros((1, 2)), 0.5, 25.0, rng)
    found = joint_tracks(seen(camera, joints, rng).keypoints, camera.lens, Clock(25.0))
    nobody = joint_tracks(Keypoints.empty(), camera.lens, Clock(25.0))
    graph = ViewGraph((), ((0, 1), (2,), (3,), (4,)), np.zeros(5))
    for candidates, wanted in (
        (None, [(0, 2), (0, 4), (1, 2), (1, 4), (2, 4)]),
        ({(0, 1), (0, 2), (2, 3), (2, 4)}, [(0, 2), (2, 4)]),
    ):
        tried.clear()
        joint_graph.register_by_joints([found, found, found, nobody, found], graph, rng, None, silent, candidates)
        assert tried == wanted


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
    """A rig found from people nobody has identified."""
    observations = Observations(
        {
            camera.name: seen(camera, joints, rng, exchanged=camera.name in exchanged)
            for camera, joints in zip(rig, shown, strict=True)
        },
        25.0,
    )

    bare = Rig(tuple(Camera(camera.name, camera.lens) for camera in rig))
    cameras = {camera.name: {"keypoints": f"{camera.name}.json", "intrinsics": "rig.toml"} for camera in rig}
    scene = Scene.model_validate({"scene": {"name": "spot"}, "cameras": cameras, "association": {"mode": "combined"}})
    found = estimate_rig(CalibrationRun(scene, PeopleOptions()), SceneInputs(bare, observations, ()))
    return found.solution, found.association


@pytest.mark.slow
@thinned("exchanged", [(), ("C3",)], ids=["as they are", "left and right exchanged in C3"])
def test_a_rig_from_one_person_on_the_spot(exchanged):
    rng = np.random.default_rng(3)
    rig = ring(4, rng)
    joints = moving_on_spot(np.zeros((1, 2)), 4.0, 25.0, rng)
    solution, association = calibrated(rig, rng, [joints] * 4, exchanged)
    judged = compare(solution.rig, rig).similarity
    assert all(camera.pose is not None for camera in solution.rig)
    assert judged.mean_position_mm < 60
    assert judged.mean_orientation_deg < 1.0
    assert {pair.route for pair in association.figures.pairs} == {"joints"}
    assert "registered_by_keypoints" in [notice.code for notice in association.notices]


def test_cameras_that_see_different_people_on_the_spot_are_refused():
    rng = np.random.default_rng(4)
    rig = ring(2, rng)
    shown = [moving_on_spot(np.zeros((1, 2)), 4.0, 25.0, rng) for _ in rig]
    solution, association = calibrated(rig, rng, shown)
    assert solution.verdict == "refused"
    assert [(pair.route, pair.used) for pair in association.figures.pairs] in ([], [("joints", False)])
