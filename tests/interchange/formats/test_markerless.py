"""Files of Anipose, Caliscope, EasyMocap, FreeMoCap and Pose2Sim, and K, R and t as JSON, as these tools write them."""

import json
import tomllib

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.formats import Given, read_rig_as
from support.refusals import refused
from support.scenes import handmade_rigs as hand

BENT = (-0.1, 0.02, 0.001, -0.002, 0.003)


def table(head, *more, size="1280, 720", focal=900.0, bent="-0.2, 0.05, 0.001, -0.002, 0.01", turn="0.0, 0.0, 0.1",
          moved="0.1, -0.05, 2.0"):  # fmt: skip
    return (
        f"[{head}]\nsize = [ {size}]\nmatrix = [ [ {focal}, 0.0, 640.0], [ 0.0, {focal + 5}, 360.0], [ 0.0, 0.0, 1.0]]\n"
        f"distortions = [ {bent}]\nrotation = [ {turn}]\ntranslation = [ {moved}]\n" + "".join(f"{line}\n" for line in more)
    )


METADATA = "[metadata]\nadjusted = false\nerror = 0.31\n"
FISHEYE = {"focal": 400.0, "bent": "0.03, -0.01, 0.0, 0.0", "turn": "0.0, 0.0, 0.0", "moved": "0.0, 0.0, 0.0"}
ANIPOSE = table("cam_10", 'name = "B"', moved="100.0, -50.0, 2000.0") + table(
    "cam_2", 'name = "A"', "fisheye = true", **FISHEYE
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
# As FreeMoCap 1.8.2 dumps a group of cameras (toml 0.10.2).
FREEMOCAP = """\
[cam_0]
name = "Camera_000_synchronized"
size = [ 1280, 720,]
matrix = [ [ 900.5, 0.0, 639.5,], [ 0.0, 900.5, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.05, 0.0, 0.0, 0.0, 0.0,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]
world_orientation = [ [ 1.0, 0.0, 0.0,], [ 0.0, 1.0, 0.0,], [ 0.0, 0.0, 1.0,],]
world_position = [ 0.0, 0.0, 0.0,]
[cam_1]
name = "Camera_001_synchronized"
size = [ 1280, 720,]
matrix = [ [ 910.0, 0.0, 639.5,], [ 0.0, 910.0, 359.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.04, 0.0, 0.0, 0.0, 0.0,]
rotation = [ 0.0, 0.5, 0.0,]
translation = [ -500.0, 0.0, 250.0,]
[metadata]
charuco_square_size = 54.0
groundplane_calibration = false
"""
KRT = {
    "K": hand.MATRIX.tolist(), "R": hand.LOOKING_NORTH.tolist(), "t": list(hand.TRANSLATION), "dist": [0.0] * 5,
    "imgSize": list(hand.SIZE),
}  # fmt: skip


def read(form, content, folder, **given):
    """The rig in one file, and what is not read of it."""
    path = folder / ("cameras.json" if form in ("krt-json", "panoptic") else "rig.toml")
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    asked = Given(**given)
    return read_rig_as(form, path, asked)[0], asked.unread.told


def tables_of(form, folder, names):
    """The tables of a file of cameras with these names."""
    hand.written(form, hand.turned_rig(names), folder / "rig.toml")
    return tomllib.loads((folder / "rig.toml").read_text())


def test_anipose_does_not_state_its_unit_and_sorts_its_tables_as_text(tmp_path):
    """So that more than ten cameras need numbers of two digits to stay in order."""
    with pytest.raises(InputError, match=r"rig\.toml: does not state the unit.*--units mm"):
        read("anipose", ANIPOSE + METADATA, tmp_path)
    rig, _ = read("anipose", ANIPOSE + METADATA, tmp_path, metres_per_unit=0.001)
    np.testing.assert_allclose(rig["B"].pose.t_cw, (0.1, -0.05, 2))
    assert [(camera.name, camera.lens.fisheye) for camera in rig] == [("B", False), ("A", True)]
    names = [f"c{index}" for index in range(12)]
    tables = tables_of("anipose", tmp_path, names)
    assert [tables[key]["name"] for key in sorted(tables) if key != "metadata"] == names


def test_caliscope_leaves_cameras_without_a_lens(tmp_path):
    loss = "camera cam_2 has no lens yet and is left out"
    with pytest.raises(InputError, match=loss):
        read("caliscope", CALISCOPE, tmp_path)
    rig, losses = read_rig_as("caliscope", tmp_path / "rig.toml", lossy=True)
    assert (losses, rig.names) == ((loss,), ("cam_1",))
    np.testing.assert_allclose(rig["cam_1"].pose.t_cw, (0.1, -0.05, 2))
    old, _ = read("caliscope", OLD_CALISCOPE, tmp_path)
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    assert old.names == ("cam_0",)
    np.testing.assert_allclose(old["cam_0"].project(points), rig["cam_1"].project(points), atol=1e-9)


@pytest.mark.parametrize(("names", "numbers"), [
    (("cam_3", "cam_0"), ["3", "0"]), (("cam_3", "door"), ["0", "1"]), ((f"cam_{'9' * 5000}", "cam_1"), ["0", "1"]),
])  # fmt: skip
def test_caliscope_numbers_cameras_as_their_videos(names, numbers, tmp_path):
    tables = tables_of("caliscope", tmp_path, names)["cameras"]
    assert list(tables) == numbers
    assert [(table["cam_id"], table["name"]) for table in tables.values()] == list(zip(map(int, numbers), names, strict=True))


def test_pose2sim_keeps_the_order_of_the_file_and_takes_every_table_for_a_camera(tmp_path):
    """But those with the names that it gives to other things."""
    rig, _ = read("pose2sim", POSE2SIM, tmp_path)
    assert rig.names == ("cam_r", "left")
    np.testing.assert_allclose(rig["left"].pose.t_cw, (0.1, -0.05, 2))
    unsized = POSE2SIM.replace("size = [ 1280.0, 720.0]\n", "")
    with pytest.raises(InputError, match=r"\[right\]: .*--size"):
        read("pose2sim", unsized, tmp_path)
    assert read("pose2sim", unsized, tmp_path, size=(1280, 720))[0]["left"].lens.size == (1280, 720)
    names = ("metadata", "metadata_", "charuco", "checkerboard", "capture_volume", "x.y")
    tables, others = tables_of("pose2sim", tmp_path, names), ("metadata", "capture_volume", "charuco", "checkerboard")
    assert [table["name"] for key, table in tables.items() if key not in others] == list(names)
    assert read_rig_as("pose2sim", tmp_path / "rig.toml")[0].names == names


def test_freemocap_finds_a_camera_at_a_known_place(tmp_path):
    hand.written("freemocap", Rig((hand.facing("north", distortions=(-0.1, 0.02, 0.001, -0.002)),)), tmp_path / "rig.toml")
    content = tomllib.loads((tmp_path / "rig.toml").read_text())
    camera = content["cam_0"]
    np.testing.assert_allclose(camera["rotation"], [np.pi / 2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(camera["translation"], [-4000, 2500, 3000], atol=1e-9)
    np.testing.assert_allclose(camera["world_position"], [4000, -3000, 2500], atol=1e-9)
    # Columns: the camera's right, down and forward in the world.
    np.testing.assert_allclose(camera["world_orientation"], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    assert (camera["name"], camera["size"], camera["distortions"]) == (
        "north",
        list(hand.SIZE),
        [-0.1, 0.02, 0.001, -0.002, 0.0],
    )
    assert content["metadata"]["groundplane_calibration"] is True
    # FreeMoCap sorts the keys as text, and the videos by their names in small letters: the two must go together.
    names = [f"{letter}{index}" for letter in ("b", "A", "c") for index in range(4)]
    tables = tables_of("freemocap", tmp_path, names)
    assert [tables[key]["name"] for key in sorted(tables) if key != "metadata"] == sorted(names, key=str.lower)


def test_a_file_of_freemocap_is_in_millimetres_or_squares_of_its_board(tmp_path):
    squares = FREEMOCAP.replace("= 54.0", "= 1")
    with pytest.raises(InputError, match=r"rig.toml: lengths are in squares of the board.*--units"):
        read("freemocap", squares, tmp_path)
    for text, unit in ((FREEMOCAP, None), (squares, 0.001)):
        rig, _ = read("freemocap", text, tmp_path, metres_per_unit=unit)
        assert rig.names == ("Camera_000_synchronized", "Camera_001_synchronized")
        pose = rig["Camera_001_synchronized"].pose
        np.testing.assert_allclose(pose.t_cw, [-0.5, 0, 0.25])
        np.testing.assert_allclose(pose.R_cw, cv2.Rodrigues(np.array([0, 0.5, 0]))[0])


@pytest.mark.parametrize(("form", "sound", "old", "new", "message"), [
    ("anipose", POSE2SIM, "[right]", "[right", "is not TOML"),
    ("anipose", POSE2SIM, POSE2SIM, "[x]\ny = 1\n", "holds no camera"),
    ("pose2sim", POSE2SIM, POSE2SIM, "[x]\ny = 1\n", "holds no camera"),
    ("caliscope", POSE2SIM, POSE2SIM, "[x]\ny = 1\n", "holds no camera"),
    *((form, POSE2SIM, old, new, message) for form in ("anipose", "caliscope") for old, new, message in (
        ("rotation = [ 0.0, 0.0, 0.1]\n", "", r"\[right\]: has a translation but no rotation"),
        ("[ -0.2, 0.05, 0.001, -0.002]", "[ -0.2, 0.05]", r"\[right\]: distortions has 2 values"),
        ("[ 1280.0, 720.0]", "[ 0.0, 720.0]", r"\[right\]: size"),
    )),
    ("pose2sim", POSE2SIM, "[ -0.2, 0.05, 0.001, -0.002]", '"none"', r"\[right\]: distortions"),
    ("freemocap", FREEMOCAP, FREEMOCAP, "", "is not a calibration of FreeMoCap"),
    ("freemocap", FREEMOCAP, "Camera_001", "Camera_000", "camera Camera_000_synchronized occurs twice"),
    ("freemocap", FREEMOCAP, "[metadata]", '[metadata]\nunits = "ft"', r"\[metadata\] units is 'ft': write one of m, cm, mm"),
])  # fmt: skip
def test_broken_files_of_toml_are_refused(tmp_path, form, sound, old, new, message):
    with refused(message, tmp_path / "rig.toml"):
        read(form, sound.replace(old, new, 1), tmp_path, metres_per_unit=None if form == "freemocap" else 1.0)


def opencv(name, columns, *values):
    numbers = ", ".join(f"{value:.6f}" for value in values)
    rows = len(values) // columns
    return f"{name}: !!opencv-matrix\r\n  rows: {rows}\r\n  cols: {columns}\r\n  dt: d\r\n  data: [{numbers}]\r\n"


# As EasyMocap's own writer has it: six digits, Windows' line ends, no picture size.
INTRI = '%YAML:1.0\r\n---\r\nnames:\r\n  - "01"\r\n  - "02"\r\n' + "".join(
    opencv(f"K_{name}", 3, *hand.MATRIX.ravel()) + opencv(f"dist_{name}", 5, *bent)
    for name, bent in (("01", BENT), ("02", 5 * (0,)))
)
EXTRI = '%YAML:1.0\r\n---\r\nnames:\r\n  - "01"\r\n' + opencv("R_01", 1, np.pi / 2, 0, 0) + opencv("T_01", 1, *hand.TRANSLATION)


def test_easymocap_finds_a_camera_at_a_known_place(tmp_path):
    hand.written("easymocap", Rig((hand.facing("north", distortions=BENT),)), tmp_path)
    for name, expected in (
        ("extri.yml", {"R_north": np.vstack([np.pi / 2, 0, 0]), "Rot_north": hand.LOOKING_NORTH,
                       "T_north": np.vstack(hand.TRANSLATION)}),
        ("intri.yml", {"K_north": hand.MATRIX, "dist_north": [BENT]}),
    ):  # fmt: skip
        assert (tmp_path / name).read_text().startswith("%YAML:1.0\n---\n")
        file = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
        for key, value in expected.items():
            np.testing.assert_allclose(file.getNode(key).mat(), value, atol=1e-12)
    assert (int(file.getNode("W_north").real()), int(file.getNode("H_north").real())) == hand.SIZE
    assert file.getNode("names").at(0).string() == "north"


def test_a_folder_of_easymocap_is_read(tmp_path):
    (tmp_path / "intri.yml").write_bytes(INTRI.encode())
    (tmp_path / "extri.yml").write_bytes(EXTRI.encode())
    with pytest.raises(InputError, match=r"camera 01: states no image size.*--size"):
        read_rig_as("easymocap", tmp_path)
    rig, _ = read_rig_as("easymocap", tmp_path, Given(hand.SIZE))
    assert rig.names == ("01", "02")
    np.testing.assert_allclose(rig["01"].centre, hand.CENTRE, atol=1e-5)
    np.testing.assert_array_equal(rig["01"].lens.distortions, BENT)
    assert rig["02"].pose is None


@pytest.mark.parametrize("edited", ["[", '["one", 2]'])
def test_names_that_were_edited_by_hand_are_those_of_the_file(tmp_path, edited):
    hand.written("easymocap", Rig((hand.facing("a b"), hand.facing("é"))), tmp_path)
    path = tmp_path / "intri.yml"
    lines = path.read_text().splitlines(keepends=True)
    (index,) = [k for k, line in enumerate(lines) if line.startswith("passerby_names")]
    lines[index] = f"passerby_names: '{edited}'\n"
    path.write_text("".join(lines))
    names = read_rig_as("easymocap", tmp_path)[0].names
    assert len(names) == 2
    assert not {"a b", "é"} & set(names)


@pytest.mark.parametrize(("intri", "extri", "message"), [
    ("nothing: 1", EXTRI, "has no list `names`"),
    ("\x00", EXTRI, "is not YAML"),
    ("[1]", EXTRI, "holds no table of OpenCV"),
    (INTRI.replace("K_02", "K_03"), EXTRI, "camera 02: K_02 is missing"),
    (INTRI.replace("1100.000000", "-1100.000000"), EXTRI, "camera 01: matrix .* focal lengths"),
    (INTRI.replace('"02"', '"01"'), EXTRI, "camera 01 occurs twice"),
    (INTRI, EXTRI.replace("T_01", "T_1"), "camera 01: R_01 or T_01 is missing"),
    (INTRI, EXTRI.replace("1.570796, ", ""), "camera 01: R_01 is .*: 3 numbers are needed"),
])  # fmt: skip
def test_broken_folders_of_easymocap_are_refused(tmp_path, intri, extri, message):
    (tmp_path / "intri.yml").write_text(intri)
    (tmp_path / "extri.yml").write_text(extri)
    with refused(message, tmp_path):
        read_rig_as("easymocap", tmp_path, Given(hand.SIZE))


@pytest.mark.parametrize(("content", "name"), [
    ({"north": {key: np.ravel(value).tolist() for key, value in KRT.items()}}, "north"),
    ([KRT | {"name": "north"}], "north"),
    ({"cameras": [KRT | {"id": 3}]}, "3"),
    ({"cameras": {"north": KRT}, "units": "m"}, "north"),
    ({"0": {key: value for key, value in KRT.items() if key not in "Rt"}
      | {"RT": np.column_stack([hand.LOOKING_NORTH, hand.TRANSLATION]).tolist()}}, "0"),
    ({"0": KRT | {"R": [np.pi / 2, 0, 0]}}, "0"),
])  # fmt: skip
def test_json_is_read_in_every_layout(tmp_path, content, name):
    rig, unread = read("krt-json", content, tmp_path, metres_per_unit=1.0)
    assert (rig.names, unread) == ((name,), ())
    np.testing.assert_allclose(rig[name].project(hand.POINTS), hand.PIXELS, atol=1e-6)


def test_the_unit_of_json_is_stated_or_asked_for(tmp_path):
    with pytest.raises(InputError, match=r"camera 0: does not state the unit.*--units mm"):
        read("krt-json", {"0": KRT}, tmp_path)
    for unit, many in (("m", 1.0), ("cm", 100.0), ("mm", 1000.0)):
        camera = KRT | {"t": [many * value for value in hand.TRANSLATION], "unit": unit}
        np.testing.assert_allclose(read("krt-json", {"0": camera}, tmp_path)[0]["0"].centre, hand.CENTRE, atol=1e-9)
    # VoxelPose has the centre, in millimetres.
    voxelpose = {
        "fx": 1000.0, "fy": 1100.0, "cx": 960.0, "cy": 540.0, "k": [[0.1], [0.01], [0.001]], "p": [[0.002], [0.003]],
        "R": hand.LOOKING_NORTH.tolist(), "T": [[1000 * value] for value in hand.CENTRE],
    }  # fmt: skip
    rig, _ = read("krt-json", {"0": voxelpose}, tmp_path, size=hand.SIZE)
    np.testing.assert_allclose(rig["0"].centre, hand.CENTRE, atol=1e-9)
    np.testing.assert_array_equal(rig["0"].lens.distortions, [0.1, 0.01, 0.002, 0.003, 0.001])


def test_what_is_not_read_of_json_is_listed(tmp_path):
    content = {"a": KRT | {"rms": 0.3}, "b": KRT | {"rms": 0.2}, "date": "today"}
    assert read("krt-json", content, tmp_path, metres_per_unit=1.0)[1] == ("not read: date, rms (2 times)",)
    bare = {key: value for key, value in KRT.items() if key != "dist"}
    unread = read("krt-json", {"a": bare}, tmp_path, metres_per_unit=1.0)[1]
    assert unread == ("not read: camera a states no distortion: none is assumed",)


def test_the_world_of_panoptic_has_y_down_and_centimetres(tmp_path):
    # Level, 2.5 m above the floor (y = -250), looking along Panoptic's +z, which is this world's +y.
    camera = {
        "name": "00_03", "type": "hd", "panel": 0, "node": 3, "resolution": list(hand.SIZE), "K": hand.MATRIX.tolist(),
        "distCoef": [0.0] * 5, "R": np.eye(3).tolist(), "t": [[-400.0], [250.0], [300.0]],
    }  # fmt: skip
    rig, unread = read("panoptic", {"calibDataSource": "171026", "cameras": [camera]}, tmp_path)
    np.testing.assert_allclose(rig["00_03"].centre, hand.CENTRE, atol=1e-9)
    np.testing.assert_allclose(rig["00_03"].project(hand.POINTS), hand.PIXELS, atol=1e-6)
    assert unread == ("not read: calibDataSource",)
    with pytest.raises(InputError, match="import it with --format panoptic"):
        read("krt-json", {"cameras": [camera]}, tmp_path, metres_per_unit=0.01)
    hand.written("panoptic", Rig((hand.facing("18181920"),)), tmp_path / "b.json")
    (camera,) = json.loads((tmp_path / "b.json").read_text())["cameras"]
    np.testing.assert_allclose(camera["R"], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.ravel(camera["t"]), [-400, 250, 300])


def test_json_has_the_keys_of_every_tool(tmp_path):
    hand.written("krt-json", Rig((hand.facing("18181920", distortions=BENT),)), tmp_path / "a.json")
    camera = json.loads((tmp_path / "a.json").read_text())["18181920"]
    assert [len(camera[key]) for key in ("K", "R", "T", "RT", "distCoeff", "imgSize")] == [9, 9, 3, 12, 5, 2]
    np.testing.assert_allclose(camera["T"], hand.TRANSLATION)


@pytest.mark.parametrize(("change", "message"), [
    ({"R": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "camera a: R: .*not a rotation"),
    ({"R": None}, "camera a: has no R"),
    ({"imgSize": None}, "states no image size.*--size"),
    ({"RT": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}, "R and T are not those in RT"),
    ({"unit": "feet"}, "unit is 'feet': write one of m, cm, mm"),
])  # fmt: skip
def test_broken_cameras_of_json_are_refused(tmp_path, change, message):
    with refused(message, tmp_path):
        read("krt-json", {"a": KRT | change}, tmp_path, metres_per_unit=None if "unit" in change else 1.0)
