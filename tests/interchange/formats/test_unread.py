"""What a file holds and the rig does not take is an error where it is a mistake, and else on one line."""

import json

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.formats import Given, read_people_as, read_rig_as
from passerby.interchange.formats.format import Unread
from passerby.interchange.formats.values import dump_yaml, load_yaml
from support.scenes.handmade_rigs import SIZE, facing, written


def unread(name, path):
    given = Given(SIZE, 1.0)
    read_rig_as(name, path, given)
    return given.unread.told


@pytest.fixture
def rig():
    return Rig((facing("01"), facing("02", (0.0, 0.0, 3.0))))


def test_easymocaps_poses_and_lenses_of_cameras_that_are_not_listed(rig, tmp_path):
    written("easymocap", rig, tmp_path)
    with (tmp_path / "intri.yml").open("a") as file:
        file.write("H_03: 1080\nccm_01: 5\n")
    assert unread("easymocap", tmp_path) == ("not read: H_03, ccm_01",)
    poses = (tmp_path / "extri.yml").read_text()
    (tmp_path / "extri.yml").write_text(poses.replace("_01:", "_1:").replace("_02:", "_2:"))
    with pytest.raises(InputError, match=r"extri.yml: has poses of cameras 1, 2, but intri.yml has cameras 01, 02: give each"):
        read_rig_as("easymocap", tmp_path)


def test_kalibr_and_nerfstudio(rig, tmp_path):
    written("kalibr", rig, tmp_path / "chain.yaml")
    chain = load_yaml(tmp_path / "chain.yaml", "a chain")
    chain["cam1"]["timeshift_cam_imu"] = 0.25
    (tmp_path / "chain.yaml").write_bytes(dump_yaml({**chain, "imu0": {"rate": 200}}))
    assert unread("kalibr", tmp_path / "chain.yaml") == ("not read: imu0, timeshift_cam_imu",)
    written("nerfstudio", rig, tmp_path / "transforms.json")
    content = json.loads((tmp_path / "transforms.json").read_text()) | {"applied_transform": np.eye(3).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    assert unread("nerfstudio", tmp_path / "transforms.json") == ("not read: applied_transform",)


def test_colmaps_points_and_frames_and_ros_transforms_of_no_camera(rig, tmp_path):
    written("colmap", rig, tmp_path)
    (tmp_path / "points3D.txt").write_text("# a comment\n1 0 0 0 9 9 9 0.1\n")
    (tmp_path / "rigs.txt").write_text("1 1 CAMERA 1\n")
    (tmp_path / "images.txt").write_text((tmp_path / "images.txt").read_text().replace("\n\n", "\n10 20 1\n", 1))
    assert unread("colmap", tmp_path) == ("not read: points3D.txt, rigs.txt, 2D points of the images",)
    written("ros", rig, tmp_path / "ros")
    (tmp_path / "ros" / "camera_info" / "camera_02.yaml").unlink()
    assert unread("ros", tmp_path / "ros") == ("not read: the transform of camera_02_optical_frame",)


def test_tables_of_toml_and_files_of_a_folder(rig, tmp_path):
    written("pose2sim", rig, tmp_path / "Calib.toml")
    text = (tmp_path / "Calib.toml").read_text().replace("error = 0.0", "error = 1.5")
    (tmp_path / "Calib.toml").write_text(f"{text}\n[charuco]\ncolumns = 4\n")
    assert unread("pose2sim", tmp_path / "Calib.toml") == ("not read: charuco, error",)
    written("opencv", rig, tmp_path / "cv")
    (tmp_path / "cv" / "board.yml").write_text("columns: 4\n")
    with (tmp_path / "cv" / "01.yml").open("a") as file:
        file.write("avg_reprojection_error: 0.2\n")
    assert unread("opencv", tmp_path / "cv") == ("not read: avgreprojectionerror, board.yml, which has no camera matrix",)


def test_people(tmp_path):
    person = {"person_id": [-1], "pose_keypoints_2d": [100.5, 50, 0.9] * 136, "hand_left_keypoints_2d": [1, 2, 0.5] * 21}
    (tmp_path / "a_000000000000_keypoints.json").write_text(json.dumps({"version": 1.3, "people": [person]}))
    given = Given()
    notes = read_people_as("openpose", tmp_path, given).notes
    assert "110 keypoints per person, of the face and the hands, are left out" in notes
    assert given.unread.told == ("not read: hand_left_keypoints_2d",)


def test_one_line_lists_all_and_empty_values_say_nothing():
    found = Unread()
    assert found.told == ()
    found.keys({"read": 1, "rms": 0.5, "none": None, "zero": 0, "empty": {}, "nested": {"x": 0}, "text": ""}, ("read",))
    found.keys({"rms": 0.1}, ())
    for index in range(30):
        found.add(f"key{index}")
    (line,) = found.told
    assert line.startswith("not read: rms (2 times), key0, ")
    assert line.endswith(" and 11 more")
