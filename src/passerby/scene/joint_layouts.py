"""Corrections of keypoints: names of another layout, and ends of wands among the joints.

OpenPose writes 25 joints in two orders, BODY_25 and BODY_25B, and its files do not state which. A tool that assumes one order
gives wrong names to the joints of the other: a knee is called a hip. Correct names order people's joints from head to feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.core.observations import MIN_JOINT_SCORE, WAND_ENDS, Keypoints
from passerby.findings.finding import notice
from passerby.interchange.formats.skeletons import find_other_layouts
from passerby.people.segments import MIN_ORDER_CORRELATION, order_correlations
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene


def correct_layouts(readings: Sequence[CameraInput]) -> None:
    """Give joints the names of the layout that fits the images; the first of these cameras gets a notice of it.

    Cameras whose joints have the same names are tested together: one tool made them. Names are corrected only if the stated
    ones do not fit and those of another layout with the same number of joints do.
    """
    by_names: dict[tuple[str, ...], list[CameraInput]] = {}
    for reading in readings:
        if len(reading.keypoints):
            by_names.setdefault(reading.keypoints.joints, []).append(reading)
    for names, cameras in by_names.items():
        known = find_other_layouts(names)
        if known is None or _order(cameras, names) >= MIN_ORDER_CORRELATION:
            continue
        stated, layouts = known
        order, layout = max((_order(cameras, renamed), layout) for layout, renamed in layouts.items())
        if order < MIN_ORDER_CORRELATION:
            continue
        for reading in cameras:
            reading.keypoints = replace(reading.keypoints, joints=layouts[layout])
        who = [reading.name for reading in cameras]
        found = notice("keypoint_layout_corrected", *who, stated=stated, layout=layout, correlation=order)
        cameras[0].findings.append(found)


def _order(cameras: Sequence[CameraInput], names: tuple[str, ...]) -> float:
    """Compute the median correlation of the joints' order by name with their order from head to feet; 1 if none is known."""
    found = [correlation for reading in cameras for correlation in order_correlations(reading.keypoints, names)]
    return float(np.median(found)) if found else 1.0


def take_wands(scene: Scene, reading: CameraInput) -> None:
    """Move the ends of the scene's wands from a camera's keypoints to its `wands`.

    A row that has no other joints is no person. Of two rows of one wand in one frame, the one with the higher score counts; the
    score of a row is the lower score of its two ends.
    """
    joints = reading.keypoints.joints
    columns = {number: [joints.index(name) for name in wand.points if name in joints]
               for number, wand in enumerate(scene.scale.wands)}  # fmt: skip
    taken = {column for own in columns.values() for column in own}
    if not taken:
        return
    people = reading.keypoints
    found = [_take_wand(people, number, own) for number, own in columns.items() if len(own) == 2]
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


def _take_wand(people: Keypoints, number: int, columns: Sequence[int]) -> Keypoints:
    """Return the rows in which both ends of a wand are found, at most one per frame."""
    score = people.score[:, columns]
    least = score.min(axis=1)
    order = np.lexsort((-least, people.frame))
    order = order[least[order] > MIN_JOINT_SCORE]
    first = order[np.unique(people.frame[order], return_index=True)[1]]
    return Keypoints(
        people.frame[first], np.full(len(first), number), people.xy[first][:, columns], score[first], WAND_ENDS
    )  # fmt: skip


def wand_faults(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Return a fault for each wand whose two ends are seen by fewer than two cameras."""
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
