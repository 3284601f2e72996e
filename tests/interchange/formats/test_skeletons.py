"""Names of joints as other tools spell them, and layouts of as many joints in another order."""

import pytest

from passerby.core.observations import BODY_17
from passerby.interchange.formats.skeletons import (
    BODY_25,
    BODY_25B,
    SKELETONS,
    find_known_joints,
    find_other_layouts,
    ordered_joints,
    standard_names,
)

OPENPOSE = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip", "RHip", "RKnee", "RAnkle",
    "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar", "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
)  # fmt: skip


def test_openposes_own_spelling() -> None:
    assert standard_names(OPENPOSE) == BODY_25


@pytest.mark.parametrize(
    "spell",
    [
        lambda name: name.replace("_", " ").title(),
        lambda name: name.replace("left_", "l_").replace("right_", "r_"),
        lambda name: name.replace("left_", "l").replace("right_", "r"),
        lambda name: f"{name.split('_')[1]}_{name[0]}" if "_" in name else name,
        lambda name: f"{name.split('_')[1]}.{name[0].upper()}" if "_" in name else name,
    ],
    ids=["title", "letter_", "letter", "suffix", "blender"],
)
def test_spellings_of_cocos_joints(spell) -> None:
    assert standard_names([spell(name) for name in BODY_17]) == BODY_17


def test_joints_of_the_middle_and_feet() -> None:
    names = ("pelvis", "UpperNeck", "top of head", "left_foot_index", "RLittleToe")
    assert standard_names(names) == ("mid_hip", "neck", "head_top", "left_big_toe", "right_small_toe")


def test_unknown_names_and_two_names_of_one_meaning_stay() -> None:
    for names in (("spine", "left_eye_inner"), ("pelvis", "hips", "nose"), ("mid_hip", "pelvis"), ("LHip", "left_hip")):
        assert standard_names(names) == names


def test_every_layout_has_its_names_once_and_spelled_as_here() -> None:
    for layouts in SKELETONS.values():
        for joints in layouts.values():
            assert (len(set(joints)), standard_names(joints)) == (len(joints), joints)


def test_the_usual_layout_comes_first() -> None:
    assert find_known_joints(25) == BODY_25
    assert find_known_joints(12) is None


def test_the_other_layout_names_the_same_columns() -> None:
    found = find_other_layouts(ordered_joints(BODY_25))
    assert found is not None
    stated, layouts = found
    assert stated == "BODY_25"
    number = [BODY_25.index(name) for name in ordered_joints(BODY_25)]
    assert layouts["BODY_25B"] == tuple(BODY_25B[index] for index in number)
    assert find_other_layouts(BODY_17) is None
    assert find_other_layouts(("nose", "neck")) is None
