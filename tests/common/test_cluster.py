"""A calibration on a Dask cluster: the same bytes as on one machine, whichever process dies, and one line for each error."""

import gc
import os
import shlex
import signal
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from passerby.cli.main import run
from passerby.common import parallel
from passerby.common.cluster import cluster_workers
from passerby.common.errors import InputError
from sites import loopback

pytest.importorskip("distributed", reason="no Dask: install the extra cluster")
pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTED = "tcp://host:8786"
FIRST_KILLED_S, KILL_EVERY_S = 2.0, 6.0
"""A job whose workers die three times is given up; beginning a worker takes seconds on a busy machine."""


@pytest.fixture
def scheduler():
    """A scheduler's address and process."""
    with loopback.scheduler() as found:
        yield found


@pytest.fixture
def workers(scheduler, tmp_path):
    """Four worker processes."""
    with loopback.workers(scheduler[0], tmp_path / "workers", 4) as found:
        yield found


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A corridor of eight cameras, and what one process makes of it."""
    folder = tmp_path_factory.mktemp("site")
    assert run(["simulate", "--preset", "airport", "--cameras", "8", "--seconds", "90", "-o", str(folder / "scene")]) == 0
    status = run(["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(folder / "alone")])
    return folder, status


def calibrating(folder, out, address):
    return ["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(out), "--scheduler", address]


def test_the_same_bytes_while_workers_are_killed(scheduler, workers, site, tmp_path):
    folder, status = site
    arguments = calibrating(folder, tmp_path / "out", scheduler[0])
    with loopback.killing(workers, FIRST_KILLED_S, KILL_EVERY_S) as killed:
        assert run(arguments) == status
    assert killed
    assert loopback.contents(tmp_path / "out") == loopback.contents(folder / "alone")


def test_the_commands_of_the_documentation(site, tmp_path, monkeypatch):
    """As they stand there, on loopback."""
    folder, status = site
    text = (ROOT / "docs" / "sites.md").read_text(encoding="utf-8").split("{ #cluster }")[1]
    commands = [shlex.split(line, comments=True) for line in text.split("```sh")[1].split("```")[0].splitlines()]
    (schedule,) = (one for one in commands if one[:2] == ["dask", "scheduler"])
    (work,) = (one for one in commands if one[:2] == ["dask", "worker"])
    (calibrate,) = (one for one in commands if one[:1] == ["passerby"])
    monkeypatch.chdir(tmp_path)
    with loopback.scheduler(schedule[1:]) as (address, _), loopback.workers(address, tmp_path / "workers", 2, work[1:]):
        here = {DOCUMENTED: address, "scene.toml": str(folder / "scene" / "scene.toml")}
        arguments = [here.get(one, one) for one in calibrate[1:]]
        assert address in arguments
        assert run(arguments) == status
    assert loopback.contents(tmp_path / "out") == loopback.contents(folder / "alone")


def dying_beside_others():
    """A job that takes its worker with it unless it is alone: a batch of several does."""

    def work(marks):
        for mark in marks:
            mark.touch()
        if len(marks) > 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return [mark.name for mark in marks]

    return work


def test_a_job_whose_workers_die_is_given_once_more_in_parts(scheduler, workers, tmp_path):
    marks = [tmp_path / f"mark-{k}" for k in range(3)]
    with cluster_workers(scheduler[0], tmp_path / "out") as executor:
        (found,) = parallel._results(executor, dying_beside_others(), [marks])
    assert found == [mark.name for mark in marks]
    said = "workers died again and again at one job"
    with pytest.raises(InputError, match=said), cluster_workers(scheduler[0], tmp_path / "out") as executor:
        list(parallel._results(executor, lambda _: os.kill(os.getpid(), signal.SIGKILL), [marks]))


def test_a_scheduler_that_dies_is_one_line(scheduler, workers, site, tmp_path, capfd):
    folder, _ = site

    def kill_when_begun():
        loopback.wait_for(lambda: (tmp_path / "out" / "association").is_dir() or (tmp_path / "out").is_dir())
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


def test_workers_and_a_scheduler_of_another_version(scheduler, workers, tmp_path, monkeypatch):
    """Every worker is asked for its versions before anything is given to it, and one that came later too."""
    same = "install the same version"
    for changed, value, said in (
        ("passerby.common.cluster.__version__", "9.9.9", rf"has passerby .*, here is 9\.9\.9: {same}"),
        ("passerby.common.cluster._dask", lambda: "2020.1.0",
         rf"--scheduler {scheduler[0]}: has distributed \(Dask\) 20.*, here is 2020\.1\.0: {same}"),
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(changed, value)
            with pytest.raises(InputError, match=said), cluster_workers(scheduler[0], tmp_path):
                pass
    with cluster_workers(scheduler[0], tmp_path) as executor:
        monkeypatch.setattr(executor, "_versions", {**executor._versions, "scipy": "9.9.9"})
        with pytest.raises(InputError, match=rf"has scipy .*, here is 9\.9\.9: {same} on all machines"):
            executor.submit(os.getcwd).result()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_jobs_run_in_the_folder_they_were_given_in_and_a_worker_whose_own_disk_is_full_is_named(
    scheduler, workers, tmp_path, monkeypatch
):
    def full_disk():  # within: a worker cannot import this module
        with open("/dev/full", "wb", buffering=0) as file:
            file.write(b"0")

    monkeypatch.chdir(tmp_path)
    with cluster_workers(scheduler[0], tmp_path / "out") as executor:
        assert executor.submit(os.getcwd).result() == str(tmp_path)
        assert list((tmp_path / "out").iterdir()) == []
        said = r": a temporary file: cannot be written or read \(No space left on device\): make room on that machine"
        with pytest.raises(InputError, match=said):
            executor.submit(full_disk).result()


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of a file's size of another process is Linux's")
def test_workers_that_do_not_see_a_file_or_cannot_write_into_the_shared_folder_are_named(scheduler, workers, tmp_path):
    video = tmp_path / "north.mp4"

    def assert_each_says(text):
        with pytest.raises(InputError) as caught, cluster_workers(scheduler[0], tmp_path / "out", [video]):
            pass
        lines = str(caught.value).splitlines()
        assert len(lines) == len(workers)
        assert all(text in line for line in lines)

    assert_each_says(f"does not see {video}: put it on storage that all machines share")
    video.write_bytes(b"")
    for nanny in workers:
        for one in psutil.Process(nanny.pid).children(recursive=True):
            one.rlimit(psutil.RLIMIT_FSIZE, (0, 0))
    assert_each_says(f"cannot write into {tmp_path / 'out'} (File too large): make room there")
    assert not list((tmp_path / "out").iterdir())
