"""Metrics against hand-made cases with closed-form answers, and their invariances: poses, stated sigmas and intrinsics."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from passerby.cli.tables import show_comparison
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.evaluation.metrics import compare, lens_error
from support.scenes.people_and_rigs import ring

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


def as_json(rig, truth):
    return json.loads(json.dumps(compare(rig, truth).to_dict(), allow_nan=False))


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
    # A turned reference moves all others.
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


def test_what_is_missing_or_undefined_is_null_and_rigs_with_nothing_in_common_are_an_input_error():
    report = as_json(with_pose(square(), "c3", None), square())
    assert (report["missing"], report["registered"], report["cameras"][3].pop("name")) == (["c3"], 3, "c3")
    assert set(report["cameras"][3].values()) == {None}
    report = as_json(Rig((square()["c1"],)), square())
    assert report["reference"] == "c1"
    assert report["metric"]["mean_position_mm"] is report["similarity"]["mean_position_mm"] is None
    assert report["scale_ratio"] is report["gravity_error_deg"] is None
    at_one_place = Rig(tuple(replace(c, pose=Pose.from_centre(c.pose.R_cw, np.zeros(3))) for c in square()))
    report = as_json(at_one_place, at_one_place)
    assert report["scale_ratio"] is None
    assert report["metric"]["mean_position_mm"] == pytest.approx(0, abs=1e-9)
    with pytest.raises(InputError, match="names must be the same"):
        compare(Rig((Camera("x", LENS, square()["c0"].pose),)), square())
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


def with_sigmas(rig, position_m=0.05, orientation_deg=0.5):
    return Rig(tuple(replace(camera, sigma=PoseSigma(position_m, orientation_deg)) for camera in rig))


def test_a_turn_about_the_vertical_and_a_shift_along_the_ground_are_no_errors_in_sigmas():
    truth = ring(5)
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    stated = compare(with_sigmas(truth.moved(turn, np.array([7.0, -3.0, 0.0]))), truth).stated
    assert max(stated.position_mm.values()) < 1e-6
    assert max(stated.orientation_deg.values()) < 1e-5
    assert stated.to_dict()["position_within_1_sigma"] == 1.0


@pytest.mark.parametrize(
    ("tilt_deg", "raised", "scale"), [(0, 0, 1.05), (0, 0.3, 1.0), (2, 0, 1.0)], ids=["scale", "height", "tilt"]
)
def test_scale_height_and_tilt_are_errors(tilt_deg, raised, scale):
    tilt = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()
    stated = compare(with_sigmas(ring(5).moved(tilt, np.array([0.0, 0.0, raised]), scale)), ring(5)).stated
    assert max(stated.position_mm.values()) > 100


def test_errors_are_multiples_of_the_sigmas_where_sigmas_are_stated():
    found = compare(with_sigmas(ring(4).moved(np.eye(3), np.array([0.0, 0.0, 0.075]))), ring(4)).stated
    assert list(found.position_sigmas.values()) == pytest.approx([1.5] * 4)
    told = found.to_dict()
    assert (told["position_within_1_sigma"], told["position_within_2_sigmas"]) == (0.0, 1.0)
    assert told["cameras"][0]["position_error_sigmas"] == pytest.approx(1.5)
    told = compare(ring(3), ring(3)).to_dict()["stated"]
    assert told["position_within_1_sigma"] is told["cameras"][0]["position_sigma_mm"] is None
    assert compare(Rig(ring(3).cameras[:1]), ring(3)).stated is None, "one camera cannot be placed"


TRUE = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.array([-0.1, 0.01, 0, 0]))


def changed(focal=1.0, shift=(0.0, 0.0), k1=0.0):
    matrix = np.array(TRUE.matrix)
    matrix[:2, :2] *= focal
    matrix[:2, 2] += shift
    return replace(TRUE, matrix=matrix, distortions=TRUE.distortions + np.array([k1, 0, 0, 0]))


def test_each_part_of_a_lens_is_measured():
    shifted, longer, bent = (
        lens_error(lens, TRUE) for lens in (changed(shift=(3.0, 4.0)), changed(focal=1.02), changed(k1=0.05))
    )
    assert (shifted.principal_point_px, shifted.ray_px) == (pytest.approx(5.0), pytest.approx(5.0, abs=1e-2))
    assert longer.focal_percent == pytest.approx(2.0)
    # Rays move away from the middle by 2 % of their distance from it, 0.02 * 207 px on the mean over this picture.
    assert 3.5 < longer.ray_px < 4.8
    assert bent.focal_percent == pytest.approx(0.0)
    assert bent.ray_px > 1.0
    assert bent.differs
    same = lens_error(TRUE, TRUE)
    assert same.to_dict() == pytest.approx({"focal_percent": 0.0, "principal_point_px": 0.0, "ray_px": 0.0}, abs=1e-3)
    assert not same.differs
    assert lens_error(replace(TRUE, size=(1280, 960)), TRUE) is None, "lenses for other images are not compared"


def test_a_comparison_shows_lenses_where_they_differ(capsys):
    truth = ring(3)
    show_comparison(compare(truth, truth))
    assert "intrinsics" not in capsys.readouterr().out
    first, *others = truth
    longer = first.lens.matrix * [[1.03, 1, 1], [1, 1.03, 1], [1, 1, 1]]
    found = Rig((replace(first, lens=replace(first.lens, matrix=longer)), *others))
    lenses = as_json(found, truth)["lenses"]
    assert [lenses[one.name]["focal_percent"] for one in truth] == pytest.approx([3.0, 0.0, 0.0])
    show_comparison(compare(found, truth))
    assert "errors of the intrinsics" in capsys.readouterr().out
