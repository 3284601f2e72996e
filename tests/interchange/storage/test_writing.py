"""Whatever is written, killed or out of disk at any moment: what lies there is all old or all new."""

import json
import signal

import pytest

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import forget_halves, make_folder, remove, write_text
from passerby.interchange.storage.transaction import GONE, WRITING, WRITTEN, folder_lock, recover, transaction, whole_folder
from support.faults.dying_process import BUG, TOLD, every_moment, hidden, visible

FAULTS = pytest.mark.parametrize("fault", ["kill", "full"])


def as_told(ended, fault):
    return ended == (-signal.SIGKILL if fault == "kill" else TOLD) and ended != BUG


@FAULTS
def test_a_file(tmp_path, fault):
    path = tmp_path / "a.txt"
    path.write_text("old")
    for ended in every_moment(lambda: write_text(path, "new"), tmp_path, fault):
        assert as_told(ended, fault)
        assert path.read_text() in ("old", "new")
        forget_halves(path)
        assert not hidden(tmp_path)
        path.write_text("old")
    assert path.read_text() == "new"


def set_up(folder):
    (folder / "deep").mkdir(parents=True, exist_ok=True)
    for name in ("a", "deep/b", "going", "mine"):
        (folder / name).write_text("old")


def put(folder, text="new"):
    with folder_lock(folder, "a test"), transaction(folder, ["going", "never there"]) as new:
        for name in ("a", "deep/b", "more/c"):
            write_text(new / name, text)


@pytest.mark.slow
@FAULTS
def test_files_of_a_folder_that_change_together(tmp_path, fault):
    folder = tmp_path / "out"
    set_up(folder)
    old = visible(folder)
    new = {"a": b"new", "deep/b": b"new", "more/c": b"new", "mine": b"old"}
    seen = []
    for ended in every_moment(lambda: put(folder), tmp_path, fault, 1 if fault == "kill" else 3):
        assert as_told(ended, fault)
        recover(folder, "reads")
        seen.append(visible(folder))
        assert seen[-1] in (old, new)
        put(folder, "again")
        assert not hidden(folder)
        assert visible(folder)["a"] == b"again"
        for path in ("more/c", "a", "deep/b"):
            (folder / path).unlink()
        set_up(folder)
    assert seen[0] == old
    if fault == "kill":
        assert seen[-1] == new


def test_a_reader_that_may_not_write_is_told(tmp_path, monkeypatch):
    (tmp_path / WRITTEN).mkdir()
    (tmp_path / WRITTEN / "a").write_text("new")
    monkeypatch.setattr("passerby.interchange.storage.transaction.Path.open", refuse)
    with pytest.raises(InputError, match=f"{tmp_path}: cannot be written .Read-only"):
        recover(tmp_path, "reads")


def test_what_cannot_be_written_is_told_and_nothing_is_left_of_it(tmp_path):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine").write_text("old")
    (tmp_path / "file").write_text("old")
    before = visible(tmp_path)
    for write in (
        lambda: write_text(tmp_path / "taken", "new"),
        lambda: write_text(tmp_path / "file" / "a.txt", "new"),
        lambda: make_folder(tmp_path / "file" / "deep"),
        lambda: remove(tmp_path / "taken"),
    ):
        with pytest.raises(InputError, match=f"^{tmp_path}/.*: cannot be written .*: choose a folder that you may write to"):
            write()
    assert visible(tmp_path) == before
    assert not hidden(tmp_path)


def test_folders_are_made_and_files_go_whether_or_not_they_are_there(tmp_path):
    for _ in range(2):
        make_folder(tmp_path / "a" / "b")
        assert (tmp_path / "a" / "b").is_dir()
    write_text(tmp_path / "a" / "file", "old")
    for _ in range(2):
        remove(tmp_path / "a" / "file")
        assert not (tmp_path / "a" / "file").exists()


def test_halves_of_a_file_go_and_nothing_else(tmp_path):
    """A killed process may leave a folder as well as a file; other files' halves are theirs."""
    (tmp_path / ".a.txt.abcd_123.part").write_text("half")
    (tmp_path / ".a.txt.efgh5678.part" / "deep").mkdir(parents=True)
    others = [".b.txt.abcd_123.part", ".a.txt.short.part", ".a.txt.abcd_123.part.old", "a.txt"]
    for name in others:
        (tmp_path / name).write_text("mine")
    forget_halves(tmp_path / "a.txt")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(others)


def test_files_that_change_together_need_a_folder(tmp_path):
    (tmp_path / "file").write_text("old")
    with pytest.raises(InputError, match="file: cannot be written"), transaction(tmp_path / "file"):
        raise AssertionError
    assert (tmp_path / "file").read_text() == "old"


def test_what_a_killed_process_had_decided_is_ended_by_the_next_one(tmp_path):
    """What was to go goes, what was to come comes, and what was only begun is forgotten; without a list nothing goes."""
    for gone in (["going"], None):
        set_up(tmp_path)
        (tmp_path / WRITTEN).mkdir()
        (tmp_path / WRITTEN / "a").write_text("new")
        if gone is not None:
            (tmp_path / WRITTEN / GONE).write_text(json.dumps(gone))
        (tmp_path / WRITING).mkdir()
        (tmp_path / WRITING / "b").write_text("half")
        with folder_lock(tmp_path, "a test"):
            stays = {} if gone else {"going": b"old"}
            assert visible(tmp_path) == {"a": b"new", "deep/b": b"old", "mine": b"old"} | stays
        assert not hidden(tmp_path)


def lock(folder):
    with folder_lock(folder, "a test"):
        pass


def read(folder):
    recover(folder, "reads")


COMERS = pytest.mark.parametrize("come", [lock, read])


@pytest.mark.parametrize("damage", ['["going', "3", '{"going": 1}'])
@COMERS
def test_a_decision_that_is_damaged_is_told_and_changes_nothing(tmp_path, come, damage):
    set_up(tmp_path)
    (tmp_path / WRITTEN).mkdir()
    (tmp_path / WRITTEN / "a").write_text("new")
    (tmp_path / WRITTEN / GONE).write_text(damage)
    told = f"{GONE}: is damaged .*: delete {tmp_path / WRITTEN} and run the last command again"
    with pytest.raises(InputError, match=told):
        come(tmp_path)
    assert ((tmp_path / "a").read_text(), (tmp_path / "going").read_text()) == ("old", "old")


@COMERS
def test_a_decision_that_cannot_be_ended_is_told(tmp_path, come):
    """A folder has taken the place of a file meanwhile."""
    (tmp_path / "a" / "mine").mkdir(parents=True)
    (tmp_path / WRITTEN).mkdir()
    (tmp_path / WRITTEN / "a").write_text("new")
    with pytest.raises(InputError, match=f"^{tmp_path}: cannot be written"):
        come(tmp_path)
    assert (tmp_path / "a" / "mine").is_dir()
    assert (tmp_path / WRITTEN / "a").read_text() == "new"


def refuse(*arguments, **named):
    raise OSError(30, "Read-only file system")


def test_a_name_in_the_way_is_found_out_before_anything_changes(tmp_path):
    set_up(tmp_path)
    (tmp_path / "more" / "c").mkdir(parents=True)
    before = visible(tmp_path)
    with pytest.raises(InputError, match="more/c is a folder"):
        put(tmp_path)
    assert visible(tmp_path) == before
    assert not hidden(tmp_path)


def test_what_is_to_go_stays_in_the_folder(tmp_path):
    folder = tmp_path / "out"
    (folder / WRITTEN).mkdir(parents=True)
    (tmp_path / "precious").write_text("mine")
    (folder / WRITTEN / GONE).write_text(f'["../precious", "{tmp_path}/precious", 3]')
    recover(folder, "reads")
    assert (tmp_path / "precious").read_text() == "mine"
    assert not hidden(folder)


def make(target, text="new"):
    with whole_folder(target, "mark", "a made thing") as new:
        for name in ("mark", "a", "b"):
            write_text(new / name, text)


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "at_once"), [("kill", True), ("kill", False), ("full", True)])
def test_a_whole_folder(tmp_path, monkeypatch, fault, at_once):
    """Also where folders cannot change places at once: what was moved away comes back with the next run."""
    target = tmp_path / "made"
    if not at_once:
        monkeypatch.setattr("passerby.interchange.storage.transaction.exchange_folders", lambda one, other: False)
    make(target, "old")
    old, new = visible(target), dict.fromkeys(("a", "b", "mark"), b"new")
    for ended in every_moment(lambda: make(target), tmp_path, fault, 1 if fault == "kill" else 3):
        assert as_told(ended, fault)
        if not target.exists() and not at_once:
            with pytest.raises(RuntimeError), whole_folder(target, "mark", "a made thing"):
                raise RuntimeError
        assert visible(target) in (old, new)
        make(target, "old")
        assert [path.name for path in tmp_path.iterdir()] == ["made"]
    assert visible(target) == new
