"""Whatever is written, killed or out of disk at any moment: what lies there is all old or all new."""

import errno
import signal
from pathlib import Path

import pytest

from passerby.common.errors import InputError
from passerby.interchange.storage import transaction as transaction_module
from passerby.interchange.storage.atomic import forget_halves, make_folder, remove, write_text
from passerby.interchange.storage.transaction import GONE, WRITING, WRITTEN, folder_lock, recover, transaction, whole_folder
from support.faults.dying_process import TOLD, every_moment, hidden, visible

ENDS = {"kill": -signal.SIGKILL, "full": TOLD}
"""How the process ends that is killed, or that finds the disk full."""
FAULTS = pytest.mark.parametrize("fault", ENDS)


@FAULTS
def test_a_file_is_old_or_new(tmp_path, fault):
    path = tmp_path / "a.txt"
    path.write_text("old")
    for ended in every_moment(lambda: write_text(path, "new"), tmp_path, fault):
        assert ended == ENDS[fault]
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
def test_files_of_a_folder_change_together(tmp_path, fault):
    folder = tmp_path / "out"
    set_up(folder)
    old = visible(folder)
    new = {"a": b"new", "deep/b": b"new", "more/c": b"new", "mine": b"old"}
    seen = []
    for ended in every_moment(lambda: put(folder), tmp_path, fault, 1 if fault == "kill" else 3):
        assert ended == ENDS[fault]
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


def failing(number, message):
    def fail(*arguments, **named):
        raise OSError(number, message)

    return fail


def decided(folder, gone=None):
    """A killed process had decided that a file comes, and which others go."""
    (folder / WRITTEN).mkdir(parents=True, exist_ok=True)
    (folder / WRITTEN / "a").write_text("new")
    if gone is not None:
        (folder / WRITTEN / GONE).write_text(gone)


def test_folders_are_made_and_files_go_whether_or_not_they_are_there(tmp_path):
    """A killed process may leave halves of a file, a folder as well as a file; other files' halves are theirs."""
    for _ in range(2):
        make_folder(tmp_path / "a" / "b")
        assert (tmp_path / "a" / "b").is_dir()
    write_text(tmp_path / "a" / "file", "old")
    for _ in range(2):
        remove(tmp_path / "a" / "file")
        assert not (tmp_path / "a" / "file").exists()
    remains = [".b.txt.abcd_123.part", ".a.txt.short.part", ".a.txt.abcd_123.part.old", "a.txt"]
    for name in (".a.txt.abcd_123.part", *remains):
        (tmp_path / name).write_text("half or mine")
    (tmp_path / ".a.txt.efgh5678.part" / "deep").mkdir(parents=True)
    forget_halves(tmp_path / "a.txt")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*remains, "a"])


def test_what_cannot_be_written_is_refused_and_nothing_is_left_of_it(tmp_path):
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
    with pytest.raises(InputError, match="file: cannot be written"), transaction(tmp_path / "file"):
        raise AssertionError
    assert visible(tmp_path) == before
    assert not hidden(tmp_path)


def test_what_a_killed_process_had_decided_is_ended_by_the_next_one(tmp_path):
    """What was to go goes, what was to come comes, and what was only begun is forgotten; without a list nothing goes."""
    for gone in ('["going"]', None):
        set_up(tmp_path)
        decided(tmp_path, gone)
        (tmp_path / WRITING).mkdir()
        (tmp_path / WRITING / "b").write_text("half")
        with folder_lock(tmp_path, "a test"):
            stays = {} if gone else {"going": b"old"}
            assert visible(tmp_path) == {"a": b"new", "deep/b": b"old", "mine": b"old"} | stays
        assert not hidden(tmp_path)


@pytest.mark.parametrize("come", [lambda to: recover(to, "reads"), lambda to: folder_lock(to, "a test").__enter__()])
def test_a_decision_that_is_damaged_or_cannot_be_ended_is_refused(tmp_path, monkeypatch, come):
    """Nothing changes then; a folder may have taken the place of a file meanwhile."""
    for damage in ('["going', "3"):
        set_up(tmp_path)
        decided(tmp_path, damage)
        message = f"{GONE}: is damaged .*: delete {tmp_path / WRITTEN} and run the last command again"
        with pytest.raises(InputError, match=message):
            come(tmp_path)
        assert ((tmp_path / "a").read_text(), (tmp_path / "going").read_text()) == ("old", "old")
    (tmp_path / WRITTEN / GONE).unlink()
    (tmp_path / "a").unlink()
    (tmp_path / "a" / "mine").mkdir(parents=True)
    with pytest.raises(InputError, match=f"^{tmp_path}: cannot be written"):
        come(tmp_path)
    assert (tmp_path / "a" / "mine").is_dir()
    assert (tmp_path / WRITTEN / "a").read_text() == "new"
    monkeypatch.setattr("passerby.interchange.storage.transaction.Path.open", failing(30, "Read-only file system"))
    with pytest.raises(InputError, match=f"{tmp_path}: cannot be written .Read-only"):
        come(tmp_path)


def test_a_name_in_the_way_is_found_out_before_anything_changes(tmp_path):
    set_up(tmp_path)
    (tmp_path / "more" / "c").mkdir(parents=True)
    before = visible(tmp_path)
    with pytest.raises(InputError, match="more/c is a folder"):
        put(tmp_path)
    assert visible(tmp_path) == before
    assert not hidden(tmp_path)


def test_what_is_to_go_stays_in_the_folder(tmp_path):
    (tmp_path / "precious").write_text("mine")
    decided(tmp_path / "out", f'["../precious", "{tmp_path}/precious", 3]')
    recover(tmp_path / "out", "reads")
    assert (tmp_path / "precious").read_text() == "mine"
    assert not hidden(tmp_path / "out")


def make(target, text="new"):
    with whole_folder(target, "mark", "a made thing") as new:
        for name in ("mark", "a", "b"):
            write_text(new / name, text)


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "at_once"), [("kill", True), ("kill", False), ("full", True)])
def test_a_whole_folder_is_old_or_new(tmp_path, monkeypatch, fault, at_once):
    """Also where folders cannot change places at once: what was moved away comes back with the next run."""
    target = tmp_path / "made"
    if not at_once:
        monkeypatch.setattr("passerby.interchange.storage.transaction.exchange_folders", lambda one, other: False)
    make(target, "old")
    old, new = visible(target), dict.fromkeys(("a", "b", "mark"), b"new")
    for ended in every_moment(lambda: make(target), tmp_path, fault, 1 if fault == "kill" else 3):
        assert ended == ENDS[fault]
        if not target.exists() and not at_once:
            with pytest.raises(RuntimeError), whole_folder(target, "mark", "a made thing"):
                raise RuntimeError
        assert visible(target) in (old, new)
        make(target, "old")
        assert [path.name for path in tmp_path.iterdir()] == ["made"]
    assert visible(target) == new


def found(target):
    """The mark of a folder, and what lies beside it."""
    return (target / "mark").read_text(), sorted(path.name for path in target.parent.iterdir())


def interrupt(target):
    """Write half of a new folder."""
    with whole_folder(target, "mark", "a made thing") as folder:
        (folder / "mark").write_text("interrupted")
        raise RuntimeError("halfway")


@pytest.mark.parametrize("at_once", [True, False])
def test_a_folder_replaces_its_like_and_leaves_others_alone(tmp_path, monkeypatch, at_once):
    """Also on a system where two folders cannot change places at once."""
    if not at_once:
        monkeypatch.setattr(transaction_module.ctypes, "CDLL", lambda *arguments, **named: object())
        assert not transaction_module.exchange_folders(tmp_path / "a", tmp_path / "b")
    thing, letter = tmp_path / "deep" / "thing", tmp_path / "letters" / "a.txt"
    make(thing, "one")
    (thing / "more").write_text("of the first")
    make(thing, "two")
    assert visible(thing) == dict.fromkeys(("a", "b", "mark"), b"two")
    assert found(thing) == ("two", ["thing"])
    with pytest.raises(RuntimeError, match="halfway"):
        interrupt(thing)
    assert found(thing) == ("two", ["thing"])
    letter.parent.mkdir()
    letter.write_text("mine")
    for place, message in ((letter.parent, "holds something other than a made thing"), (letter, "is a file")):
        with pytest.raises(InputError, match=message):
            make(place)
    assert letter.read_text() == "mine"


@pytest.mark.parametrize("comes_back", [True, False])
def test_the_old_folder_is_never_lost_where_the_new_one_cannot_take_its_place(tmp_path, monkeypatch, comes_back):
    """It comes back at once; where not even that can be done it waits beside its place, and comes back with the next run."""
    monkeypatch.setattr(transaction_module.ctypes, "CDLL", lambda *arguments, **named: object())
    make(tmp_path / "thing", "one")
    real = Path.rename

    def stuck(self, target):
        if target == tmp_path / "thing" and (self.name == "new" or not comes_back):
            raise OSError(errno.EIO, "Input/output error")
        return real(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", stuck)
        with pytest.raises(InputError, match=r"thing: cannot be written .Input/output error"):
            make(tmp_path / "thing", "two")
    assert (tmp_path / "thing").exists() == comes_back
    with pytest.raises(RuntimeError, match="halfway"):
        interrupt(tmp_path / "thing")
    assert found(tmp_path / "thing") == ("one", ["thing"])


def test_what_a_killed_process_left_goes_and_other_hidden_files_stay(tmp_path):
    """It had made a whole new folder, or half of one, beside the old one."""
    make(tmp_path / "thing", "one")
    (tmp_path / ".thing.abcd_123.part" / "new").mkdir(parents=True)
    (tmp_path / ".thing.efgh5678.part").write_text("a file, no workshop")
    (tmp_path / ".other.abcd_123.part" / "new").mkdir(parents=True)
    make(tmp_path / "thing", "two")
    assert found(tmp_path / "thing") == ("two", [".other.abcd_123.part", ".thing.efgh5678.part", "thing"])


@pytest.mark.parametrize("place", ["pathlib.Path.glob", "tempfile.mkdtemp"])
def test_a_disk_that_takes_nothing_is_an_error(tmp_path, monkeypatch, place):
    make(tmp_path / "thing", "one")
    with monkeypatch.context() as patch:
        patch.setattr(place, failing(errno.ENOSPC, "No space left on device"))
        with pytest.raises(InputError, match=r"thing: cannot be written .No space left on device.: make room there"):
            make(tmp_path / "thing", "two")
    assert found(tmp_path / "thing") == ("one", ["thing"])
