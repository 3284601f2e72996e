"""`exclude` and `exclude_s`: people in regions of the image, and in spans of time, are not used."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Boxes, Keypoints
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.scene.inputs import SceneInputs, read_inputs
from passerby.scene.scene import Scene
from passerby.scene.used_rows import feet_of_keypoints, find_inside_any

LEFT = [[0.0, 0.0], [500.0, 0.0], [500.0, 719.0], [0.0, 719.0]]


def scene(folder: Path, **keys: object) -> Path:
    """Two cameras that see two people for ten frames: one at the left, whose feet are at (250, 400), one at (900, 400)."""
    frames = np.repeat(np.arange(1, 11), 2)
    identity = np.tile([1, 2], 10)
    ltwh = np.tile([[200.0, 200.0, 100.0, 200.0], [850.0, 200.0, 100.0, 200.0]], (10, 1))
    lens = Lens((1280, 720), np.array([[900.0, 0.0, 639.5], [0.0, 900.0, 359.5], [0.0, 0.0, 1.0]]), np.zeros(0))
    write_rig(folder / "lenses.toml", Rig((Camera("A", lens), Camera("B", lens))))
    for name, score in (("A", 1.0), ("B", 0.9)):
        write_boxes(folder / f"{name}.txt", Boxes(frames, identity, ltwh, np.full(20, score)))
    cameras = {name: {"intrinsics": "lenses.toml", "tracks": f"{name}.txt"} for name in ("A", "B")}
    content = {"scene": {"fps": 10.0}, "cameras": {"A": cameras["A"] | keys, "B": cameras["B"]}}
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps(content))
    return path


def read(path: Path) -> SceneInputs:
    return read_inputs(Scene.load(path))


def test_people_with_their_feet_in_a_region_are_left_out_and_counted(tmp_path):
    """Somebody in front of an excluded screen stays."""
    inputs = read(scene(tmp_path, exclude=[LEFT]))
    assert (set(inputs.observations["A"].boxes.identity), set(inputs.observations["B"].boxes.identity)) == ({2}, {1, 2})
    counted = [finding.values for finding in inputs.findings if finding.code == "people_excluded"]
    assert [(one["left_out"], one["rows"]) for one in counted] == [(10, 20)]
    screen = [[180.0, 150.0], [320.0, 150.0], [320.0, 390.0], [180.0, 390.0]]
    assert set(read(scene(tmp_path, exclude=[screen])).observations["A"].boxes.identity) == {1, 2}


def test_spans_of_time_are_left_out(tmp_path):
    frames = read(scene(tmp_path, exclude_s=[[0.0, 0.15], [0.5, 0.7]])).observations["A"].boxes.frame
    assert sorted(set(frames)) == [3, 4, 5, 9, 10]


@pytest.mark.parametrize(
    ("keys", "reported"),
    [
        ({"exclude": [LEFT, [[600.0, 0.0], [1279.0, 0.0], [1279.0, 719.0], [600.0, 719.0]]]}, "nothing is left"),
        ({"exclude": [[[2000.0, 0.0], [2100.0, 0.0], [2100.0, 50.0]]]}, "polygon 1 is outside the image of 1280 x 720"),
        ({"exclude": [[[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]]]}, "has 2 different corners"),
        ({"exclude": [[[0.0, 0.0], [10.0, float("nan")], [0.0, 5.0]]]}, "finite number"),
        ({"exclude_s": [[3.0, 2.0]]}, "ends before it begins"),
        ({"exclude_s": [[0.0, 60.0]]}, "exclude_s = [[0.0, 60.0]]: it saw people only from 0.0 to 0.9 s"),
    ],
)
def test_what_leaves_nothing_or_says_nothing_is_an_error_that_names_the_camera(tmp_path, keys, reported):
    with pytest.raises(InputError) as error:
        read(scene(tmp_path, **keys))
    assert reported in str(error.value)
    assert "cameras.A" in str(error.value)


def test_keypoints_alone_stand_on_their_lowest_detected_one(tmp_path):
    xy = np.zeros((2, 17, 2))
    xy[:, :3] = [[240.0, 210.0], [260.0, 300.0], [250.0, 395.0]]
    xy[1, :, 0] += 650.0
    score = np.zeros((2, 17))
    score[:, :3] = 1.0
    joints = Keypoints(np.array([1, 1]), np.array([1, 2]), xy, score)
    assert feet_of_keypoints(joints).tolist() == [[250.0, 395.0], [900.0, 395.0]]
    path = scene(tmp_path, exclude=[LEFT], keypoints="A.json")
    write_keypoints(tmp_path / "A.json", joints)
    assert read(path).observations["A"].keypoints.xy[:, 0].tolist() == [[890.0, 210.0]]


def test_a_polygon_that_crosses_itself_has_holes_and_no_point_is_in_it_twice():
    points = np.array([[1.0, 1.0], [3.0, 3.0], [5.0, 1.0], [np.nan, 1.0]])
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    assert find_inside_any(points, [square, square + 0.5]).tolist() == [True, True, False, False]
    bow = np.array([[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]])
    assert find_inside_any(np.array([[0.5, 2.0], [2.0, 0.5]]), [bow]).tolist() == [True, False]
