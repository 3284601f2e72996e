"""What all formats share: recognition, targets, what is not read, and what is refused."""

import json

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange import formats
from passerby.interchange.formats import Export, Format, Given, all_formats, read_people_as, read_rig_as, recognise_format
from passerby.interchange.formats.format import Unread
from passerby.interchange.formats.values import dump_yaml, load_yaml
from passerby.interchange.rig_toml import write_rig
from support.scenes.handmade_rigs import SIZE, facing, written
from support.untrusted import example_files as example

BY_FOLDER = {
    "colmap": "cameras.txt", "colmap-bin": "cameras.bin", "opencv": "A.yml", "easymocap": "intri.yml",
    "ros": "camera_info/A.yaml", "mv3dt": "camInfo/A.yml",
}  # fmt: skip
"""The file of a folder's rig that has the intrinsics."""
BY_NAME = {"pose2sim": "Calib.toml"}
"""Where the content alone does not tell."""
READERS = [form for form in all_formats() if form.read is not None]


def laid_out(form, folder):
    if form.target == "folder":
        for name, content in example.exported(form.name, "").items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        return folder / BY_FOLDER[form.name]
    path = folder / BY_NAME.get(form.name, f"rig{form.suffixes[0]}")
    path.write_bytes(example.exported(form.name, path.name)[path.name])
    return path


@pytest.mark.parametrize("form", READERS, ids=lambda form: form.name)
def test_a_format_recognises_its_files_and_reads_what_it_recognises(form, tmp_path):
    path = laid_out(form, tmp_path)
    found = recognise_format(path)
    assert found.name == form.name
    size = None if form.name in example.READ_ONLY else (640, 480)
    assert len(read_rig_as(found.name, path, Given(size, 1.0), lossy=True)[0])


def test_what_is_no_calibration_of_another_tool_is_not_recognised(tmp_path):
    write_rig(tmp_path / "rig.toml", example.rig())
    (tmp_path / "scene.toml").write_text(example.SCENE)
    (tmp_path / "A.json").write_bytes(example.joints_file())
    (tmp_path / "notes.cal").write_text("a text that another tool wrote")
    (tmp_path / "model.pickle").write_bytes(b"\x80\x04K\x01.")
    for path in [*tmp_path.iterdir(), tmp_path, tmp_path / "missing.json"]:
        assert recognise_format(path) is None
    (tmp_path / "lab.cal").write_bytes(bytes(range(256)))
    assert recognise_format(tmp_path / "lab.cal").name == "motive"


POSED = Rig((facing("01"),))


@pytest.fixture
def made(monkeypatch):
    known = {
        "two": Format("two", "two files", ("none",), "folder", write=lambda *given: {"a.txt": b"a", "below/b.txt": b"b"}),
        "one": Format("one", "a file", ("none",), "file", (".one",), write=lambda *given: {"": b"1"}),
        "read": Format("read", "read only", ("none",), "file", read=lambda path, given: POSED),
    }
    monkeypatch.setattr(formats, "MODULES", known)
    monkeypatch.setattr(formats, "find_format", known.__getitem__)


def test_a_format_refuses_what_it_is_not_for(made, tmp_path):
    (tmp_path / "a.one").write_text("")
    with pytest.raises(InputError, match="format one holds no cameras that can be read: choose one of read"):
        read_rig_as("one", tmp_path / "a.one")
    with pytest.raises(InputError, match="no such file"):
        read_rig_as("read", tmp_path / "x")
    for form, target, message in (
        ("two", "a.one", "is a file, but format two is a folder"), ("one", ".", "is a folder, but format one is one file"),
        ("read", "x", "only read"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=message):
            formats.export(Export(POSED), form, tmp_path / target)


def test_files_of_another_rig_are_not_left_beside_it(made, tmp_path):
    for _ in range(2):
        formats.export(Export(POSED), "two", tmp_path / "out")
    (tmp_path / "out/notes.md").write_text("")
    formats.export(Export(POSED), "two", tmp_path / "out")
    (tmp_path / "out/below/other.txt").write_text("")
    with pytest.raises(InputError, match=r"other\.txt: would be taken for a part of the rig"):
        formats.export(Export(POSED), "two", tmp_path / "out")


@pytest.mark.parametrize("far", [1e308, 1e12])
def test_a_camera_that_is_nowhere_is_refused(tmp_path, far):
    """A translation of 1e308 overflows on the way: NaN and infinity come out."""
    path = tmp_path / "gate.yml"
    path.write_text(f"projectionMatrix_3x4_w2p: [10, 0, 1, {far}, 0, 10, 1, -{far}, 0, 0, 1, 1]\n".replace("e+", "e"))
    with pytest.raises(InputError, match=f"{path}: camera gate: the translation of its pose is .*: correct its pose"):
        read_rig_as("mv3dt", path, Given((640, 480), 100.0))


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


def test_what_a_format_does_not_read_is_listed(rig, tmp_path):
    written("kalibr", rig, tmp_path / "chain.yaml")
    chain = load_yaml(tmp_path / "chain.yaml", "a chain")
    chain["cam1"]["timeshift_cam_imu"] = 0.25
    (tmp_path / "chain.yaml").write_bytes(dump_yaml({**chain, "imu0": {"rate": 200}}))
    assert unread("kalibr", tmp_path / "chain.yaml") == ("not read: imu0, timeshift_cam_imu",)
    written("nerfstudio", rig, tmp_path / "transforms.json")
    content = json.loads((tmp_path / "transforms.json").read_text()) | {"applied_transform": np.eye(3).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    assert unread("nerfstudio", tmp_path / "transforms.json") == ("not read: applied_transform",)
    colmap = tmp_path / "colmap"
    written("colmap", rig, colmap)
    (colmap / "points3D.txt").write_text("# a comment\n1 0 0 0 9 9 9 0.1\n")
    (colmap / "rigs.txt").write_text("1 1 CAMERA 1\n")
    (colmap / "images.txt").write_text((colmap / "images.txt").read_text().replace("\n\n", "\n10 20 1\n", 1))
    assert unread("colmap", colmap) == ("not read: points3D.txt, rigs.txt, 2D points of the images",)
    written("ros", rig, tmp_path / "ros")
    (tmp_path / "ros" / "camera_info" / "camera_02.yaml").unlink()
    assert unread("ros", tmp_path / "ros") == ("not read: the transform of camera_02_optical_frame",)
    written("pose2sim", rig, tmp_path / "Calib.toml")
    text = (tmp_path / "Calib.toml").read_text().replace("error = 0.0", "error = 1.5")
    (tmp_path / "Calib.toml").write_text(f"{text}\n[charuco]\ncolumns = 4\n")
    assert unread("pose2sim", tmp_path / "Calib.toml") == ("not read: charuco, error",)
    written("opencv", rig, tmp_path / "cv")
    (tmp_path / "cv" / "board.yml").write_text("columns: 4\n")
    with (tmp_path / "cv" / "01.yml").open("a") as file:
        file.write("avg_reprojection_error: 0.2\n")
    assert unread("opencv", tmp_path / "cv") == ("not read: avgreprojectionerror, board.yml, which has no camera matrix",)


def test_keypoints_of_people_that_are_not_read_are_listed(tmp_path):
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
