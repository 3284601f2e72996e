"""Work side by side: the same results, in the same order, told as they come."""

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from passerby.association.camera_tracklets import build_tracklets
from passerby.common import parallel
from passerby.common.errors import InputError
from passerby.common.parallel import local_processes, pays, side_by_side
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


def test_processes_pay_where_there_is_much_to_do_and_more_than_one():
    assert not pays(100_000, 4, 8), "four cameras for half a minute"
    assert not pays(10**9, 7, 1)
    assert pays(2_000_000, 7, 2), "seven cameras for some minutes"
    assert pays(100_000, 20, 2), "many pairs"


def test_no_processes_where_they_would_not_pay():
    with local_processes(1000, 4) as executor:
        assert executor is None


def test_processes_prepare_cameras_bit_for_bit(monkeypatch):
    monkeypatch.setattr(parallel, "pays", lambda *measure: True)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1}, raising=False)
    truth = simulate(SimulationOptions(seconds=6.0, box_noise=0.02, unrelated_ids=True))
    rig = Rig(tuple(replace(camera, pose=None, sigma=None) for camera in truth.rig))
    clocks = dict.fromkeys(rig.names, Clock(truth.options.fps))

    def prepared(executor):
        return build_tracklets(rig, truth.observations, clocks, 1.72, np.random.default_rng(3), executor)

    before = multiprocessing.active_children()
    with local_processes(0, 4) as executor:
        assert executor is not None
        apart = prepared(executor)
        assert len(multiprocessing.active_children()) > len(before)
    for one, other in zip(prepared(None), apart, strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.seen.boxes.identity, other.seen.boxes.identity)
        assert one.level.height == other.level.height
        np.testing.assert_array_equal(one.tracks.position, other.tracks.position)


def test_a_process_that_is_killed_from_outside_is_told(monkeypatch):
    monkeypatch.setattr(parallel, "pays", lambda *measure: True)
    with (
        pytest.raises(InputError, match="was killed by the system, usually because memory ran out: close other programs"),
        local_processes(0, 4) as executor,
    ):
        executor.submit(os._exit, 9).result()


INTERRUPTED = """
import multiprocessing, os, time
from passerby.common.parallel import local_processes
started = []
def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
try:
    with local_processes(10**10, 8) as pool:
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
