"""Metrics against hand-made cases with closed-form answers, and their invariances."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.evaluation.metrics import compare

LENS = Lens((1920, 1080), np.array([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]]), np.zeros(5))


def looking_at_origin(centre):
    forward = -np.asarray(centre, dtype=float) / np.linalg.norm(centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(forward, right), forward])


def square(half=5.0, height=2.0):
    centres = [(half, half, height), (-half, half, height), (-half, -half, height), (half, -half, height)]
    return Rig(tuple(Camera(f"c{i}", LENS, Pose.from_centre(looking_at_origin(c), c)) for i, c in enumerate(centres)))


def with_pose(rig, name, pose):
    return replace(rig, cameras=tuple(replace(c, pose=pose) if c.name == name else c for c in rig))


def test_truth_against_itself_is_zero():
    comparison = compare(square(), square())
    assert comparison.metric.mean_position_mm == pytest.approx(0, abs=1e-9)
    assert comparison.similarity.mean_orientation_deg == pytest.approx(0, abs=1e-9)
    assert comparison.scale_ratio == pytest.approx(1)
    assert comparison.gravity_error_deg == pytest.approx(0, abs=1e-9)
    assert comparison.ground_error_mm == pytest.approx(0, abs=1e-9)


def test_pure_scale():
    truth = square()
    comparison = compare(truth.moved(np.eye(3), np.zeros(3), 1.1), truth)
    assert comparison.scale_ratio == pytest.approx(1.1)
    assert comparison.similarity.mean_position_mm == pytest.approx(0, abs=1e-6)
    # Around the first corner the others move by a tenth of the side, the diagonal, and the side of the square.
    assert comparison.metric.mean_position_mm == pytest.approx(1000 * (10 + 10 + 10 * np.sqrt(2)) / 3 / 10)
    assert comparison.metric.median_position_mm == pytest.approx(1000)
    assert comparison.metric.mean_orientation_deg == pytest.approx(0, abs=1e-9)


def test_one_displaced_camera():
    truth = square()
    moved = Pose.from_centre(truth["c2"].pose.R_cw, truth["c2"].centre + np.array([0, 0, 0.4]))
    comparison = compare(with_pose(truth, "c2", moved), truth)
    assert comparison.metric.position_mm["c2"] == pytest.approx(400)
    assert comparison.metric.mean_position_mm == pytest.approx(400 / 3)
    # The displacement is orthogonal to the spread, so the least-squares scale is below one only by the added spread.
    spread = 4 * 50.0
    scale = spread / (spread + 0.4**2 * 3 / 4)
    assert comparison.scale_ratio == pytest.approx(1 / scale)
    centred = np.array([-0.1, -0.1, 0.3, -0.1]) * scale
    radial = (1 - scale) * np.sqrt(50)
    assert comparison.similarity.mean_position_mm == pytest.approx(1000 * np.hypot(centred, radial).mean())


def test_one_turned_camera():
    truth = square()
    turned = Pose.from_centre(Rotation.from_euler("y", 6, degrees=True).as_matrix() @ truth["c1"].pose.R_cw, truth["c1"].centre)
    comparison = compare(with_pose(truth, "c1", turned), truth)
    assert comparison.metric.orientation_deg == pytest.approx({"c0": 0, "c1": 6, "c2": 0, "c3": 0}, abs=1e-6)
    assert comparison.metric.mean_orientation_deg == pytest.approx(2)
    # The chordal mean of three identities and a turn by 6 degrees turns by atan2(sin 6, 3 + cos 6).
    mean = np.degrees(np.arctan2(np.sin(np.radians(6)), 3 + np.cos(np.radians(6))))
    assert comparison.similarity.orientation_deg["c0"] == pytest.approx(mean)
    assert comparison.similarity.orientation_deg["c1"] == pytest.approx(6 - mean)


def test_turned_reference_moves_all_others():
    truth = square()
    R_cw = truth["c0"].pose.R_cw @ Rotation.from_euler("z", 90, degrees=True).as_matrix()
    estimate = with_pose(truth, "c0", Pose.from_centre(R_cw, truth["c0"].centre))
    assert compare(estimate, truth).metric.mean_orientation_deg == pytest.approx(90)
    assert compare(estimate, truth, reference="c1").metric.mean_orientation_deg == pytest.approx(30)


def test_gravity_and_ground_of_a_tilted_raised_world():
    truth, tilt = square(), Rotation.from_euler("x", 3, degrees=True).as_matrix()
    comparison = compare(truth.moved(tilt, tilt @ (0, 0, -0.25)), truth)
    assert comparison.gravity_error_deg == pytest.approx(3)
    # The true origin lies 0.25 m straight below the point where the estimated plane meets the vertical through it.
    assert comparison.ground_error_mm == pytest.approx(250)
    assert comparison.metric.mean_position_mm == pytest.approx(0, abs=1e-6)
    # Of a world twice as large, in true lengths.
    assert compare(truth.moved(np.eye(3), (0, 0, 1.0), 2.0), truth).ground_error_mm == pytest.approx(500)


def test_missing_cameras_are_named_and_left_out():
    report = compare(with_pose(square(), "c3", None), square()).to_dict()
    assert (report["missing"], report["registered"], report["cameras"][3].pop("name")) == (["c3"], 3, "c3")
    assert set(report["cameras"][3].values()) == {None}


def test_one_common_camera_leaves_the_rest_undefined():
    report = json.loads(json.dumps(compare(Rig((square()["c1"],)), square()).to_dict(), allow_nan=False))
    assert report["reference"] == "c1"
    assert report["metric"]["mean_position_mm"] is report["similarity"]["mean_position_mm"] is None
    assert report["scale_ratio"] is report["gravity_error_deg"] is None


def test_cameras_at_one_place_have_no_scale():
    truth = Rig(tuple(replace(c, pose=Pose.from_centre(c.pose.R_cw, np.zeros(3))) for c in square()))
    report = json.loads(json.dumps(compare(truth, truth).to_dict(), allow_nan=False))
    assert report["scale_ratio"] is None
    assert report["metric"]["mean_position_mm"] == pytest.approx(0, abs=1e-9)


def test_nothing_in_common_is_an_input_error():
    other = Rig((Camera("x", LENS, square()["c0"].pose),))
    with pytest.raises(InputError, match="names must be the same"):
        compare(other, square())
    with pytest.raises(InputError, match="reference camera c9"):
        compare(square(), square(), reference="c9")


vectors = st.tuples(*[st.floats(-3, 3) for _ in range(3)]).map(np.array)


def noisy(rig, seed):
    rng, cameras = np.random.default_rng(seed), []
    for c in rig:
        turn = Rotation.from_rotvec(rng.normal(0, 0.05, 3)).as_matrix()
        cameras.append(replace(c, pose=Pose.from_centre(turn @ c.pose.R_cw, c.centre + rng.normal(0, 0.3, 3))))
    return replace(rig, cameras=tuple(cameras))


@settings(max_examples=25, deadline=None)
@given(vectors, vectors, st.floats(0.3, 3), st.integers(0, 5))
def test_errors_do_not_see_how_the_estimate_is_placed(turn, shift, scale, seed):
    truth, estimate, turn = square(), noisy(square(), seed), Rotation.from_rotvec(turn).as_matrix()
    plain, rigid, moved = (
        compare(rig, truth) for rig in (estimate, estimate.moved(turn, shift), estimate.moved(turn, shift, scale))
    )
    assert rigid.metric.position_mm == pytest.approx(plain.metric.position_mm, abs=1e-6)
    assert rigid.metric.orientation_deg == pytest.approx(plain.metric.orientation_deg, abs=1e-6)
    assert moved.similarity.position_mm == pytest.approx(plain.similarity.position_mm, abs=1e-6)
    assert moved.similarity.orientation_deg == pytest.approx(plain.similarity.orientation_deg, abs=1e-6)
    assert moved.scale_ratio == pytest.approx(plain.scale_ratio * scale)


@settings(max_examples=25, deadline=None)
@given(vectors, st.integers(0, 5))
def test_all_errors_are_those_of_the_moved_truth(shift, seed):
    turn = Rotation.from_rotvec([0, 0, shift[0]]).as_matrix()
    truth, estimate = square(), noisy(square(), seed)
    flat = np.array([shift[1], shift[2], 0])
    plain, moved = compare(estimate, truth), compare(estimate, truth.moved(turn, flat))
    assert moved.similarity.position_mm == pytest.approx(plain.similarity.position_mm, abs=1e-6)
    assert moved.metric.position_mm == pytest.approx(plain.metric.position_mm, abs=1e-6)
    assert moved.gravity_error_deg == pytest.approx(plain.gravity_error_deg, abs=1e-6)
    assert moved.ground_error_mm == pytest.approx(plain.ground_error_mm, abs=1e-6)
