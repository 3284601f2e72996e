"""WILDTRACK, MultiviewX and CMC: cameras, people and boxes come out as they were put in; what is broken is named."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.io import savemat

from passerby.common.errors import InputError
from passerby.datasets import read_published
from support.datasets.cmc import write_cmc
from support.datasets.grids import annotation, write_multiviewx, write_storage, write_wildtrack
from support.refusals import refused
from support.scenes.walking_area import Walk
from support.tiers import thinned

WRITERS = {"wildtrack": write_wildtrack, "multiviewx": write_multiviewx}


@pytest.fixture(scope="session", params=sorted(WRITERS))
def example(request, tmp_path_factory) -> tuple[str, Path, Walk]:
    folder = tmp_path_factory.mktemp("sets") / request.param
    return request.param, folder, WRITERS[request.param](folder)


@pytest.fixture
def broken(example, tmp_path) -> tuple[str, Path]:
    name, folder, _ = example
    shutil.copytree(folder, tmp_path / name)
    return name, tmp_path / name


def test_cameras_positions_and_times_are_those_put_in(example) -> None:
    name, folder, walk = example
    found = read_published(name, folder)
    assert found.rig.names == walk.rig.names
    for camera, true in zip(found.rig, walk.rig, strict=True):
        assert camera.lens.size == true.lens.size
        np.testing.assert_allclose(camera.lens.matrix, true.lens.matrix, rtol=1e-9)
        np.testing.assert_allclose(camera.pose.R_cw, true.pose.R_cw, atol=1e-9)
        np.testing.assert_allclose(camera.centre, true.centre, atol=1e-8)
        points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) + [*walk.positions[0, 0], 0]
        np.testing.assert_allclose(camera.project(points), true.project(points), atol=1e-6)
    assert len(found.ground) == walk.positions.shape[0] * walk.positions.shape[1]
    np.testing.assert_allclose(found.ground.xy, walk.positions[found.ground.frame - 1, found.ground.identity], atol=1e-9)
    assert found.fps == 2.0
    assert set(found.boxes["C1"].frame) <= set(range(1, len(walk.positions) + 1))
    assert {camera: found.frames_of_pictures(camera) for camera in found.pictures} == dict.fromkeys(walk.rig.names, (1, 2))
    assert any("left-handed" in note for note in found.notes) == (name == "multiviewx")


def test_boxes_are_those_put_in_cut_at_the_border(example) -> None:
    name, folder, walk = example
    found = read_published(name, folder)
    cut = 0
    for camera in walk.rig:
        boxes = found.boxes[camera.name]
        at = {(f, p): row for row, (f, p) in enumerate(zip(boxes.frame.tolist(), boxes.identity.tolist(), strict=True))}
        for frame in range(len(walk.positions)):
            for person, xy in enumerate(walk.positions[frame]):
                box = walk.cylinder_box(camera, xy)
                assert (box is not None) == ((frame + 1, person) in at)
                if box is None:
                    continue
                whole = np.array(box)
                left, top, width, height = boxes.ltwh[at[frame + 1, person]]
                within = np.clip(whole, 0, [*camera.lens.size] * 2)
                assert (left, top, left + width, top + height) == tuple(within)
                cut += int((within != whole).any())
    assert cut > 0
    assert any(note.startswith(f"{cut} boxes reach beyond") for note in found.notes)


def test_a_right_handed_copy_of_multiviewx_and_annotations_from_1_are_understood(tmp_path) -> None:
    """Somebody who fixed the calibration, and mirrored the cells with it, is not mirrored once more."""
    walk = write_multiviewx(tmp_path / "set", pictures=0)
    for camera in walk.rig:
        path = tmp_path / "set" / "calibrations" / "extrinsic" / f"extr_Camera{camera.name[1]}.xml"
        # The world turned by half a turn about z, and shifted: cells stay within the grid.
        moved = camera.pose.moved(np.diag([-1.0, -1.0, 1.0]), np.array([0.0, 16.0, 0.0]))
        write_storage(path, rvec=cv2.Rodrigues(np.array(moved.R_cw))[0], tvec=moved.t_cw[:, None])
    for path in (tmp_path / "set" / "annotations_positions").iterdir():
        content = json.loads(path.read_text())
        for person in content:
            x, y = person["positionID"] % 1000, person["positionID"] // 1000
            person["positionID"] = x + 1000 * (640 - y)
        path.write_text(json.dumps(content))
    found = read_published("multiviewx", tmp_path / "set")
    assert not any("left-handed" in note for note in found.notes)
    true = walk.positions[found.ground.frame - 1, found.ground.identity]
    np.testing.assert_allclose(found.ground.xy, [0, 16] - true, atol=1e-9)
    # Annotations from 1 are of pictures from 0.
    write_multiviewx(tmp_path / "one", frames=3, pictures=3, annotated_from=1)
    found = read_published("multiviewx", tmp_path / "one")
    assert (sorted(set(found.boxes["C1"].frame)), found.frames_of_pictures("C1")) == ([1, 2, 3], (1, 2, 3))
    assert any("numbered from 1" in note for note in found.notes)


def change(path: Path, **values: object) -> None:
    people = json.loads(path.read_text())
    people[0] |= values
    path.write_text(json.dumps(people))


def view(path: Path, **values: object) -> None:
    people = json.loads(path.read_text())
    people[0]["views"][0] |= values
    path.write_text(json.dumps(people))


def test_missing_annotations_double_identities_and_impossible_boxes_are_left_out(broken) -> None:
    name, folder = broken
    annotation(folder, 3).unlink()
    people = json.loads(annotation(folder).read_text())
    twice = people[0]["personID"] = people[1]["personID"]
    annotation(folder).write_text(json.dumps(people))
    view(annotation(folder, 1), xmin=50, xmax=40, ymin=1, ymax=9)
    flat = json.loads(annotation(folder, 1).read_text())[0]["personID"]
    found = read_published(name, folder)
    assert 4 not in found.ground.frame
    assert {3, 5} <= set(found.ground.frame)
    boxes = found.boxes["C1"]
    for number, who, said in ((0, twice, "occur twice"), (1, flat, f"person {flat}, viewNum 0")):
        assert who not in boxes.identity[boxes.frame == number + 1]
        assert any(said in note and annotation(folder, number).name in note for note in found.notes)


BREAKS = {
    "no annotations": (lambda f: shutil.rmtree(f / "annotations_positions"), "annotations_positions.*no annotations"),
    "cut short": (lambda f: annotation(f).write_text(annotation(f).read_text()[:200]), "0000.*json: is not JSON"),
    "no list": (lambda f: annotation(f).write_text("{}"), "is not a list of people"),
    "a broken cell": (lambda f: change(annotation(f), positionID=3.5), "person 1: positionID is 3.5: a whole number"),
    "a cell outside": (lambda f: change(annotation(f), positionID=691200), "positionID is 691200, but the grid"),
    "a nameless person": (lambda f: change(annotation(f), personID="Ann"), "personID is 'Ann'"),
    "a box of words": (lambda f: view(annotation(f), ymax="low"), "viewNum 0: ymax is 'low': a finite number"),
    "no views": (lambda f: change(annotation(f), views=None), "views is None"),
    "a camera too many": (lambda f: view(annotation(f), viewNum=9), "viewNum is 9, but there are"),
    "a camera twice": (lambda f: view(annotation(f), viewNum=1), "viewNum 1: occurs twice"),
    "no people": (lambda f: [p.write_text("[]") for p in (f / "annotations_positions").iterdir()], "no person is annotated"),
    "an image of another size": (
        lambda f: cv2.imwrite(str(next(iter(sorted((f / "Image_subsets" / "C2").iterdir())))), np.zeros((540, 960), np.uint8)),
        "C2.*is an image of 960 x 540, but the set's calibration is of 1920 x 1080",
    ),
    "a broken picture": (
        lambda f: next(iter(sorted((f / "Image_subsets" / "C2").iterdir()))).write_bytes(b"no picture"),
        "C2.*cannot be read as an image",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", sorted(BREAKS))
def test_what_is_broken_is_named_in_one_line(broken, what) -> None:
    name, folder = broken
    spoil, message = BREAKS[what]
    spoil(folder)
    with refused(message, folder):
        read_published(name, folder)


def lensless(path: Path) -> None:
    """A lens without a focal length."""
    write_storage(path, camera_matrix=np.diag([0.0, 1, 1]), distortion_coefficients=np.zeros((1, 5)))


CALIBRATION_BREAKS = {
    "no lens": ("intr", lambda p: p.unlink(), "no such file"),
    "no XML": ("intr", lambda p: p.write_text("camera_matrix: 1"), "is not XML"),
    "no rotation": ("extr", lambda p: p.write_text(p.read_text().replace("rvec", "other")), "<rvec> is missing"),
    "not finite": ("intr", lambda p: p.write_text(p.read_text().replace("0. 0. 1.", "0. 0. .Nan")), "<camera_matrix>"),
    "no focal length": ("intr", lambda p: lensless(p), "is not a camera matrix"),
}  # fmt: skip


@pytest.mark.parametrize("what", sorted(CALIBRATION_BREAKS))
def test_a_broken_calibration_is_named_in_one_line(broken, what) -> None:
    name, folder = broken
    kind, spoil, message = CALIBRATION_BREAKS[what]
    where = {"intr": "intrinsic_zero" if name == "wildtrack" else "intrinsic", "extr": "extrinsic"}[kind]
    path = sorted((folder / "calibrations" / where).iterdir())[2]
    spoil(path)
    with refused(message, path):
        read_published(name, folder)


def distorted(folder: Path) -> None:
    shutil.rmtree(folder / "calibrations" / "intrinsic_zero")
    shutil.copytree(folder / "calibrations" / "intrinsic_original", folder / "calibrations" / "intrinsic_zero")


def of_another_hand(folder: Path) -> None:
    """One camera has people in front of it, as in a right-handed world."""
    path = folder / "calibrations" / "extrinsic" / "extr_Camera3.xml"
    write_storage(path, rvec=np.zeros((3, 1)), tvec=np.array([[0.0], [0.0], [40.0]]))


def between(folder: Path) -> None:
    annotation(folder, 1).rename(folder / "annotations_positions" / "00000007.json")


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("wildtrack", distorted, "intrinsic_original copied over intrinsic_zero"),
        ("wildtrack", between, r"00000007.json: the number 7 is not a multiple of 5"),
        ("multiviewx", of_another_hand,
         r"camera C1 .*left-handed world, those of camera C3 only in a right-handed one"),
    ],
)  # fmt: skip
def test_lenses_poses_and_numbers_of_another_kind_are_refused(tmp_path, name, spoil, message) -> None:
    WRITERS[name](tmp_path / "set", frames=4, pictures=0)
    spoil(tmp_path / "set")
    with pytest.raises(InputError, match=message):
        read_published(name, tmp_path / "set")


@pytest.mark.slow
@thinned(
    ("name", "left_handed", "scale", "matrices"),
    [("CMC1", False, 1.0, "mat"), ("CMC2", False, -0.3, "txt"), ("CMC3", True, 2.0, "mat"), ("CMC5", True, -1.0, "mat")],
    quick=2,
)
def test_cmc_is_what_was_put_in(tmp_path, name, left_handed, scale, matrices) -> None:
    walk = write_cmc(tmp_path / name, left_handed=left_handed, scale=scale, matrices=matrices)
    found = read_published("cmc", tmp_path / name)
    assert (found.name, found.fps, found.rig.names) == (name.lower(), 4.0, walk.rig.names)
    for camera, true in zip(found.rig, walk.rig, strict=True):
        np.testing.assert_allclose(camera.lens.matrix, true.lens.matrix, atol=1e-6)
        np.testing.assert_allclose(camera.pose.R_cw, true.pose.R_cw, atol=1e-9)
        np.testing.assert_allclose(camera.centre, true.centre, atol=1e-8)
        boxes = found.boxes[camera.name]
        expected = {
            (frame + 1, person + 1): box
            for frame, here in enumerate(walk.positions)
            for person, xy in enumerate(here)
            if (box := walk.cylinder_box(true, xy, whole=True)) is not None
        }
        corners = np.hstack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])
        keys = list(zip(boxes.frame.tolist(), boxes.identity.tolist(), strict=True))
        assert keys == sorted(expected)
        np.testing.assert_allclose(corners, [expected[key] for key in keys])
        assert found.frames_of_pictures(camera.name) == (1, 2)
    np.testing.assert_allclose(found.ground.xy, walk.positions[found.ground.frame - 1, found.ground.identity - 1], atol=1e-5)
    assert any("left-handed" in note for note in found.notes) == left_handed


@pytest.fixture(scope="session")
def cmc(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "set"
    write_cmc(folder / "CMC1", matrices="txt")
    return folder


def line(path: Path, number: int, text: str) -> None:
    """Replace one line of a file, counted from 1."""
    lines = path.read_text().splitlines()
    lines[number - 1] = text
    path.write_text("\n".join(lines) + "\n")


BOXES, WORLD = "GT_CMC1_Cam2.txt", "GT_CMC1_WORLD_CENTROID.txt"
HDF5 = b"MATLAB 7.3 MAT-file, Platform: MACI64".ljust(116) + bytes(8) + b"\x00\x02IM" + bytes(400)


def matlab(folder: Path) -> Path:
    """The file of the first camera's matrix, which is MATLAB's now."""
    (folder / "cam1_cam_mat.txt").unlink()
    return folder / "cam1_cam_mat.mat"


CMC_BREAKS = {
    "MATLAB 7.3": (lambda f: matlab(f).write_bytes(HDF5), "cam1_cam_mat.mat: .*(install h5py, or save it as|cannot be read)"),
    "another shape": (lambda f: savemat(matlab(f), {"cam1_cam_mat": np.eye(3)}), r"has the shape \(3, 3\): a matrix of 3 x 4"),
    "no truth": (lambda f: (f / WORLD).unlink(), "no GT_CMC1_WORLD_CENTROID.txt"),
    "two sequences": (lambda f: shutil.copy(f / WORLD, f / "GT_CMC2_WORLD_CENTROID.txt"), "CMC1.* and GT_CMC2"),
    "no boxes": (lambda f: (f / BOXES).unlink(), f"{BOXES}: no such file"),
    "empty boxes": (lambda f: (f / BOXES).write_text(""), f"{BOXES}: is empty"),
    "a word": (lambda f: line(f / BOXES, 3, "1 2 a 4 5 6 1 -1 -1 -1"), f"{BOXES}: line 3 is .*numbers are needed"),
    "not finite": (lambda f: line(f / BOXES, 3, "1 2 nan 4 5 6 1 -1 -1 -1"), f"{BOXES}: line 3 is .*must be finite"),
    "too few columns": (lambda f: line(f / BOXES, 3, "1 2 3 4 5"), f"{BOXES}: line 3: has 5 columns"),
    "half a frame": (lambda f: line(f / BOXES, 3, "1.5 2 3 4 5 6 1 -1 -1 -1"), f"{BOXES}: line 3: frame and identity are 1.5"),
    "a flat box": (lambda f: line(f / BOXES, 1, "1 1 30 40 0 60 1 -1 -1 -1"), "the box of identity 1 in frame 1 is 0 x 60"),
    "twice": (lambda f: line(f / BOXES, 2, (f / BOXES).read_text().splitlines()[0]), "identity 1 occurs twice in frame"),
    "a centroid too few": (lambda f: line(f / WORLD, 2, "1 2 -1 -1 -1"), f"{WORLD}: line 2: has 5 columns"),
    "no matrix": (lambda f: (f / "cam3_cam_mat.txt").unlink(), "cam3_cam_mat.mat: no such file, and none in"),
    "a broken matrix": (lambda f: (f / "cam3_cam_mat.txt").write_text("1 2 3"), "cam3_cam_mat.txt: the matrix is .*3 rows"),
    "no camera": (lambda f: (f / "cam3_cam_mat.txt").write_text("0 0 0 1 " * 3), "cam3_cam_mat.txt: .*not a projection"),
    "another's matrix": (
        lambda f: shutil.copy(f / "cam1_cam_mat.txt", f / "cam3_cam_mat.txt"),
        "camera Cam_3 .*(of another recording|in front of it)",
    ),
    "small images": (lambda f: [shutil.copy(f / "tiny.png", p) for p in (f / "Cam_4").iterdir()], "is an image of 4 x 3"),
}  # fmt: skip


@pytest.mark.parametrize("what", sorted(CMC_BREAKS))
def test_a_broken_cmc_is_named_in_one_line(cmc, tmp_path, what) -> None:
    shutil.copytree(cmc, tmp_path / "set")
    folder = tmp_path / "set" / "CMC1"
    cv2.imwrite(str(folder / "tiny.png"), np.zeros((3, 4), np.uint8))
    spoil, message = CMC_BREAKS[what]
    spoil(folder)
    with refused(message, folder):
        read_published("cmc", folder)
