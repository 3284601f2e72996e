"""Parts that formats share: names, numbers, YAML, rotations, and the names of joints."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17
from passerby.interchange.formats import skeletons
from passerby.interchange.formats.values import dump_yaml, numbers, parse_yaml, rigid, rotation

PLAIN = st.one_of(st.text(max_size=8), st.floats(allow_nan=False), st.integers())


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.text(max_size=5), PLAIN, max_size=3))
def test_yaml_comes_back_here_and_elsewhere(values):
    text = dump_yaml(values).decode()
    assert (parse_yaml(Path("a"), text), yaml.safe_load(text)) == (values, values)


def test_yaml_has_the_numbers_of_other_languages_and_no_objects(tmp_path):
    for text in ("1e5", "-1e-05", "1.5E+3", ".5e1", "3.e2"):
        assert parse_yaml(tmp_path, f"a: {text}\nb: '{text}'") == {"a": float(text), "b": text}
    with pytest.raises(InputError, match=r"a.yaml: line 1: is not YAML"):
        parse_yaml(tmp_path / "a.yaml", "!!python/object/apply:os.system ['true']")


def test_numbers_are_counted_and_finite():
    assert numbers("p", {"a": [[1, 2], [3, 4.5]]}, "a", (2, 2)).tolist() == [[1, 2], [3, 4.5]]
    assert numbers("p", {"a": 3}, "a", ()) == 3
    for value in (None, True, [1, "2"], [float("inf")], [1, 2, 3], {"b": 1}):
        with pytest.raises(InputError, match=r"^p: a is .*needed"):
            numbers("p", {"a": value}, "a", (2,))


@pytest.mark.parametrize("inmost", ["1", ""])
def test_a_few_bytes_that_stand_for_endless_lists_are_refused_at_once(inmost):
    """Nine levels of nine references each: 400 million lists, were they counted."""
    text = f"a0: &a0 [{inmost}]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 10))
    with pytest.raises(InputError, match=r"^p: a9 is .*: 9 numbers are needed"):
        numbers("p", parse_yaml(Path("a"), text), "a9", (3, 3))


def test_rounded_rotations_are_made_rotations():
    found = rotation("p", np.round(np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0, 0, 1]]), 4))
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
    for bad in (np.diag([1.0, 1, -1]), 1.01 * np.eye(3), np.zeros((3, 3))):
        with pytest.raises(InputError, match=r"p: .* is not a rotation"):
            rotation("p", bad)
    with pytest.raises(InputError, match="p: the last row"):
        rigid("p", np.ones((4, 4)), 1.0)


OPENPOSE = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip", "RHip", "RKnee", "RAnkle",
    "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar", "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
)  # fmt: skip


@pytest.mark.parametrize("spell", [
    lambda name: name.replace("_", " ").title(),
    lambda name: name.replace("left_", "l_").replace("right_", "r_"),
    lambda name: name.replace("left_", "l").replace("right_", "r"),
    lambda name: f"{name.split('_')[1]}_{name[0]}" if "_" in name else name,
    lambda name: f"{name.split('_')[1]}.{name[0].upper()}" if "_" in name else name,
], ids=["title", "letter_", "letter", "suffix", "blender"])  # fmt: skip
def test_joints_of_coco_are_known_in_other_spellings(spell) -> None:
    assert skeletons.standard_names([spell(name) for name in BODY_17]) == BODY_17


def test_other_names_of_joints_are_known_and_two_of_one_meaning_stay() -> None:
    assert skeletons.standard_names(OPENPOSE) == skeletons.BODY_25
    names = ("pelvis", "UpperNeck", "top of head", "left_foot_index", "RLittleToe")
    assert skeletons.standard_names(names) == ("mid_hip", "neck", "head_top", "left_big_toe", "right_small_toe")
    for names in (("spine", "left_eye_inner"), ("pelvis", "hips", "nose"), ("mid_hip", "pelvis"), ("LHip", "left_hip")):
        assert skeletons.standard_names(names) == names
    for layouts in skeletons.SKELETONS.values():
        for joints in layouts.values():
            assert (len(set(joints)), skeletons.standard_names(joints)) == (len(joints), joints)


def test_the_usual_layout_comes_first_and_the_other_names_the_same_columns() -> None:
    assert skeletons.find_known_joints(25) == skeletons.BODY_25
    assert skeletons.find_known_joints(12) is None
    found = skeletons.find_other_layouts(skeletons.ordered_joints(skeletons.BODY_25))
    assert found is not None
    stated, layouts = found
    assert stated == "BODY_25"
    number = [skeletons.BODY_25.index(name) for name in skeletons.ordered_joints(skeletons.BODY_25)]
    assert layouts["BODY_25B"] == tuple(skeletons.BODY_25B[index] for index in number)
    assert skeletons.find_other_layouts(BODY_17) is None
    assert skeletons.find_other_layouts(("nose", "neck")) is None
