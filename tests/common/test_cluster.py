"""A calibration on a Dask cluster: the same bytes as on one machine, whoever dies, and one line for what is wrong."""

import gc
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from passerby.cli.main import run
from passerby.common.cluster import OTHER_VERSION, cluster_workers
from passerby.common.errors import InputError

pytest.importorskip("distributed", reason="no Dask: install the extra cluster")
pytestmark = pytest.mark.slow

ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
PATIENCE_S = 120
FIRST_KILLED_S, KILL_EVERY_S = 2.0, 6.0
"""A job whose workers die three times is given up; beginning a worker takes seconds on a busy machine."""


def begin(*arguments, cwd=None):
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    return subprocess.Popen(command, env=ENVIRONMENT, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wait_for(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.1)


def answers(port):
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def end_all(processes):
    for process in processes:
        for one in [*psutil.Process(process.pid).children(recursive=True), process] if process.poll() is None else []:
            one.kill()
        process.wait()


@pytest.fixture
def scheduler():
    """A scheduler's address and process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = begin("scheduler", "--host", "127.0.0.1", "--port", str(port))
    wait_for(lambda: answers(port))
    yield f"tcp://127.0.0.1:{port}", process
    end_all([process])


@pytest.fixture
def workers(scheduler, tmp_path):
    """Four worker processes, each with a nanny that begins it again when it dies."""
    from distributed import Client

    folder = tmp_path / "workers"
    folder.mkdir()
    found = [begin("worker", scheduler[0], "--nthreads", "1", "--local-directory", str(folder)) for _ in range(4)]
    with Client(scheduler[0], set_as_default=False) as client:
        client.wait_for_workers(4, timeout=PATIENCE_S)
    yield found
    end_all(found)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A corridor of eight cameras, and what one process makes of it."""
    folder = tmp_path_factory.mktemp("site")
    assert run(["simulate", "--preset", "airport", "--cameras", "8", "--seconds", "90", "-o", str(folder / "scene")]) == 0
    status = run(["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(folder / "alone")])
    return folder, status


def calibrating(folder, out, address):
    return ["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(out), "--scheduler", address]


def contents(folder):
    """All files of an output folder, but for those that only help the next run."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "association" not in path.parts and path.suffix != ".lock"
    }


def test_the_same_bytes_while_workers_are_killed(scheduler, workers, site, tmp_path):
    folder, status = site
    killed, done = [], threading.Event()

    def kill_in_turn():
        while not done.wait(KILL_EVERY_S if killed else FIRST_KILLED_S):
            nanny = workers[len(killed) % len(workers)]
            children = [one for one in psutil.Process(nanny.pid).children(recursive=True) if one.is_running()]
            for one in children[-1:]:
                one.send_signal(signal.SIGKILL)
                killed.append(one.pid)

    killer = threading.Thread(target=kill_in_turn)
    killer.start()
    try:
        arguments = [
            "calibrate",
            str(folder / "scene" / "scene.toml"),
            "-o",
            str(tmp_path / "out"),
            "--scheduler",
            scheduler[0],
        ]
        assert run(arguments) == status
    finally:
        done.set()
        killer.join()
    assert killed
    assert contents(tmp_path / "out") == contents(folder / "alone")


def test_a_scheduler_that_dies_is_one_line(scheduler, workers, site, tmp_path, capfd):
    folder, _ = site

    def kill_when_begun():
        wait_for(lambda: (tmp_path / "out" / "association").is_dir() or (tmp_path / "out").is_dir())
        time.sleep(2.0)
        scheduler[1].kill()

    killer = threading.Thread(target=kill_when_begun)
    killer.start()
    status = run(calibrating(folder, tmp_path / "out", scheduler[0]))
    killer.join()
    said = capfd.readouterr().err
    assert status == 2, said
    assert "the scheduler does not answer any more" in said
    assert not (tmp_path / "out" / "rig.toml").exists()


def test_a_worker_that_does_not_see_a_file(scheduler, workers, tmp_path):
    missing = tmp_path / "north.mp4"
    with pytest.raises(InputError) as caught, cluster_workers(scheduler[0], tmp_path / "out", [missing]):
        pass
    lines = str(caught.value).splitlines()
    assert len(lines) == len(workers)
    assert all(f"does not see {missing}: put it on storage that all machines share" in line for line in lines)


def test_no_workers_and_no_scheduler(scheduler, tmp_path):
    from distributed import Client

    gc.collect()
    with pytest.raises(InputError, match="has no workers: start some by"), cluster_workers(scheduler[0], tmp_path):
        pass
    for address in ("tcp://127.0.0.1:1", "nonsense", "tcp://"):
        with pytest.raises(InputError, match="no Dask scheduler answers there"), cluster_workers(address, tmp_path):
            pass
    left = [one for one in gc.get_objects() if isinstance(one, Client) and one.status != "closed"]
    assert not left, "the end of each, by the collector, would stop a thread for 30 s"


def test_a_worker_of_another_version(scheduler, workers, tmp_path, monkeypatch):
    """Every worker is asked for its versions before anything is given to it."""
    monkeypatch.setattr("passerby.common.cluster.__version__", "9.9.9")
    said = r"has passerby .*, here is 9\.9\.9: install the same version"
    with pytest.raises(InputError, match=said), cluster_workers(scheduler[0], tmp_path):
        pass
    assert "{worker}" in OTHER_VERSION


def test_a_scheduler_of_another_version(scheduler, workers, tmp_path, monkeypatch):
    monkeypatch.setattr("passerby.common.cluster._dask", lambda: "2020.1.0")
    said = rf"--scheduler {scheduler[0]}: has distributed \(Dask\) 20.*, here is 2020\.1\.0: install the same version"
    with pytest.raises(InputError, match=said), cluster_workers(scheduler[0], tmp_path):
        pass


def test_a_worker_of_another_version_that_came_later(scheduler, workers, tmp_path, monkeypatch):
    with cluster_workers(scheduler[0], tmp_path) as executor:
        monkeypatch.setattr(executor, "_versions", {**executor._versions, "scipy": "9.9.9"})
        with pytest.raises(InputError, match=r"has scipy .*, here is 9\.9\.9: install the same version on all machines"):
            executor.submit(os.getcwd).result()


def full_disk():
    """What writing to a worker's own disk ends with when there is no room."""
    with open("/dev/full", "wb", buffering=0) as file:
        file.write(b"0")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_worker_whose_own_disk_is_full_is_named(scheduler, workers, tmp_path):
    with cluster_workers(scheduler[0], tmp_path) as executor:
        said = r": a temporary file: cannot be written or read \(No space left on device\): make room on that machine"
        with pytest.raises(InputError, match=said):
            executor.submit(full_disk).result()


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of a file's size of another process is Linux's")
def test_a_worker_that_cannot_write_into_the_shared_folder(scheduler, workers, tmp_path):
    video = tmp_path / "north.mp4"
    video.write_bytes(b"")
    for nanny in workers:
        for one in psutil.Process(nanny.pid).children(recursive=True):
            one.rlimit(psutil.RLIMIT_FSIZE, (0, 0))
    with pytest.raises(InputError) as caught, cluster_workers(scheduler[0], tmp_path / "out", [video]):
        pass
    lines = str(caught.value).splitlines()
    assert len(lines) == len(workers)
    assert all(f"cannot write into {tmp_path / 'out'} (File too large): make room there" in line for line in lines)
    assert not list((tmp_path / "out").iterdir())


def test_jobs_run_in_the_folder_they_were_given_in(scheduler, workers, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with cluster_workers(scheduler[0], tmp_path / "out") as executor:
        assert executor.submit(os.getcwd).result() == str(tmp_path)
    assert list(Path(tmp_path / "out").iterdir()) == []
