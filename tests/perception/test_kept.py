"""Kept results: whole or missing, known by what decides them."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.perception.kept import StageCache, cache_lock, fingerprint, forget_others, hash_of_arrays, key_of

PART = {"number": np.arange(5), "score": np.linspace(0, 1, 7).reshape(7, 1), "none": np.zeros((0, 4))}


@pytest.fixture
def stage(tmp_path):
    kept = StageCache.of(tmp_path, "people", {"a": 1})
    kept.save(3, PART)
    kept.finish({"pictures": 5, "moves": [{"until": None, "seconds": 0.1}]})
    return kept


def only_file(stage, ending):
    (path,) = stage.folder.glob(f"*{ending}")
    return path


def test_what_was_kept_is_found_by_us_and_by_numpy(stage, tmp_path):
    loaded = stage.load(3)
    assert list(loaded) == list(PART)
    for name, array in PART.items():
        assert loaded[name].dtype == array.dtype
        np.testing.assert_array_equal(loaded[name], array)
    with np.load(only_file(stage, ".npz")) as archive:
        np.testing.assert_array_equal(archive["score"], PART["score"])
    assert stage.load(2) is None
    summary = stage.summary()
    assert summary == {"pictures": 5, "moves": [{"until": None, "seconds": 0.1}]}
    assert list(summary) == ["pictures", "moves"], "the order decides the bytes of what it is written into"
    unfinished = StageCache.of(tmp_path, "people", {"a": 2})
    unfinished.save(0, PART)
    assert unfinished.summary() is None


@pytest.mark.parametrize("ending", [".npz", ".txt"])
def test_a_cut_file_or_any_changed_byte_counts_as_missing(stage, ending):
    path = only_file(stage, ending)
    whole = path.read_bytes()
    cut = {0, 1, 15, 16, 17, len(whole) // 2, len(whole) - 17, len(whole) - 16, len(whole) - 2}
    # The last byte of the summary is the line's end.
    places = range(len(whole) - (ending == ".txt"))
    changed = (whole[:place] + bytes([whole[place] ^ 0x40]) + whole[place + 1 :] for place in places)
    for damaged in (*(whole[:length] for length in cut), *changed, bytes(len(whole))):
        path.write_bytes(damaged)
        assert (stage.load(3) if ending == ".npz" else stage.summary()) is None
    path.unlink()
    path.mkdir()
    assert (stage.load(3) if ending == ".npz" else stage.summary()) is None
    path.rmdir()
    stage.save(3, {"number": np.arange(2)})
    np.testing.assert_array_equal(stage.load(3)["number"], [0, 1])


def test_a_folder_that_cannot_be_written_or_locked(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        StageCache.of(tmp_path / "file", "people", {}).save(0, PART)
    shelf = cache_lock(tmp_path / "file" / "C1")
    with pytest.raises(InputError, match=r"file/C1: cannot be written .*: choose a folder"), shelf:
        raise AssertionError
    # A system without locks keeps no one out.
    monkeypatch.setattr("passerby.perception.kept.fcntl", None)
    with cache_lock(tmp_path / "C1"), cache_lock(tmp_path / "C1"):
        assert (tmp_path / "C1").is_dir()


def test_keys_differ_with_what_decides():
    keys = {key_of(identity) for identity in ({}, {"a": 1}, {"a": 1.5}, {"a": "1"}, {"b": 1}, {"a": {"b": 1}}, {"a": None})}
    assert len(keys) == 7
    assert key_of({"a": 1, "b": 2}) == key_of({"b": 2, "a": 1})
    base = np.arange(6.0)
    digests = {hash_of_arrays(array) for array in (base, base[::-1], base.reshape(2, 3), base.astype(np.float32), base[:5])}
    assert len(digests | {hash_of_arrays(base, base)}) == 6
    assert hash_of_arrays(base) == hash_of_arrays(base.copy()) == hash_of_arrays(np.repeat(base, 2)[::2])


def test_a_file_is_known_by_its_content(tmp_path):
    content = np.random.default_rng(0).bytes(9_000_000)
    first, second = tmp_path / "a.mp4", tmp_path / "other" / "b.avi"
    first.write_bytes(content)
    second.parent.mkdir()
    shutil.copyfile(first, second)
    os.utime(second, (1, 1))
    assert fingerprint(first) == fingerprint(second)
    # Video codecs change everything behind a change: a piece of 256 kB is never missed by 64 samples of 9 MB.
    second.write_bytes(content[:4_000_000] + bytes(262_144) + content[4_262_144:])
    assert fingerprint(first) != fingerprint(second)
    second.write_bytes(content + b"\0")
    assert fingerprint(first) != fingerprint(second)
    for tiny in (b"", b"a", b"b"):
        (tmp_path / "tiny").write_bytes(tiny)
        assert fingerprint(tmp_path / "tiny")["bytes"] == len(tiny)


WAITS = """
import sys
from pathlib import Path
from passerby.perception.kept import cache_lock
print("begun", flush=True)
with cache_lock(Path(sys.argv[1])):
    print("in", flush=True)
    sys.stdin.readline()
"""


def test_a_shelf_belongs_to_one_process_and_a_killed_one_gives_it_back(tmp_path):
    fcntl = pytest.importorskip("fcntl")

    def held():
        handle = os.open(tmp_path, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(handle)
        return False

    def begin():
        command = [sys.executable, "-c", WAITS, str(tmp_path)]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    with begin() as first:
        assert [first.stdout.readline() for _ in range(2)] == ["begun\n", "in\n"]
        with begin() as second:
            assert second.stdout.readline() == "begun\n"
            assert held()
            first.kill()
            assert second.stdout.readline() == "in\n"
            assert held()
            second.kill()
    assert not held()


def test_what_is_not_used_any_more_and_what_killed_runs_left_goes(tmp_path):
    used, other = (StageCache.of(tmp_path, "people", {"a": number}) for number in (1, 2))
    for kept in (used, other):
        kept.save(3, PART)
        (kept.folder / ".000004.npz.abcd_123.part").write_bytes(b"half")
    (tmp_path / "mine.txt").write_text("mine")
    forget_others(tmp_path, {used.folder})
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["mine.txt", used.folder.name])
    assert [path.name for path in used.folder.iterdir()] == ["000003.npz"]
    forget_others(tmp_path / "none", set())
    assert not (tmp_path / "none").exists()
