"""WILDTRACK and MultiviewX: cameras, people and boxes come out as they were put in; what is broken is told."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.datasets import read_published
from passerby.datasets.published import Published
from support.datasets.grids import annotation, write_multiviewx, write_wildtrack
from support.refusals import refused
from support.scenes.walking_area import Walk

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


def assert_cameras(found: Published, walk: Walk) -> None:
    assert found.rig.names == walk.rig.names
    for camera, true in zip(found.rig, walk.rig, strict=True):
        assert camera.lens.size == true.lens.size
        np.testing.assert_allclose(camera.lens.matrix, true.lens.matrix, rtol=1e-9)
        np.testing.assert_allclose(camera.pose.R_cw, true.pose.R_cw, atol=1e-9)
        np.testing.assert_allclose(camera.centre, true.centre, atol=1e-8)
        points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) + [*walk.positions[0, 0], 0]
        np.testing.assert_allclose(camera.project(points), true.project(points), atol=1e-6)


def test_cameras_positions_and_times_are_those_put_in(example) -> None:
    name, folder, walk = example
    found = read_published(name, folder)
    assert_cameras(found, walk)
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


def test_a_right_handed_copy_of_multiviewx_is_left_as_it_is(tmp_path) -> None:
    """Somebody who fixed the calibration, and mirrored the cells with it, is not mirrored once more."""
    walk = write_multiviewx(tmp_path / "set", pictures=0)
    for camera in walk.rig:
        path = tmp_path / "set" / "calibrations" / "extrinsic" / f"extr_Camera{camera.name[1]}.xml"
        pose = camera.pose
        # The world turned by half a turn about z, and shifted: cells stay within the grid.
        moved = pose.moved(np.diag([-1.0, -1.0, 1.0]), np.array([0.0, 16.0, 0.0]))
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        storage.write("rvec", cv2.Rodrigues(np.array(moved.R_cw))[0])
        storage.write("tvec", np.array(moved.t_cw)[:, None])
        storage.release()
    for path in (tmp_path / "set" / "annotations_positions").iterdir():
        content = json.loads(path.read_text())
        for person in content:
            x, y = person["positionID"] % 1000, person["positionID"] // 1000
            person["positionID"] = x + 1000 * (640 - y)
        path.write_text(json.dumps(content))
    found = read_published("multiviewx", tmp_path / "set")
    assert not any("left-handed" in note for note in found.notes)
    np.testing.assert_allclose(
        found.ground.xy, [0, 16] - walk.positions[found.ground.frame - 1, found.ground.identity], atol=1e-9
    )


def test_annotations_from_1_are_of_pictures_from_0(tmp_path) -> None:
    write_multiviewx(tmp_path / "set", frames=3, pictures=3, annotated_from=1)
    found = read_published("multiviewx", tmp_path / "set")
    assert (sorted(set(found.boxes["C1"].frame)), found.frames_of_pictures("C1")) == ([1, 2, 3], (1, 2, 3))
    assert any("numbered from 1" in note for note in found.notes)


def test_a_missing_annotation_leaves_its_frame_out(broken) -> None:
    name, folder = broken
    annotation(folder, 3).unlink()
    found = read_published(name, folder)
    assert 4 not in found.ground.frame
    assert {3, 5} <= set(found.ground.frame)


def test_an_identity_twice_in_an_instant_is_unknown(broken) -> None:
    name, folder = broken
    people = json.loads(annotation(folder).read_text())
    people[1]["personID"] = people[0]["personID"]
    annotation(folder).write_text(json.dumps(people))
    found = read_published(name, folder)
    first = found.boxes["C1"].identity[found.boxes["C1"].frame == 1]
    assert people[0]["personID"] not in first
    assert any("occur twice" in note and annotation(folder).name in note for note in found.notes)


def test_a_box_that_ends_before_it_begins_is_left_out(broken) -> None:
    name, folder = broken
    view(annotation(folder), xmin=50, xmax=40, ymin=1, ymax=9)
    found = read_published(name, folder)
    who = json.loads(annotation(folder).read_text())[0]["personID"]
    assert who not in found.boxes["C1"].identity[found.boxes["C1"].frame == 1]
    assert any(f"{annotation(folder).name}, person {who}, viewNum 0" in note for note in found.notes)


def change(path: Path, **values: object) -> None:
    people = json.loads(path.read_text())
    people[0] |= values
    path.write_text(json.dumps(people))


def view(path: Path, **values: object) -> None:
    people = json.loads(path.read_text())
    people[0]["views"][0] |= values
    path.write_text(json.dumps(people))


def replace(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))


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
    "nobody": (lambda f: [p.write_text("[]") for p in (f / "annotations_positions").iterdir()], "no person is annotated"),
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
def test_what_is_broken_is_told_in_one_line(broken, what) -> None:
    name, folder = broken
    spoil, message = BREAKS[what]
    spoil(folder)
    with refused(message, folder):
        read_published(name, folder)


CALIBRATION_BREAKS = {
    "no lens": ("intr", lambda p: p.unlink(), "no such file"),
    "no XML": ("intr", lambda p: p.write_text("camera_matrix: 1"), "is not XML"),
    "no rotation": ("extr", lambda p: p.write_text(p.read_text().replace("rvec", "other")), "<rvec> is missing"),
    "not finite": ("intr", lambda p: p.write_text(p.read_text().replace("0. 0. 1.", "0. 0. .Nan")), "<camera_matrix>"),
    "no focal length": ("intr", lambda p: p.write_text(spoiled_focal(p.read_text())), "is not a camera matrix"),
}  # fmt: skip


def spoiled_focal(text: str) -> str:
    before, rest = text.split("<data>", 1)
    words = rest.lstrip().split(None, 1)
    return f"{before}<data>\n    0. {words[1]}"


@pytest.mark.parametrize("what", sorted(CALIBRATION_BREAKS))
def test_a_broken_calibration_is_told_in_one_line(broken, what) -> None:
    name, folder = broken
    kind, spoil, message = CALIBRATION_BREAKS[what]
    where = {"intr": "intrinsic_zero" if name == "wildtrack" else "intrinsic", "extr": "extrinsic"}[kind]
    path = sorted((folder / "calibrations" / where).iterdir())[2]
    spoil(path)
    with refused(message, path):
        read_published(name, folder)


def test_distorted_lenses_for_undistorted_pictures_are_refused(tmp_path) -> None:
    write_wildtrack(tmp_path / "set", frames=2, pictures=0)
    shutil.rmtree(tmp_path / "set" / "calibrations" / "intrinsic_zero")
    shutil.copytree(
        tmp_path / "set" / "calibrations" / "intrinsic_original", tmp_path / "set" / "calibrations" / "intrinsic_zero"
    )
    with pytest.raises(InputError, match="intrinsic_original copied over intrinsic_zero"):
        read_published("wildtrack", tmp_path / "set")


def test_a_camera_of_another_hand_is_refused(tmp_path) -> None:
    """One camera has people in front of it, as in a right-handed world."""
    write_multiviewx(tmp_path / "set", frames=4, pictures=0)
    storage = cv2.FileStorage(str(tmp_path / "set" / "calibrations" / "extrinsic" / "extr_Camera3.xml"), cv2.FILE_STORAGE_WRITE)
    storage.write("rvec", np.zeros((3, 1)))
    storage.write("tvec", np.array([[0.0], [0.0], [40.0]]))
    storage.release()
    with pytest.raises(InputError, match=r"camera C1 .*left-handed world, those of camera C3 only in a right-handed one"):
        read_published("multiviewx", tmp_path / "set")


def test_numbers_between_two_instants_are_refused(tmp_path) -> None:
    write_wildtrack(tmp_path / "set", frames=2, pictures=0)
    annotation(tmp_path / "set", 1).rename(tmp_path / "set" / "annotations_positions" / "00000007.json")
    with pytest.raises(InputError, match=r"00000007.json: the number 7 is not a multiple of 5"):
        read_published("wildtrack", tmp_path / "set")
