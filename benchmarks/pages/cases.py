"""Cases that are run side by side, each kept as soon as it is finished, so that a stopped run goes on."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from multiprocessing import forkserver, parent_process
from multiprocessing.connection import wait
from typing import Any

from pages.kept import Kept

REPORTED_EVERY_S = 20.0

Outcomes = dict[str, dict[str, Any]]


def run_cases(
    store: Kept, name: str, cases: Mapping[str, Any], work: Callable[[Any], Mapping[str, Any]], workers: int
) -> Iterator[Outcomes]:
    """The outcomes of the finished cases by key, in the order of `cases`: of those that are kept, then again after each.

    Args:
        store: keeps outcomes; those of the same code are not run again.
        name: of the part; outcomes are kept under it and their key.
        cases: key -> argument of `work`; both must be picklable, `work` a function of a module.
        work: JSON-ready figures of one case. Its exceptions end the run: a case that may fail has to say so in its figures.
        workers: number of processes.
    """
    known = {key: store.get(f"{name} {key}") for key in cases}
    done = {key: outcome for key, outcome in known.items() if outcome is not None}
    todo = [key for key in cases if key not in done]
    yield dict(done)
    if not todo:
        return
    began = reported = time.monotonic()
    pool = ProcessPoolExecutor(workers, initializer=_begin_work)
    try:
        futures: dict[Future[Mapping[str, Any]], str] = {pool.submit(work, cases[key]): key for key in todo}
        for count, future in enumerate(as_completed(futures), 1):
            key = futures[future]
            done[key] = dict(future.result())
            store.put(f"{name} {key}", done[key])
            if time.monotonic() - reported > REPORTED_EVERY_S or count == len(todo):
                reported = time.monotonic()
                left = (reported - began) / count * (len(todo) - count)
                print(f"{name}: {count} of {len(todo)} cases, about {left / 60:.0f} min left", file=sys.stderr, flush=True)
            yield {key: done[key] for key in cases if key in done}
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_work() -> None:
    """Processes that share the cores do not fight for them with threads of their own, nor for their parent's fork server.

    They end with their parent: one that was killed cannot end them, and they would keep the cores from the next run.
    """
    from threadpoolctl import threadpool_limits

    threading.Thread(target=_end_with_parent, daemon=True).start()
    server: Any = forkserver._forkserver
    server._forkserver_address = server._forkserver_alive_fd = server._forkserver_pid = None
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    threadpool_limits(limits=1)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
