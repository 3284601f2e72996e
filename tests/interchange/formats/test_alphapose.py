"""AlphaPose's results: joints, boxes, tracks, frames from picture names, broken files."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from passerby.cli.main import app
from passerby.common.errors import InputError
from passerby.core.observations import BODY_17
from passerby.interchange.formats import read_people_as
from passerby.interchange.motchallenge import read_boxes
from support.refusals import refused


def person(image, count=17, start=100.0, **other):
    values = [value for k in range(count) for value in (start + k, start + 100 + k, 0.5)]
    return {"image_id": image, "category_id": 1, "keypoints": values, "score": 2.9, **other}


def read(tmp_path, people):
    path = tmp_path / "alphapose-results.json"
    path.write_text(json.dumps(people))
    return read_people_as("alphapose", path)


def test_joints_boxes_and_tracks(tmp_path):
    people = [
        person("0.jpg", box=[90.0, 180.0, 60.0, 170.0], idx=3),
        person("0.jpg", start=400.0, box=[390.0, 480.0, 61.0, 171.0], idx=1),
        person("12.jpg", start=105.0, box=[95.0, 185.0, 60.0, 170.0], idx=3),
    ]
    found = read(tmp_path, people)
    assert found.keypoints.joints == BODY_17
    assert found.keypoints.frame.tolist() == [1, 1, 13]  # AlphaPose counts a video from 0
    assert found.keypoints.identity.tolist() == found.boxes.identity.tolist() == [1, 3, 3]
    np.testing.assert_array_equal(found.keypoints.xy[1, :, 0], 100 + np.arange(17))
    np.testing.assert_array_equal(found.boxes.ltwh[0], (390, 480, 61, 171))
    assert found.boxes.score.tolist() == [2.9] * 3
    assert found.notes == ("frame numbers are those of a video counted from 0, and are raised by one",)


def test_halpe_has_feet_and_head(tmp_path):
    found = read(tmp_path, [person("000007.jpg", count=26)]).keypoints
    assert found.frame.tolist() == [7]  # the picture's own number
    assert found.joints[:17] == BODY_17
    places = {"head_top": 17, "neck": 18, "mid_hip": 19, "left_big_toe": 20, "right_big_toe": 21, "left_small_toe": 22,
              "right_small_toe": 23, "left_heel": 24, "right_heel": 25}  # fmt: skip
    for name, place in places.items():
        np.testing.assert_array_equal(found.xy[0, found.joints.index(name)], (100 + place, 200 + place), name)
    assert len(read(tmp_path, [person("000007.jpg", count=136)]).keypoints.joints) == 26


def test_without_a_tracker_nobody_has_an_identity(tmp_path):
    people = [person("0.jpg", idx=[0.0]), person("0.jpg", start=400.0, idx=[0.0, 0.0]), person("1.jpg", idx=[0.0])]
    found = read(tmp_path, people)
    assert found.keypoints.identity.tolist() == [-1, -1, -1]
    assert any("not tracked" in note for note in found.notes)


def test_tracks_in_lists(tmp_path):
    people = [
        person("0.jpg", idx=[2.0]),
        person("0.jpg", start=400.0, idx=[[5.0], [5.0]]),
        person("0.jpg", start=700.0, idx=[1, 4]),
    ]
    assert sorted(read(tmp_path, people).keypoints.identity.tolist()) == [-1, 2, 5]


def test_pictures_by_number_and_nobody_at_all(tmp_path):
    assert read(tmp_path, [person(17), person(3)]).keypoints.frame.tolist() == [3, 17]
    nobody = read(tmp_path, [])
    assert len(nobody.keypoints) == len(nobody.boxes) == 0


def test_the_command_writes_boxes_too(tmp_path):
    read(tmp_path, [person("4.jpg", box=[90.0, 180.0, 60.0, 170.0], idx=3), person("6.jpg", box=[1, 2, 0, 4], idx=3)])
    out = tmp_path / "tracks/C1.txt"
    source = str(tmp_path / "alphapose-results.json")
    result = CliRunner().invoke(app, ["import", source, "--format", "alphapose", "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert "one flat box is left out" in result.output
    found = read_boxes(out)
    assert found.frame.tolist() == [5]
    assert found.identity.tolist() == [3]


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ({"0.jpg": {"people": []}}, "sep-json"),
        ("text", "is not a list of people"),
        ([3], r"\[0\]: has no keypoints"),
        ([{"image_id": "0.jpg"}], r"\[0\]: has no keypoints"),
        ([person(None)], "image_id is None"),
        ([person("first.jpg")], "does not end with a frame number"),
        ([person("a1.jpg"), person("b2.jpg")], "differ in more than the number"),
        ([person("1.jpg"), person("1.png")], "are both frame 1"),
        ([person("1.jpg"), person(2)], "some image_id are names"),
        ([person(-1)], "image_id is -1"),
        ([person(10**30)], "image_id is 10000"),
        ([person("1.jpg", count=21)], "63 numbers per person"),
        ([person("1.jpg"), person("2.jpg", count=26)], "51 numbers of keypoints and others 78"),
        ([person("1.jpg", box=[1, 2, 3])], "box has 3 numbers: 4"),
        ([person("1.jpg", box=[1, 2, 3, "x"])], "box holds 'x'"),
        ([person("1.jpg", idx="seven")], "idx is 'seven'"),
        ([person("1.jpg", idx=1.5)], "idx is 1.5"),
        ([{**person("1.jpg"), "score": None}], "score holds None"),
    ],
)
def test_broken_files_are_told(tmp_path, content, match):
    with refused(match, "alphapose-results.json"):
        read(tmp_path, content)


def test_a_folder_is_told(tmp_path):
    with pytest.raises(InputError, match=r"is a folder: give the file alphapose-results.json in it"):
        read_people_as("alphapose", tmp_path)
