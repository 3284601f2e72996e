"""Which joints other tools find, in which order.

BODY_25 and COCO of OpenPose: its `doc/02_output.md`. Halpe's 26 and 136: the README of Halpe-FullBody, AlphaPose's own set.
COCO-WholeBody's 133: its README. The 17 of COCO come first in Halpe's and COCO-WholeBody's.
"""

from __future__ import annotations

from collections.abc import Mapping

from passerby.core.observations import BODY_17

BODY_25 = (
    "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist", "mid_hip",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear",
    "left_ear", "left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe", "right_heel",
)  # fmt: skip
COCO_18 = (
    "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist", "right_hip",
    "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear", "left_ear",
)  # fmt: skip
HALPE_26 = (
    *BODY_17, "head_top", "neck", "mid_hip", "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe", "left_heel",
    "right_heel",
)  # fmt: skip
WHOLE_BODY_23 = (
    *BODY_17, "left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe", "right_heel",
)  # fmt: skip
SKELETONS: Mapping[int, tuple[str, ...]] = {
    17: BODY_17, 18: COCO_18, 25: BODY_25, 26: HALPE_26, 133: WHOLE_BODY_23, 136: HALPE_26,
}  # fmt: skip
"""How many joints a tool writes -> the names of the first of them; the face and the hands that follow have none here."""


def known_joints(count: int) -> tuple[str, ...] | None:
    """The names of the first of so many joints, in the tool's order; None for a number that no skeleton here has."""
    return SKELETONS.get(count)


def ordered_joints(names: tuple[str, ...]) -> tuple[str, ...]:
    """COCO's 17 first, in COCO's order, then the others in the tool's.

    The others are kept: with all 25 of OpenPose's joints the cameras of Pose2Sim's demonstration come to 29 mm and 0.51 degrees
    of the truth, with COCO's 17 of them alone to 43 mm and 1.05 degrees.
    """
    return (*(name for name in BODY_17 if name in names), *(name for name in names if name not in BODY_17))


def list_joint_counts() -> str:
    """The numbers of joints that are known, for a message."""
    return "17 (COCO), 18 (OpenPose's COCO), 25 (BODY_25), 26 or 136 (Halpe) or 133 (COCO-WholeBody)"
