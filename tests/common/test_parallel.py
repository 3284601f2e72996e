"""Work side by side: the same results, in the same order, announced as they come, and used again for jobs that are the same."""

import multiprocessing
import multiprocessing.synchronize
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from passerby.association.camera_tracklets import build_tracklets
from passerby.common import parallel
from passerby.common.errors import InputError
from passerby.common.parallel import EarlierResults, open_local_processes, pays, side_by_side
from passerby.common.progress import silent
from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.simulation import SimulationOptions, simulate


def squared(value):
    return value * value


@pytest.mark.parametrize("threads", [0, 2])
def test_results_come_in_order_and_are_counted(threads):
    told = []
    executor = ThreadPoolExecutor(threads) if threads else None
    results = side_by_side(squared, [3, 1, 2], executor, lambda *part: told.append(part), "squares")
    assert results == [9, 1, 4]
    assert told == [("squares", 0, 3), ("squares", 1, 3), ("squares", 2, 3), ("squares", 3, 3)]


class Dying(ThreadPoolExecutor):
    """Batches of several jobs die, and a job alone so many times as it says."""

    died = (ConnectionError,)
    least_s = 2.0

    def __init__(self, deaths):
        super().__init__(2)
        self.deaths, self.given = dict(deaths), []

    def submit(self, fn, batch):
        self.given.append(list(batch))
        if len(batch) > 1 and set(batch) & set(self.deaths):
            return super().submit(self.die)
        if self.deaths.get(batch[0], 0) > 1 and len(batch) == 1:
            return super().submit(self.die)
        return super().submit(fn, batch)

    def die(self):
        raise ConnectionError


def test_jobs_whose_workers_died_are_given_once_more_one_by_one():
    executor = Dying({3: 1})
    results = side_by_side(squared, list(range(6)), executor, lambda *part: None, "squares", job_s=1.0)
    assert (results, executor.given) == ([0, 1, 4, 9, 16, 25], [[0, 1], [2, 3], [4, 5], [2], [3]])
    with pytest.raises(ConnectionError):
        side_by_side(squared, list(range(6)), Dying({3: 2}), lambda *part: None, "squares", job_s=1.0)


def test_processes_pay_where_there_is_much_to_do_and_more_than_one():
    assert not pays(100_000, 4, 8), "four cameras for half a minute"
    assert not pays(10**9, 7, 1)
    assert pays(2_000_000, 7, 2), "seven cameras for some minutes"
    assert pays(100_000, 20, 2), "many pairs"
    with open_local_processes(1000, 4) as executor:
        assert executor is None


def test_no_processes_where_the_system_allows_none(monkeypatch):
    """Containers without shared memory have no semaphores: the work goes on in this process."""

    def none(*arguments, **named):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(parallel, "pays", lambda *measure: True)
    monkeypatch.setattr(multiprocessing.synchronize.SemLock, "__init__", none)
    with open_local_processes(0, 4) as executor:
        assert executor is None
    with pytest.raises(InputError) as caught, open_local_processes(0, 4):
        raise InputError("the work's own")
    assert caught.value.__context__ is None, "no trace of the semaphores"


@pytest.mark.slow
def test_processes_prepare_cameras_bit_for_bit(monkeypatch):
    monkeypatch.setattr(parallel, "pays", lambda *measure: True)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1}, raising=False)
    truth = simulate(SimulationOptions(seconds=6.0, box_noise=0.02, unrelated_ids=True))
    rig = Rig(tuple(replace(camera, pose=None, sigma=None) for camera in truth.rig))
    clocks = dict.fromkeys(rig.names, Clock(truth.options.fps))

    def prepared(executor):
        return build_tracklets(rig, truth.observations, clocks, 1.72, np.random.default_rng(3), executor)

    before = set(multiprocessing.active_children())
    with open_local_processes(0, 4) as executor:
        assert executor is not None
        apart = prepared(executor)
        assert set(multiprocessing.active_children()) - before
    for one, other in zip(prepared(None), apart, strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.seen.boxes.identity, other.seen.boxes.identity)
        assert one.level.height == other.level.height
        np.testing.assert_array_equal(one.tracks.position, other.tracks.position)


def test_a_killed_process_is_one_error_and_nothing_else_is_reported(monkeypatch):
    """However slowly its thread tells job after job of the process that died, while this thread already gives up."""
    monkeypatch.setattr(parallel, "pays", lambda *measure: True)
    usual, before, unhandled = Future.set_exception, set(threading.enumerate()), []
    monkeypatch.setattr(Future, "set_exception", lambda *given: (usual(*given), time.sleep(0.1)))
    monkeypatch.setattr(threading, "excepthook", unhandled.append)
    killed = "was killed by the system, usually because memory ran out: close other programs"
    with pytest.raises(InputError, match=killed), open_local_processes(0, 4) as executor:
        side_by_side(os._exit, [9] * 4, executor, lambda *part: None, "jobs")
    for thread in set(threading.enumerate()) - before:
        thread.join(60)  # one that failed may leave another behind that waits for ever
    assert unhandled == []


class InterruptedExecutor(Executor):
    def __init__(self):
        self.futures = []

    def submit(self, function, *arguments):
        signal.raise_signal(signal.SIGINT)
        self.futures.append(Future())
        return self.futures[-1]


def test_an_interruption_waits_until_all_jobs_are_given():
    executor = InterruptedExecutor()
    with pytest.raises(KeyboardInterrupt):
        side_by_side(squared, [3, 1, 2], executor, lambda *part: None, "squares")
    assert [future.cancelled() for future in executor.futures] == [True] * 3
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


BEGINNING = """
import os, signal
from passerby.common import parallel
if __name__ == "__mp_main__":
    os.kill(os.getpid(), signal.SIGINT)  # Ctrl-C reaches all processes of a terminal, this one before it is prepared.
if __name__ == "__main__":
    os.sched_getaffinity = lambda process: {0, 1}
    with parallel.open_local_processes(10**10, 8) as pool:
        print(parallel.side_by_side(abs, [-1, -2], pool, lambda *part: None, "numbers"))
"""


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be kept waiting")
def test_a_process_that_is_interrupted_while_it_begins_says_nothing(tmp_path):
    (tmp_path / "beginning.py").write_text(BEGINNING)
    ended = subprocess.run([sys.executable, tmp_path / "beginning.py"], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "[1, 2]\n", "")


INTERRUPTED = """
import multiprocessing, os, time
from passerby.common.parallel import open_local_processes
started = []
def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
try:
    with open_local_processes(10**10, 8) as pool:
        if pool is not None:
            asleep = pool.submit(time.sleep, 600)
            while not asleep.running():
                time.sleep(0.05)
        started = [process.pid for process in multiprocessing.active_children()]
        raise KeyboardInterrupt
except KeyboardInterrupt:
    until = time.monotonic() + 600
    while any(map(alive, started)) and time.monotonic() < until:
        multiprocessing.active_children()
        time.sleep(0.05)
    print("alive:", sum(map(alive, started)), flush=True)
    os._exit(0)
"""


def test_an_interrupted_pool_leaves_no_process_behind():
    ended = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=1200, check=False)
    assert ended.stdout.strip() == "alive: 0", ended.stderr


def test_only_jobs_that_are_new_or_changed_are_done():
    done: list[int] = []

    def double(job: int) -> int:
        done.append(job)
        return 2 * job

    earlier: EarlierResults[int, int] = EarlierResults(lambda a, b: a == b)
    assert earlier.side_by_side(double, [1, 2, 3], "abc", None, silent, "doubling") == [2, 4, 6]
    assert earlier.side_by_side(double, [3, 1, 5], "cab", None, silent, "doubling") == [6, 2, 10]
    assert done == [1, 2, 3, 5]
    assert earlier.side_by_side(double, [2], "b", None, silent, "doubling") == [4]
    assert done == [1, 2, 3, 5, 2]
