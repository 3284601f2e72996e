"""Files of Anipose, Pose2Sim and Caliscope as these tools write them."""

import tomllib

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Export, Given, export, read_rig_as
from support.refusals import refused

LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 905, 360], [0, 0, 1]]), np.array([-0.2, 0.05, 0.001, -0.002, 0.01]))
ANIPOSE = """
[cam_10]
name = "B"
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.0,], [ 0.0, 905.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.2, 0.05, 0.001, -0.002, 0.01,]
rotation = [ 0.0, 0.0, 0.1,]
translation = [ 100.0, -50.0, 2000.0,]

[cam_2]
name = "A"
size = [ 1280, 720,]
matrix = [ [ 400.0, 0.0, 640.0,], [ 0.0, 405.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.03, -0.01, 0.0, 0.0,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]
fisheye = true

[metadata]
adjusted = false
error = 0.31
"""
CALISCOPE = """
[cameras.1]
cam_id = 1
size = [1280, 720]
rotation_count = 0
error = 0.4
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.2, 0.05, 0.001, -0.002, 0.01]
translation = [0.1, -0.05, 2.0]
rotation = [0.0, 0.0, 0.1]
grid_count = 20
fisheye = false

[cameras.2]
cam_id = 2
size = [1280, 720]
rotation_count = 0
error = "null"
matrix = "null"
distortions = "null"
fisheye = false
"""
OLD_CALISCOPE = """
creation_date = 2023-05-01T10:00:00

[charuco]
columns = 4

[cam_0]
port = 0
size = [1280, 720]
rotation_count = 0
error = 0.3
matrix = [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [[-0.2, 0.05, 0.001, -0.002, 0.01]]
exposure = "null"
translation = [[0.1], [-0.05], [2.0]]
rotation = [[0.9950041652780258, -0.09983341664682815, 0.0], [0.09983341664682815, 0.9950041652780258, 0.0], [0.0, 0.0, 1.0]]
"""
POSE2SIM = """
[right]
name = "cam_r"
size = [ 1280.0, 720.0]
matrix = [ [ 900.0, 0.0, 640.0], [ 0.0, 905.0, 360.0], [ 0.0, 0.0, 1.0]]
distortions = [ -0.2, 0.05, 0.001, -0.002]
rotation = [ 0.0, 0.0, 0.1]
translation = [ 0.1, -0.05, 2.0]
fisheye = false

[left]
size = [ 1280.0, 720.0]
matrix = [ [ 900.0, 0.0, 640.0], [ 0.0, 905.0, 360.0], [ 0.0, 0.0, 1.0]]
distortions = [ -0.2, 0.05, 0.001, -0.002]
rotation = [ 0.0, 0.0, 0.1]
translation = [ 0.1, -0.05, 2.0]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"""


def read(form, text, folder, **given):
    path = folder / "rig.toml"
    path.write_text(text)
    return read_rig_as(form, path, Given(**given))


def test_anipose_does_not_tell_its_unit(tmp_path):
    with pytest.raises(InputError, match=r"rig\.toml: does not state the unit.*--units mm"):
        read("anipose", ANIPOSE, tmp_path)
    rig, _ = read("anipose", ANIPOSE, tmp_path, metres_per_unit=0.001)
    assert rig.names == ("B", "A")
    np.testing.assert_allclose(rig["B"].pose.t_cw, (0.1, -0.05, 2))
    assert rig["A"].lens.fisheye
    assert not rig["B"].lens.fisheye


def test_anipose_sorts_its_tables_as_text(tmp_path):
    """So that more than ten cameras need numbers of two digits to stay in order."""
    rig = Rig(tuple(Camera(f"c{index}", LENS, Pose(np.eye(3), np.array([index, 0, 5.0]))) for index in range(12)))
    export(Export(rig), "anipose", tmp_path / "rig.toml")
    tables = tomllib.loads((tmp_path / "rig.toml").read_text())
    assert [tables[key]["name"] for key in sorted(tables) if key != "metadata"] == list(rig.names)


def test_caliscope_leaves_cameras_without_a_lens(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(CALISCOPE)
    with pytest.raises(InputError, match="camera cam_2 has no lens yet and is left out"):
        read_rig_as("caliscope", path)
    rig, told = read_rig_as("caliscope", path, lossy=True)
    assert told == ("camera cam_2 has no lens yet and is left out",)
    assert rig.names == ("cam_1",)
    np.testing.assert_allclose(rig["cam_1"].pose.t_cw, (0.1, -0.05, 2))


def test_caliscope_of_earlier_days(tmp_path):
    new, _ = read("caliscope", CALISCOPE.split("[cameras.2]")[0], tmp_path)
    old, _ = read("caliscope", OLD_CALISCOPE, tmp_path)
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    assert old.names == ("cam_0",)
    np.testing.assert_allclose(old["cam_0"].project(points), new["cam_1"].project(points), atol=1e-9)


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (("cam_3", "cam_0"), ["3", "0"]),
        (("cam_3", "door"), ["0", "1"]),
        (("cam_03", "cam_1"), ["0", "1"]),
        ((f"cam_{'9' * 5000}", "cam_1"), ["0", "1"]),
    ],
)
def test_caliscope_numbers_cameras_as_their_videos(names, numbers, tmp_path):
    rig = Rig(tuple(Camera(name, LENS, Pose(np.eye(3), np.array([index, 0, 5.0]))) for index, name in enumerate(names)))
    export(Export(rig), "caliscope", tmp_path / "rig.toml")
    tables = tomllib.loads((tmp_path / "rig.toml").read_text())["cameras"]
    assert list(tables) == numbers
    assert [table["cam_id"] for table in tables.values()] == [int(number) for number in numbers]
    assert [table["name"] for table in tables.values()] == list(names)


def test_pose2sim_keeps_the_order_of_the_file(tmp_path):
    rig, _ = read("pose2sim", POSE2SIM, tmp_path)
    assert rig.names == ("cam_r", "left")
    np.testing.assert_allclose(rig["left"].pose.t_cw, (0.1, -0.05, 2))


def test_pose2sim_takes_every_table_for_a_camera(tmp_path):
    """But those with the names that it gives to other things."""
    names = ("metadata", "metadata_", "charuco", "checkerboard", "capture_volume", "x.y")
    rig = Rig(tuple(Camera(name, LENS, Pose(np.eye(3), np.array([index, 0, 5.0]))) for index, name in enumerate(names)))
    export(Export(rig), "pose2sim", tmp_path / "rig.toml")
    tables = tomllib.loads((tmp_path / "rig.toml").read_text())
    seen = [key for key in tables if key not in ("metadata", "capture_volume", "charuco", "checkerboard")]
    assert [tables[key]["name"] for key in seen] == list(names)
    assert read_rig_as("pose2sim", tmp_path / "rig.toml")[0].names == names


@pytest.mark.parametrize("form", ["anipose", "pose2sim", "caliscope"])
@pytest.mark.parametrize(
    ("found", "put", "said"),
    [
        ("rotation = [ 0.0, 0.0, 0.1]\n", "", r"\[right\]: has a translation but no rotation"),
        ("[ -0.2, 0.05, 0.001, -0.002]", "[ -0.2, 0.05]", r"\[right\]: distortions has 2 values"),
        ("[ -0.2, 0.05, 0.001, -0.002]", '"none"', r"\[right\]: distortions"),
        ("[ 1280.0, 720.0]", "[ 0.0, 720.0]", r"\[right\]: size"),
        ("translation = [ 0.1", 'translation = [ "a"', r"\[right\]: translation"),
        ("[right]", "[right", "is not TOML"),
        (POSE2SIM, "[x]\ny = 1\n", "holds no camera"),
    ],
)
def test_faults(form, found, put, said, tmp_path):
    with refused(said, tmp_path / "rig.toml"):
        read(form, POSE2SIM.replace(found, put, 1), tmp_path, metres_per_unit=1.0)


def test_a_size_that_is_not_told_can_be_given(tmp_path):
    text = POSE2SIM.replace("size = [ 1280.0, 720.0]\n", "")
    with pytest.raises(InputError, match=r"\[right\]: .*--size"):
        read("pose2sim", text, tmp_path)
    assert read("pose2sim", text, tmp_path, size=(1280, 720))[0]["left"].lens.size == (1280, 720)
