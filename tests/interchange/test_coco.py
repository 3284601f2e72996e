"""COCO keypoints: what is read from where, round trips, and every fault."""

import copy
import json

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from passerby.core.observations import Keypoints
from passerby.interchange.coco import read_keypoints, write_keypoints
from support.refusals import refused

GOOD = {
    "images": [{"id": 7, "file_name": "000012.png", "frame": 3}, {"id": 8, "file_name": "000014.png", "frame": 1}],
    "categories": [{"id": 1, "name": "person", "keypoints": ["head", "foot"]}],
    "annotations": [
        {"id": 1, "image_id": 7, "category_id": 1, "track_id": 5, "keypoints": [10, 20, 0.5, 11, 90, 0.25]},
        {"id": 2, "image_id": 8, "category_id": 1, "track_id": 5, "keypoints": [12, 20, 1, 0, 0, 0]},
        {"id": 3, "image_id": 8, "category_id": 1, "keypoints": [50, 20, 0.5, 51, 80, 0.5]},
    ],
}


def read(tmp_path, content):
    path = tmp_path / "keypoints.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_keypoints(path)


def changed(**paths):
    content = copy.deepcopy(GOOD)
    for path, value in paths.items():
        *where, last = [int(part) if part.isdigit() else part for part in path.split("__")]
        target = content
        for part in where:
            target = target[part]
        if value is None:
            del target[last]
        else:
            target[last] = value
    return content


def test_joints_frames_and_identities_are_read(tmp_path):
    keypoints = read(tmp_path, GOOD)
    assert (keypoints.joints, keypoints.frame.tolist()) == (("head", "foot"), [1, 1, 3])
    assert (keypoints.identity.tolist(), keypoints.xy[2].tolist()) == ([-1, 5, 5], [[10, 20], [11, 90]])
    assert keypoints.score.tolist() == [[0.5, 0.5], [1, 0], [0.5, 0.25]]
    # Frames are of the names of files or the numbers of images where none are stated.
    by_name = changed(images__0__frame=None, images__1__frame=None)
    assert read(tmp_path, by_name).frame.tolist() == [12, 14, 14]
    assert read(tmp_path, changed(images=[{"id": 7}, {"id": 8}])).frame.tolist() == [7, 8, 8]
    # Annotations of boxes alone are left out.
    keypoints = read(tmp_path, changed(annotations__0__keypoints=None))
    assert (keypoints.frame.tolist(), keypoints.joints) == ([1, 1], ("head", "foot"))


def test_visibilities_become_confidences(tmp_path):
    content = changed(
        annotations__0__keypoints=[10, 20, 2, 11, 90, 1],
        annotations__1__keypoints=[12, 20, 2, 0, 0, 0],
        annotations__2__keypoints=[50, 20, 2, 51, 80, 2],
    )
    assert read(tmp_path, content).score.tolist() == [[1, 1], [1, 0], [1, 0.5]]


@pytest.mark.parametrize(("content", "message"), [
    ("{", "is not JSON"),
    ("[]", "top level: an object"),
    ({"images": []}, "categories: is missing"),
    (changed(categories__0__keypoints=None), "category_id 1 is not a category with keypoint names"),
    (changed(categories__0__keypoints=["head", "head"]), "keypoint 'head' occurs twice"),
    (changed(categories__0__keypoints=["head", 3]), "must be a list of keypoint names"),
    (changed(images__0__id=None), r"images\[0\]: needs a whole number `id`"),
    (changed(images__0__frame=1.5), r"images\[0\]: frame is 1.5: a whole number"),
    (changed(images__1__frame=3), r"images\[1\]: frame 3 is that of image 7 too"),
    (changed(images__1__id=7), r"images\[1\]: image id 7 occurs twice"),
    (changed(annotations__0__image_id=99), r"annotations\[0\]: image_id 99 is none of the images"),
    (changed(annotations__0__track_id="Bob"), r"annotations\[0\]: track_id is 'Bob'"),
    (changed(annotations__0__keypoints=[1, 2, 1]), r"annotations\[0\]: keypoints has 3 numbers; 2 keypoints take 6"),
    (changed(annotations__0__keypoints=[1, 2, 1, float("nan"), 2, 1]), r"keypoints holds nan"),
    (changed(annotations__0__keypoints=[1, 2, 1.5, 1, 2, 1]), r"third number of a keypoint is 1.5"),
    (changed(annotations__0__keypoints=[1, 2, -0.5, 1, 2, 1]), r"confidence is -0.5"),
    (changed(annotations__2__track_id=5), r"identity 5 occurs twice in frame 1"),
    (changed(categories__0=["person"]), r"categories\[0\]: needs a whole number `id`"),
    (changed(annotations__1=[1, 2]), r"annotations\[1\]: is not an object"),
    (changed(categories=[*GOOD["categories"], {"id": 2, "keypoints": ["foot", "x"]}], annotations__1__category_id=2),
     "annotations: people of several categories with different keypoints: give one category only"),
    (GOOD | {"annotations": [GOOD["annotations"][2]] * 2}, "the same keypoints occur twice in frame 1"),
])  # fmt: skip
def test_a_fault_names_file_place_value_and_mend(tmp_path, content, message):
    with refused(message, tmp_path / "keypoints.json"):
        read(tmp_path, content)


coordinates = st.floats(-2000, 4000).map(lambda value: round(value, 3))
people = st.lists(
    st.tuples(
        st.integers(0, 1000),
        st.integers(0, 50),
        st.lists(st.tuples(coordinates, coordinates, st.floats(0, 1)), min_size=3, max_size=3),
    ),
    unique_by=lambda person: person[:2],
    max_size=10,
)


@given(people)
@example([(3, 1, [(1.0, 2.0, 0.0)] * 3)])  # a person without a joint
def test_keypoints_come_back(tmp_path_factory, people):
    table = np.array([person[2] for person in people], dtype=float).reshape(-1, 3, 3).round(3)
    frame, identity = [person[0] for person in people], [person[1] for person in people]
    keypoints = Keypoints(frame, identity, table[..., :2], table[..., 2], ("a", "b", "c"))
    path = tmp_path_factory.mktemp("joints") / "joints.json"
    write_keypoints(path, keypoints)
    back = read_keypoints(path)
    order = np.lexsort((keypoints.identity, keypoints.frame))
    assert back.joints == keypoints.joints
    assert np.array_equal(back.frame, keypoints.frame[order])
    assert np.array_equal(back.identity, keypoints.identity[order])
    assert np.array_equal(back.xy, keypoints.xy[order])
    assert np.array_equal(back.score, keypoints.score[order])
