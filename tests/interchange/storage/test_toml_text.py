"""Pieces of TOML that are written with comments: what is written is read again as what it was."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.interchange.storage import text_formats

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


def test_paths_are_relative_to_the_scene_with_forward_slashes(tmp_path):
    scene = tmp_path / "scenes" / "scene.toml"
    assert text_formats.relative(tmp_path / "scenes" / "a" / "b.mp4", scene) == "a/b.mp4"
    assert text_formats.relative(tmp_path / "videos" / "b.mp4", scene) == "../videos/b.mp4"


def test_a_path_on_another_drive_is_absolute(tmp_path, monkeypatch):
    def other_drive(path, start):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(text_formats.os.path, "relpath", other_drive)
    assert text_formats.relative(tmp_path / "b.mp4", tmp_path / "scene.toml") == (tmp_path.resolve() / "b.mp4").as_posix()
    assert Path(text_formats.relative(tmp_path / "b.mp4", tmp_path / "scene.toml")).is_absolute()
