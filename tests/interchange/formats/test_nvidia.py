"""NVIDIA's formats: camera files, maps and dewarpers of MV3DT, results of AutoMagicCalib, sensors of calibration.json."""

import json
import re

import cv2
import numpy as np
import pytest
import yaml

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Pose, Rig
from support.refusals import refused
from support.scenes import handmade_rigs as hand

# K [R | t] of `hand.facing()`, by hand: rows 1000 x + 960 z, -1100 (z - 2.5) + 540 (y + 3), y + 3.
NORTH = [[1000.0, 960, 0, -1120], [0, 540, -1100, 4370], [0, 1, 0, 3]]
SAFE_ID = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
"""What generate_cam_info_configs.py of NVIDIA's video-search-and-summarization takes for a sensor's id."""


def test_camera_files_and_the_map_of_mv3dt_have_the_cameras_where_they_stand(tmp_path):
    """As load_map_and_transforms and draw_objects_on_map of NVIDIA's kafka_bev_visualizer.py use the map."""
    near = Camera("a", hand.facing().lens, Pose(np.eye(3), (0, 0, 1e-9)))  # small numbers are numbers to PyYAML
    rig = Rig((hand.facing("north"), hand.facing("south", centre=(-6.0, 8.0, 2.5)), near))
    hand.written("mv3dt", rig, tmp_path)
    stored = yaml.safe_load((tmp_path / "camInfo/north.yml").read_text())
    assert list(stored) == ["projectionMatrix_3x4_w2p", "modelInfo"]
    np.testing.assert_allclose(np.reshape(stored["projectionMatrix_3x4_w2p"], (3, 4)), NORTH, atol=1e-9)
    assert 1.5 < stored["modelInfo"]["height"] < 2
    assert 0.1 < stored["modelInfo"]["radius"] < 0.5
    values = yaml.safe_load((tmp_path / "camInfo/a.yml").read_text())["projectionMatrix_3x4_w2p"]
    assert {type(value) for value in (*values, *stored["projectionMatrix_3x4_w2p"])} == {float}
    assert values[-1] == 1e-9
    to_map = np.array(yaml.safe_load((tmp_path / "transforms.yml").read_text())["T_ov2px"]).reshape(3, 3)
    picture = cv2.imread(str(tmp_path / "map.png"))
    places = np.array([to_map @ (*camera.centre[:2], 1.0) for camera in rig])
    assert (places[:, 2] == 1).all()
    assert ((places[:, :2] >= 0) & (places[:, :2] < picture.shape[1::-1])).all()
    assert all(picture[round(y), round(x)].min() < 200 for x, y, _ in places)
    assert (places[1, :2] < places[0, :2]).all()


def test_calibration_json(tmp_path):
    up = Camera("up", hand.facing().lens, Pose.from_centre(np.eye(3), (0, 0, 2)))
    hand.written("amc", Rig((hand.facing("down"), up)), tmp_path / "calibration.json")
    content = json.loads((tmp_path / "calibration.json").read_text())
    assert (content["version"], content["osmURL"], content["calibrationType"]) == ("1.0", "", "cartesian")
    sensor, blind = content["sensors"]
    assert (sensor["type"], sensor["id"], sensor["coordinates"]) == (
        "camera",
        "down",
        dict(zip("xyz", hand.CENTRE, strict=True)),
    )
    assert {item["name"]: item["value"] for item in sensor["attributes"]} == {"frameWidth": "1920", "frameHeight": "1080"}
    K, Rt = np.array(sensor["intrinsicMatrix"]), np.array(sensor["extrinsicMatrix"])
    np.testing.assert_allclose(Rt, [[1, 0, 0, -4], [0, 0, -1, 2.5], [0, 1, 0, 3]], atol=1e-12)
    np.testing.assert_allclose(sensor["cameraMatrix"], NORTH, atol=1e-9)
    np.testing.assert_allclose(K @ Rt, NORTH, atol=1e-9)
    assert "homography" not in sensor  # its direction differs from reader to reader; they compute it from these points:
    pixels = np.array([[point["x"], point["y"]] for point in sensor["imageCoordinates"]])
    ground = np.array([[point["x"], point["y"], point["z"], 1] for point in sensor["globalCoordinates"]])
    assert len(pixels) == len(ground) >= 4
    seen = ground @ np.array(sensor["cameraMatrix"]).T
    np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], pixels, atol=1e-6)
    # The middle of the picture's lower part is ahead of the camera, between its foot and the horizon.
    assert (seen[:, 2] > 0).all()
    assert (ground[:, 1] > hand.CENTRE[1]).all()
    assert (ground[:, 2] == 0).all()
    assert blind["imageCoordinates"] == blind["globalCoordinates"] == []


@pytest.mark.parametrize("form", ["mv3dt", "amc"])
def test_names_that_nvidias_programs_take(tmp_path, form):
    rig, target = hand.turned_rig(hand.NASTY_NAMES), tmp_path / "out"
    hand.written(form, rig, target)
    if form == "mv3dt":
        ids = [path.stem for path in (target / "camInfo").iterdir()]
    else:
        ids = [sensor["id"] for sensor in json.loads(target.read_text())["sensors"]]
    assert len({name.lower() for name in ids}) == len(rig)
    assert all(SAFE_ID.fullmatch(name) for name in ids)
    assert "01" in ids


def test_the_dewarper_of_mv3dt_removes_the_distortion(tmp_path):
    """Its file by hand: OpenCV's coefficients with k3 third, and the pinhole of the matrix as the result's."""
    bent = hand.looking_down("bent", distortions=(-0.05, 0.01, 0.002, -0.003, 0.004))
    rig = Rig((hand.facing("straight"), bent))
    assert hand.written("mv3dt", rig, tmp_path) == ()
    assert [path.name for path in (tmp_path / "dewarper").iterdir()] == ["bent.txt"]
    assert (tmp_path / "dewarper/bent.txt").read_text().splitlines() == [
        "[property]", "output-width=1920", "output-height=1080", "num-batch-buffers=1", "",
        "[surface0]", "projection-type=3", "surface-index=0", "width=1920", "height=1080", "focal-length=1000.0;1100.0",
        "src-x0=960.0", "src-y0=540.0", "distortion=-0.05;0.01;0.004;0.002;-0.003", "dst-focal-length=1000.0;1100.0",
        "dst-principal-point=960.0;540.0",
    ]  # fmt: skip
    stored = yaml.safe_load((tmp_path / "camInfo/bent.yml").read_text())["projectionMatrix_3x4_w2p"]
    ideal = np.column_stack([bent.pose.R_cw, bent.pose.t_cw])
    np.testing.assert_allclose(np.reshape(stored, (3, 4)), bent.lens.matrix @ ideal, atol=1e-9)
    assert hand.same_cameras(rig, hand.read_back("mv3dt", tmp_path)[0])


@pytest.mark.parametrize(("old", "new", "message"), [
    ("projection-type=3", "projection-type=4", r"bent\.txt: \[surface0\] projection-type is '4': only 3"),
    ("focal-length=1000.0;1100.0", "focal-length=wide", r"bent\.txt: \[surface0\] focal-length is 'wide': finite numbers"),
    ("focal-length=1000.0;1100.0", "focal-length=-1000", r"bent\.txt: matrix .*focal lengths above 0"),
    ("src-x0=960.0", "src-x0=1;2", r"bent\.txt: \[surface0\]: one or two focal lengths"),
    ("[surface0]", "[surface0", r"bent\.txt: is no configuration file of Gst-nvdewarper"),
])  # fmt: skip
def test_a_broken_dewarper_is_refused(tmp_path, old, new, message):
    hand.written("mv3dt", Rig((hand.looking_down("bent", distortions=(-0.05, 0.01, 0, 0)),)), tmp_path)
    file = tmp_path / "dewarper/bent.txt"
    file.write_text(file.read_text().replace(old, new, 1))
    with refused(message, tmp_path):
        hand.read_back("mv3dt", tmp_path)


def test_matrices_and_results_of_other_programs_are_read(tmp_path):
    """Before `_w2p`, DeepStream added half the picture's size itself (DS_plugin_gst-nvtracker.html). AutoMagicCalib has K, R, t
    and a matrix that is called zero-centred but is not, as its README.md shows them."""
    centred = np.array([[1.0, 0, -960], [0, 1, -540], [0, 0, 1]]) @ NORTH
    values = "".join(f"  - {value}\n" for value in (-2 * centred).ravel())
    path = tmp_path / "camInfo-01.yml"
    path.write_text(f"%YAML:1.0\n---\n# of a test\nprojectionMatrix_3x4:\n{values}modelInfo:\n  height: 205\n  radius: 33\n")
    with pytest.raises(InputError, match=r"camInfo-01.yml: states no image size"):
        hand.read_back("mv3dt", path)
    rig, _ = hand.read_back("mv3dt", tmp_path, size=hand.SIZE, metres_per_unit=0.01)
    np.testing.assert_allclose(rig["camInfo-01"].lens.matrix, hand.facing().lens.matrix, atol=1e-9)
    np.testing.assert_allclose(rig["camInfo-01"].pose.R_cw, hand.LOOKING_NORTH, atol=1e-12)
    np.testing.assert_allclose(rig["camInfo-01"].centre, np.array(hand.CENTRE) / 100, atol=1e-12)
    result = {"K": hand.facing().lens.matrix.tolist(), "R": hand.LOOKING_NORTH.tolist(), "projectionMatrix_3x4": NORTH}
    result["t"] = [[-4.0], [2.5], [3.0]]
    folder = tmp_path / "results" / "camInfo"
    folder.mkdir(parents=True)
    (folder / "camInfo_00.yaml").write_text(yaml.safe_dump(result))
    (folder / "other.yaml").write_text("a: 1")
    rig, _ = hand.read_back("mv3dt", tmp_path / "results", size=hand.SIZE)
    assert rig.names == ("camInfo_00",)
    np.testing.assert_allclose(rig["camInfo_00"].project(hand.POINTS), hand.PIXELS, atol=1e-9)
    (folder / "camInfo_00.yaml").write_text(yaml.safe_dump(result | {"K": np.diag([-900.0, 900.0, 1.0]).tolist()}))
    with pytest.raises(InputError, match=f"^{folder}/camInfo_00.yaml: .*focal lengths above 0"):
        hand.read_back("mv3dt", tmp_path / "results", size=hand.SIZE)


def test_sensors_of_other_programs_are_read(tmp_path):
    """A matrix of any scale and sign, as fitted ones have; a 4 x 4 extrinsic matrix; what is no camera."""
    sensors = [
        {"type": "camera", "id": "Camera_01", "cameraMatrix": (-0.3 * np.array(NORTH)).tolist()},
        {
            "type": "camera", "id": "Camera_02", "intrinsicMatrix": hand.facing().lens.matrix.tolist(),
            "extrinsicMatrix": [[1, 0, 0, -4], [0, 0, -1, 2.5], [0, 1, 0, 3], [0, 0, 0, 1]], "cameraMatrix": [[0] * 4] * 3,
            "attributes": [{"name": "frameWidth", "value": 1280}, {"name": "frameHeight", "value": "720"}],
        },
        {"type": "lidar", "id": "x"},
    ]  # fmt: skip
    (tmp_path / "calibration.json").write_text(json.dumps({"calibrationType": "cartesian", "sensors": sensors}))
    rig, _ = hand.read_back("amc", tmp_path, size=hand.SIZE)
    assert rig.names == ("Camera_01", "Camera_02")
    assert (rig["Camera_01"].lens.size, rig["Camera_02"].lens.size) == (hand.SIZE, (1280, 720))
    for camera in rig:
        np.testing.assert_allclose(camera.project(hand.POINTS), hand.PIXELS, atol=1e-8)
        np.testing.assert_allclose(camera.centre, hand.CENTRE, atol=1e-9)


SENSOR = {"type": "camera", "id": "c", "cameraMatrix": NORTH}


@pytest.mark.parametrize(("content", "message"), [
    ({}, "has no list `sensors`"),
    ({"sensors": [SENSOR, SENSOR]}, "camera c occurs twice"),
    *(({"sensors": [SENSOR | change]}, message) for change, message in (
        ({"cameraMatrix": None}, "sensor 'c': has neither intrinsicMatrix .* a homography is not enough"),
        ({"id": None}, "sensor None: id is None"),
        ({"cameraMatrix": [[1, 0, 0, 0]] * 3}, "is not that of a camera"),
        ({"attributes": [{"name": f"frame{key}", "value": 10**400} for key in ("Width", "Height")]}, "frameWidth is 1000.*: a"),
        ({"intrinsicMatrix": np.eye(3).tolist(), "extrinsicMatrix": [[1, 2, 3]] * 3}, "extrinsicMatrix has 9 numbers"),
        ({"intrinsicMatrix": np.eye(3).tolist(), "extrinsicMatrix": np.ones((3, 4)).tolist()}, "is not a rotation"),
    )),
])  # fmt: skip
def test_broken_sensors_are_refused(tmp_path, content, message):
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(content))
    with refused(message, path):
        hand.read_back("amc", path, size=hand.SIZE)


@pytest.mark.parametrize("comment", ["{not JSON}", '{"name": 3}'])
def test_a_name_whose_comment_was_edited_is_that_of_the_file(tmp_path, comment):
    hand.written("mv3dt", Rig((hand.facing("a b"),)), tmp_path)
    (file,) = (tmp_path / "camInfo").iterdir()
    text, count = re.subn(r"^# passerby: .*$", f"# passerby: {comment}", file.read_text(), flags=re.MULTILINE)
    assert count == 1
    file.write_text(text)
    assert hand.read_back("mv3dt", tmp_path, size=hand.SIZE)[0].names == (file.stem,)
