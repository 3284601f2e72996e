"""OpenPose's folders of JSON: which joint is which, frames from names, what was not found, several people, broken files."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from passerby.cli.main import app
from passerby.common.errors import InputError
from passerby.core.observations import BODY_17
from passerby.interchange.coco import read_keypoints
from passerby.interchange.formats import read_people_as
from support.refusals import refused

# As OpenPose's documentation lists them: joint k of a made-up person lies at (100 + k, 200 + k).
BODY_25_AT = {"nose": 0, "left_shoulder": 5, "right_shoulder": 2, "left_hip": 12, "right_hip": 9, "left_ankle": 14,
              "right_ankle": 11, "left_eye": 16, "right_eye": 15, "left_ear": 18, "right_ear": 17, "left_wrist": 7,
              "neck": 1, "mid_hip": 8, "left_big_toe": 19, "left_heel": 21, "right_heel": 24}  # fmt: skip
COCO_18_AT = {"nose": 0, "neck": 1, "right_shoulder": 2, "left_shoulder": 5, "right_hip": 8, "left_hip": 11, "right_ankle": 10,
              "left_ankle": 13, "right_eye": 14, "left_eye": 15, "right_ear": 16, "left_ear": 17}  # fmt: skip


def joints(count, start=100.0, confidence=0.5):
    return [value for k in range(count) for value in (start + k, start + 100 + k, confidence)]


def written(folder, frames, name="walk_{:012d}_keypoints.json"):
    folder.mkdir(exist_ok=True)
    for frame, people in frames.items():
        content = {"version": 1.3, "people": people}
        (folder / name.format(frame)).write_text(json.dumps(content))
    return folder


def person(values, identity=-1):
    return {"person_id": [identity], "pose_keypoints_2d": values, "face_keypoints_2d": [], "hand_left_keypoints_2d": []}


@pytest.mark.parametrize(("count", "places"), [(25, BODY_25_AT), (18, COCO_18_AT)])
def test_joints_are_who_they_are(tmp_path, count, places):
    found = read_people_as("openpose", written(tmp_path / "C1", {0: [person(joints(count))]})).keypoints
    assert found.joints[:17] == BODY_17
    for name, place in places.items():
        np.testing.assert_array_equal(found.xy[0, found.joints.index(name)], (100 + place, 200 + place), name)
    assert len(found.joints) == (25 if count == 25 else 18)


@pytest.mark.parametrize(("count", "kept"), [(17, 17), (26, 26), (133, 23), (136, 26)])
def test_joints_of_other_tools(tmp_path, count, kept):
    found = read_people_as("openpose", written(tmp_path / "C1", {0: [person(joints(count))]})).keypoints
    assert found.joints[:17] == BODY_17
    assert len(found.joints) == kept
    np.testing.assert_array_equal(found.xy[0, :17, 0], 100 + np.arange(17))
    if count != 17:
        heel = {26: 24, 136: 24, 133: 19}[count]
        np.testing.assert_array_equal(found.xy[0, found.joints.index("left_heel")], (100 + heel, 200 + heel))


def test_a_video_counts_from_zero_and_empty_frames_are_frames(tmp_path):
    two = [person(joints(25)), person(joints(25, 300.0))]
    found = read_people_as("openpose", written(tmp_path / "C1", {0: [], 1: two, 11: [person(joints(25))]}))
    assert found.keypoints.frame.tolist() == [2, 2, 12]
    assert found.keypoints.identity.tolist() == [-1, -1, -1]
    assert len(found.boxes) == 0
    assert found.notes == ("frame numbers are those of a video counted from 0, and are raised by one",)


@pytest.mark.parametrize("name", ["cam1_{:06d}.json", "{}_keypoints.json", "picture {}_keypoints.json", "C1.{:04d}.json"])
def test_numbers_of_pictures_stay(tmp_path, name):
    found = read_people_as("openpose", written(tmp_path / "C1", {3: [person(joints(25))], 10: [person(joints(25))]}, name))
    assert found.keypoints.frame.tolist() == [3, 10]


def test_what_was_not_found_is_not_there(tmp_path):
    values = joints(25)
    values[0:3] = [0, 0, 0]  # the nose, as OpenPose leaves it out
    values[3 * 16 : 3 * 16 + 3] = [float("nan"), 5.0, 0.9]  # the left eye, as Sports2D leaves it out
    values[3 * 15 : 3 * 15 + 3] = [-1, -1, -0.01]  # the right eye, as RTMLib leaves it out
    values[3 * 18 + 2] = 1.07
    people = [person(values), person([0.0] * 75), person([])]
    found = read_people_as("openpose", written(tmp_path / "C1", {0: people}))
    score = dict(zip(found.keypoints.joints, found.keypoints.score[0], strict=True))
    assert len(found.keypoints) == 1
    assert score["nose"] == score["left_eye"] == score["right_eye"] == 0
    assert score["left_ear"] == 1
    assert score["right_ear"] == 0.5
    assert "one keypoint has the confidence 1.07: it becomes 1" in found.notes
    assert "one person without a keypoint is left out" in found.notes


def test_identities_are_kept_and_nobody_is_twice(tmp_path):
    people = [person(joints(25), 7), person(joints(25, 300.0, 0.9), 7), person(joints(25, 500.0), 2)]
    found = read_people_as("openpose", written(tmp_path / "C1", {0: people}))
    by = {float(xy[0, 0]): identity for xy, identity in zip(found.keypoints.xy, found.keypoints.identity, strict=True)}
    assert by == {100.0: -1, 300.0: 7, 500.0: 2}
    assert any("twice" in note for note in found.notes)


def test_the_same_twice_is_once(tmp_path):
    found = read_people_as("openpose", written(tmp_path / "C1", {0: [person(joints(25)), person(joints(25))]}))
    assert len(found.keypoints) == 1
    assert "one of the people occurs twice" in found.notes


def test_the_command_writes_what_a_scene_takes(tmp_path):
    folder = written(tmp_path / "C1", {0: [person(joints(25))], 5: [person(joints(25, 300.0), 4)]})
    out = tmp_path / "keypoints/C1.json"
    result = CliRunner().invoke(app, ["import", str(folder), "--format", "openpose", "-o", str(out)])
    assert result.exit_code == 0, result.output
    found = read_keypoints(out)
    assert found.frame.tolist() == [1, 6]
    assert found.identity.tolist() == [-1, 4]
    np.testing.assert_array_equal(found.xy[1, found.joints.index("left_ankle")], (314, 414))


@pytest.mark.parametrize(
    ("files", "match"),
    [
        ({}, "holds no JSON file"),
        ({"notes.json": "{}"}, "does not end with a frame number"),
        ({"a_1.json": "{}", "b_2.json": "{}"}, "differ in more than the number"),
        ({"a_1.json": "{}", "a_01.json": "{}"}, "are both frame 1"),
        ({"a_1_2.json": "{}", "a_2_2.json": "{}"}, "differ in more than the number"),
        ({"a_1.json": "{"}, r"a_1.json: line 1: is not JSON"),
        ({"a_1.json": "[]"}, r"a_1.json: has no list `people`"),
        ({"a_1.json": '{"people": [{}]}'}, r"people\[0\]: has no pose_keypoints_2d"),
        ({"a_1.json": '{"people": [{"pose_keypoints_2d": [1, 2]}]}'}, "2 numbers per person"),
        ({"a_1.json": '{"people": [{"pose_keypoints_2d": [1, 2, "3"]}]}'}, "holds '3': finite numbers"),
        ({"a_1.json": '{"people": [{"pose_keypoints_2d": [1, 2, Infinity]}]}'}, "holds inf: finite numbers"),
        ({"a_1.json": json.dumps({"people": [person(joints(15))]})}, "45 numbers per person"),
        ({"a_1.json": json.dumps({"people": [person(joints(25)), person(joints(18))]})}, "54 numbers.* others 75"),
        ({"a_1.json": json.dumps({"people": [person([0.5, 0.25, 0.9] * 25)]})}, "--keypoint_scale 0"),
        ({"a_1.json": '{"people": [{"pose_keypoints_2d": [], "person_id": ["x"]}]}'}, None),
        ({"a_1.json": json.dumps({"people": [person(joints(25), "x")]})}, r"person_id is \['x'\]"),
        ({"a_1.json": json.dumps({"people": [person(joints(25), 10**400)]})}, "person_id is"),
        ({"a_1.json": json.dumps({"people": [person([10**400, 1, 1])]})}, "finite numbers"),
        ({"a_99999999999999999999.json": "{}"}, "does not end with a frame number"),
    ],
)
def test_broken_folders_are_told(tmp_path, files, match):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    if match is None:
        assert len(read_people_as("openpose", tmp_path).keypoints) == 0
        return
    with refused(match, tmp_path):
        read_people_as("openpose", tmp_path)


def test_people_without_any_joint_are_no_scaled_ones(tmp_path):
    found = read_people_as("openpose", written(tmp_path / "C1", {0: [person([0] * 75)]}))
    assert len(found.keypoints) == 0


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "a_1.json").write_text("{}")
    with pytest.raises(InputError, match="give the folder of --write_json"):
        read_people_as("openpose", tmp_path / "a_1.json")
