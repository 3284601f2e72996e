"""One process at a time works in a folder; a killed one holds no other up."""

import errno
import itertools
import math
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.interchange.storage import transaction
from passerby.interchange.storage.transaction import FOLDER_LOCK, lock_folder

pytest.importorskip("fcntl", reason="the system has no such locks")


HOLD = """
import sys
from pathlib import Path
from passerby.interchange.storage.transaction import lock_folder
with lock_folder(Path(sys.argv[1]), "passerby calibrate"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_the_second_process_names_the_first_until_it_is_killed(tmp_path, holder, capsys):
    """A killed process leaves a file and no lock."""
    for command in (["report", str(tmp_path)], ["align", str(tmp_path), "-o", str(tmp_path), "--camera", "C1"]):
        assert run(command) == 2
        errors = capsys.readouterr().err
        assert errors.startswith(f"error: {tmp_path}: process {holder.pid} on ")
        assert errors.endswith("(passerby calibrate) is running there now: wait until it has finished, or give another place\n")
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    assert (tmp_path / FOLDER_LOCK).exists()
    with lock_folder(tmp_path, "a test"):
        assert f"process {os.getpid()} on " in (tmp_path / FOLDER_LOCK).read_text()
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_never_two_at_once(tmp_path):
    """Many threads that take the lock, and delete its file, again and again, while the folder is removed when empty."""
    inside, most, done, ended = [], [], [], threading.Event()

    def work(number):
        for _ in range(20):
            with lock_folder(tmp_path / "out", "a test", wait_s=math.inf):
                inside.append(number)
                most.append(len(inside))
                inside.remove(number)
                done.append(number)

    def remove():
        # Again and again, but never so that the folder is gone for as long as a lock is tried to be made.
        while not ended.wait(0.0005):
            with suppress(OSError):
                (tmp_path / "out").rmdir()

    with ThreadPoolExecutor(7) as threads:
        removing = threads.submit(remove)
        try:
            list(threads.map(work, range(6)))
        finally:
            ended.set()
        removing.result()
    assert len(done) == 120
    assert set(most) == {1}
    assert not list((tmp_path / "out").glob("*")), "nothing is left behind"


def test_one_who_may_wait_gets_the_lock_when_it_is_free(tmp_path, monkeypatch):
    holding, waits = ExitStack(), []
    holding.enter_context(lock_folder(tmp_path, "another test"))

    def until_the_third_time(seconds):
        waits.append(seconds)
        if len(waits) == 3:
            holding.close()

    monkeypatch.setattr(transaction.time, "sleep", until_the_third_time)
    with lock_folder(tmp_path, "a test", wait_s=3600.0):
        assert (tmp_path / FOLDER_LOCK).read_text().endswith("(a test)")
    assert len(waits) == 3


def test_a_file_system_without_locks_keeps_no_process_out(tmp_path, monkeypatch):
    def unsupported(file):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(transaction, "try_lock", unsupported)
    with lock_folder(tmp_path, "a test"), lock_folder(tmp_path, "another"):
        (tmp_path / "result").write_text("done")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_a_lock_whose_file_its_holder_has_just_deleted_is_taken_anew(tmp_path, monkeypatch):
    """Else two would each hold a lock: one on the file that has gone, one on the file that has its name."""
    real, tries = transaction.try_lock, []

    def deleted_at_first(file):
        tries.append(file)
        if len(tries) == 1:
            (tmp_path / FOLDER_LOCK).unlink()
        return real(file)

    monkeypatch.setattr(transaction, "try_lock", deleted_at_first)
    with lock_folder(tmp_path, "a test"):
        assert tries[0].closed
        with pytest.raises(InputError, match=r"\(a test\) is running there"), lock_folder(tmp_path, "another"):
            raise AssertionError


def test_the_holder_of_a_lock_that_cannot_be_read_is_another_process(tmp_path, monkeypatch):
    """Windows lets no other process read what is locked."""
    real = Path.open
    with lock_folder(tmp_path, "a test"):
        monkeypatch.setattr(Path, "open", lambda path, mode, buffering: real(path, "ab", buffering))
        with pytest.raises(InputError, match="another process is running there now"), lock_folder(tmp_path, "another"):
            raise AssertionError


@pytest.mark.parametrize("call", ["open", "mkdir"])
def test_a_folder_that_goes_and_comes_is_no_fault(tmp_path, monkeypatch, call):
    """Its holder removes it while another process opens the lock in it, and a third makes it anew at once; also where hours go
    by between two tries."""
    out, real, times, hours = tmp_path / "out", getattr(Path, call), [], itertools.count(step=3600)

    def gone_for_a_moment(self, *arguments, **named):
        if self == (out / FOLDER_LOCK if call == "open" else out) and len(times) < 5:
            times.append(self)
            if call == "mkdir":  # pathlib found the folder, and then did not
                raise FileExistsError(errno.EEXIST, "File exists", str(self))
            out.rmdir()
            try:
                return real(self, *arguments, **named)
            finally:
                out.mkdir()
        return real(self, *arguments, **named)

    monkeypatch.setattr(Path, call, gone_for_a_moment)
    monkeypatch.setattr(transaction.time, "monotonic", lambda: float(next(hours)))
    with lock_folder(out, "a test"):
        assert (out / FOLDER_LOCK).exists()
    assert len(times) == 5
    assert not out.exists()


def test_a_lock_that_can_never_be_made_is_a_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(transaction, "GONE_FOR_S", 0.01)
    (tmp_path / FOLDER_LOCK).symlink_to(tmp_path / "nowhere" / "lock")
    (tmp_path / "file").write_text("")
    for folder in (tmp_path, tmp_path / "file"):
        with pytest.raises(InputError, match="cannot be written"), lock_folder(folder, "a test"):
            raise AssertionError


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of a file's size")
def test_a_lock_that_a_full_disk_does_not_sign_is_let_go_without_an_error(tmp_path):
    import resource

    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        try:
            with lock_folder(tmp_path / "out", "a test"):
                pass
            os._exit(0)
        except BaseException:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
