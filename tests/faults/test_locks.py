"""One process at a time in a folder; a killed one holds nobody up."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from passerby.cli import run
from passerby.errors import InputError
from passerby.interchange.locks import FOLDER_LOCK, alone_in

pytest.importorskip("fcntl", reason="the system has no such locks")

HOLD = """
import sys, time
from pathlib import Path
from passerby.interchange.locks import alone_in
with alone_in(Path(sys.argv[1]), "passerby calibrate"):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_the_second_is_told_of_the_first(tmp_path, holder, capsys):
    for command in (["report", str(tmp_path)], ["align", str(tmp_path), "-o", str(tmp_path), "--camera", "C1"]):
        assert run(command) == 2
        errors = capsys.readouterr().err
        assert errors.startswith(f"error: {tmp_path}: process {holder.pid} on ")
        assert errors.endswith(
            "(passerby calibrate) works there at this moment: wait until it has ended, or give another place\n"
        )


def test_a_killed_process_leaves_a_file_and_no_lock(tmp_path, holder):
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    assert (tmp_path / FOLDER_LOCK).exists()
    with alone_in(tmp_path, "a test"):
        assert f"process {os.getpid()} on " in (tmp_path / FOLDER_LOCK).read_text()
    assert not list(tmp_path.iterdir())


def test_never_two_at_once(tmp_path):
    """Many threads that take the lock, and delete its file, again and again."""
    inside, most, done = [], [], []

    def work(number):
        for _ in range(20):
            with alone_in(tmp_path / "out", "a test", wait_s=60):
                inside.append(number)
                most.append(len(inside))
                inside.remove(number)
                done.append(number)

    with ThreadPoolExecutor(6) as threads:
        list(threads.map(work, range(6)))
    assert len(done) == 120
    assert set(most) == {1}
    assert not list((tmp_path / "out").glob("*")), "nothing is left behind"


def test_a_folder_that_was_there_stays(tmp_path):
    with alone_in(tmp_path, "a test"), pytest.raises(InputError, match="works there"), alone_in(tmp_path, "another"):
        raise AssertionError
    assert tmp_path.is_dir()
