"""Joints under the names of another layout of as many joints, and wands beside people in keypoint files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, Keypoints
from passerby.findings.finding import Finding
from passerby.interchange.coco import write_keypoints
from passerby.interchange.formats.skeletons import BODY_25, BODY_25B, ordered_joints
from passerby.interchange.rig_toml import write_rig
from passerby.scene.camera_input import CameraInput
from passerby.scene.inputs import read_inputs
from passerby.scene.joint_layouts import correct_layouts
from passerby.scene.scene import Scene
from support.scenes.people_and_rigs import part, simulated, without_poses
from support.scenes.simulated import scene
from support.scenes.wands import as_annotations, carried_wand


@pytest.fixture(scope="module")
def people() -> dict[str, Keypoints]:
    """Simulated people's joints, as BODY_25B has them, by camera."""
    simulated = scene(seconds=4.0)
    return {name: as_body_25b(simulated.observations[name].keypoints) for name in simulated.rig.names}


def as_body_25b(people: Keypoints) -> Keypoints:
    at = dict(zip(BODY_17, np.moveaxis(people.xy, 1, 0), strict=True))
    neck = (at["left_shoulder"] + at["right_shoulder"]) / 2
    at |= {"neck": neck, "head_top": at["nose"] + 0.5 * (at["nose"] - neck)}
    at |= {f"{side}_{part}": at[f"{side}_ankle"] for side in ("left", "right") for part in ("big_toe", "small_toe", "heel")}
    xy = np.stack([at[name] for name in BODY_25B], axis=1)
    return Keypoints(people.frame, people.identity, xy, np.ones(xy.shape[:2]), BODY_25B)


def readings(people: dict[str, Keypoints], names: tuple[str, ...]) -> list[CameraInput]:
    return [CameraInput(name, keypoints=replace(one, joints=names)) for name, one in people.items()]


def corrected(given: list[CameraInput]) -> list[Finding]:
    before = [len(one.findings) for one in given]
    correct_layouts(given)
    return [finding for one, count in zip(given, before, strict=True) for finding in one.findings[count:]]


def test_joints_of_another_layout_get_its_names(people) -> None:
    given = readings(people, BODY_25)
    (found,) = corrected(given)
    assert (found.code, found.severity, found.cameras) == ("keypoint_layout_corrected", "notice", tuple(people))
    assert (found.values["stated"], found.values["layout"]) == ("BODY_25", "BODY_25B")
    assert ({one.keypoints.joints for one in given}, corrected(given)) == ({BODY_25B}, [])


def test_columns_in_another_order(people) -> None:
    """An import puts COCO's joints first, by their wrong names."""
    order = [BODY_25.index(name) for name in ordered_joints(BODY_25)]
    moved = {
        name: Keypoints(one.frame, one.identity, one.xy[:, order], one.score[:, order], ordered_joints(BODY_25))
        for name, one in people.items()
    }
    given = readings(moved, ordered_joints(BODY_25))
    assert len(corrected(given)) == 1
    for one in given:
        column = one.keypoints.joints.index("left_knee")
        np.testing.assert_array_equal(one.keypoints.xy[:, column], people[one.name].xy[:, BODY_25B.index("left_knee")])


def test_right_names_and_names_of_no_tool_stay(people) -> None:
    """Shuffled joints are those of no tool either: the doubt about their names remains."""
    own = tuple(f"marker {number}" for number in range(25))
    shuffle = np.random.default_rng(3).permutation(25)
    shuffled = {name: replace(one, xy=one.xy[:, shuffle]) for name, one in people.items()}
    empty = {name: one.take(np.zeros(0, dtype=np.int64)) for name, one in people.items()}
    for seen, names in ((people, BODY_25B), (people, own), (shuffled, BODY_25), (empty, BODY_25)):
        given = readings(seen, names)
        assert (corrected(given), {one.keypoints.joints for one in given}) == ([], {names})


TRUTH = simulated("terrace", seconds=8.0)
NAMES = ("stick_a", "stick_b")


def scene_with_wand(folder: Path, wand: str, *, marked: tuple[str, ...] = TRUTH.rig.names) -> Scene:
    """A scene of keypoint files, the wand in those of the cameras `marked`."""
    seen = carried_wand(TRUTH, np.random.default_rng(1))
    write_rig(folder / "rig.toml", without_poses(TRUTH.rig))
    text = '[association]\nmode = "given"\n'
    for name, people in part(TRUTH.observations, boxes=False, keypoints=True).cameras.items():
        own = seen[name] if name in marked else seen[name].take(np.zeros(0, int))
        write_keypoints(folder / f"{name}.json", as_annotations(people.keypoints, own, NAMES))
        text += f'[cameras.{name}]\nintrinsics = "rig.toml"\nkeypoints = "{name}.json"\n'
    (folder / "scene.toml").write_text(f"{text}[[scale.wands]]\n{wand}\n")
    return Scene.load(folder / "scene.toml")


def test_a_wand_is_read_beside_the_people_and_of_two_marks_in_one_frame_the_better_counts(tmp_path: Path) -> None:
    made = scene_with_wand(tmp_path, 'points = ["stick_a", "stick_b"]\nmetres = 1.0')
    inputs, expected = read_inputs(made), carried_wand(TRUTH, np.random.default_rng(1))
    people = part(TRUTH.observations, boxes=False, keypoints=True)
    for name, seen in people.cameras.items():
        found = inputs.observations[name]
        assert (found.keypoints.joints, len(found.keypoints)) == (BODY_17, len(seen.keypoints))
        assert np.array_equal(found.wands.frame, expected[name].frame)
        np.testing.assert_allclose(found.wands.xy, expected[name].xy, atol=1e-3)
    assert not [one for one in inputs.findings if one.code == "rows_without_identity"]
    one = expected["C1"].take(np.array([0]))
    both = one.take(np.array([0, 0]))
    both = Keypoints(both.frame, both.identity, both.xy + [[[50]], [[0]]], both.score * [[0.5], [1]], both.joints)
    write_keypoints(tmp_path / "C1.json", as_annotations(people["C1"].keypoints, both, NAMES))
    np.testing.assert_allclose(read_inputs(made).observations["C1"].wands.xy, one.xy, atol=1e-3)


@pytest.mark.parametrize(
    ("wand", "marked", "says"),
    [
        ('points = ["tip", "grip"]\nmetres = 1.0', TRUTH.rig.names, "no camera has keypoints named tip and grip"),
        ('points = ["stick_a", "stick_b"]\nmetres = 1.0', ("C1",), "only camera C1 has keypoints named stick_a and stick_b"),
        ('points = ["stick_a", "left_wrist"]\nmetres = 1.0', TRUTH.rig.names, "'left_wrist' is a keypoint of the body"),
        ('points = ["stick_a", "stick_a"]\nmetres = 1.0', TRUTH.rig.names, "names 'stick_a' twice"),
    ],
)
def test_an_error_says_what_is_wrong_with_a_wand(tmp_path: Path, wand: str, marked: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_inputs(scene_with_wand(tmp_path, wand, marked=marked))
