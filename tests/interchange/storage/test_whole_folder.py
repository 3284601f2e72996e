"""Folders that appear whole or not at all."""

import pytest

from passerby.common.errors import InputError
from passerby.interchange.storage.whole_folder import whole_folder


def write(target, text, marker="mark"):
    with whole_folder(target, "mark", "a made thing") as folder:
        (folder / marker).write_text(text)


def half_written(target):
    with whole_folder(target, "mark", "a made thing") as folder:
        (folder / "mark").write_text("two")
        raise RuntimeError("halfway")


def test_appears_whole_and_replaces_its_like(tmp_path):
    write(tmp_path / "deep" / "thing", "one")
    (tmp_path / "deep" / "thing" / "more").write_text("of the first")
    write(tmp_path / "deep" / "thing", "two")
    assert [(path.name, path.read_text()) for path in (tmp_path / "deep" / "thing").iterdir()] == [("mark", "two")]
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["thing"]


def test_an_exception_leaves_everything_as_it_was(tmp_path):
    write(tmp_path / "thing", "one")
    with pytest.raises(RuntimeError, match="halfway"):
        half_written(tmp_path / "thing")
    assert (tmp_path / "thing" / "mark").read_text() == "one"
    assert [path.name for path in tmp_path.iterdir()] == ["thing"]


def test_other_folders_and_files_are_left_alone(tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("mine")
    with pytest.raises(InputError, match="holds something other than a made thing"):
        write(tmp_path / "letters", "one")
    with pytest.raises(InputError, match="is a file"):
        write(tmp_path / "letters" / "a.txt", "one")
    assert (tmp_path / "letters" / "a.txt").read_text() == "mine"
