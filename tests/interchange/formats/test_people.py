"""People found by OpenPose, AlphaPose and tools that write COCO: keypoints, boxes, frames, identities, broken files."""

import json

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.observations import BODY_17
from passerby.interchange.coco import read_keypoints
from passerby.interchange.formats import read_people_as
from passerby.interchange.motchallenge import read_boxes
from support.refusals import refused

COUNTED_FROM_0 = ("frame numbers are those of a video counted from 0, and are raised by one",)


def body(count=17, start=100.0, third=0.5):
    """Keypoint k lies at (start + k, start + 100 + k)."""
    return [value for k in range(count) for value in (start + k, start + 100 + k, third)]


def read(form, folder, content):
    """What is found in one file, or in the files of a folder by their names."""
    if isinstance(content, dict) and form == "openpose":
        for name, text in content.items():
            (folder / name).write_text(text if isinstance(text, str) else json.dumps({"version": 1.3, "people": text}))
        return read_people_as(form, folder)
    (folder / "people.json").write_text(json.dumps(content))
    return read_people_as(form, folder / "people.json")


def places(keypoints):
    numbers = keypoints.xy[0, :, 0] - 100
    np.testing.assert_array_equal(keypoints.xy[0, :, 1], 200 + numbers)
    return dict(zip(keypoints.joints, numbers.astype(int).tolist(), strict=True))


def walker(values, identity=-1):
    return {"person_id": [identity], "pose_keypoints_2d": values, "face_keypoints_2d": [], "hand_left_keypoints_2d": []}


def alpha(image, count=17, start=100.0, **other):
    return {"image_id": image, "category_id": 1, "keypoints": body(count, start), "score": 2.9, **other}


IMAGES = [{"id": 51, "file_name": "C1/frame_000003.jpg"}, {"id": 7, "file_name": "C1/frame_000004.jpg"}]
PEOPLE = [{"id": 1, "name": "person", "keypoints": list(BODY_17)}]


def coco(image=51, box=(10, 20, 30, 40), **other):
    return {"id": 900, "image_id": image, "category_id": 1, "bbox": list(box), **other}


def annotations(found, images=IMAGES, categories=PEOPLE):
    return {"images": images, "annotations": found, "categories": categories}


# Columns as the documentation of each tool lists them.
BODY_25 = {"nose": 0, "left_shoulder": 5, "right_shoulder": 2, "left_hip": 12, "right_hip": 9, "left_ankle": 14,
           "right_ankle": 11, "left_eye": 16, "right_eye": 15, "left_ear": 18, "right_ear": 17, "left_wrist": 7, "neck": 1,
           "mid_hip": 8, "left_big_toe": 19, "left_heel": 21, "right_heel": 24}  # fmt: skip
COCO_18 = {"nose": 0, "neck": 1, "right_shoulder": 2, "left_shoulder": 5, "right_hip": 8, "left_hip": 11, "right_ankle": 10,
           "left_ankle": 13, "right_eye": 14, "left_eye": 15, "right_ear": 16, "left_ear": 17}  # fmt: skip
HALPE = {name: place for place, name in enumerate(BODY_17)} | {
    "head_top": 17, "neck": 18, "mid_hip": 19, "left_big_toe": 20, "right_big_toe": 21, "left_small_toe": 22,
    "right_small_toe": 23, "left_heel": 24, "right_heel": 25,
}  # fmt: skip
WHOLE_BODY = {"left_heel": 19}


@pytest.mark.parametrize(("form", "count", "known", "kept"), [
    ("openpose", 25, BODY_25, 25), ("openpose", 18, COCO_18, 18), ("openpose", 17, {}, 17), ("openpose", 26, HALPE, 26),
    ("openpose", 133, WHOLE_BODY, 23), ("openpose", 136, HALPE, 26), ("alphapose", 17, {}, 17),
    ("alphapose", 26, HALPE, 26), ("alphapose", 136, HALPE, 26), ("coco", 17, {}, 17),
])  # fmt: skip
def test_keypoints_are_those_of_the_columns(tmp_path, form, count, known, kept):
    values = body(count)
    content = {
        "openpose": {"a_000000000000_keypoints.json": [walker(values)]}, "alphapose": [alpha("0.jpg", count)],
        "coco": annotations([coco(keypoints=values)]),
    }[form]  # fmt: skip
    found = places(read(form, tmp_path, content).keypoints)
    assert (tuple(found)[:17], len(found)) == (BODY_17, kept)
    assert known.items() <= found.items()
    assert known or list(found.values()) == list(range(17))


@pytest.mark.parametrize(("form", "content", "frames", "notes"), [
    ("openpose", {"w_000000000000_keypoints.json": [], "w_000000000011_keypoints.json": [walker(body(25))]}, [12],
     COUNTED_FROM_0),
    *(("openpose", {name.format(n): [walker(body(25))] for n in (3, 10)}, [3, 10], ())
      for name in ("cam1_{:06d}.json", "picture {}_keypoints.json", "C1.{:04d}.json")),
    ("alphapose", [alpha("0.jpg"), alpha("12.jpg")], [1, 13], COUNTED_FROM_0),
    ("alphapose", [alpha(17), alpha(3)], [3, 17], ()),
])  # fmt: skip
def test_frames_are_from_the_names_of_files(tmp_path, form, content, frames, notes):
    found = read(form, tmp_path, content)
    assert (found.keypoints.frame.tolist(), found.notes, len(found.boxes)) == (frames, notes, 0)


@pytest.mark.parametrize(("images", "frames"), [
    ([{"id": 51, "frame": 9, "file_name": "x3.jpg"}, {"id": 7, "frame": 8, "file_name": "x4.jpg"}], [9, 8]),
    ([{"id": 51, "frame_id": 2, "file_name": "x3.jpg"}, {"id": 7, "frame_id": 1, "file_name": "x4.jpg"}], [2, 1]),
    ([{"id": 51}, {"id": 7}], [51, 7]),
    ([{"id": "a", "file_name": "0.png"}, {"id": 7, "file_name": "1.png"}], [0, 1]),
])  # fmt: skip
def test_frames_of_coco_are_stated_or_of_the_images(tmp_path, images, frames):
    found = read("coco", tmp_path, annotations([coco(images[0]["id"], (1, 1, 2, 2)), coco(7, (3, 3, 4, 4))], images)).boxes
    at = {int(ltwh[0]): int(frame) for ltwh, frame in zip(found.ltwh, found.frame, strict=True)}
    assert at == {1: frames[0], 3: frames[1]}


def test_what_openpose_did_not_find_is_not_there(tmp_path):
    values = body(25)
    values[0:3] = [0, 0, 0]  # the nose, as OpenPose leaves it out
    values[3 * 16 : 3 * 16 + 3] = [float("nan"), 5.0, 0.9]  # the left eye, as Sports2D leaves it out
    values[3 * 15 : 3 * 15 + 3] = [-1, -1, -0.01]  # the right eye, as RTMLib leaves it out
    values[3 * 18 + 2] = 1.07
    found = read("openpose", tmp_path, {"a_0.json": [walker(values), walker([0.0] * 75), walker([])]})
    assert len(found.keypoints) == 1
    score = dict(zip(found.keypoints.joints, found.keypoints.score[0], strict=True))
    assert [score[name] for name in ("nose", "left_eye", "right_eye", "left_ear", "right_ear")] == [0, 0, 0, 1, 0.5]
    assert {"one keypoint has the confidence 1.07: it becomes 1", "one person without a keypoint is left out"} <= {*found.notes}
    for form in ("openpose", "alphapose", "coco"):
        empty = read(form, tmp_path, {"a_0.json": []} if form == "openpose" else [])
        assert len(empty.keypoints) == len(empty.boxes) == 0


def test_identities_of_openpose_are_kept_and_no_person_is_there_twice(tmp_path):
    people = [walker(body(25), 7), walker(body(25, 300.0, 0.9), 7), walker(body(25, 500.0), 2), *2 * [walker(body(25, 9.0))]]
    found = read("openpose", tmp_path, {"a_0.json": people})
    by = {float(xy[0, 0]): identity for xy, identity in zip(found.keypoints.xy, found.keypoints.identity, strict=True)}
    assert by == {100.0: -1, 300.0: 7, 500.0: 2, 9.0: -1}
    assert len(found.keypoints) == 4
    assert {"one of the people occurs twice"} < {note for note in found.notes if "twice" in note}


def test_boxes_and_tracks_of_alphapose(tmp_path):
    first, second = [90.0, 180.0, 60.0, 170.0], [390.0, 480.0, 61.0, 171.0]
    people = [("0.jpg", 100.0, first, 3), ("0.jpg", 400.0, second, 1), ("12.jpg", 105.0, first, 3)]
    found = read("alphapose", tmp_path, [alpha(image, start=start, box=box, idx=who) for image, start, box, who in people])
    assert found.keypoints.frame.tolist() == [1, 1, 13]
    assert found.keypoints.identity.tolist() == found.boxes.identity.tolist() == [1, 3, 3]
    assert (found.boxes.ltwh[0].tolist(), found.boxes.score.tolist()) == (second, [2.9] * 3)


@pytest.mark.parametrize(("indices", "identities", "tracked"), [
    ([[0.0], [0.0, 0.0], [0.0]], [-1, -1, -1], False), ([[2.0], [[5.0], [5.0]], [1, 4]], [-1, 2, 5], True),
])  # fmt: skip
def test_tracks_of_alphapose_in_lists(tmp_path, indices, identities, tracked):
    found = read("alphapose", tmp_path, [alpha("0.jpg", start=300.0 * k, idx=idx) for k, idx in enumerate(indices)])
    assert sorted(found.keypoints.identity.tolist()) == identities
    assert any("not tracked" in note for note in found.notes) == (not tracked)


def test_the_command_writes_what_a_scene_takes(tmp_path, capsys):
    (tmp_path / "C1").mkdir()
    people = {0: walker(body(25)), 5: walker(body(25, 300.0), 4)}
    read("openpose", tmp_path / "C1", {f"w_{frame:012d}_keypoints.json": [one] for frame, one in people.items()})
    out = tmp_path / "keypoints/C1.json"
    assert run(["import", str(tmp_path / "C1"), "--format", "openpose", "-o", str(out)]) == 0
    found = read_keypoints(out)
    assert (found.frame.tolist(), found.identity.tolist()) == ([1, 6], [-1, 4])
    np.testing.assert_array_equal(found.xy[1, found.joints.index("left_ankle")], (314, 414))
    again = read_people_as("coco", out).keypoints
    assert (again.frame.tolist(), again.identity.tolist()) == ([1, 6], [-1, 4])
    np.testing.assert_array_equal(again.xy[1, again.joints.index("left_ankle")], (314, 414))
    read("alphapose", tmp_path, [alpha("4.jpg", box=[90.0, 180, 60, 170], idx=3), alpha("6.jpg", box=[1, 2, 0, 4], idx=3)])
    out = tmp_path / "tracks/C1.txt"
    assert run(["import", str(tmp_path / "people.json"), "--format", "alphapose", "-o", str(out)]) == 0
    assert "one flat box is left out" in "".join(capsys.readouterr())
    boxes = read_boxes(out)
    assert (boxes.frame.tolist(), boxes.identity.tolist()) == ([5], [3])


def test_annotations_of_coco(tmp_path):
    """Identities are those of tracks, and not the annotations' own numbers."""
    people = [
        coco(7, keypoints=body(), track_id=3, score=0.8),
        coco(51, (50, 60, 7, 8), keypoints=body(start=400.0, third=0.25), attributes={"track_id": 5}),
        coco(51, (1, 1, 2, 2)),
    ]
    found = read("coco", tmp_path, annotations(people))
    assert (found.boxes.frame.tolist(), found.boxes.identity.tolist()) == ([3, 3, 4], [-1, 5, 3])
    assert found.boxes.score.tolist() == [1.0, 1.0, 0.8]
    np.testing.assert_array_equal(found.boxes.ltwh[1], (50, 60, 7, 8))
    assert (found.keypoints.frame.tolist(), found.keypoints.score[0, 0], found.notes) == ([3, 4], 0.25, ())
    # Results of a detector have no images.
    results = [coco(12, score=0.5, keypoints=body(third=1.02)), coco(2, score=0.25, keypoints=body(third=0))]
    found = read("coco", tmp_path, results)
    assert (found.boxes.frame.tolist(), found.boxes.score.tolist()) == ([2, 12], [0.25, 0.5])
    assert found.keypoints.frame.tolist() == [12]
    assert (found.keypoints.score == 1).all()
    assert len(found.notes) == 2
    assert read("coco", tmp_path, [coco("cam_0012.jpg")]).boxes.frame.tolist() == [12]


def test_visibilities_of_coco_become_confidences_and_names_are_those_of_the_category(tmp_path):
    values = body(third=2)
    values[2], values[5] = 0, 1
    found = read("coco", tmp_path, annotations([coco(keypoints=values)]))
    assert (found.keypoints.score[0, :4].tolist(), found.notes) == ([0.0, 0.5, 1.0, 1.0], ())
    categories = [{"id": 1, "name": "person", "keypoints": ["Head-Top", "left ankle", "nose"]}]
    found = read("coco", tmp_path, annotations([coco(keypoints=body(3))], categories=categories)).keypoints
    assert list(places(found).items()) == [("nose", 2), ("left_ankle", 1), ("head_top", 0)]


def test_only_people_of_coco_count(tmp_path):
    categories = [{"id": 3, "name": "car"}, {"id": 4, "name": "Person"}]
    people = [coco(category_id=3), coco(box=(5, 5, 6, 6), category_id=4), coco(category_id=4, iscrowd=1)]
    found = read("coco", tmp_path, annotations(people, categories=categories))
    assert found.boxes.ltwh[:, 0].tolist() == [5]
    assert {"1 of other categories than people left out", "1 crowds left out"} <= {*found.notes}
    assert len(read("coco", tmp_path, annotations([coco()], categories=[])).boxes) == 1
    alone = read("coco", tmp_path, annotations([coco(category_id=9)], categories=[{"id": 9, "name": "<b>walker</b>"}]))
    assert len(alone.boxes) == 1
    assert "walker" in alone.notes[0]


def one(**values):
    return {"a_1.json": [walker(body(25)) | values]}


BROKEN = {
    "openpose": [
        ({}, "holds no JSON file"),
        ({"a_99999999999999999999.json": "{}"}, "does not end with a frame number"),
        ({"a_1.json": "{}", "a_01.json": "{}"}, "are both frame 1"),
        ({"a_1.json": "{"}, r"a_1.json: line 1: is not JSON"),
        ({"a_1.json": "[]"}, r"a_1.json: has no list `people`"),
        ({"a_1.json": [{}]}, r"people\[0\]: has no pose_keypoints_2d"),
        (one(pose_keypoints_2d=[10**400, 1, 1]), "finite numbers"),
        ({"a_1.json": [walker(body(25)), walker(body(18))]}, "54 numbers.* others 75"),
        (one(pose_keypoints_2d=[0.5, 0.25, 0.9] * 25), "--keypoint_scale 0"),
        (one(person_id=["x"]), r"person_id is \['x'\]"),
        (one(person_id=[10**400]), "person_id is"),
    ],
    "alphapose": [
        ({"0.jpg": {"people": []}}, "sep-json"),
        ("text", "is not a list of people"),
        ([{"image_id": "0.jpg"}], r"\[0\]: has no keypoints"),
        ([alpha(None)], "image_id is None"),
        ([alpha("first.jpg")], "does not end with a frame number"),
        ([alpha("1.jpg"), alpha(2)], "some image_id are names"),
        ([alpha(-1)], "image_id is -1"),
        ([alpha(10**30)], "image_id is 10000"),
        ([alpha("1.jpg", count=21)], "63 numbers per person"),
        ([alpha("1.jpg", box=[1, 2, 3])], "box has 3 numbers: 4"),
        ([alpha("1.jpg", idx=1.5)], "idx is 1.5"),
    ],
    "coco": [
        ({"images": []}, "has neither annotations"),
        ({"annotations": []}, "images is missing"),
        (annotations([coco(3)]), "image_id 3 is none of the images"),
        (annotations([], [{"file_name": "1.jpg"}]), r"images\[0\]: needs an `id`"),
        (annotations([], [{"id": 1, "file_name": "a/1.jpg"}, {"id": 2, "file_name": "b/2.jpg"}]), "differ in more"),
        (annotations([], [{"id": 1, "file_name": "1.jpg"}, {"id": 2}]), "others none"),
        (annotations([], [{"id": 1, "frame": 4}, {"id": 2, "frame": 4}]), "frame 4 is that of image 1 too"),
        (annotations([], [{"id": 1, "frame": 4}, {"id": 1, "frame": 5}]), "image id 1 occurs twice"),
        (annotations([], [{"id": 1, "frame": 4.5}]), "frame is 4.5"),
        (annotations([coco(box=(10**400, 2, 3, 4))]), "bbox holds 10000.*finite numbers"),
        (annotations([coco(keypoints=body(4))]), "keypoints have 12 numbers, but the category has 17"),
        (annotations([coco() | {"bbox": 3}]), "bbox is 3: a list of numbers is needed"),
        (annotations([coco(box=(float("nan"), 2, 3, 4))]), r"a box of frame 3 is \[nan, .*: not finite numbers"),
        (annotations([coco(score=float("nan"))]), "score nan: not finite numbers"),
        (annotations([], categories=[{"id": 1, "name": "a"}, {"id": 2, "name": "b"}]), "none of the categories is called"),
        (annotations([], categories=[{"id": 1, "name": "person", "keypoints": ["a", "A"]}]), "a keypoint occurs twice"),
        (annotations([], categories={"id": 1}), "categories is not a list"),
        (annotations([], categories=[{"id": "1", "name": "person"}]), r"categories\[0\]: needs a whole number `id`"),
        (annotations([], categories=[{"id": 1, "name": "person", "keypoints": [1]}]), "must be a list of keypoint names"),
        (annotations([coco(keypoints=body()), coco(7, category_id=2, keypoints=body(1))],
                     categories=[*PEOPLE, {"id": 2, "name": "pedestrian", "keypoints": ["top"]}]),
         "several categories of people have different keypoints: keep one of them"),
        ([coco(1), coco("2.jpg")], "some image_id are names"),
        ([7], r"\[0\]: is not an object"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("form", "content", "message"), [(form, *row) for form, rows in BROKEN.items() for row in rows])
def test_broken_files_are_refused_with_their_place_and_value(tmp_path, form, content, message):
    with refused(message, tmp_path):
        read(form, tmp_path, content)


@pytest.mark.parametrize(("form", "place", "message"), [
    ("openpose", "a_1.json", "give the folder of --write_json"),
    ("alphapose", ".", "is a folder: give the file alphapose-results.json in it"),
    ("coco", ".", "is a folder: give the JSON file in it"),
    ("kalibr", ".", r"format kalibr holds no people: .*coco.* do"),
])  # fmt: skip
def test_a_file_for_a_folder_and_a_folder_for_a_file_are_refused(tmp_path, form, place, message):
    (tmp_path / "a_1.json").write_text("{}")
    with refused(message, "" if form == "kalibr" else tmp_path):
        read_people_as(form, tmp_path / place)
