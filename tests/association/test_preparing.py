"""What association starts from, against the truth of simulated cameras."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.camera_tracklets import CameraTracklets, build_camera_tracklets, build_tracklets, earlier_tracklets
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.simulation import SimulatedScene
from support.scenes.people_and_rigs import simulated

FPS = 5.0


@pytest.fixture(scope="module")
def scene() -> SimulatedScene:
    return simulated("terrace", 20.0, 5, people=6)


def seen(scene: SimulatedScene, *, boxes: bool = True, joints: bool = True) -> CameraObservations:
    """By the first camera, with true identities."""
    found = scene.observations[scene.rig.names[0]]
    return CameraObservations(found.boxes if boxes else Boxes.empty(), found.keypoints if joints else Keypoints.empty())


def nameless(found: CameraObservations) -> CameraObservations:
    return CameraObservations(*(replace(own, identity=np.full(len(own), UNKNOWN)) for own in (found.boxes, found.keypoints)))


def prepared(scene: SimulatedScene, found: CameraObservations, *, given: bool = False) -> CameraTracklets:
    camera = replace(scene.rig.cameras[0], pose=None)
    return build_camera_tracklets(camera, found, Clock(FPS), 1.72, np.random.default_rng(0), given=given)


def assert_people(tracklet: np.ndarray, truth: np.ndarray, least: float) -> None:
    """Each tracklet shows one person, and nearly everybody is in one."""
    known = tracklet > UNKNOWN
    assert known.mean() > least
    pure = sum(np.bincount(truth[tracklet == number]).max() for number in np.unique(tracklet[known]).tolist())
    assert pure / known.sum() > 0.98
    assert known.sum() > 10 * len(np.unique(tracklet[known])), "seconds long"


def test_detections_are_tracked_and_the_camera_is_levelled(scene: SimulatedScene) -> None:
    true = seen(scene, joints=False)
    found = prepared(scene, nameless(true))
    assert found.name == scene.rig.names[0]
    own = found.seen.boxes
    np.testing.assert_array_equal(own.ltwh, true.boxes.ltwh)
    assert_people(own.identity, true.boxes.identity, 0.8)
    np.testing.assert_array_equal(np.unique(own.identity[own.identity > UNKNOWN]), np.arange(found.n_tracklets))
    np.testing.assert_allclose(found.level.height, scene.rig.cameras[0].pose.centre[2], rtol=0.2)
    assert len(found.tracks) > 100
    assert set(found.tracks.tracklet.tolist()) <= set(range(found.n_tracklets))
    np.testing.assert_array_equal(found.bodies.seconds, Clock(FPS).seconds(found.bodies.step))


def test_known_people_are_left_as_they_are(scene: SimulatedScene) -> None:
    """Even where the identities jump from person to person."""
    true = seen(scene)
    mixed = replace(true, boxes=replace(true.boxes, identity=np.where(true.boxes.frame > 50, 60, true.boxes.identity)))
    found = prepared(scene, mixed, given=True)
    np.testing.assert_array_equal(found.seen.boxes.identity, mixed.boxes.identity)
    np.testing.assert_array_equal(found.seen.keypoints.identity, mixed.keypoints.identity)
    assert ([len(column) for column in found.continued], found.n_tracklets) == ([0, 0], 61)


def test_given_tracklets_are_numbered_from_nought_and_the_rest_is_tracked(scene: SimulatedScene) -> None:
    """Two people have tracklets 40 and 17, who are not taken apart, the others are detections."""
    true = seen(scene, joints=False).boxes
    often = np.argsort(-np.bincount(true.identity))[:2]
    identity = np.full(len(true), UNKNOWN)
    identity[true.identity == often[0]], identity[true.identity == often[1]] = 40, 17
    found = prepared(scene, CameraObservations(replace(true, identity=identity))).seen.boxes.identity
    assert_people(found, true.identity, 0.9)
    for number in (40, 17):
        rows = identity == number
        assert (found[rows] > UNKNOWN).all()
        assert not np.isin(found[~rows], found[rows]).any()
        assert np.bincount(found[rows]).max() > 0.5 * rows.sum()
    assert np.unique(found[found > UNKNOWN]).tolist() == list(range(found.max() + 1))


def test_a_given_tracklet_that_changes_person_is_split(scene: SimulatedScene) -> None:
    true = seen(scene, joints=False).boxes
    middle = true.ltwh[:, 0] + 0.5 * true.ltwh[:, 2]
    at = {frame: dict(zip(true.identity[on].tolist(), middle[on].tolist(), strict=True))
          for frame in (50, 51) for on in [true.frame == frame]}  # fmt: skip
    both = sorted(set(at[50]) & set(at[51]))
    first, second = max(((i, j) for i in both for j in both), key=lambda pair: abs(at[50][pair[0]] - at[51][pair[1]]))
    keep = ((true.identity == first) & (true.frame <= 50)) | ((true.identity == second) & (true.frame > 50))
    own = true.take(keep)
    found = prepared(scene, CameraObservations(replace(own, identity=np.full(len(own), 3)))).seen.boxes
    assert not set(found.identity[found.frame <= 50].tolist()) & set(found.identity[found.frame > 50].tolist()) - {UNKNOWN}


def test_joints_belong_to_the_boxes_that_they_lie_in(scene: SimulatedScene) -> None:
    """And those far from every box to no one."""
    true = seen(scene)
    found = prepared(scene, nameless(true)).seen
    keys = zip(true.boxes.frame.tolist(), true.boxes.identity.tolist(), strict=True)
    tracklet_of = dict(zip(keys, found.boxes.identity.tolist(), strict=True))
    joints = found.keypoints
    own = zip(joints.frame.tolist(), true.keypoints.identity.tolist(), strict=True)
    expected = np.array([tracklet_of.get(key, UNKNOWN) for key in own])
    known = joints.identity > UNKNOWN
    assert known.mean() > 0.8
    assert np.mean(joints.identity[known] == expected[known]) > 0.98
    each = set(zip(joints.frame[known].tolist(), joints.identity[known].tolist(), strict=True))
    assert len(each) == known.sum(), "two on one box"
    true = nameless(true)
    moved = replace(true, keypoints=replace(true.keypoints, xy=true.keypoints.xy + 5000.0))
    assert (prepared(scene, moved).seen.keypoints.identity == UNKNOWN).all()


def test_joints_alone_are_tracked_but_for_those_that_were_not_found(scene: SimulatedScene) -> None:
    true = seen(scene, boxes=False)
    found = prepared(scene, nameless(true))
    assert_people(found.seen.keypoints.identity, true.keypoints.identity, 0.8)
    assert len(found.seen.boxes) == 0
    assert found.bodies.from_joints.all()
    assert found.n_tracklets == found.seen.keypoints.identity.max() + 1
    joints = nameless(true).keypoints
    score = np.where(np.arange(len(joints))[:, None] % 3 == 0, 0.0, joints.score)
    some = prepared(scene, CameraObservations(Boxes.empty(), replace(joints, score=score))).seen.keypoints.identity
    assert (some[::3] == UNKNOWN).all()
    assert (some > UNKNOWN).mean() > 0.3
    nobody = prepared(scene, CameraObservations())
    assert (nobody.n_tracklets, len(nobody.bodies), nobody.level, nobody.tracks) == (0, 0, None, None)


def test_a_camera_is_prepared_again_only_where_what_it_saw_has_changed(scene: SimulatedScene) -> None:
    seen = {name: nameless(CameraObservations(scene.truth[name])) for name in scene.rig.names}
    clocks = dict.fromkeys(scene.rig.names, Clock(FPS))
    changed = scene.rig.names[1]
    rest = {**seen, changed: replace(seen[changed], boxes=seen[changed].boxes.take(slice(40, None)))}
    earlier = earlier_tracklets()
    rng = np.random.default_rng
    counted: list[tuple[int, int]] = []

    def tell(stage: str, done: int = 0, total: int = 0) -> None:
        counted.append((done, total))

    first = build_tracklets(scene.rig, Observations(seen), clocks, 1.72, rng(3), earlier=earlier, tell=tell)
    assert counted[-1] == (len(scene.rig), len(scene.rig))
    assert [camera.name for camera in first] == list(scene.rig.names)
    again = build_tracklets(scene.rig, Observations(rest), clocks, 1.72, rng(3), earlier=earlier)
    alone = build_tracklets(scene.rig, Observations(rest), clocks, 1.72, rng(3))
    for one, same, other in zip(first, again, alone, strict=True):
        assert (one is same) == (one.name != changed)
        np.testing.assert_array_equal(same.seen.boxes.identity, other.seen.boxes.identity)
        assert same.level.height == other.level.height
