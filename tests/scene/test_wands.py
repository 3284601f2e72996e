"""Wands in keypoint files: read beside people, and never taken for one."""

from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, Keypoints
from passerby.interchange.coco import write_keypoints
from passerby.interchange.rig_toml import write_rig
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from support.scenes.people_and_rigs import part, simulated, without_poses
from support.scenes.wands import as_annotations, carried_wand

TRUTH = simulated("terrace", seconds=8.0)
NAMES = ("stick_a", "stick_b")


def scene(folder: Path, wand: str, *, marked: tuple[str, ...] = TRUTH.rig.names) -> Scene:
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


def test_a_wand_is_read_beside_the_people(tmp_path: Path) -> None:
    inputs = read_inputs(scene(tmp_path, 'points = ["stick_a", "stick_b"]\nmetres = 1.0'))
    expected = carried_wand(TRUTH, np.random.default_rng(1))
    for name, people in part(TRUTH.observations, boxes=False, keypoints=True).cameras.items():
        found = inputs.observations[name]
        assert (found.keypoints.joints, len(found.keypoints)) == (BODY_17, len(people.keypoints))
        assert np.array_equal(found.wands.frame, expected[name].frame)
        np.testing.assert_allclose(found.wands.xy, expected[name].xy, atol=1e-3)
    assert not [one for one in inputs.findings if one.code == "rows_without_identity"]


def test_of_two_marks_in_one_frame_the_better_counts(tmp_path):
    one = scene(tmp_path, 'points = ["stick_a", "stick_b"]\nmetres = 1.0')
    seen = carried_wand(TRUTH, np.random.default_rng(1))["C1"].take(np.array([0]))
    both = seen.take(np.array([0, 0]))
    both = Keypoints(both.frame, both.identity, both.xy + [[[50]], [[0]]], both.score * [[0.5], [1]], both.joints)
    people = part(TRUTH.observations, boxes=False, keypoints=True)["C1"].keypoints
    write_keypoints(tmp_path / "C1.json", as_annotations(people, both, NAMES))
    np.testing.assert_allclose(read_inputs(one).observations["C1"].wands.xy, seen.xy, atol=1e-3)


@pytest.mark.parametrize(
    ("wand", "marked", "says"),
    [
        ('points = ["tip", "grip"]\nmetres = 1.0', TRUTH.rig.names, "no camera has keypoints named tip and grip"),
        ('points = ["stick_a", "stick_b"]\nmetres = 1.0', ("C1",), "only camera C1 has keypoints named stick_a and stick_b"),
        ('points = ["stick_a", "left_wrist"]\nmetres = 1.0', TRUTH.rig.names, "'left_wrist' is a keypoint of the body"),
        ('points = ["stick_a", "stick_a"]\nmetres = 1.0', TRUTH.rig.names, "names 'stick_a' twice"),
    ],
)
def test_what_is_wrong_with_a_wand_is_an_error(tmp_path: Path, wand: str, marked: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_inputs(scene(tmp_path, wand, marked=marked))
