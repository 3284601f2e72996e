"""Folders that appear whole or not at all."""

import errno
from pathlib import Path

import pytest

from passerby.common.errors import InputError
from passerby.interchange.storage import transaction as module
from passerby.interchange.storage.transaction import whole_folder


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
    assert ((tmp_path / "thing" / "mark").read_text(), [path.name for path in tmp_path.iterdir()]) == ("one", ["thing"])


def test_other_folders_and_files_are_left_alone(tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("mine")
    with pytest.raises(InputError, match="holds something other than a made thing"):
        write(tmp_path / "letters", "one")
    with pytest.raises(InputError, match="is a file"):
        write(tmp_path / "letters" / "a.txt", "one")
    assert (tmp_path / "letters" / "a.txt").read_text() == "mine"


@pytest.fixture
def one_by_one(monkeypatch):
    """A system where two folders cannot change places at once."""

    class Old:
        def __init__(self, *arguments, **named):
            pass

    monkeypatch.setattr(module.ctypes, "CDLL", Old)


def test_a_system_without_an_exchange_of_folders_moves_them_one_by_one(tmp_path, one_by_one):
    assert not module.exchange_folders(tmp_path / "a", tmp_path / "b")
    write(tmp_path / "thing", "one")
    (tmp_path / "thing" / "more").write_text("of the first")
    write(tmp_path / "thing", "two")
    assert [(path.name, path.read_text()) for path in (tmp_path / "thing").iterdir()] == [("mark", "two")]
    assert [path.name for path in tmp_path.iterdir()] == ["thing"]


@pytest.mark.parametrize("comes_back", [True, False])
def test_the_old_folder_is_never_lost_where_the_new_one_cannot_take_its_place(tmp_path, monkeypatch, one_by_one, comes_back):
    """It comes back at once; where not even that can be done it waits beside its place, and comes back with the next run."""
    write(tmp_path / "thing", "one")
    real = Path.rename

    def failing(self, target):
        if target == tmp_path / "thing" and (self.name == "new" or not comes_back):
            raise OSError(errno.EIO, "Input/output error")
        return real(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", failing)
        with pytest.raises(InputError, match=r"thing: cannot be written .Input/output error"):
            write(tmp_path / "thing", "two")
    assert (tmp_path / "thing").exists() == comes_back
    with pytest.raises(RuntimeError, match="halfway"):
        half_written(tmp_path / "thing")
    assert ((tmp_path / "thing" / "mark").read_text(), [path.name for path in tmp_path.iterdir()]) == ("one", ["thing"])


def test_what_a_killed_process_left_goes_and_other_hidden_files_stay(tmp_path):
    """It had made a whole new folder, or half of one, beside the old one."""
    write(tmp_path / "thing", "one")
    (tmp_path / ".thing.abcd_123.part" / "new").mkdir(parents=True)
    (tmp_path / ".thing.efgh5678.part").write_text("a file, no workshop")
    (tmp_path / ".other.abcd_123.part" / "new").mkdir(parents=True)
    write(tmp_path / "thing", "two")
    assert (tmp_path / "thing" / "mark").read_text() == "two"
    assert sorted(path.name for path in tmp_path.iterdir()) == [".other.abcd_123.part", ".thing.efgh5678.part", "thing"]


@pytest.mark.parametrize("fails", ["glob", "mkdtemp"])
def test_a_disk_that_takes_nothing_is_told(tmp_path, monkeypatch, fails):
    def full(*arguments, **named):
        raise OSError(errno.ENOSPC, "No space left on device")

    write(tmp_path / "thing", "one")
    with monkeypatch.context() as patch:
        patch.setattr(*((Path, "glob", full) if fails == "glob" else (module.tempfile, "mkdtemp", full)))
        with pytest.raises(InputError, match=r"thing: cannot be written .No space left on device.: make room there"):
            write(tmp_path / "thing", "two")
    assert ((tmp_path / "thing" / "mark").read_text(), [path.name for path in tmp_path.iterdir()]) == ("one", ["thing"])
