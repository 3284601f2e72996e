"""EPFL's sequences: cameras, positions on the grid, boxes, and what is missing or broken."""

import re
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.datasets.epfl import read
from passerby.interchange.rig_toml import write_rig
from support.datasets import tsai as tsai_sets
from support.refusals import refused


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return tsai_sets.write_epfl(tmp_path_factory.mktemp("epfl"))


@pytest.fixture(scope="module")
def published(sequence):
    return read(sequence)


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


def test_without_boxes_people_are_to_be_found(broken):
    published = read(broken)
    assert not published.boxes
    assert not published.identities_known
    assert any("detected in the videos" in note for note in published.notes)


def test_homographies_alone_tell_neither_lens_nor_pose(broken):
    for path in (broken / "calibration").iterdir():
        path.unlink()
    (broken / "calibration-6p.txt").write_text("# Camera 0\n# Ground plane homography\n1 0 0\n0 1 0\n0 0 1\n")
    with pytest.raises(InputError, match=r"calibration-6p.txt has homographies.*intrinsics.toml with the tables \[c0\]"):
        read(broken)
    write_rig(broken / "intrinsics.toml", Rig(tuple(replace(one, name=f"c{n}") for n, one in enumerate(tsai_sets.scene().rig))))
    published = read(broken)
    assert [camera.pose for camera in published.rig] == [None] * 4
    assert any("no true poses" in note for note in published.notes)


def test_other_sequences_have_positions_of_unknown_size(tmp_path):
    published = read(tsai_sets.write_epfl(tmp_path, sequence="match5", views=False))
    assert published.ground is None
    assert any("gt_match5.txt" in note for note in published.notes)


def remove(name):
    return lambda folder: next(folder.rglob(name)).unlink()


def change(name, old, new):
    def act(folder):
        path = next(folder.rglob(name))
        path.write_text(path.read_text().replace(old, new, 1))

    return act


def copy(name, to):
    return lambda folder: (folder / to).write_bytes(next(folder.rglob(name)).read_bytes())


def boxes_of(rows):
    return lambda folder: (folder / "terrace1-c1.txt").write_text(rows + "\n")


@pytest.mark.parametrize(
    ("harm", "told"),
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
def test_what_is_missing_or_broken_is_told(broken, harm, told):
    harm(broken)
    with refused(re.escape(told), broken):
        read(broken)


def test_empty_folder(tmp_path):
    with pytest.raises(InputError, match=r"holds no videos SEQUENCE-cN.avi"):
        read(tmp_path)
