"""Files of Anipose, Pose2Sim and Caliscope as these tools write them."""

import tomllib

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Export, Given, export, read_rig_as
from support.refusals import refused

LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 905, 360], [0, 0, 1]]), np.array([-0.2, 0.05, 0.001, -0.002, 0.01]))


def table(head, *more, size="1280, 720", focal=900.0, bent="-0.2, 0.05, 0.001, -0.002, 0.01", turn="0.0, 0.0, 0.1",
          moved="0.1, -0.05, 2.0"):  # fmt: skip
    return (
        f"[{head}]\nsize = [ {size}]\nmatrix = [ [ {focal}, 0.0, 640.0], [ 0.0, {focal + 5}, 360.0], [ 0.0, 0.0, 1.0]]\n"
        f"distortions = [ {bent}]\nrotation = [ {turn}]\ntranslation = [ {moved}]\n" + "".join(f"{line}\n" for line in more)
    )


NOWHERE = {"turn": "0.0, 0.0, 0.0", "moved": "0.0, 0.0, 0.0"}
METADATA = "[metadata]\nadjusted = false\nerror = 0.31\n"
ANIPOSE = (
    table("cam_10", 'name = "B"', moved="100.0, -50.0, 2000.0")
    + table("cam_2", 'name = "A"', "fisheye = true", focal=400.0, bent="0.03, -0.01, 0.0, 0.0", **NOWHERE)
    + METADATA
)
STATED = ("rotation_count = 0", "error = 0.4", "grid_count = 20")
CALISCOPE = table("cameras.1", "cam_id = 1", "fisheye = false", *STATED) + (
    '[cameras.2]\ncam_id = 2\nsize = [1280, 720]\nerror = "null"\nmatrix = "null"\ndistortions = "null"\nfisheye = false\n'
)
COSINE, SINE = 0.9950041652780258, 0.09983341664682815
OLD_CALISCOPE = "creation_date = 2023-05-01T10:00:00\n[charuco]\ncolumns = 4\n" + table(
    "cam_0", "port = 0", *STATED, 'exposure = "null"', bent="[-0.2, 0.05, 0.001, -0.002, 0.01]",
    turn=f"[{COSINE}, {-SINE}, 0.0], [{SINE}, {COSINE}, 0.0], [0.0, 0.0, 1.0]", moved="[0.1], [-0.05], [2.0]",
)  # fmt: skip
SIZED = {"size": "1280.0, 720.0", "bent": "-0.2, 0.05, 0.001, -0.002"}
POSE2SIM = table("right", 'name = "cam_r"', "fisheye = false", **SIZED) + table("left", **SIZED) + METADATA


def read(form, text, folder, **given):
    path = folder / "rig.toml"
    path.write_text(text)
    return read_rig_as(form, path, Given(**given))


def exported(form, folder, names):
    """A rig of cameras of these names, and the tables of its file."""
    rig = Rig(tuple(Camera(name, LENS, Pose(np.eye(3), np.array([index, 0, 5.0]))) for index, name in enumerate(names)))
    export(Export(rig), form, folder / "rig.toml")
    return rig, tomllib.loads((folder / "rig.toml").read_text())


def test_anipose_does_not_tell_its_unit_and_sorts_its_tables_as_text(tmp_path):
    """So that more than ten cameras need numbers of two digits to stay in order."""
    with pytest.raises(InputError, match=r"rig\.toml: does not state the unit.*--units mm"):
        read("anipose", ANIPOSE, tmp_path)
    rig, _ = read("anipose", ANIPOSE, tmp_path, metres_per_unit=0.001)
    np.testing.assert_allclose(rig["B"].pose.t_cw, (0.1, -0.05, 2))
    assert [(camera.name, camera.lens.fisheye) for camera in rig] == [("B", False), ("A", True)]
    rig, tables = exported("anipose", tmp_path, [f"c{index}" for index in range(12)])
    assert [tables[key]["name"] for key in sorted(tables) if key != "metadata"] == list(rig.names)


def test_caliscope_leaves_cameras_without_a_lens(tmp_path):
    told = "camera cam_2 has no lens yet and is left out"
    with pytest.raises(InputError, match=told):
        read("caliscope", CALISCOPE, tmp_path)
    rig, losses = read_rig_as("caliscope", tmp_path / "rig.toml", lossy=True)
    assert (losses, rig.names) == ((told,), ("cam_1",))
    np.testing.assert_allclose(rig["cam_1"].pose.t_cw, (0.1, -0.05, 2))


def test_caliscope_of_earlier_days(tmp_path):
    new, _ = read("caliscope", CALISCOPE.split("[cameras.2]")[0], tmp_path)
    old, _ = read("caliscope", OLD_CALISCOPE, tmp_path)
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    assert old.names == ("cam_0",)
    np.testing.assert_allclose(old["cam_0"].project(points), new["cam_1"].project(points), atol=1e-9)


@pytest.mark.parametrize(
    ("names", "numbers"),
    [(("cam_3", "cam_0"), ["3", "0"]), (("cam_3", "door"), ["0", "1"]), ((f"cam_{'9' * 5000}", "cam_1"), ["0", "1"])],
)
def test_caliscope_numbers_cameras_as_their_videos(names, numbers, tmp_path):
    tables = exported("caliscope", tmp_path, names)[1]["cameras"]
    assert list(tables) == numbers
    assert [(table["cam_id"], table["name"]) for table in tables.values()] == list(zip(map(int, numbers), names, strict=True))


def test_pose2sim_keeps_the_order_of_the_file_and_takes_every_table_for_a_camera(tmp_path):
    """But those with the names that it gives to other things."""
    rig, _ = read("pose2sim", POSE2SIM, tmp_path)
    assert rig.names == ("cam_r", "left")
    np.testing.assert_allclose(rig["left"].pose.t_cw, (0.1, -0.05, 2))
    names = ("metadata", "metadata_", "charuco", "checkerboard", "capture_volume", "x.y")
    _, tables = exported("pose2sim", tmp_path, names)
    others = ("metadata", "capture_volume", "charuco", "checkerboard")
    assert [table["name"] for key, table in tables.items() if key not in others] == list(names)
    assert read_rig_as("pose2sim", tmp_path / "rig.toml")[0].names == names


@pytest.mark.parametrize("form", ["anipose", "pose2sim", "caliscope"])
@pytest.mark.parametrize(
    ("found", "put", "said"),
    [
        ("rotation = [ 0.0, 0.0, 0.1]\n", "", r"\[right\]: has a translation but no rotation"),
        ("[ -0.2, 0.05, 0.001, -0.002]", "[ -0.2, 0.05]", r"\[right\]: distortions has 2 values"),
        ("[ -0.2, 0.05, 0.001, -0.002]", '"none"', r"\[right\]: distortions"),
        ("[ 1280.0, 720.0]", "[ 0.0, 720.0]", r"\[right\]: size"),
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
