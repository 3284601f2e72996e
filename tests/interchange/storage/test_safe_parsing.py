"""Files that cannot be read, and text that is not of its format, each with a reason that fits in a line."""

import os
from pathlib import Path

import pytest

from passerby.common.errors import InputError
from passerby.interchange.storage.safe_parsing import (
    LARGEST_BYTES,
    LARGEST_YAML,
    MOST_DOTS,
    NotParsed,
    check_is_file,
    parse_json,
    parse_safe_yaml,
    parse_toml,
    read_text,
)
from passerby.interchange.storage.text_formats import csv_rows


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (PermissionError(13, "Permission denied"), r"cannot be read \(Permission denied\): a rig is needed"),
        (MemoryError(), r"does not fit into memory: a rig is needed: is it another kind of file\?"),
    ],
)
def test_a_file_that_cannot_be_read_is_told(tmp_path, monkeypatch, fault, told):
    def failing(self):
        raise fault

    (tmp_path / "a.txt").write_text("1")
    monkeypatch.setattr(Path, "read_bytes", failing)
    with pytest.raises(InputError, match=f"^{tmp_path}/a.txt: {told}"):
        read_text(tmp_path / "a.txt", "a rig")


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    with (tmp_path / "film.txt").open("wb") as file:
        os.truncate(file.fileno(), LARGEST_BYTES + 1)  # takes no room
    with pytest.raises(InputError, match=r"has 2 GB, but a rig is needed.* At most 2 GB are read"):
        check_is_file(tmp_path / "film.txt", "a rig")


def test_a_path_with_a_zero_byte_is_none():
    with pytest.raises(InputError, match="is not a path, since it holds a zero byte") as error:
        check_is_file(Path("a\0" + 4000 * "b"), "a rig")
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("parse", "text", "told"),
    [
        (parse_toml, f"a{MOST_DOTS * '.a'}.a = 1", "nested too deep"),
        (parse_toml, f"a = {'1' * 1000}", "a number of a thousand digits"),
        (parse_json, f'{{"a": {"1" * 5000}}}', "a number of a thousand digits"),
        (parse_safe_yaml, "a" * (LARGEST_YAML + 1), "more than 1000000 characters"),
        (parse_safe_yaml, "[" * 1100, "is not YAML: it is nested too deep"),
        (parse_safe_yaml, "a: &a {b: 1}\nc:\n  <<: *a\n", r"line 3: is not YAML: tables that are merged \(<<\)"),
    ],
    ids=["dots", "digits of TOML", "digits of JSON", "long YAML", "deep YAML", "merged YAML"],
)
def test_text_that_would_take_gigabytes_or_minutes_is_refused(parse, text, told):
    with pytest.raises(NotParsed, match=told) as error:
        parse(text)
    assert len(str(error.value)) < 300


def test_rows_of_csv_keep_the_numbers_of_their_lines():
    assert csv_rows("a.csv", "x, y\n\n1 ,2\n\n 3,4\n") == (["x", "y"], [(3, ["1", "2"]), (5, ["3", "4"])])
    assert csv_rows("a.csv", "\n\n") == ([], [])


def test_what_is_no_csv_is_told_with_its_line():
    with pytest.raises(InputError, match=r"^a\.csv: line 2: is not CSV .*: give fields separated by commas"):
        csv_rows("a.csv", "x,y\n1," + 200_000 * "2")
