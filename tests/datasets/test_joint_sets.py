"""CMU Panoptic and TUM Shelf and Campus: cameras and joints come out as they were put in; what is broken is named."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import BODY_17
from passerby.datasets import read_published
from passerby.datasets.published import Published
from passerby.datasets.skeletons import Skeletons, project_joints
from passerby.datasets.tum import JOINTS
from support.datasets.joints import FIRST, People, write_panoptic, write_tum
from support.refusals import refused
from support.tiers import thinned


def assert_cameras(found: Published, truth: People, tolerance_px: float = 1e-4) -> None:
    """All cameras project as those put in, and stand where they do."""
    assert len(found.rig) == len(truth.rig)
    points = np.nan_to_num(truth.joints[-1, 0])
    for camera, true in zip(found.rig, truth.rig, strict=True):
        assert camera.lens.size == true.lens.size
        np.testing.assert_allclose(camera.lens.matrix, true.lens.matrix, atol=1e-4)
        np.testing.assert_allclose(camera.centre, true.centre, atol=1e-6)
        np.testing.assert_allclose(camera.project(points), true.project(points), atol=tolerance_px)


def inside(pixels: np.ndarray, size: tuple[int, int]) -> bool:
    return bool(((pixels > 1) & (pixels < np.array(size) - 2)).all())


def assert_joints(found: Published, truth: People, names: tuple[str, ...], first: int, first_id: int) -> None:
    """Every joint in a picture is the projection of the one put in, and no person in a picture is left out."""
    joints = 0
    for camera, true in zip(found.rig, truth.rig, strict=True):
        seen = found.keypoints[camera.name]
        assert seen.joints == names
        for frame, who, xy, score in zip(seen.frame, seen.identity, seen.xy, seen.score, strict=True):
            expected = true.project(truth.named(frame - first, who - first_id, names))
            np.testing.assert_allclose(xy[score > 0], expected[score > 0], atol=1e-3)
            joints += int((score > 0).sum())
        there = {
            (frame + first, person + first_id)
            for frame in range(len(truth.joints))
            for person in range(truth.joints.shape[1])
            if truth.there(frame, person) and inside(true.project(truth.joints[frame, person]), true.lens.size)
        }
        assert there <= set(zip(seen.frame.tolist(), seen.identity.tolist(), strict=True))
    assert joints > 1000


def assert_ground(found: Published, truth: People, first: int, first_id: int) -> None:
    ankles = [BODY_17.index("left_ankle"), BODY_17.index("right_ankle")]
    true = truth.joints[found.ground.frame - first, found.ground.identity - first_id][:, ankles, :2].mean(axis=1)
    np.testing.assert_allclose(found.ground.xy, true, atol=1e-6)
    assert len(found.ground) == np.isfinite(truth.joints).all(axis=(2, 3)).sum()


def test_panoptic_is_what_was_put_in(tmp_path) -> None:
    truth = write_panoptic(tmp_path / "170101_walk1")
    found = read_published("panoptic", tmp_path / "170101_walk1")
    assert (found.name, found.fps, found.rig.names) == ("170101_walk1", 29.97, truth.rig.names)
    assert_cameras(found, truth)
    assert_joints(found, truth, BODY_17, FIRST + 1, 0)
    assert_ground(found, truth, FIRST + 1, 0)
    ear = BODY_17.index("left_ear")
    assert all((seen.score[:, ear] == 0).all() and seen.score.max() == 0.6 for seen in found.keypoints.values())
    assert any("projected through its cameras" in note for note in found.notes)


def test_panoptic_takes_the_cameras_whose_pictures_or_videos_are_there(tmp_path) -> None:
    truth = write_panoptic(tmp_path / "set", media="pictures")
    found = read_published("panoptic", tmp_path / "set")
    assert found.rig.names == (truth.rig.names[0], truth.rig.names[2])
    assert {name: found.frames_of_pictures(name) for name in found.rig.names} == dict.fromkeys(found.rig.names, (FIRST + 1,))
    write_panoptic(tmp_path / "filmed", media="videos")
    found = read_published("panoptic", tmp_path / "filmed")
    assert [path.name for path in found.videos.values()] == ["hd_00_00.mp4", "hd_00_02.mp4"]


@pytest.mark.real
def test_the_published_panoptic_cameras_stand_above_the_floor(data_root) -> None:
    """The convention of the axes on real files: a dome of 5.5 m, cameras from 0.7 to 3.5 m high that look inwards and down."""
    folder = data_root / "panoptic" / "demo"
    if not (folder / "camera_parameters.json").is_file():
        pytest.skip(f"no data set {folder}")
    found = read_published("panoptic", folder)
    assert found.rig.names == ("00_03", "00_06", "00_12", "00_13", "00_23")
    for camera in found.rig:
        assert 0.7 < camera.centre[2] < 3.5
        assert np.linalg.norm(camera.centre[:2]) < 3.0
        middle = camera.project(np.array([[0.0, 0.0, 0.9]]))[0]
        assert ((middle > 0) & (middle < camera.lens.size)).all()
        upright = camera.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.8]]))
        assert upright[1, 1] < upright[0, 1] - 200
        assert found.frames_of_pictures(camera.name) == (4501, 5515, 6860, 9349, 13008)


@thinned(
    ("separator", "scale", "calibration", "cameras"),
    [(",", 1.0, "P", 5), (" ", -2.5, "P", 3), (",", 0.004, "P", 3), ("", 1.0, "shelf", 5), ("", 1.0, "campus", 3)],
    quick=3,
)
def test_tum_is_what_was_put_in(tmp_path, separator, scale, calibration, cameras) -> None:
    truth = write_tum(tmp_path / "set", separator, scale, calibration, cameras)
    name = {5: "shelf", 3: "campus"}[cameras]
    found = read_published(name, tmp_path / "set")
    assert (found.name, found.fps) == (name, None)
    assert found.rig.names == tuple(f"Camera{number}" for number in range(cameras))
    assert_cameras(found, truth)
    assert_joints(found, truth, JOINTS, 1, 1)
    assert_ground(found, truth, 1, 1)
    assert found.frames_of_pictures("Camera1") == (5,)
    assert any("not from the set's own" in note for note in found.notes) == (calibration != "P")


def test_a_lens_does_not_fold_people_into_its_picture() -> None:
    """Barrel distortion turns back at 46 degrees here: somebody at 63 comes out within the picture, on the other side."""
    lens = Lens((1000, 800), np.array([[600.0, 0, 500], [0, 600, 400], [0, 0, 1]]), np.array([-0.3, 0.0, 0.0, 0.0]))
    camera = Camera("A", lens, Pose(np.eye(3), np.zeros(3)))
    xyz = np.array([[[0.0, 0.0, 5.0], [10.0, 0.0, 5.0]]])
    assert ((camera.project(xyz[0]) > 0) & (camera.project(xyz[0]) < lens.size)).all()
    people = Skeletons(np.array([1]), np.array([1]), xyz, np.ones((1, 2)), ("nose", "neck"))
    seen = project_joints(Rig((camera,)), people, "here")["A"]
    assert seen.score.tolist() == [[1.0, 0.0]]


@pytest.fixture(scope="session")
def panoptic(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "sequence"
    write_panoptic(folder, media="pictures")
    return folder


@pytest.fixture(scope="session")
def campus(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "CampusSeq1"
    write_tum(folder)
    return folder


def every_camera(folder: Path, **values: object) -> None:
    path = folder / "calibration_sequence.json"
    path.write_text(json.dumps({"cameras": [table | values for table in json.loads(path.read_text())["cameras"]]}))


def camera(folder: Path, **values: object) -> None:
    path = folder / "calibration_sequence.json"
    content = json.loads(path.read_text())
    content["cameras"][1] |= values
    path.write_text(json.dumps(content))


def poses(folder: Path, number: int = 0) -> Path:
    return sorted((folder / "hdPose3d_stage1_coco19").iterdir())[number]


def body(folder: Path, **values: object) -> None:
    content = json.loads(poses(folder).read_text())
    content["bodies"][0] |= values
    poses(folder).write_text(json.dumps(content))


def moved(folder: Path, scale: float, shift: float) -> None:
    """Every joint's y, which points down, scaled and shifted."""
    for path in (folder / "hdPose3d_stage1_coco19").iterdir():
        content = json.loads(path.read_text())
        for person in content["bodies"]:
            joints = np.array(person["joints19"]).reshape(19, 4)
            joints[:, 1] = scale * joints[:, 1] + shift
            person["joints19"] = joints.ravel().tolist()
        path.write_text(json.dumps(content))


def packed(folder: Path) -> None:
    """Joints as they are fetched, and no images."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
    (folder / "hdPose3d_stage1_coco19.tar").write_bytes(b"")


PANOPTIC_BREAKS = {
    "still packed": (packed, "unpack the [.]tar first"),
    "no name": (lambda f: every_camera(f, name=None), "name is .*: a text is needed"),
    "an endless rotation": (lambda f: every_camera(f, R=[[1e300, -1e300, 0], [1e300, 1e300, 0], [0, 0, 1]]), "not a rotation"),
    "no calibration": (lambda f: (f / "calibration_sequence.json").unlink(), "no calibration_SEQUENCE.json"),
    "two calibrations": (
        lambda f: shutil.copy(f / "calibration_sequence.json", f / "calibration_other.json"),
        "calibration_other.json and calibration_sequence.json",
    ),
    "no cameras": (lambda f: (f / "calibration_sequence.json").write_text('{"cameras": []}'), "holds no camera"),
    "no hd camera": (lambda f: every_camera(f, type="vga"), "no camera is of the type hd"),
    "a camera twice": (lambda f: camera(f, name="00_01"), "00_01 occurs twice"),
    "no rotation": (lambda f: camera(f, R=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), "camera 00_00: R.*not a rotation"),
    "not finite": (lambda f: camera(f, t=[[1], [float("nan")], [2]]), "camera 00_00: t is .*finite numbers"),
    "too few": (lambda f: camera(f, distCoef=[0.1, 0.2]), "camera 00_00: distortions has 2 values"),
    "no focal length": (lambda f: camera(f, K=[[0, 0, 1], [0, 0, 1], [0, 0, 1]]), "00_00: matrix .* not a camera matrix"),
    "joints cut short": (lambda f: poses(f).write_text(poses(f).read_text()[:-40]), r"body3DScene_00000140.json: is not JSON"),
    "no bodies": (lambda f: poses(f).write_text("{}"), "'bodies' is missing"),
    "a joint too few": (lambda f: body(f, joints19=[0.0] * 72), r"bodies\[0\]: joints19 .*19 x 4 numbers are needed"),
    "a broken joint": (lambda f: body(f, joints19=[float("nan")] * 76), r"bodies\[0\]: joints19 .*must be finite"),
    "no id": (lambda f: body(f, id=None), r"bodies\[0\]: id is None"),
    "an id twice": (lambda f: body(f, id=1), r"bodies\[1\]: id 1 occurs twice"),
    "no people": (lambda f: [p.write_text('{"bodies": []}') for p in poses(f).parent.iterdir()], "none of the .* has a person"),
    "upside down": (lambda f: moved(f, -1, 0), "heads of the people lie"),
    "elsewhere": (lambda f: moved(f, 1, 1e5), "none of the .* people lies in the image"),
}  # fmt: skip


@pytest.mark.parametrize("what", sorted(PANOPTIC_BREAKS))
def test_a_broken_sequence_is_named_in_one_line(panoptic, tmp_path, what) -> None:
    folder = tmp_path / "sequence"
    shutil.copytree(panoptic, folder)
    spoil, message = PANOPTIC_BREAKS[what]
    spoil(folder)
    with refused(message, folder):
        read_published("panoptic", folder)


def actors(folder: Path, change) -> None:
    content = loadmat(folder / "actorsGT.mat")["actor3D"]
    change(content)
    savemat(folder / "actorsGT.mat", {"actor3D": content})


def set_cell(value):
    """A change of one joint, or of the whole cell, of actor 1 in the last frame."""

    def change(content) -> None:
        content[0, 0][-1, 0] = value(content[0, 0][-1, 0])

    return change


def shorter(content) -> None:
    content[0, 1] = content[0, 1][:-2]


def emptied(content) -> None:
    for actor in content[0]:
        for frame in range(len(actor)):
            actor[frame, 0] = np.zeros((1, 0))


TUM_BREAKS = {
    "no truth": (lambda f: (f / "actorsGT.mat").unlink(), "actorsGT.mat: no such file"),
    "no MATLAB file": (lambda f: (f / "actorsGT.mat").write_text("no matrix at all" * 50), "actorsGT.mat: cannot be read"),
    "cut short": (lambda f: (f / "actorsGT.mat").write_bytes((f / "actorsGT.mat").read_bytes()[:3000]), "actorsGT.mat: cannot"),
    "another variable": (lambda f: savemat(f / "actorsGT.mat", {"actor2D": 1}), "no variable actor3D .it has actor2D"),
    "no cells": (lambda f: savemat(f / "actorsGT.mat", {"actor3D": np.zeros((3, 3))}), "actor3D is not a cell array"),
    "another shape": (lambda f: actors(f, set_cell(lambda c: c[:13])), r"actor3D\{1\}\{30\} has the shape \(13, 3\): 14 x 3"),
    "not finite": (lambda f: actors(f, set_cell(lambda c: c * np.nan)), r"actor3D\{1\}\{30\}: keypoint 1 is \[nan, nan, nan\]"),
    "other lengths": (lambda f: actors(f, shorter), "have 28 and 30 frames"),
    "no people": (lambda f: actors(f, emptied), "actor3D has no person"),
    "upside down": (lambda f: actors(f, lambda c: [set_axes(a) for a in c[0]]), "heads of the people lie"),
    "no calibration": (lambda f: shutil.rmtree(f / "Calibration"), "Calibration: no projection matrices"),
    "an empty matrix": (lambda f: (f / "Calibration" / "P1.txt").write_text(""), "P1.txt: the matrix is .*3 rows of 4 numbers"),
    "a word": (lambda f: (f / "Calibration" / "P1.txt").write_text("a b c d " * 3), "P1.txt: the matrix is .*3 rows of 4"),
    "not a number": (lambda f: (f / "Calibration" / "P1.txt").write_text("1 2 nan 4 " * 3), "P1.txt: .*must be finite"),
    "no camera": (lambda f: (f / "Calibration" / "P1.txt").write_text("1 2 3 4 " * 3), "P1.txt: .*not a projection matrix"),
    "a broken picture": (lambda f: (f / "Camera1" / "img_000004.png").write_bytes(b"x"), "img_000004.png: cannot be read"),
}  # fmt: skip


def set_axes(actor) -> None:
    for frame in range(len(actor)):
        if actor[frame, 0].size:
            actor[frame, 0] = actor[frame, 0] * [1, 1, -1] + [0, 0, 2]


@thinned("what", sorted(TUM_BREAKS), every=3)
def test_a_broken_campus_is_named_in_one_line(campus, tmp_path, what) -> None:
    folder = tmp_path / "CampusSeq1"
    shutil.copytree(campus, folder)
    spoil, message = TUM_BREAKS[what]
    spoil(folder)
    with refused(message, folder):
        read_published("campus", folder)


@pytest.mark.slow
def test_a_skew_is_noted(campus, tmp_path) -> None:
    shutil.copytree(campus, tmp_path / "CampusSeq1")
    path = tmp_path / "CampusSeq1" / "Calibration" / "P0.txt"
    skewed = np.array([[1.0, 0.01, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) @ np.loadtxt(path, delimiter=",")
    path.write_text("\n".join(" ".join(map(repr, row)) for row in skewed.tolist()))
    notes = " ".join(read_published("campus", tmp_path / "CampusSeq1").notes)
    assert ("camera Camera0 has a skew" in notes, "Camera1 has a skew" in notes) == (True, False)
