import re
import sys
import types

import numpy as np
import pytest
import yaml

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.refusals import refused
from support.scenes.handmade_rigs import (
    CENTRE,
    LOOKING_NORTH,
    NASTY_NAMES,
    facing,
    read_back,
    same_cameras,
    turned_rig,
    written,
)


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
BODY = stamped("map", "narrow_stereo_link", CENTRE, (0.0, 0.0, 0.5**0.5, 0.5**0.5))
OPTICAL = stamped("narrow_stereo_link", "narrow_stereo_optical_frame", (0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5))
ECHOED = yaml.safe_dump({"transforms": [BODY, OPTICAL]}, sort_keys=False) + "---\n"


def info(path, name):
    return yaml.safe_load((path / "camera_info" / f"{name}.yaml").read_text())


def launched(path, monkeypatch):
    """The nodes that the launch file starts, with stand-ins for ROS 2's modules."""
    launch, actions = types.ModuleType("launch"), types.ModuleType("launch_ros.actions")
    launch.LaunchDescription, actions.Node = list, dict
    monkeypatch.setitem(sys.modules, "launch", launch)
    monkeypatch.setitem(sys.modules, "launch_ros", types.ModuleType("launch_ros"))
    monkeypatch.setitem(sys.modules, "launch_ros.actions", actions)
    known = {}
    exec(compile((path / "static_transforms.launch.py").read_text(), "launch file", "exec"), known)
    return known["generate_launch_description"]()


def test_a_camera_at_a_known_place(tmp_path, monkeypatch):
    written("ros", Rig((facing("north", distortions=(-0.1, 0.02, 0.001, -0.002, 0.003)),)), tmp_path)
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
    told = dict(zip(node["arguments"][::2], node["arguments"][1::2], strict=True))
    assert transform["header"]["frame_id"] == told["--frame-id"] == "world"
    assert transform["child_frame_id"] == told["--child-frame-id"] == "north_optical_frame"
    half = 0.5**0.5  # a quarter turn back about the world's x takes the optical frame's z from up to north
    for key, axes, mark, expected in (("translation", "xyz", "", CENTRE), ("rotation", "xyzw", "q", (-half, 0, 0, half))):
        np.testing.assert_allclose([transform["transform"][key][axis] for axis in axes], expected, atol=1e-12)
        np.testing.assert_allclose([float(told[f"--{mark}{axis}"]) for axis in axes], expected, atol=1e-12)


def test_files_of_ros(tmp_path):
    (tmp_path / "camera_info").mkdir()
    (tmp_path / "camera_info/narrow_stereo.yaml").write_text(OST)
    (tmp_path / "ost.yaml").write_text(OST)
    assert read_back("ros", tmp_path / "ost.yaml")[0]["narrow_stereo"].pose is None
    (tmp_path / "static_transforms.yaml").write_text(ECHOED)
    camera = read_back("ros", tmp_path)[0]["narrow_stereo"]
    np.testing.assert_array_equal(camera.lens.matrix, [[698.12, 0, 319.5], [0, 698.5, 239.5], [0, 0, 1]])
    np.testing.assert_array_equal(camera.lens.distortions, [-0.36, 0.14, 0.0005, -0.0001, 0])
    assert camera.lens.size == (640, 480)
    # A body turned by 90 degrees to the left looks along y.
    np.testing.assert_allclose(camera.pose.R_cw, LOOKING_NORTH, atol=1e-12)
    np.testing.assert_allclose(camera.centre, CENTRE, atol=1e-12)


def test_names_of_files_frames_and_nodes_are_valid(tmp_path, monkeypatch):
    rig = turned_rig(NASTY_NAMES)
    written("ros", rig, tmp_path)
    names = [path.stem for path in (tmp_path / "camera_info").iterdir()]
    assert len({name.lower() for name in names}) == len(rig)
    assert all(re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name) for name in names)
    assert all(info(tmp_path, name)["camera_name"] == name for name in names)
    assert {node["name"] for node in launched(tmp_path, monkeypatch)} == {f"static_transform_{name}" for name in names}


@pytest.mark.parametrize(
    ("coefficients", "fisheye", "model", "count"),
    [
        ((), False, "plumb_bob", 5),
        ((-0.1, 0.02, 0, 0, 0, 0.01, 0.02, 0), False, "rational_polynomial", 8),
        ((0.1, 0.01, 0.001, 0), True, "equidistant", 4),
    ],
)
def test_lens_models(tmp_path, coefficients, fisheye, model, count):
    rig = Rig((facing(distortions=coefficients, fisheye=fisheye),))
    assert written("ros", rig, tmp_path) == ()
    stored = info(tmp_path, "north")
    assert (stored["distortion_model"], stored["distortion_coefficients"]["cols"]) == (model, count)
    assert same_cameras(rig, read_back("ros", tmp_path)[0])


@pytest.mark.parametrize(
    ("info_change", "transforms_change", "match"),
    [
        (("image_width: 640", ""), None, "ost.yaml: image_width is missing"),
        (("plumb_bob", "thin"), None, "distortion_model 'thin' is not known"),
        (("[-0.36, 0.14, 0.0005, -1e-04, 0.]", "[1.0, 2.0]"), None, "has 2 values: plumb_bob takes 5"),
        ((OST, "- 1"), None, "holds no camera_info"),
        (None, (ECHOED, "transforms: 1"), "has no list `transforms`"),
        (None, ("w: 0.5", "w: 0.6"), "is not a unit quaternion"),
        (None, ("frame_id: map", "frame_id: narrow_stereo_optical_frame"), "is its own ancestor"),
        (None, ("x: 4.0", "x: four"), r"transforms\[0\]: narrow_stereo_link: translation: x is 'four'"),
        (None, ("narrow_stereo_optical_frame", "narrow_stereo_link"), "each frame needs one parent"),
    ],
)
def test_bad_files(tmp_path, info_change, transforms_change, match):
    (tmp_path / "ost.yaml").write_text(OST.replace(*info_change) if info_change else OST)
    (tmp_path / "static_transforms.yaml").write_text(ECHOED.replace(*transforms_change) if transforms_change else ECHOED)
    with refused(match, tmp_path):
        read_back("ros", tmp_path)


def test_cameras_that_contradict_one_another(tmp_path):
    (tmp_path / "a.yaml").write_text(OST)
    (tmp_path / "b.yaml").write_text(OST)
    with pytest.raises(InputError, match=f"^{tmp_path}: camera narrow_stereo occurs twice"):
        read_back("ros", tmp_path)
    (tmp_path / "b.yaml").write_text(OST.replace("698.12", "-698.12"))
    with pytest.raises(InputError, match=f"^{tmp_path}/b.yaml: .*focal lengths above 0"):
        read_back("ros", tmp_path)
    (tmp_path / "b.yaml").write_text(OST.replace("narrow_stereo", "b"))
    other = ECHOED.partition("---")[0].replace("narrow_stereo", "b").replace("map", "odom").removeprefix("transforms:\n")
    (tmp_path / "static_transforms.yaml").write_text(ECHOED.partition("---")[0] + other)
    with pytest.raises(InputError, match=r"a.yaml stands below frame map, b.yaml below odom"):
        read_back("ros", tmp_path)
