"""Joints under the names of another layout of as many joints."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.observations import BODY_17, Keypoints
from passerby.findings.finding import Finding
from passerby.interchange.formats.skeletons import BODY_25, BODY_25B, ordered_joints
from passerby.scene.camera_input import CameraInput
from passerby.scene.joint_layouts import correct_layouts
from support.scenes.simulated import scene


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
    nobody = {name: one.take(np.zeros(0, dtype=np.int64)) for name, one in people.items()}
    for seen, names in ((people, BODY_25B), (people, own), (shuffled, BODY_25), (nobody, BODY_25)):
        given = readings(seen, names)
        assert (corrected(given), {one.keypoints.joints for one in given}) == ([], {names})
