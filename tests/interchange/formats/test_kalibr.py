import cv2
import numpy as np
import pytest
import yaml

from passerby.core.cameras import Rig
from support.refusals import refused
from support.scenes.handmade_rigs import (
    LOOKING_NORTH,
    SIZE,
    TRANSLATION,
    facing,
    largest_told_px,
    read_back,
    turned_rig,
    written,
)

# From the sample in Kalibr's wiki (yaml formats), shortened.
CHAIN = """\
cam0:
  camera_model: pinhole
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  distortion_model: radtan
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  T_cam_imu:
  - [0.01779318, 0.99967549, -0.01822936, 0.07008565]
  - [-0.9998017, 0.01795239, 0.00860714, -0.01771023]
  - [0.00893160, 0.01807260, 0.99979678, 0.00399246]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: -8.121e-05
  rostopic: /cam0/image_raw
  resolution: [752, 480]
cam1:
  camera_model: omni
  intrinsics: [0.8, 833.006, 830.345, 373.850, 253.749]
  distortion_model: radtan
  distortion_coeffs: [-0.33518750, 0.13211436, 0.00055967, 5e-05]
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  rostopic: /cam1/image_raw
  resolution: [752, 480]
"""


def test_cameras_at_known_places(tmp_path):
    """`CameraParameters` of kalibr_common/ConfigReader.py checks types so; every key at the top is a camera to it."""
    fisheye = facing("b", (6.0, -3.0, 2.5), (0.1, 0.2, 0.3, 0.4), fisheye=True)
    written("kalibr", Rig((facing("1", distortions=(-0.1, 0.02, 0.001, -0.002)), fisheye)), tmp_path / "chain.yaml")
    chain = yaml.safe_load((tmp_path / "chain.yaml").read_text())
    assert list(chain) == ["cam0", "cam1"]
    one, two = chain.values()
    world, step = np.eye(4), np.eye(4)
    world[:3, :3], world[:3, 3] = LOOKING_NORTH, TRANSLATION
    np.testing.assert_allclose(one["T_cam_world"], world, atol=1e-12)
    assert "T_cn_cnm1" not in one
    step[0, 3] = -2.0  # the second camera stands two metres to the right of the first, so points lie two farther left
    np.testing.assert_allclose(two["T_cn_cnm1"], step, atol=1e-12)
    assert (one["camera_model"], one["distortion_model"]) == ("pinhole", "radtan")
    assert (two["camera_model"], two["distortion_model"]) == ("pinhole", "equidistant")
    assert (one["distortion_coeffs"], two["distortion_coeffs"]) == ([-0.1, 0.02, 0.001, -0.002], [0.1, 0.2, 0.3, 0.4])
    assert (one["intrinsics"], one["resolution"]) == ([1000.0, 1100.0, 960.0, 540.0], list(SIZE))
    assert {type(number) for number in one["intrinsics"]} == {float}
    assert {type(number) for number in one["resolution"]} == {int}
    assert (one["rostopic"], two["rostopic"]) == ("/camera_1/image_raw", "/b/image_raw")


def test_a_camera_without_distortion_has_four_zeros(tmp_path):
    written("kalibr", turned_rig(("a",)), tmp_path / "chain.yaml")
    assert yaml.safe_load((tmp_path / "chain.yaml").read_text())["cam0"]["distortion_coeffs"] == [0.0] * 4


def test_a_chain_of_kalibr(tmp_path):
    (tmp_path / "chain.yaml").write_text(CHAIN)
    rig, losses = read_back("kalibr", tmp_path / "chain.yaml")
    assert (rig.names, rig["cam0"].lens.size) == (("cam0", "cam1"), (752, 480))
    np.testing.assert_array_equal(rig["cam0"].pose.R_cw, np.eye(3))
    np.testing.assert_allclose(rig["cam1"].centre, (0.1, 0, 0), atol=1e-12)
    np.testing.assert_array_equal(rig["cam0"].lens.distortions, [-0.27695497, 0.06712482, 0.00087538, 0.00011556])
    assert len(losses) == 1
    assert "camera cam1: omni with radtan is fitted" in losses[0]
    # OpenCV's omnidirectional model, by hand: a point a little to the right of the axis.
    point = np.array([[0.3, 0.1, 2.0]])
    x, y = (point[0, :2] / (point[0, 2] + 0.8 * np.linalg.norm(point))).tolist()
    seen = cv2.projectPoints(
        np.array([[x, y, 1.0]]), np.zeros(3), np.zeros(3), np.array([[833.006, 0, 373.85], [0, 830.345, 253.749], [0, 0, 1]]),
        np.array([-0.33518750, 0.13211436, 0.00055967, 5e-05]),
    )[0][0, 0]  # fmt: skip
    np.testing.assert_allclose(rig["cam1"].lens.project_rays(point)[0], seen, atol=largest_told_px(losses))


def write_camera(path, model, intrinsics, distortion, coefficients):
    camera = {
        "camera_model": model, "intrinsics": [*intrinsics, 400.0, 410.0, 640.0, 480.0], "distortion_model": distortion,
        "distortion_coeffs": coefficients, "resolution": [1280, 960],
    }  # fmt: skip
    path.write_text(yaml.safe_dump({"cam0": camera}))


@pytest.mark.parametrize(
    ("model", "intrinsics", "distortion", "coefficients", "plane"),
    [
        # Where each model has a point at 45 degrees to the right, in units of the focal length, by its paper's formula.
        ("ds", [-0.2, 0.6], "none", [], lambda: 1 / (0.6 * np.hypot(1, 1 - 0.2 * 2**0.5) + 0.4 * (1 - 0.2 * 2**0.5))),
        ("eucm", [0.6, 1.1], "none", [], lambda: 1 / (0.6 * np.sqrt(1.1 + 1) + 0.4)),
        ("omni", [1.2], "none", [], lambda: 1 / (1 + 1.2 * 2**0.5)),
        ("pinhole", [], "fov", [0.9], lambda: np.arctan(2 * np.tan(0.45)) / 0.9),
    ],
)
def test_models_that_are_fitted(tmp_path, model, intrinsics, distortion, coefficients, plane):
    write_camera(tmp_path / "chain.yaml", model, intrinsics, distortion, coefficients)
    rig, losses = read_back("kalibr", tmp_path / "chain.yaml")
    assert rig["cam0"].pose is None
    seen = rig["cam0"].lens.project_rays(np.array([[1.0, 0, 1]]))[0]
    np.testing.assert_allclose(seen, (640 + 400 * plane(), 480), atol=largest_told_px(losses))
    assert largest_told_px(losses) < 0.2


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("camera_model: pinhole", "camera_model: fancy", "cam0: camera_model fancy"),
        ("intrinsics: [461.629,", "intrinsics: [", "cam0: intrinsics is .*: 4 numbers"),
        ("intrinsics: [461.629,", "intrinsics: [-461.629,", "cam0: matrix .* focal lengths"),
        ("cam1:\n", "cam1:\n  camera_name: cam0\n", "camera cam0 occurs twice"),
        ("[0.8, 833.006", "[.nan, 833.006", "cam1: intrinsics .* finite"),
        ("cam0:", "cam0: [", "is not YAML"),
        (CHAIN, "[]", "holds no camera chain"),
        (CHAIN, "a: {}", "has no table cam0"),
        ("distortion_model: radtan", "distortion_model: fov", "cam0: distortion_coeffs is .*: 1 numbers"),
    ],
)
def test_bad_files(tmp_path, old, new, match):
    path = tmp_path / "chain.yaml"
    path.write_text(CHAIN.replace(old, new))
    with refused(match, path):
        read_back("kalibr", path)


def test_models_that_kalibr_has_not_either(tmp_path):
    write_camera(tmp_path / "chain.yaml", "ds", [-0.2, 0.6], "radtan", [0.0, 0.0, 0.0, 0.0])
    with refused(r"cam0: camera_model ds with distortion_model radtan does not exist", tmp_path / "chain.yaml"):
        read_back("kalibr", tmp_path / "chain.yaml")
