"""COCO annotations and results: frames, boxes, joints, identities, categories, broken files."""

import json

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, Keypoints
from passerby.interchange.coco import write_keypoints
from passerby.interchange.formats import read_people_as
from support.refusals import refused

IMAGES = [{"id": 51, "file_name": "C1/frame_000003.jpg"}, {"id": 7, "file_name": "C1/frame_000004.jpg"}]
PEOPLE = [{"id": 1, "name": "person", "keypoints": list(BODY_17)}]


def body(third=0.5, count=17, start=100.0):
    return [value for k in range(count) for value in (start + k, start + 100 + k, third)]


def annotation(image=51, box=(10, 20, 30, 40), **other):
    return {"id": 900, "image_id": image, "category_id": 1, "bbox": list(box), **other}


def read(tmp_path, content):
    (tmp_path / "people.json").write_text(json.dumps(content))
    return read_people_as("coco", tmp_path / "people.json")


def annotations(found, images=IMAGES, categories=PEOPLE):
    return {"images": images, "annotations": found, "categories": categories}


def test_annotations_with_boxes_joints_and_tracks(tmp_path):
    found = read(
        tmp_path,
        annotations(
            [
                annotation(7, keypoints=body(), track_id=3, score=0.8),
                annotation(51, (50, 60, 7, 8), keypoints=body(0.25, start=400.0), attributes={"track_id": 5}),
                annotation(51, (1, 1, 2, 2)),
            ]
        ),
    )
    assert found.boxes.frame.tolist() == [3, 3, 4]
    assert found.boxes.identity.tolist() == [-1, 5, 3]
    assert found.boxes.score.tolist() == [1.0, 1.0, 0.8]
    np.testing.assert_array_equal(found.boxes.ltwh[1], (50, 60, 7, 8))
    assert found.keypoints.frame.tolist() == [3, 4]
    assert found.keypoints.joints == BODY_17
    assert found.keypoints.score[0, 0] == 0.25
    assert found.notes == ()


def test_annotation_ids_are_no_identities(tmp_path):
    assert read(tmp_path, annotations([annotation()])).boxes.identity.tolist() == [-1]


@pytest.mark.parametrize(
    ("images", "frames"),
    [
        ([{"id": 51, "frame": 9, "file_name": "x3.jpg"}, {"id": 7, "frame": 8, "file_name": "x4.jpg"}], [9, 8]),
        ([{"id": 51, "frame_id": 2, "file_name": "x3.jpg"}, {"id": 7, "frame_id": 1, "file_name": "x4.jpg"}], [2, 1]),
        ([{"id": 51}, {"id": 7}], [51, 7]),
        ([{"id": "a", "file_name": "0.png"}, {"id": 7, "file_name": "1.png"}], [0, 1]),
    ],
)
def test_where_frames_are_from(tmp_path, images, frames):
    people = [annotation(images[0]["id"], (1, 1, 2, 2)), annotation(7, (3, 3, 4, 4))]
    found = read(tmp_path, annotations(people, images)).boxes
    assert {int(ltwh[0]): int(frame) for ltwh, frame in zip(found.ltwh, found.frame, strict=True)} == {
        1: frames[0],
        3: frames[1],
    }


def test_results_without_images(tmp_path):
    results = [annotation(12, score=0.5, keypoints=body(1.02)), annotation(2, score=0.25, keypoints=body(0))]
    found = read(tmp_path, results)
    assert found.boxes.frame.tolist() == [2, 12]
    assert found.boxes.score.tolist() == [0.25, 0.5]
    assert found.keypoints.frame.tolist() == [12]
    assert (found.keypoints.score == 1).all()
    assert len(found.notes) == 2
    assert read(tmp_path, [annotation("cam_0012.jpg")]).boxes.frame.tolist() == [12]
    assert len(read(tmp_path, []).boxes) == 0


def test_visibilities_become_confidences(tmp_path):
    values = body(2)
    values[2], values[5] = 0, 1
    found = read(tmp_path, annotations([annotation(keypoints=values)]))
    assert found.keypoints.score[0, :4].tolist() == [0.0, 0.5, 1.0, 1.0]
    assert found.notes == ()


def test_only_people_count(tmp_path):
    categories = [{"id": 3, "name": "car"}, {"id": 4, "name": "Person"}]
    people = [annotation(category_id=3), annotation(box=(5, 5, 6, 6), category_id=4), annotation(category_id=4, iscrowd=1)]
    found = read(tmp_path, annotations(people, categories=categories))
    assert found.boxes.ltwh[:, 0].tolist() == [5]
    assert "1 of other categories than people left out" in found.notes
    assert "1 crowds left out" in found.notes
    assert len(read(tmp_path, annotations([annotation()], categories=[])).boxes) == 1
    alone = read(tmp_path, annotations([annotation(category_id=9)], categories=[{"id": 9, "name": "<b>walker</b>"}]))
    assert len(alone.boxes) == 1
    assert "walker" in alone.notes[0]


def test_joints_have_the_names_of_their_category(tmp_path):
    names = ["Head-Top", "left ankle", "nose"]
    categories = [{"id": 1, "name": "person", "keypoints": names}]
    found = read(tmp_path, annotations([annotation(keypoints=body(count=3))], categories=categories)).keypoints
    assert found.joints == ("nose", "left_ankle", "head_top")
    assert found.xy[0, :, 0].tolist() == [102, 101, 100]


def test_what_passerby_writes_is_read(tmp_path):
    rng = np.random.default_rng(0)
    joints = Keypoints(np.array([0, 4]), np.array([2, -1]), rng.uniform(0, 900, (2, 17, 2)).round(3), np.full((2, 17), 0.5))
    write_keypoints(tmp_path / "C1.json", joints)
    found = read_people_as("coco", tmp_path / "C1.json").keypoints
    assert found.frame.tolist() == [0, 4]
    assert found.identity.tolist() == [2, -1]
    np.testing.assert_array_equal(found.xy, joints.xy)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ({"images": []}, "has neither annotations"),
        ({"annotations": []}, "images is missing"),
        (annotations([annotation(3)]), "image_id 3 is none of the images"),
        (annotations([annotation([1])]), r"image_id \[1\] is none of the images"),
        (annotations([], [{"file_name": "1.jpg"}]), r"images\[0\]: needs an `id`"),
        (annotations([], [{"id": 1, "file_name": "one.jpg"}]), "does not end with a frame number"),
        (annotations([], [{"id": 1, "file_name": "a/1.jpg"}, {"id": 2, "file_name": "b/2.jpg"}]), "differ in more"),
        (annotations([], [{"id": 1, "file_name": "1.jpg"}, {"id": 2}]), "others none"),
        (annotations([], [{"id": 1, "frame": 4}, {"id": 2, "frame": 4}]), "frame 4 is that of image 1 too"),
        (annotations([], [{"id": 1, "frame": 4}, {"id": 1, "frame": 5}]), "image id 1 occurs twice"),
        (annotations([], [{"id": 1, "frame": 4.5}]), "frame is 4.5"),
        (annotations([], [{"id": 1, "frame": 10**30}]), "frame is 10000"),
        (annotations([annotation(box=(10**400, 2, 3, 4))]), "bbox holds 10000.*finite numbers"),
        (annotations([annotation(keypoints=body(count=4))]), "keypoints have 12 numbers, but the category has 17"),
        (annotations([annotation(box=(1, 2, 3))]), "bbox has 3 numbers"),
        (annotations([annotation(track_id="x")]), "track_id is 'x'"),
        (
            annotations([], categories=[{"id": 1, "name": "a"}, {"id": 2, "name": "b"}]),
            "none of the categories is called person",
        ),
        (annotations([], categories=[{"id": 1, "name": "person", "keypoints": ["a", "A"]}]), "a keypoint occurs twice"),
        ([annotation(-2)], "image_id is -2"),
        ([annotation(1), annotation("2.jpg")], "some image_id are names"),
        ([7], r"\[0\]: is not an object"),
        (annotations([], categories={"id": 1}), "categories is not a list"),
        (annotations([], categories=[{"id": "1", "name": "person"}]), r"categories\[0\]: needs a whole number `id`"),
        (annotations([], categories=[{"id": 1, "name": "person", "keypoints": "nose"}]), "must be a list of keypoint names"),
        (annotations([], categories=[{"id": 1, "name": "person", "keypoints": [1]}]), "must be a list of keypoint names"),
        (annotations([{**annotation(), "bbox": 3}]), "bbox is 3: a list of numbers is needed"),
        (annotations([annotation(box=(float("nan"), 2, 3, 4))]), r"a box of frame 3 is \[nan, .*: not finite numbers"),
        (annotations([annotation(score=float("nan"))]), "score nan: not finite numbers"),
        (
            annotations(
                [annotation(keypoints=body()), annotation(7, category_id=2, keypoints=body(count=1))],
                categories=[*PEOPLE, {"id": 2, "name": "pedestrian", "keypoints": ["top"]}],
            ),
            "several categories of people have different keypoints: keep one of them",
        ),
    ],
)
def test_broken_files_are_told(tmp_path, content, match):
    with refused(match, "people.json"):
        read(tmp_path, content)


def test_a_folder_and_a_format_without_people_are_told(tmp_path):
    with pytest.raises(InputError, match="is a folder: give the JSON file in it"):
        read_people_as("coco", tmp_path)
    with pytest.raises(InputError, match=r"format kalibr holds no people: .*coco.* do"):
        read_people_as("kalibr", tmp_path)
