"""Wands: sticks of known length that people carry. Their ends stand among the keypoints, and are taken out of them here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.core.observations import MIN_JOINT_SCORE, WAND_ENDS, Keypoints
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene


def take_wands(scene: Scene, reading: CameraInput) -> None:
    """Move the ends of the scene's wands from a camera's keypoints to its `wands`.

    A row that has nothing else is no person. Of two rows of one wand in one frame, that of the higher score counts: its lower
    end decides.
    """
    joints = reading.keypoints.joints
    columns = {number: [joints.index(name) for name in wand.points if name in joints]
               for number, wand in enumerate(scene.scale.wands)}  # fmt: skip
    taken = {column for own in columns.values() for column in own}
    if not taken:
        return
    people = reading.keypoints
    found = [_of_wand(people, number, own) for number, own in columns.items() if len(own) == 2]
    if found:
        parts = {name: np.concatenate([getattr(one, name) for one in found]) for name in ("frame", "identity", "xy", "score")}
        reading.wands = Keypoints(**parts, joints=WAND_ENDS)
    kept = [column for column in range(len(joints)) if column not in taken]
    some = (people.score[:, kept] > 0).any(axis=1)
    body = Keypoints(
        people.frame[some], people.identity[some], people.xy[some][:, kept], people.score[some][:, kept],
        tuple(joints[column] for column in kept),
    )  # fmt: skip
    if kept:
        reading.keypoints = body
    else:
        reading.keypoints, reading.keypoints_path = Keypoints.empty(), None


def _of_wand(people: Keypoints, number: int, columns: Sequence[int]) -> Keypoints:
    """The rows in which both ends of a wand are found, one in a frame."""
    score = people.score[:, columns]
    least = score.min(axis=1)
    order = np.lexsort((-least, people.frame))
    order = order[least[order] > MIN_JOINT_SCORE]
    first = order[np.unique(people.frame[order], return_index=True)[1]]
    return Keypoints(
        people.frame[first], np.full(len(first), number), people.xy[first][:, columns], score[first], WAND_ENDS
    )  # fmt: skip


def wand_faults(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """A fault for each wand of which fewer than two cameras see both ends."""
    faults = []
    for number, wand in enumerate(scene.scale.wands):
        seen = [reading.name for reading in readings if (reading.wands.identity == number).any()]
        if len(seen) < 2 and not any(reading.faults for reading in readings):
            cameras = f"only camera {seen[0]} has" if seen else "no camera has"
            faults.append(
                f"{scene.place}: [[scale.wands]] {number + 1} points: {cameras} keypoints named {wand.points[0]} and "
                f"{wand.points[1]} in one annotation, with scores above {MIN_JOINT_SCORE:g}: two cameras or more need them, "
                "under the names in the list `keypoints` of the category"
            )
    return faults
