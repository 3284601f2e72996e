import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.interchange.formats.values import LETTER, dump_yaml, numbers, parse_yaml, rigid, rotation, tame_names

ROS = re.compile(r"[^A-Za-z0-9_]")


@settings(max_examples=60, deadline=None)
@given(st.lists(st.text(min_size=1, max_size=6), min_size=1, max_size=6, unique=True))
def test_names_are_valid_and_differ(names):
    led = tame_names(names, ROS, LETTER)
    assert list(led) == names
    assert all(re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name) for name in led.values())
    assert len({name.casefold() for name in led.values()}) == len(names)
    first = {name.casefold(): name for name in reversed(names)}
    for name in names:
        if re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name) and first[name.casefold()] == name:
            assert led[name] == name


PLAIN = st.one_of(st.text(max_size=8), st.floats(allow_nan=False), st.integers())


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.text(max_size=5), PLAIN, max_size=3))
def test_yaml_comes_back_here_and_elsewhere(values):
    text = dump_yaml(values).decode()
    assert (parse_yaml(Path("a"), text), yaml.safe_load(text)) == (values, values)


@pytest.mark.parametrize("text", ["1e5", "-1e-05", "1.5E+3", ".5e1", "3.e2"])
def test_numbers_as_other_languages_write_them(tmp_path, text):
    assert parse_yaml(tmp_path, f"a: {text}") == {"a": float(text)}
    assert parse_yaml(tmp_path, f"a: '{text}'") == {"a": text}


def test_no_object_is_made_of_a_yaml_file(tmp_path):
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


def test_the_last_row_of_a_transform():
    with pytest.raises(InputError, match="p: the last row"):
        rigid("p", np.ones((4, 4)), 1.0)
