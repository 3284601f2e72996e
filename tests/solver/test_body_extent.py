"""Which points become correspondences, and what people's bodies say about vertical, ground and scale."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import BODY_17, Boxes, CameraObservations, Keypoints, Observations
from passerby.geometry.rotations import direction_angle, exp_rotation
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.solver.geopose import body_extent, correspondences

LENS = Lens((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), np.zeros(4))
RIG = Rig((Camera("A", LENS), Camera("B", LENS)))


def boxes(*rows: tuple[int, int, float, float, float, float]) -> CameraObservations:
    """Boxes of (frame, identity, left, top, width, height)."""
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return CameraObservations(
        Boxes(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:], np.ones(len(table)))
    )


def test_parts_of_a_box_are_points_with_rays_and_sigmas() -> None:
    seen = Observations({"A": boxes((1, 7, 100, 50, 40, 120))})
    points = correspondences.box_points(RIG, seen, (correspondences.CENTRE, correspondences.TOP, correspondences.BOTTOM))
    at = {int(part): pixel.tolist() for part, pixel in zip(points.part, points.pixel, strict=True)}
    assert at == {correspondences.CENTRE: [120, 110], correspondences.TOP: [120, 50], correspondences.BOTTOM: [120, 170]}
    assert set(points.identity) == {7}
    np.testing.assert_allclose(LENS.project_rays(points.bearing), points.pixel, atol=1e-9)
    of_centre = points.sigma_px[points.part == correspondences.CENTRE]
    assert (of_centre < points.sigma_px[points.part != correspondences.CENTRE]).all()


@pytest.mark.parametrize("box", [(1.5, 100, 40, 120), (100, 0, 40, 120), (599, 100, 40, 120), (100, 359, 40, 120)])
def test_boxes_cut_by_the_border_or_of_unknown_identity_are_left_out(box: tuple[float, float, float, float]) -> None:
    whole = tuple(np.clip(box, 3, None) - np.array([3, 3, 0, 0]) * (np.array(box) > 300))
    points = correspondences.box_points(RIG, Observations({"A": boxes((1, 7, *box), (2, 0, *whole), (3, -1, *whole))}))
    assert (points.frame.tolist(), points.identity.tolist()) == ([2], [0])


@given(st.sets(st.tuples(st.integers(1, 6), st.integers(0, 6))), st.sets(st.tuples(st.integers(1, 6), st.integers(0, 6))))
def test_pairs_are_those_with_the_same_identity_and_frame(in_a: set[tuple[int, int]], in_b: set[tuple[int, int]]) -> None:
    seen = Observations(
        {
            "A": boxes(*((frame, who, 10 + frame, 20 + who, 30, 60) for frame, who in in_a)),
            "B": boxes(*((frame, who, 200 + frame, 20 + who, 30, 60) for frame, who in in_b)),
        }
    )
    points = correspondences.box_points(RIG, seen)
    label, key = points.labels()
    rows_a, rows_b = correspondences.match_pair(points, label, 0, 1)
    assert set(zip(points.frame[rows_a], points.identity[rows_a], strict=True)) == in_a & in_b
    assert (points.camera[rows_a] == 0).all()
    assert (points.camera[rows_b] == 1).all()
    assert (label[rows_a] == label[rows_b]).all()
    assert len(key) == len(in_a | in_b)
    np.testing.assert_array_equal(key[label], np.column_stack([points.identity, points.frame, points.part]))


def skeletons(joints: int, score: float = 1.0) -> CameraObservations:
    xy = np.random.default_rng(0).uniform(50, 400, (2, joints, 2))
    scores = np.full((2, joints), score)
    scores[0, 1] = 0.1
    names = tuple(f"joint_{j}" for j in range(joints))
    people = Keypoints(np.array([1, 2]), np.array([4, 4]), xy, scores, names)
    return CameraObservations(keypoints=people)


def test_doubtful_joints_are_left_out_and_joints_keep_their_number() -> None:
    points = correspondences.joint_points(RIG, Observations({"A": skeletons(5), "B": skeletons(5)}))
    assert len(points) == 2 * (2 * 5 - 1)
    assert not ((points.part == 1) & (points.frame == 1)).any()
    seen = skeletons(5).keypoints
    np.testing.assert_array_equal(points.pixel[(points.part == 3) & (points.frame == 2)], np.tile(seen.xy[1, 3], (2, 1)))


def test_an_identity_twice_in_a_picture_and_layouts_of_different_length_are_bad_input() -> None:
    seen = Observations({"B": boxes((3, 7, 100, 50, 40, 120), (3, 7, 200, 50, 40, 120))})
    with pytest.raises(InputError, match=r"camera B .* identity 7 in frame 3"):
        correspondences.box_points(RIG, seen)
    with pytest.raises(InputError, match="A 5, B 6"):
        correspondences.joint_points(RIG, Observations({"A": skeletons(5), "B": skeletons(6)}))


def test_each_sighting_moves_over_the_picture_as_its_own_lens_has_it() -> None:
    long = Lens((640, 480), np.array([[1500.0, 0, 320], [0, 1500, 240], [0, 0, 1]]), np.zeros(4))
    bent = Lens((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), np.array([-0.2, 0.05, 0, 0]))
    rig = Rig((Camera("A", LENS), Camera("B", long), Camera("C", bent)))
    rng = np.random.default_rng(0)
    numbers = np.arange(8)
    points = correspondences.numbered_points(
        rig, {name: (numbers, rng.uniform([20, 20], [620, 460], (8, 2))) for name in rig.names}
    )
    seen = correspondences.point_observations(rig, points, points.labels()[0])
    turned = seen.bearing + 1e-5 * np.cross(rng.normal(size=(24, 3)), seen.bearing)
    moved = np.einsum("mki,mi->mk", seen.tangent, turned - seen.bearing)
    for c, camera in enumerate(rig):
        own = seen.camera == c
        assert own.sum() == 8
        np.testing.assert_allclose(camera.lens.project_rays(turned[own]) - points.pixel[own], moved[own], rtol=1e-3, atol=1e-5)


def crowd(
    rng: np.random.Generator, area: float, lean: np.ndarray, crouched: float = 0.0, each: int = 40
) -> body_extent.BodySegments3D:
    """Six people of 1.6 to 1.85 m, `each` instants, feet on z = 0, all leaning alike; crouched at a share of the instants."""
    heights = np.repeat(np.linspace(1.6, 1.85, 6), each)
    n = len(heights)
    down = rng.random(n) < crouched
    heights = heights * np.where(down, rng.uniform(0.55, 0.85, n), 1.0) * rng.normal(1, 0.015, n)
    feet = np.column_stack([rng.uniform(-area, area, (n, 2)), rng.normal(0, 0.03, n)])
    direction = np.array([0, 0, 1.0]) + lean + rng.normal(0, 0.03, (n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return body_extent.BodySegments3D(np.repeat(np.arange(6), each), feet + heights[:, None] * direction, feet)


def moved(segments: body_extent.BodySegments3D, R: np.ndarray, t: np.ndarray, scale: float = 1.0) -> body_extent.BodySegments3D:
    return body_extent.BodySegments3D(segments.identity, scale * segments.top @ R.T + t, scale * segments.bottom @ R.T + t)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.5), st.floats(0, 0.2))
def test_feet_on_a_wide_floor_decide_the_vertical_and_crouching_people_do_not_shorten_the_standing_length(
    seed: int, crouched: float, ankles: float
) -> None:
    """The world has its origin below the reference, and feet on the ground."""
    rng = np.random.default_rng(seed)
    R, t = exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.normal(size=3)
    up = body_extent.vertical(moved(crowd(rng, area=5.0, lean=np.array([0.03, 0.0, 0.0])), R, t, scale=0.3))
    assert np.degrees(direction_angle(up, R[:, 2])) < 0.25
    found = body_extent.standing_length(crowd(rng, 5.0, np.zeros(3), crouched), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(found, np.linspace(1.6, 1.85, 6).mean(), rtol=0.015)
    segments, reference = moved(crowd(rng, 5.0, np.zeros(3)), R, t), R @ np.array([3.0, 4.0, 2.5]) + t
    world = body_extent.place_world(segments, R[:, 2], reference, ankles)
    np.testing.assert_allclose(world.apply(reference), [0, 0, 2.5 + ankles], atol=0.02)
    np.testing.assert_allclose(np.median(world.apply(segments.bottom)[:, 2]), ankles, atol=1e-9)


def test_on_the_spot_the_bodies_decide_the_vertical() -> None:
    segments = crowd(np.random.default_rng(7), area=0.02, lean=np.zeros(3))
    tilted = replace(segments, bottom=segments.bottom + [0, 0, 0.2] * segments.bottom[:, :1])
    assert np.degrees(direction_angle(body_extent.vertical(tilted), [0.0, 0.0, 1.0])) < 1.5


def test_people_lying_or_leaning_are_let_go() -> None:
    rng = np.random.default_rng(7)
    standing = crowd(rng, 5.0, np.zeros(3))
    lying = crowd(rng, 5.0, np.array([2.0, 0, 0]), each=10)
    both = body_extent.BodySegments3D(
        np.concatenate([standing.identity, lying.identity]),
        np.concatenate([standing.top, lying.bottom + 0.5 * (lying.top - lying.bottom)]),
        np.concatenate([standing.bottom, lying.bottom]),
    )
    up = body_extent.vertical(both)
    assert np.degrees(direction_angle(up, [0.0, 0.0, 1.0])) < 0.5
    np.testing.assert_allclose(body_extent.standing_length(both, up), body_extent.standing_length(standing, up), rtol=0.003)


def test_longest_peak_is_not_the_stray_longest_value_and_few_people_are_too_little_evidence() -> None:
    rng = np.random.default_rng(7)
    lengths = np.concatenate([rng.normal(1.7, 0.03, 60), rng.normal(1.1, 0.05, 90), [2.2, 2.4]])
    assert body_extent.longest_peak(lengths) == pytest.approx(1.7, abs=0.02)
    assert body_extent.longest_peak(np.array([1.5])) == pytest.approx(1.5, rel=0.01)
    few = crowd(rng, 5.0, np.zeros(3)).take(np.arange(7))
    with pytest.raises(EvidenceError, match="7 people"):
        body_extent.vertical(few)
    with pytest.raises(EvidenceError, match="7 upright"):
        body_extent.standing_length(few, np.array([0.0, 0.0, 1.0]))


@pytest.fixture(scope="module")
def workers() -> SimulatedScene:
    return simulate(SimulationOptions(preset="construction", seed=3, seconds=25, box_noise=0.02, joint_noise_px=1.0))


@pytest.mark.slow
@pytest.mark.parametrize("extents_of", [body_extent.box_extents, body_extent.joint_extents])
def test_with_true_cameras_the_true_world_comes_out(workers: SimulatedScene, extents_of) -> None:  # type: ignore[no-untyped-def]
    rig = workers.rig
    R, t = (np.array([getattr(camera.pose, name) for camera in rig]) for name in ("R_cw", "t_cw"))
    extents = extents_of(rig, workers.observations)
    assert extents.finding is None
    segments = body_extent.triangulate_segments(rig, extents, np.arange(len(rig)), R, t)
    up = body_extent.vertical(segments)
    assert np.degrees(direction_angle(up, [0.0, 0.0, 1.0])) < 0.15
    standing = body_extent.standing_length(segments, up) / extents.span
    np.testing.assert_allclose(standing, np.mean(list(workers.heights.values())), rtol=0.02)
    ground = np.median(segments.bottom[:, 2]) - extents.shares[1] * standing
    assert abs(ground) < 0.04
    own = (extents.points.take(np.flatnonzero(extents.points.camera == c)) for c in (0, 1))
    keys = [set(zip(points.identity, points.frame, strict=True)) for points in own]
    if extents_of is body_extent.box_extents:  # of joints, both ends have to be seen
        assert extents.shared(0, 1) == len(keys[0] & keys[1])
    # One camera alone measures no one.
    assert len(body_extent.triangulate_segments(rig, extents, np.array([0]), R[:1], t[:1])) == 0


TALL = np.repeat([0.94, 0.82, 0.6, 0.52, 0.28, 0.04], [5, 2, 4, 2, 2, 2])
"""Of each joint, as a share of a standing person's height."""


def extents_of(v: np.ndarray, score: np.ndarray, names: tuple[str, ...] = BODY_17):
    """Of joints in these rows of the picture of one camera; a camera without anybody in it says nothing of names."""
    xy = np.stack([np.full(v.shape, 300.0), v], axis=2)
    seen = Keypoints(np.arange(len(v)), np.zeros(len(v), int), xy, score, names)
    return body_extent.joint_extents(RIG, Observations({"A": CameraObservations(keypoints=seen), "B": CameraObservations()}))


@pytest.mark.parametrize("right", [True, False])
def test_heads_and_ankles_are_the_ends_of_people_unless_their_names_contradict_the_pictures(right: bool) -> None:
    v = 400 - 300 * np.tile(TALL, (20, 1)) + np.random.default_rng(0).normal(0, 1, (20, 17))
    found = extents_of(v, np.ones((20, 17)), BODY_17 if right else BODY_17[::-1])
    assert (found.finding is None) == right
    assert right or found.finding.code == "keypoint_names_unfit"
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
    nothing = body_extent.joint_extents(RIG, Observations({"A": CameraObservations(), "B": CameraObservations()}))
    assert len(body_extent.triangulate_segments(RIG, nothing, np.arange(2), np.stack([np.eye(3)] * 2), np.zeros((2, 3)))) == 0
