"""EPFL's sequences and PETS 2009: cameras, positions, boxes, who is who in both, and what is missing or broken."""

import re
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.datasets import epfl, pets
from passerby.datasets.annotations import match_identities
from passerby.datasets.published import GroundTruth
from passerby.interchange.rig_toml import write_rig
from support.datasets import tsai as tsai_sets
from support.refusals import refused


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return tsai_sets.write_epfl(tmp_path_factory.mktemp("epfl"))


@pytest.fixture(scope="module")
def published(sequence):
    return epfl.read(sequence)


@pytest.fixture
def broken(tmp_path):
    return tsai_sets.write_epfl(tmp_path / "set", views=False)


def test_cameras_are_those_of_the_set(published):
    assert (published.name, published.rig.names, published.fps) == ("terrace1", ("c0", "c1", "c2", "c3"), 5.0)
    people = np.random.default_rng(0).uniform((1, 2, 0), (5.5, 6.5, 1.8), (200, 3))
    for camera, true in zip(published.rig, tsai_sets.cameras().values(), strict=True):
        assert camera.lens.size == (true.size[0] // 2, true.size[1] // 2)
        assert np.allclose(camera.centre, true.pose.centre, atol=1e-6)
        assert np.allclose(camera.pose.R_cw, true.pose.R_cw, atol=1e-9)
        pixels = camera.project(people)
        inside = (pixels > 0).all(axis=1) & (pixels < np.array(camera.lens.size) - 1).all(axis=1)
        assert inside.sum() > 50
        assert np.abs(pixels - ((true.project(people) + 0.5) / 2 - 0.5))[inside].max() < 0.02
    assert {camera: path.name for camera, path in published.videos.items()} == {f"c{n}": f"terrace1-c{n}.avi" for n in range(4)}


def test_positions_are_within_half_a_cell_of_the_truth_under_the_boxes_numbers(published):
    ground, true = published.ground, tsai_sets.scene().ground_positions + tsai_sets.SHIFT[:2]
    assert np.abs(true[ground.frame - 1, ground.identity - 1] - ground.xy).max() <= 0.125 + 1e-9
    assert set(ground.frame.tolist()) == set(range(1, 101, 5))
    (left, near), (wide, deep) = tsai_sets.AREA
    inside = (true[::5] >= (left, near)).all(axis=2) & (true[::5] < (left + wide, near + deep)).all(axis=2)
    assert len(ground) == inside.sum() > 100


def test_boxes_are_those_of_the_annotation(published):
    for (name, boxes), camera in zip(published.boxes.items(), tsai_sets.cameras(), strict=True):
        true = tsai_sets.boxes(camera, 0.5)
        true = true[np.lexsort((true[:, 1], true[:, 0]))]
        assert np.array_equal(boxes.frame, true[:, 0])
        assert np.array_equal(boxes.identity, true[:, 1])
        assert np.allclose(boxes.ltwh[:, :2] + boxes.ltwh[:, 2:], true[:, 4:6], atol=2e-4), name
    assert published.identities_known
    assert published.people == 7


def test_without_boxes_or_with_homographies_alone_less_is_known(broken, tmp_path):
    published = epfl.read(broken)
    assert (dict(published.boxes), published.identities_known) == ({}, False)
    assert any("detected in the videos" in note for note in published.notes)
    other = epfl.read(tsai_sets.write_epfl(tmp_path / "match", sequence="match5", views=False))
    assert other.ground is None, "other sequences have positions of unknown size"
    assert any("gt_match5.txt" in note for note in other.notes)
    for path in (broken / "calibration").iterdir():
        path.unlink()
    (broken / "calibration-6p.txt").write_text("# Camera 0\n# Ground plane homography\n1 0 0\n0 1 0\n0 0 1\n")
    with pytest.raises(InputError, match=r"calibration-6p.txt has homographies.*intrinsics.toml with the tables \[c0\]"):
        epfl.read(broken)
    write_rig(broken / "intrinsics.toml", Rig(tuple(replace(one, name=f"c{n}") for n, one in enumerate(tsai_sets.scene().rig))))
    published = epfl.read(broken)
    assert [camera.pose for camera in published.rig] == [None] * 4
    assert any("no true poses" in note for note in published.notes)


def remove(name):
    return lambda folder: next(folder.rglob(name)).unlink()


def copy(name, to):
    return lambda folder: (folder / to).write_bytes(next(folder.rglob(name)).read_bytes())


def boxes_of(rows):
    return lambda folder: (folder / "terrace1-c1.txt").write_text(rows + "\n")


def change(name, old, new):
    def act(folder):
        path = next(folder.rglob(name))
        path.write_text(path.read_text().replace(old, new, 1))

    return act


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (remove("terrace-tsai-c2.xml"), "no calibration *-c2.xml for the video terrace1-c2.avi"),
        (change("terrace-tsai-c1.xml", 'height="576"', 'height="72"'), "camera c1: "),
        (copy("terrace1-c0.avi", "terrace2-c0.avi"), "holds the sequences terrace1, terrace2"),
        (copy("terrace-tsai-c0.xml", "another-c0.xml"), "a second calibration of camera c0"),
        (copy("terrace1-c0.avi", "terrace1-c0.mp4"), "a second video of camera c0"),
        (copy("gt_terrace1.txt", "gt_lab_terrace1.txt"), "a second file of positions"),
        (change("gt_terrace1.txt", "100 7 30 44 5 0 99", "100 7 30 44"), "line 2 must be"),
        (change("gt_terrace1.txt", "100 7 30 44", "101 7 30 44"), "100 rows of positions, but line 2 says 101"),
        (change("gt_terrace1.txt", "100 7 30 44", "100 8 30 44"), "7 numbers, but line 2 says 8 people"),
        (change("gt_terrace1.txt", "100 7 30 44", "100 7 3 4"), "cells are 0 to 11"),
        (change("gt_terrace1.txt", "\t-1", "\tx"), "whole numbers are needed"),
        (boxes_of("1 2 3 4"), "terrace1-c1.txt: line 1: 4 columns"),
        (boxes_of('1 2 3 1 9 5 0 0 0 "PERSON"'), "a box -1 wide"),
        (boxes_of('1 2 3 4 9 -5 0 0 0 "PERSON"'), "frames before the first image"),
        (boxes_of('1 2 3 4 9 5 0 0 0 "PERSON"\n1 2 3 4 9 5 0 0 0 "PERSON"'), "identity 1 has two boxes in frame 6"),
        (boxes_of('one 2 3 4 9 5 0 0 0 "PERSON"'), "'one' is not a finite number"),
    ],
)
def test_what_is_missing_or_broken_in_a_sequence_is_named(broken, harm, said):
    harm(broken)
    with refused(re.escape(said), broken):
        epfl.read(broken)


NAMES = list(tsai_sets.cameras())


@pytest.fixture
def pictured(tmp_path):
    return tsai_sets.write_pets(tmp_path / "set", views=False, pictures=2)


def test_a_recordings_cameras_pictures_and_boxes(tmp_path):
    published = pets.read(tsai_sets.write_pets(tmp_path / "set"))
    assert (published.rig.names, published.fps) == (("View_001", "View_002", "View_003", "View_004"), 7.0)
    for camera, true in zip(published.rig, tsai_sets.cameras().values(), strict=True):
        assert camera.lens.size == true.size
        assert np.allclose(camera.centre, true.pose.centre, atol=1e-6)
    assert [path.name for path in published.pictures["View_002"]] == [f"frame_{number:04}.jpg" for number in range(4)]
    assert published.frames_of_pictures("View_002") == (1, 2, 3, 4)
    assert (published.identities_known, published.ground) == (True, None)
    assert len(published.boxes["View_003"]) == len(tsai_sets.boxes(NAMES[2]))


def test_cvml_counts_from_0_and_has_centres_and_views_may_be_spelt_otherwise(pictured):
    boxes = pets.read(pictured).boxes
    true = tsai_sets.boxes(NAMES[0])
    true = true[np.lexsort((true[:, 1], true[:, 0]))]
    assert list(boxes) == ["View_001"]
    assert np.array_equal(boxes["View_001"].frame, true[:, 0])
    assert np.array_equal(boxes["View_001"].identity, true[:, 1])
    assert np.allclose(boxes["View_001"].ltwh[:, :2], true[:, 2:4], atol=2e-4)
    assert not pets.read(pictured).identities_known
    # Pictures keep their frames where one is missing.
    next(pictured.rglob("View_001/frame_0000.jpg")).unlink()
    next(pictured.rglob("PETS2009-S2L1.xml")).unlink()
    for number, camera in enumerate(NAMES, start=1):
        (pictured / f"view-{number}.txt").write_text(tsai_sets.vatic(camera))
    published = pets.read(pictured)
    assert list(published.boxes) == ["View_001", "View_002", "View_003", "View_004"]
    assert len(published.boxes["View_004"]) == len(tsai_sets.boxes(NAMES[3]))
    assert (published.frames_of_pictures("View_001"), published.frames_of_pictures("View_002")) == ((2,), (1, 2))


def test_positions_of_the_3d_challenge_get_the_boxes_numbers(tmp_path):
    folder = tsai_sets.write_pets(tmp_path / "set")
    lines = (line.split(",", 2) for line in tsai_sets.mot_truth(NAMES[0]).splitlines())
    (folder / "gt").mkdir()
    (folder / "gt" / "gt.txt").write_text("".join(f"{frame},{30 - int(identity)},{rest}\n" for frame, identity, rest in lines))
    ground = pets.read(folder).ground
    true = tsai_sets.scene().ground_positions + tsai_sets.SHIFT[:2]
    assert len(ground) == len(tsai_sets.boxes(NAMES[0]))
    assert np.abs(true[ground.frame - 1, ground.identity - 1] - ground.xy).max() < 1e-3


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("View_002.xml", "<Camera>", "View_002.xml: is not XML"),
        ("Time_14-55/View_001/frame_0000.jpg", "", "a second folder of images of View_001"),
        ("old/View_001.xml", "<Camera/>", "a second calibration of View_001"),
        ("PETS2009-S2L1.xml", "<dataset><frame number='0'></dataset>", "PETS2009-S2L1.xml: is not XML"),
        ("PETS2009-S2L1.xml", "<dataset><frame number='0'><objectlist><object id='1'/></objectlist></frame></dataset>",
         '<object id="1"> has no <box>'),
        ("PETS2009-S2L2.xml", "<dataset><frame number='0'/></dataset>", "a second annotation of View_001"),
        ("boxes-View_009.xml", "<dataset><frame number='0'/></dataset>", "has no calibration View_009.xml"),
        ("S2/L1/Time_12-34/View_003/frame_0000.jpg", "no image", "is not an image that can be read"),
        ("gt/gt.txt", "1,2,3\n", "3 columns"),
    ],
)  # fmt: skip
def test_what_is_broken_in_a_recording_is_named(pictured, name, text, said):
    path = pictured / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(said)):
        pets.read(pictured)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"holds no videos SEQUENCE-cN.avi"):
        epfl.read(tmp_path)
    with pytest.raises(InputError, match=r"holds no calibrations View_00N.xml"):
        pets.read(tmp_path)
    for number, camera in enumerate(tsai_sets.cameras().values(), start=1):
        (tmp_path / f"View_{number:03}.xml").write_text(camera.xml())
    with pytest.raises(InputError, match=r"holds no View_00N/frame_NNNN.jpg"):
        pets.read(tmp_path)


def test_positions_under_other_numbers_get_those_of_the_boxes_by_the_true_poses():
    """A person without boxes gets a number of its own; without poses nothing is changed."""
    scene = tsai_sets.scene()
    frame, person = np.nonzero(np.isfinite(scene.ground_positions[:, :, 0]))
    ground = GroundTruth(frame + 1, 100 - person, scene.ground_positions[frame, person])
    boxes, rig = {camera: scene.observations[camera].boxes for camera in scene.rig.names}, scene.rig
    found, notes = match_identities(boxes, rig, ground)
    assert np.array_equal(found.identity, 101 - ground.identity)
    assert np.array_equal(found.xy, ground.xy)
    assert notes == ("Of 7 people with positions, 7 were found among those with boxes, and have their numbers.",)
    fewer = {camera: seen.take(~np.isin(seen.identity, (2, 5))) for camera, seen in boxes.items()}
    found, notes = match_identities(fewer, rig, ground)
    without = np.isin(101 - ground.identity, (2, 5))
    assert np.array_equal(found.identity[~without], 101 - ground.identity[~without])
    assert sorted(set(found.identity[without].tolist())) == [8, 9]
    assert "Of 7 people with positions, 5 were found" in notes[0]
    blind = Rig(tuple(Camera(camera.name, camera.lens) for camera in rig))
    assert (match_identities(boxes, blind, ground), match_identities({}, rig, ground)) == ((ground, ()), (ground, ()))
