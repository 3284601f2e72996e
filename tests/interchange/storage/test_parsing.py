"""Files that cannot be read, text that is not of its format, pieces of TOML that are written, and pickles of arrays."""

import collections
import os
import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.interchange.storage import safe_parsing, text_formats
from passerby.interchange.storage.archives import parse_pickled_arrays
from passerby.interchange.storage.text_formats import csv_rows


@pytest.mark.parametrize(("fault", "message"), [
    (PermissionError(13, "Permission denied"), r"cannot be read \(Permission denied\): a rig is needed"),
    (MemoryError(), r"does not fit into memory: a rig is needed: is it another kind of file\?"),
])  # fmt: skip
def test_a_file_that_cannot_be_read_is_an_error(tmp_path, monkeypatch, fault, message):
    def failing(self):
        raise fault

    (tmp_path / "a.txt").write_text("1")
    monkeypatch.setattr(Path, "read_bytes", failing)
    with pytest.raises(InputError, match=f"^{tmp_path}/a.txt: {message}"):
        safe_parsing.read_text(tmp_path / "a.txt", "a rig")


def test_a_file_that_is_too_large_and_a_path_with_a_zero_byte_are_not_read(tmp_path):
    with (tmp_path / "film.txt").open("wb") as file:
        os.truncate(file.fileno(), safe_parsing.LARGEST_BYTES + 1)  # takes no room
    with pytest.raises(InputError, match=r"has 2 GB, but a rig is needed.* At most 2 GB are read"):
        safe_parsing.check_is_file(tmp_path / "film.txt", "a rig")
    with pytest.raises(InputError, match="is not a path, since it holds a zero byte") as error:
        safe_parsing.check_is_file(Path("a\0" + 4000 * "b"), "a rig")
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(("parse", "text", "message"), [
    (safe_parsing.parse_toml, f"a{50_000 * '.a'} = 1", "nested too deep"),
    (safe_parsing.parse_toml, f"a = {'1' * 1000}", "a number of a thousand digits"),
    (safe_parsing.parse_json, f'{{"a": {"1" * 5000}}}', "a number of a thousand digits"),
    (safe_parsing.parse_safe_yaml, "a" * 2_000_000, "more than 1000000 characters"),
    (safe_parsing.parse_safe_yaml, "[" * 1100, "is not YAML: it is nested too deep"),
    (safe_parsing.parse_safe_yaml, "a: &a {b: 1}\nc:\n  <<: *a\n", r"line 3: is not YAML: tables that are merged \(<<\)"),
], ids=["dots", "digits of TOML", "digits of JSON", "long YAML", "deep YAML", "merged YAML"])  # fmt: skip
def test_text_that_would_take_gigabytes_or_minutes_is_refused(parse, text, message):
    with pytest.raises(safe_parsing.NotParsed, match=message) as error:
        parse(text)
    assert len(str(error.value)) < 300


def test_rows_of_csv_keep_the_numbers_of_their_lines():
    assert csv_rows("a.csv", "x, y\n\n1 ,2\n\n 3,4\n") == (["x", "y"], [(3, ["1", "2"]), (5, ["3", "4"])])
    assert csv_rows("a.csv", "\n\n") == ([], [])
    with pytest.raises(InputError, match=r"^a\.csv: line 2: is not CSV .*: give fields separated by commas"):
        csv_rows("a.csv", "x,y\n1," + 200_000 * "2")


@pytest.mark.parametrize("count", [1, 2, 500])
def test_faults_of_a_file_survive_another_process(count: int) -> None:
    error = safe_parsing.FileFaults([f"/data/a.txt: line {k} is wrong" for k in range(count)])
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.faults) == (str(error), error.faults)


PLAIN = st.one_of(st.text(), st.integers(-(2**63), 2**63 - 1), st.booleans(), st.floats(allow_nan=False))


@given(st.text(st.characters(codec="utf-8")), st.one_of(PLAIN, st.lists(PLAIN, max_size=4), st.lists(st.lists(PLAIN))))
def test_keys_and_values_come_back(name, content):
    line = f"{text_formats.key(name)} = {text_formats.value(content)}\n"
    assert (line.count("\n"), tomllib.loads(line)) == (1, {name: content})


def test_numbers_of_a_whole_file_end_where_people_would_end_them():
    content = {"scale": {"sd_m": 0.0125 * 1.72, "points": [[0.1 + 0.2, 3]], "count": 3}, "name": "a"}
    written = text_formats.to_toml(content)
    assert "sd_m = 0.0215\n" in written
    assert tomllib.loads(written) == {"scale": {"sd_m": 0.0215, "points": [[0.3, 3]], "count": 3}, "name": "a"}


@given(st.floats(-1e9, 1e9))
def test_numbers_of_a_whole_file_keep_twelve_digits(number):
    assert tomllib.loads(text_formats.to_toml({"x": number}))["x"] == pytest.approx(number, rel=1e-11, abs=0)


@given(st.text())
def test_comments_hold_nothing_but_comments(text):
    written = text_formats.comment(text, "  ")
    assert tomllib.loads(written) == {}
    assert all(line.startswith("  #") and line == line.rstrip() for line in written.splitlines())


def test_paths_are_relative_to_the_scene_and_absolute_on_another_drive(tmp_path, monkeypatch):
    scene = tmp_path / "scenes" / "scene.toml"
    assert text_formats.relative(tmp_path / "scenes" / "a" / "b.mp4", scene) == "a/b.mp4"
    assert text_formats.relative(tmp_path / "videos" / "b.mp4", scene) == "../videos/b.mp4"

    def other_drive(path, start):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(text_formats.os.path, "relpath", other_drive)
    assert text_formats.relative(tmp_path / "b.mp4", scene) == (tmp_path.resolve() / "b.mp4").as_posix()
    assert Path(text_formats.relative(tmp_path / "b.mp4", scene)).is_absolute()


VALUE = {
    "float": np.arange(6.0).reshape(2, 3), "fortran": np.asfortranarray(np.arange(6, dtype=">i4").reshape(2, 3)),
    "byte": np.array([1, 2, 255], dtype=np.uint8), "flag": np.array([True, False]), "scalar": np.float64(2.5), "none": None,
    "mixed": [1, -7, 2**70, 2.5, "text", b"bytes", True, (1, (2, 3)), {"inner": 4}], "empty": np.zeros((0, 3)),
}  # fmt: skip


@pytest.mark.parametrize("protocol", range(6))
def test_a_pickle_of_arrays_comes_back_whole_or_not_at_all(protocol):
    found = parse_pickled_arrays(pickle.dumps(VALUE, protocol))
    assert found.keys() == VALUE.keys()
    for key, value in VALUE.items():
        np.testing.assert_array_equal(found[key], value) if isinstance(value, np.ndarray) else None
        assert isinstance(value, np.ndarray) or found[key] == value
    whole = pickle.dumps({"a": np.arange(6.0).reshape(2, 3), "b": [1, "x"]}, protocol)
    for length in range(len(whole) - 1):
        with pytest.raises(safe_parsing.NotParsed):
            parse_pickled_arrays(whole[:length])


@pytest.mark.parametrize("value", [
    collections.OrderedDict(a=1), np.array([object()]), np.array(["text"]), np.zeros(2, dtype="f8,f4"), print, {1.5: 2},
    np.datetime64("2026-01-01"), {1, 2},
], ids=["subclass", "objects", "texts", "records", "function", "number as key", "date", "set"])  # fmt: skip
def test_other_objects_in_a_pickle_are_refused(value):
    with pytest.raises(safe_parsing.NotParsed):
        parse_pickled_arrays(pickle.dumps(value))


def test_few_bytes_of_a_pickle_do_not_stand_for_endless_values():
    value = [0]
    for _ in range(40):
        value = [value, value]
    with pytest.raises(safe_parsing.NotParsed, match="more than 10000 values"):
        parse_pickled_arrays(pickle.dumps(value))
    endless = []
    endless.append(endless)
    with pytest.raises(safe_parsing.NotParsed):
        parse_pickled_arrays(pickle.dumps(endless))
