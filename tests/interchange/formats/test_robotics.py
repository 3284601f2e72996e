"""Calibrations of Kalibr and ROS: what their own programs read and write, by hand and broken."""

import re
import sys
import types

import cv2
import numpy as np
import pytest
import yaml

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.refusals import refused
from support.scenes import handmade_rigs as hand

# From the sample in Kalibr's wiki (yaml formats), shortened.
CHAIN = """\
cam0:
  camera_model: pinhole
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  distortion_model: radtan
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  timeshift_cam_imu: -8.121e-05
  rostopic: /cam0/image_raw
  resolution: [752, 480]
cam1:
  camera_model: omni
  intrinsics: [0.8, 833.006, 830.345, 373.850, 253.749]
  distortion_model: radtan
  distortion_coeffs: [-0.33518750, 0.13211436, 0.00055967, 5e-05]
  T_cn_cnm1: [[1.0, 0.0, 0.0, -0.1], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
  resolution: [752, 480]
"""


def test_kalibr_finds_cameras_at_known_places(tmp_path):
    """`CameraParameters` of kalibr_common/ConfigReader.py checks types so; every key at the top is a camera to it."""
    fisheye = hand.facing("b", (6.0, -3.0, 2.5), (0.1, 0.2, 0.3, 0.4), fisheye=True)
    rig = Rig((hand.facing("1", distortions=(-0.1, 0.02, 0.001, -0.002)), fisheye, hand.facing("straight")))
    hand.written("kalibr", rig, tmp_path / "chain.yaml")
    chain = yaml.safe_load((tmp_path / "chain.yaml").read_text())
    assert list(chain) == ["cam0", "cam1", "cam2"]
    one, two, straight = chain.values()
    world, step = np.eye(4), np.eye(4)
    world[:3, :3], world[:3, 3] = hand.LOOKING_NORTH, hand.TRANSLATION
    np.testing.assert_allclose(one["T_cam_world"], world, atol=1e-12)
    assert "T_cn_cnm1" not in one
    step[0, 3] = -2.0  # the second camera stands two metres to the right of the first, so points lie two farther left
    np.testing.assert_allclose(two["T_cn_cnm1"], step, atol=1e-12)
    assert (one["camera_model"], one["distortion_model"]) == ("pinhole", "radtan")
    assert (two["camera_model"], two["distortion_model"]) == ("pinhole", "equidistant")
    assert (one["distortion_coeffs"], two["distortion_coeffs"]) == ([-0.1, 0.02, 0.001, -0.002], [0.1, 0.2, 0.3, 0.4])
    assert straight["distortion_coeffs"] == [0.0] * 4
    assert (one["intrinsics"], one["resolution"]) == ([1000.0, 1100.0, 960.0, 540.0], list(hand.SIZE))
    assert {type(number) for number in one["intrinsics"]} == {float}
    assert {type(number) for number in one["resolution"]} == {int}
    assert (one["rostopic"], two["rostopic"]) == ("/camera_1/image_raw", "/b/image_raw")


def test_a_chain_of_kalibr_is_read(tmp_path):
    (tmp_path / "chain.yaml").write_text(CHAIN)
    rig, losses = hand.read_back("kalibr", tmp_path / "chain.yaml")
    assert (rig.names, rig["cam0"].lens.size) == (("cam0", "cam1"), (752, 480))
    np.testing.assert_array_equal(rig["cam0"].pose.R_cw, np.eye(3))
    np.testing.assert_allclose(rig["cam1"].centre, (0.1, 0, 0), atol=1e-12)
    np.testing.assert_array_equal(rig["cam0"].lens.distortions, [-0.27695497, 0.06712482, 0.00087538, 0.00011556])
    (loss,) = losses
    assert "camera cam1: omni with radtan is fitted" in loss
    # OpenCV's omnidirectional model, by hand: a point a little to the right of the axis.
    point = np.array([[0.3, 0.1, 2.0]])
    x, y = (point[0, :2] / (point[0, 2] + 0.8 * np.linalg.norm(point))).tolist()
    seen = cv2.projectPoints(
        np.array([[x, y, 1.0]]), np.zeros(3), np.zeros(3), np.array([[833.006, 0, 373.85], [0, 830.345, 253.749], [0, 0, 1]]),
        np.array([-0.33518750, 0.13211436, 0.00055967, 5e-05]),
    )[0][0, 0]  # fmt: skip
    np.testing.assert_allclose(rig["cam1"].lens.project_rays(point)[0], seen, atol=hand.largest_told_px(losses))


def write_camera(path, model, intrinsics, distortion, coefficients):
    camera = {
        "camera_model": model, "intrinsics": [*intrinsics, 400.0, 410.0, 640.0, 480.0], "distortion_model": distortion,
        "distortion_coeffs": coefficients, "resolution": [1280, 960],
    }  # fmt: skip
    path.write_text(yaml.safe_dump({"cam0": camera}))


@pytest.mark.parametrize(("model", "intrinsics", "distortion", "coefficients", "plane"), [
    # Where each model has a point at 45 degrees to the right, in units of the focal length, by its paper's formula.
    ("ds", [-0.2, 0.6], "none", [], lambda: 1 / (0.6 * np.hypot(1, 1 - 0.2 * 2**0.5) + 0.4 * (1 - 0.2 * 2**0.5))),
    ("eucm", [0.6, 1.1], "none", [], lambda: 1 / (0.6 * np.sqrt(1.1 + 1) + 0.4)),
    ("omni", [1.2], "none", [], lambda: 1 / (1 + 1.2 * 2**0.5)),
    ("pinhole", [], "fov", [0.9], lambda: np.arctan(2 * np.tan(0.45)) / 0.9),
])  # fmt: skip
def test_models_of_kalibr_are_fitted_as_near_as_stated(tmp_path, model, intrinsics, distortion, coefficients, plane):
    write_camera(tmp_path / "chain.yaml", model, intrinsics, distortion, coefficients)
    rig, losses = hand.read_back("kalibr", tmp_path / "chain.yaml")
    assert rig["cam0"].pose is None
    seen = rig["cam0"].lens.project_rays(np.array([[1.0, 0, 1]]))[0]
    np.testing.assert_allclose(seen, (640 + 400 * plane(), 480), atol=hand.largest_told_px(losses))
    assert hand.largest_told_px(losses) < 0.2


@pytest.mark.parametrize(("old", "new", "message"), [
    ("camera_model: pinhole", "camera_model: fancy", "cam0: camera_model fancy"),
    ("omni\n  intrinsics: [0.8,", "ds\n  intrinsics: [-0.2, 0.6,",
     "cam1: camera_model ds with distortion_model radtan does not exist"),
    ("intrinsics: [461.629,", "intrinsics: [", "cam0: intrinsics is .*: 4 numbers"),
    ("intrinsics: [461.629,", "intrinsics: [-461.629,", "cam0: matrix .* focal lengths"),
    ("cam1:\n", "cam1:\n  camera_name: cam0\n", "camera cam0 occurs twice"),
    ("cam0:", "cam0: [", "is not YAML"),
    (CHAIN, "[]", "holds no camera chain"),
    (CHAIN, "a: {}", "has no table cam0"),
    ("distortion_model: radtan", "distortion_model: fov", "cam0: distortion_coeffs is .*: 1 numbers"),
])  # fmt: skip
def test_broken_chains_of_kalibr_are_refused(tmp_path, old, new, message):
    path = tmp_path / "chain.yaml"
    path.write_text(CHAIN.replace(old, new))
    with refused(message, path):
        hand.read_back("kalibr", path)


def matrix(name, columns, data):
    return f"{name}:\n  rows: {len(data.split(',')) // columns}\n  cols: {columns}\n  data: [{data}]\n"


def stamped(parent, child, xyz, xyzw):
    transform = {"translation": dict(zip("xyz", xyz, strict=True)), "rotation": dict(zip("xyzw", xyzw, strict=True))}
    header = {"stamp": {"sec": 1700000000, "nanosec": 5}, "frame_id": parent}
    return {"header": header, "child_frame_id": child, "transform": transform}


# As camera_calibration writes it (ost.yaml).
OST = (
    "image_width: 640\nimage_height: 480\ncamera_name: narrow_stereo\n"
    + matrix("camera_matrix", 3, "698.12, 0.     , 319.5, 0., 698.5, 239.5,\n   0., 0., 1.     ")
    + "distortion_model: plumb_bob\n"
    + matrix("distortion_coefficients", 5, "-0.36, 0.14, 0.0005, -1e-04, 0.")
    + matrix("rectification_matrix", 3, "1., 0., 0., 0., 1., 0., 0., 0., 1.")
    + matrix("projection_matrix", 4, "650.0, 0., 318.0, 0., 0., 670.0, 240.0, 0., 0., 0., 1., 0.")
)
# As `ros2 topic echo --once /tf_static` prints it: the camera's body in the world, the optical frame in the body (REP 103).
BODY = stamped("map", "narrow_stereo_link", hand.CENTRE, (0.0, 0.0, 0.5**0.5, 0.5**0.5))
OPTICAL = stamped("narrow_stereo_link", "narrow_stereo_optical_frame", (0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5))
ECHOED = yaml.safe_dump({"transforms": [BODY, OPTICAL]}, sort_keys=False) + "---\n"


def info(path, name):
    return yaml.safe_load((path / "camera_info" / f"{name}.yaml").read_text())


def launched(path, monkeypatch):
    """The nodes that the launch file starts, with stand-ins for ROS 2's modules."""
    launch, actions = types.ModuleType("launch"), types.ModuleType("launch_ros.actions")
    launch.LaunchDescription, actions.Node = list, dict
    for module in (launch, types.ModuleType("launch_ros"), actions):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    known = {}
    exec(compile((path / "static_transforms.launch.py").read_text(), "launch file", "exec"), known)
    return known["generate_launch_description"]()


def test_ros_finds_a_camera_at_a_known_place(tmp_path, monkeypatch):
    hand.written("ros", Rig((hand.facing("north", distortions=(-0.1, 0.02, 0.001, -0.002, 0.003)),)), tmp_path)
    assert list(info(tmp_path, "north").items())[3:] == [
        ("camera_matrix", {"rows": 3, "cols": 3, "data": [1000.0, 0, 960, 0, 1100, 540, 0, 0, 1]}),
        ("distortion_model", "plumb_bob"),
        ("distortion_coefficients", {"rows": 1, "cols": 5, "data": [-0.1, 0.02, 0.001, -0.002, 0.003]}),
        ("rectification_matrix", {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]}),
        ("projection_matrix", {"rows": 3, "cols": 4, "data": [1000.0, 0, 960, 0, 0, 1100, 540, 0, 0, 0, 1, 0]}),
    ]
    (transform,) = yaml.safe_load((tmp_path / "static_transforms.yaml").read_text())["transforms"]
    (node,) = launched(tmp_path, monkeypatch)
    assert (node["package"], node["executable"]) == ("tf2_ros", "static_transform_publisher")
    given = dict(zip(node["arguments"][::2], node["arguments"][1::2], strict=True))
    assert transform["header"]["frame_id"] == given["--frame-id"] == "world"
    assert transform["child_frame_id"] == given["--child-frame-id"] == "north_optical_frame"
    half = 0.5**0.5  # a quarter turn back about the world's x takes the optical frame's z from up to north
    for key, axes, mark, expected in (("translation", "xyz", "", hand.CENTRE), ("rotation", "xyzw", "q", (-half, 0, 0, half))):
        np.testing.assert_allclose([transform["transform"][key][axis] for axis in axes], expected, atol=1e-12)
        np.testing.assert_allclose([float(given[f"--{mark}{axis}"]) for axis in axes], expected, atol=1e-12)


def test_files_of_ros_are_read(tmp_path):
    (tmp_path / "camera_info").mkdir()
    (tmp_path / "camera_info/narrow_stereo.yaml").write_text(OST)
    (tmp_path / "ost.yaml").write_text(OST)
    assert hand.read_back("ros", tmp_path / "ost.yaml")[0]["narrow_stereo"].pose is None
    (tmp_path / "static_transforms.yaml").write_text(ECHOED)
    camera = hand.read_back("ros", tmp_path)[0]["narrow_stereo"]
    np.testing.assert_array_equal(camera.lens.matrix, [[698.12, 0, 319.5], [0, 698.5, 239.5], [0, 0, 1]])
    np.testing.assert_array_equal(camera.lens.distortions, [-0.36, 0.14, 0.0005, -0.0001, 0])
    assert camera.lens.size == (640, 480)
    # A body turned by 90 degrees to the left looks along y.
    np.testing.assert_allclose(camera.pose.R_cw, hand.LOOKING_NORTH, atol=1e-12)
    np.testing.assert_allclose(camera.centre, hand.CENTRE, atol=1e-12)


def test_names_of_files_frames_and_nodes_of_ros_are_valid(tmp_path, monkeypatch):
    rig = hand.turned_rig(hand.NASTY_NAMES)
    hand.written("ros", rig, tmp_path)
    names = [path.stem for path in (tmp_path / "camera_info").iterdir()]
    assert len({name.lower() for name in names}) == len(rig)
    assert all(re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name) for name in names)
    assert all(info(tmp_path, name)["camera_name"] == name for name in names)
    assert {node["name"] for node in launched(tmp_path, monkeypatch)} == {f"static_transform_{name}" for name in names}


def test_ros_names_the_model_of_each_lens(tmp_path):
    rational = hand.facing("rational", distortions=(-0.1, 0.02, 0, 0, 0, 0.01, 0.02, 0))
    fisheye = hand.facing("fisheye", distortions=(0.1, 0.01, 0.001, 0), fisheye=True)
    assert hand.written("ros", Rig((hand.facing("north"), rational, fisheye)), tmp_path) == ()
    expected = {"north": ("plumb_bob", 5), "rational": ("rational_polynomial", 8), "fisheye": ("equidistant", 4)}
    for name, (model, count) in expected.items():
        stored = info(tmp_path, name)
        assert (stored["distortion_model"], stored["distortion_coefficients"]["cols"]) == (model, count)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("image_width: 640", "", "ost.yaml: image_width is missing"),
    ("plumb_bob", "thin", "distortion_model 'thin' is not known"),
    ("[-0.36, 0.14, 0.0005, -1e-04, 0.]", "[1.0, 2.0]", "has 2 values: plumb_bob takes 5"),
    ("698.12", "-698.12", "ost.yaml: .*focal lengths above 0"),
    (OST, "- 1", "holds no camera_info"),
    (ECHOED, "transforms: 1", "has no list `transforms`"),
    ("w: 0.5", "w: 0.6", "is not a unit quaternion"),
    ("frame_id: map", "frame_id: narrow_stereo_optical_frame", "is its own ancestor"),
    ("x: 4.0", "x: four", r"transforms\[0\]: narrow_stereo_link: translation: x is 'four'"),
    ("child_frame_id: narrow_stereo_optical_frame", "child_frame_id: narrow_stereo_link", "each frame needs one parent"),
])  # fmt: skip
def test_broken_files_of_ros_are_refused(tmp_path, old, new, message):
    assert (old in OST) != (old in ECHOED)
    (tmp_path / "ost.yaml").write_text(OST.replace(old, new))
    (tmp_path / "static_transforms.yaml").write_text(ECHOED.replace(old, new))
    with refused(message, tmp_path):
        hand.read_back("ros", tmp_path)


def test_cameras_of_ros_that_contradict_one_another_are_refused(tmp_path):
    (tmp_path / "a.yaml").write_text(OST)
    (tmp_path / "b.yaml").write_text(OST)
    with pytest.raises(InputError, match=f"^{tmp_path}: camera narrow_stereo occurs twice"):
        hand.read_back("ros", tmp_path)
    (tmp_path / "b.yaml").write_text(OST.replace("narrow_stereo", "b"))
    other = ECHOED.partition("---")[0].replace("narrow_stereo", "b").replace("map", "odom").removeprefix("transforms:\n")
    (tmp_path / "static_transforms.yaml").write_text(ECHOED.partition("---")[0] + other)
    with pytest.raises(InputError, match=r"a.yaml stands below frame map, b.yaml below odom"):
        hand.read_back("ros", tmp_path)
