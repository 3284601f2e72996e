"""Joints of other tools: their order, and the spellings of their names.

Sources. BODY_25 and COCO of OpenPose: its `doc/02_output.md`. BODY_25B, which OpenPose writes with 25 joints too, and
BODY_135, which begins with it: the README of openpose_train's experimental models. Halpe's 26 and 136: the README of
Halpe-FullBody, AlphaPose's own set. COCO-WholeBody's 133: its README. BlazePose's 33: MediaPipe's documentation of pose
landmarks. The 17 of COCO come first in Halpe's, COCO-WholeBody's and BODY_25B.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache

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
BODY_25B = (
    *BODY_17, "neck", "head_top", "left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe",
    "right_heel",
)  # fmt: skip
BLAZEPOSE_33 = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer", "left_ear",
    "right_ear", "mouth_left", "mouth_right", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist",
    "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb", "left_hip",
    "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel", "left_big_toe",
    "right_big_toe",
)  # fmt: skip
SKELETONS: Mapping[int, Mapping[str, tuple[str, ...]]] = {
    17: {"COCO": BODY_17}, 18: {"OpenPose's COCO": COCO_18}, 25: {"BODY_25": BODY_25, "BODY_25B": BODY_25B},
    26: {"Halpe": HALPE_26}, 33: {"BlazePose": BLAZEPOSE_33}, 133: {"COCO-WholeBody": WHOLE_BODY_23},
    135: {"BODY_135": BODY_25B}, 136: {"Halpe": HALPE_26},
}  # fmt: skip
"""Number of joints that a tool writes -> layout -> names of its first joints. Joints of the face and the hands follow them and
have no names here. Of several layouts, the usual one comes first."""

_OF_A_SIDE: Mapping[str, tuple[str, ...]] = {
    "eye": ("eye",), "ear": ("ear",), "shoulder": ("shoulder",), "elbow": ("elbow",), "wrist": ("wrist",), "hip": ("hip",),
    "knee": ("knee",), "ankle": ("ankle",), "heel": ("heel",), "big_toe": ("bigtoe", "toe", "toes", "footindex"),
    "small_toe": ("smalltoe", "littletoe"),
}  # fmt: skip
_OF_THE_MIDDLE: Mapping[str, tuple[str, ...]] = {
    "nose": ("nose",), "head": ("head",), "head_top": ("headtop", "tophead", "topofhead"),
    "neck": ("neck", "upperneck", "midshoulder", "thorax"),
    "mid_hip": ("midhip", "chip", "hip", "hips", "hipcenter", "hipcentre", "pelvis", "root"),
}  # fmt: skip
"""Passerby's name of a joint -> names in other tools, in lower case without separators."""


@cache
def _spellings() -> Mapping[str, str]:
    """Return a mapping: known spelling of a joint, in lower case without separators -> Passerby's name."""
    known = {spelling: name for name, spellings in _OF_THE_MIDDLE.items() for spelling in spellings}
    for name, spellings in _OF_A_SIDE.items():
        for spelling in spellings:
            for side in ("left", "right"):
                for mark in (side, side[0]):
                    known |= dict.fromkeys((mark + spelling, spelling + mark), f"{side}_{name}")
    return known


def standard_names(names: Sequence[str]) -> tuple[str, ...]:
    """Convert joints' names to those of the person model: `right_hip` for RHip, rhip, hip_r, Right Hip and similar names.

    Unknown names stay. If several names mean the same joint, they also stay.
    """
    standard = [_spellings().get(re.sub(r"[\W_]", "", name).lower(), name) for name in names]
    alone = {name for name in standard if standard.count(name) == 1}
    return tuple(
        new if new in alone and (new == old or new not in names) else old for old, new in zip(names, standard, strict=True)
    )


def find_known_joints(count: int) -> tuple[str, ...] | None:
    """Return the names of the first of `count` joints, in the tool's usual order; None for a number without a skeleton."""
    return next(iter(SKELETONS.get(count, {}).values()), None)


def find_other_layouts(names: Sequence[str]) -> tuple[str, Mapping[str, tuple[str, ...]]] | None:
    """Find the layout of these names, and the joints' names in each other layout of as many joints; None if there is no other.

    The joints may be in the order of `ordered_joints` instead of the tool's order.
    """
    layouts = SKELETONS.get(len(names), {})
    stated = next((layout for layout, joints in layouts.items() if sorted(joints) == sorted(names)), None)
    if stated is None or len(layouts) == 1:
        return None
    number = [layouts[stated].index(name) for name in names]
    return stated, {layout: tuple(joints[index] for index in number) for layout, joints in layouts.items() if layout != stated}


def ordered_joints(names: tuple[str, ...]) -> tuple[str, ...]:
    """Order joints: first COCO's 17 in COCO's order, then the others in the tool's order.

    The others are kept: with all 25 of OpenPose's joints, the errors of the cameras of Pose2Sim's demonstration are 34.0 mm and
    0.56 degrees; with only COCO's 17 of them, they are 34.3 mm and 0.86 degrees.
    """
    return (*(name for name in BODY_17 if name in names), *(name for name in names if name not in BODY_17))


def list_joint_counts() -> str:
    """Return a text for messages that lists the known numbers of joints."""
    return (
        "17 (COCO), 18 (OpenPose's COCO), 25 (BODY_25, BODY_25B), 26 or 136 (Halpe), 33 (BlazePose), 133 (COCO-WholeBody) or "
        "135 (BODY_135)"
    )
