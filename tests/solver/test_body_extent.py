"""What people's bodies say about vertical, ground and scale."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import BODY_17, CameraObservations, Keypoints, Observations
from passerby.geometry.rotations import direction_angle, exp_rotation
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.solver.geopose.body_extent import (
    BodySegments3D,
    box_extents,
    joint_extents,
    longest_peak,
    place_world,
    standing_length,
    triangulate_segments,
    vertical,
)

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def crowd(rng: np.random.Generator, area: float, lean: np.ndarray, crouched: float = 0.0, each: int = 40) -> BodySegments3D:
    """Six people of 1.6 to 1.85 m, `each` instants, feet on z = 0, all leaning alike; crouched at a share of the instants."""
    heights = np.repeat(np.linspace(1.6, 1.85, 6), each)
    n = len(heights)
    down = rng.random(n) < crouched
    heights = heights * np.where(down, rng.uniform(0.55, 0.85, n), 1.0) * rng.normal(1, 0.015, n)
    feet = np.column_stack([rng.uniform(-area, area, (n, 2)), rng.normal(0, 0.03, n)])
    direction = np.array([0, 0, 1.0]) + lean + rng.normal(0, 0.03, (n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return BodySegments3D(np.repeat(np.arange(6), each), feet + heights[:, None] * direction, feet)


def moved(segments: BodySegments3D, R: np.ndarray, t: np.ndarray, scale: float = 1.0) -> BodySegments3D:
    return BodySegments3D(segments.identity, scale * segments.top @ R.T + t, scale * segments.bottom @ R.T + t)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_on_a_wide_floor_the_feet_decide_the_vertical(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, t = exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.normal(size=3)
    segments = crowd(rng, area=5.0, lean=np.array([0.03, 0.0, 0.0]))
    up = vertical(moved(segments, R, t, scale=0.3))
    assert np.degrees(direction_angle(up, R[:, 2])) < 0.25


def test_on_the_spot_the_bodies_decide_the_vertical(rng: np.random.Generator) -> None:
    segments = crowd(rng, area=0.02, lean=np.zeros(3))
    tilted = replace(segments, bottom=segments.bottom + [0, 0, 0.2] * segments.bottom[:, :1])
    assert np.degrees(direction_angle(vertical(tilted), [0.0, 0.0, 1.0])) < 1.5


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(0.0, 0.5))
def test_crouching_people_do_not_shorten_the_standing_length(seed: int, crouched: float) -> None:
    segments = crowd(np.random.default_rng(seed), 5.0, np.zeros(3), crouched)
    found = standing_length(segments, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(found, np.linspace(1.6, 1.85, 6).mean(), rtol=0.015)


def test_people_lying_or_leaning_are_let_go(rng: np.random.Generator) -> None:
    standing = crowd(rng, 5.0, np.zeros(3))
    lying = crowd(rng, 5.0, np.array([2.0, 0, 0]), each=10)
    both = BodySegments3D(
        np.concatenate([standing.identity, lying.identity]),
        np.concatenate([standing.top, lying.bottom + 0.5 * (lying.top - lying.bottom)]),
        np.concatenate([standing.bottom, lying.bottom]),
    )
    up = vertical(both)
    assert np.degrees(direction_angle(up, [0.0, 0.0, 1.0])) < 0.5
    np.testing.assert_allclose(standing_length(both, up), standing_length(standing, up), rtol=0.003)


def test_longest_peak_is_not_the_stray_longest_value(rng: np.random.Generator) -> None:
    lengths = np.concatenate([rng.normal(1.7, 0.03, 60), rng.normal(1.1, 0.05, 90), [2.2, 2.4]])
    assert longest_peak(lengths) == pytest.approx(1.7, abs=0.02)
    assert longest_peak(np.array([1.5])) == pytest.approx(1.5, rel=0.01)


def test_too_few_people_are_too_little_evidence(rng: np.random.Generator) -> None:
    few = crowd(rng, 5.0, np.zeros(3)).take(np.arange(7))
    with pytest.raises(EvidenceError, match="7 people"):
        vertical(few)
    with pytest.raises(EvidenceError, match="7 upright"):
        standing_length(few, np.array([0.0, 0.0, 1.0]))


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(0, 0.2))
def test_world_has_its_origin_below_the_reference_and_feet_on_the_ground(seed: int, ankles: float) -> None:
    rng = np.random.default_rng(seed)
    R, t = exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.normal(size=3)
    segments = moved(crowd(rng, 5.0, np.zeros(3)), R, t)
    reference = R @ np.array([3.0, 4.0, 2.5]) + t
    world = place_world(segments, R[:, 2], reference, ankles)
    np.testing.assert_allclose(world.apply(reference), [0, 0, 2.5 + ankles], atol=0.02)
    np.testing.assert_allclose(np.median(world.apply(segments.bottom)[:, 2]), ankles, atol=1e-9)


@pytest.fixture(scope="module")
def workers() -> SimulatedScene:
    return simulate(SimulationOptions(preset="construction", seed=3, seconds=25, box_noise=0.02, joint_noise_px=1.0))


@pytest.mark.slow
@pytest.mark.parametrize("extents_of", [box_extents, joint_extents])
def test_with_true_cameras_the_true_world_comes_out(workers: SimulatedScene, extents_of) -> None:  # type: ignore[no-untyped-def]
    rig = workers.rig
    R, t = (np.array([getattr(camera.pose, name) for camera in rig]) for name in ("R_cw", "t_cw"))
    extents = extents_of(rig, workers.observations)
    assert extents.finding is None
    segments = triangulate_segments(rig, extents, np.arange(len(rig)), R, t)
    up = vertical(segments)
    assert np.degrees(direction_angle(up, [0.0, 0.0, 1.0])) < 0.15
    standing = standing_length(segments, up) / extents.span
    np.testing.assert_allclose(standing, np.mean(list(workers.heights.values())), rtol=0.02)
    ground = np.median(segments.bottom[:, 2]) - extents.shares[1] * standing
    assert abs(ground) < 0.04


LENS = Lens((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), np.zeros(4))
RIG = Rig((Camera("A", LENS), Camera("B", LENS)))
TALL = np.repeat([0.94, 0.82, 0.6, 0.52, 0.28, 0.04], [5, 2, 4, 2, 2, 2])
"""Of each joint, as a share of a standing person's height."""


def extents_of(v: np.ndarray, score: np.ndarray, names: tuple[str, ...] = BODY_17):
    """Of joints in these rows of the picture of one camera; a camera without anybody in it says nothing of names."""
    xy = np.stack([np.full(v.shape, 300.0), v], axis=2)
    seen = Keypoints(np.arange(len(v)), np.zeros(len(v), int), xy, score, names)
    return joint_extents(RIG, Observations({"A": CameraObservations(keypoints=seen), "B": CameraObservations()}))


@pytest.mark.parametrize("right", [True, False])
def test_heads_and_ankles_are_the_ends_of_people_unless_their_names_contradict_the_pictures(right: bool) -> None:
    v = 400 - 300 * np.tile(TALL, (20, 1)) + np.random.default_rng(0).normal(0, 1, (20, 17))
    found = extents_of(v, np.ones((20, 17)), BODY_17 if right else BODY_17[::-1])
    assert (found.finding is None) == right
    top, bottom = np.flatnonzero(found.is_top).tolist(), np.flatnonzero(found.is_bottom).tolist()
    assert set(top) <= set(range(5))
    assert len(top) == (5 if right else 1)
    assert bottom == [15, 16]
    assert found.shares[0] > 0.9
    assert found.shares[1] < 0.1


def test_the_names_of_joints_hold_for_people_near_and_far() -> None:
    """Near people without faces fill the lower half of the picture, far ones stand small in the upper half."""
    score = np.ones((40, 17))
    score[:20, :5] = 0.0
    found = extents_of(np.repeat([470.0 - 250.0 * TALL, 130.0 - 30.0 * TALL], 20, axis=0), score)
    assert found.finding is None
    assert found.is_top[:5].all()
    assert np.flatnonzero(found.is_bottom).tolist() == [15, 16]


@pytest.mark.slow
def test_joint_names_that_contradict_the_pictures_are_not_believed(workers: SimulatedScene) -> None:
    """The same joints under names turned upside down: the highest and lowest ones stand in, and it is said."""
    cameras = {}
    for name, seen in workers.observations.cameras.items():
        people = seen.keypoints
        wrong = Keypoints(people.frame, people.identity, people.xy, people.score, people.joints[::-1])
        cameras[name] = CameraObservations(keypoints=wrong)
    extents = joint_extents(workers.rig, Observations(cameras))
    assert extents.finding is not None
    assert extents.finding.code == "keypoint_names_unfit"
    right = workers.observations.cameras["C1"].keypoints.joints
    assert all("eye" in right[j] or "ear" in right[j] or right[j] == "nose" for j in np.flatnonzero(extents.is_top))
    assert all("ankle" in right[j] for j in np.flatnonzero(extents.is_bottom))


@pytest.mark.slow
def test_shared_counts_people_seen_whole_by_both(workers: SimulatedScene) -> None:
    extents = box_extents(workers.rig, workers.observations)
    keys = [
        set(zip(extents.points.identity[rows], extents.points.frame[rows], strict=True))
        for rows in (extents.points.camera == 0, extents.points.camera == 1)
    ]
    assert extents.shared(0, 1) == len(keys[0] & keys[1])


@pytest.mark.slow
def test_one_camera_alone_measures_nobody(workers: SimulatedScene) -> None:
    pose = workers.rig.cameras[0].pose
    assert pose is not None
    extents = box_extents(workers.rig, workers.observations)
    assert len(triangulate_segments(workers.rig, extents, np.array([0]), pose.R_cw[None], pose.t_cw[None])) == 0


def test_no_keypoints_no_segments() -> None:
    extents = joint_extents(RIG, Observations({"A": CameraObservations(), "B": CameraObservations()}))
    assert len(triangulate_segments(RIG, extents, np.arange(2), np.stack([np.eye(3)] * 2), np.zeros((2, 3)))) == 0
