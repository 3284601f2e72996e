"""Parallel execution of jobs, and results of jobs that several estimates share."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

from threadpoolctl import threadpool_limits

from passerby.common.errors import InputError
from passerby.common.progress import Progress

Job = TypeVar("Job")
Result = TypeVar("Result")
MAX_PROCESSES = 8
STARTING_S = 1.0
"""Time that processes take to start, seconds: most of it is the import of numpy and scipy, in parallel."""
BYTE_S, PAIR_S = 3e-6, 0.07
"""Time to convert a byte of boxes to tracklets, and to register a pair of cameras, seconds: measured on scenes of 4 to 8
cameras, a minute long. Rough figures suffice: near the threshold neither choice is faster."""
VIDEO_S = 5.0
"""Minimum time to process a video, seconds; usually it is far more."""
ORPHANED_EVERY_S = 1.0
BROKEN = (
    "a process that worked on a camera was killed by the system, usually because memory ran out: close other programs and run "
    "the same command again; results of the videos so far are cached"
)


def side_by_side(
    function: Callable[[Job], Result], jobs: Sequence[Job], executor: Executor | None, tell: Progress, stage: str, *,
    job_s: float | None = None,
) -> list[Result]:  # fmt: skip
    """Return the results of all jobs, in their order.

    Args:
        function: takes one job and returns its result. It must be a function of a module; jobs and results must be picklable.
        jobs: the arguments of `function`.
        executor: runs the jobs in parallel; None: they run one after the other.
        tell: called with the stage and the number of finished jobs.
        stage: name of the stage.
        job_s: approximate duration of a job, seconds. An executor that has `least_s` gets batches of jobs that take this long.

    Jobs that end with one of the exceptions in the executor's `died` are given to it again, one by one.
    """
    tell(stage, 0, len(jobs))
    results: list[Result] = []
    if executor is None:
        for job in jobs:
            results.append(function(job))
            tell(stage, len(results), len(jobs))
        return results
    least_s: float = getattr(executor, "least_s", 0.0)
    size = 1 if job_s is None else max(1, round(least_s / job_s))
    # Data that the jobs of a batch share is sent only once.
    batches = [jobs[begin : begin + size] for begin in range(0, len(jobs), size)]
    for batch in _results(executor, partial(_run_serially, function), batches):
        results.extend(batch)
        tell(stage, len(results), len(jobs))
    return results


def _results(
    executor: Executor, function: Callable[[Sequence[Job]], list[Result]], batches: Sequence[Sequence[Job]]
) -> Iterator[list[Result]]:
    """Yield the results of an executor, in the order of the batches of jobs. If one fails, the waiting ones are cancelled.

    They are not cancelled in a local pool, which is about to end: if its processes end before the pool has registered that a
    job was cancelled, the pool of Python 3.11 reports this as an error of its own.
    """
    died: tuple[type[Exception], ...] = getattr(executor, "died", ())
    futures: list[Future[list[Result]]] = []
    try:
        with interrupted_later():  # jobs are submitted one by one, and some of them start a process
            futures.extend(executor.submit(function, batch) for batch in batches)
        for future, batch in zip(tuple(futures), batches, strict=True):
            try:
                found = future.result()
            except died:
                again = [executor.submit(function, [job]) for job in batch]
                futures.extend(again)
                found = [result for one in again for result in one.result()]
            yield found
    finally:
        if not isinstance(executor, _LocalPool):
            for future in futures:
                future.cancel()


class _LocalPool(ProcessPoolExecutor):
    """A pool of `open_local_processes`, which kills its processes if a job fails or the work is interrupted."""

    size: int = 0
    begun: bool = False
    """Whether a job was submitted: the first job starts a process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a job, as `Executor.submit` does, and note that the pool has begun."""
        self.begun = True
        return super().submit(fn, *args, **kwargs)


@contextmanager
def interrupted_later() -> Iterator[None]:
    """Delay an interruption (Ctrl-C) until the block has ended; in processes of a local pool, until they are prepared.

    It is for the block that submits jobs to an executor: an interrupted process that is still starting would print a traceback
    on the terminal.
    """
    usual = signal.getsignal(signal.SIGINT)
    if usual is None or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    waiting: list[int] = []
    # The new processes inherit the mask. The handler is for this process, in which any thread may get the signal.
    signal.signal(signal.SIGINT, lambda number, frame: waiting.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if waiting:
            signal.raise_signal(signal.SIGINT)


def _run_serially(function: Callable[[Job], Result], jobs: Sequence[Job]) -> list[Result]:
    """Return the results of jobs, with one BLAS thread: more would wait for each other, and would change the last bits."""
    with threadpool_limits(limits=1, user_api="blas"):
        return [function(job) for job in jobs]


def _begin_process(parent: int) -> None:
    """Prepare a process of a pool: its parent handles an interruption, and the process ends when its parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent has ended: the processes of a pool would otherwise wait for work without end."""
    while os.getppid() == parent:
        time.sleep(ORPHANED_EVERY_S)
    os._exit(1)


def pays(n_bytes: int, n_cameras: int, n_processes: int, n_videos: int = 0) -> bool:
    """Return whether processes save more time than they take to start.

    Args:
        n_bytes: total size of the files of boxes and joints.
        n_cameras: number of cameras.
        n_processes: processes that would share the work.
        n_videos: number of videos in which people have to be found.
    """
    work_s = n_bytes * BYTE_S + n_cameras * (n_cameras - 1) / 2 * PAIR_S + n_videos * VIDEO_S
    return n_processes > 1 and work_s * (1 - 1 / n_processes) > STARTING_S


def worthwhile(executor: Executor | None, n_bytes: int, n_cameras: int) -> Executor | None:
    """Return the executor for the work after the videos are processed.

    None for a pool of `open_local_processes` that has not begun, for example because all results of the videos were cached, if
    it would not save time on the remaining work (see `pays`).
    """
    idle = isinstance(executor, _LocalPool) and not executor.begun and not pays(n_bytes, n_cameras, executor.size)
    return None if idle else executor


@contextmanager
def open_local_processes(n_bytes: int, n_cameras: int, n_videos: int = 0) -> Iterator[Executor | None]:
    """Provide a pool of local processes, one per core and at most `MAX_PROCESSES`.

    None if the pool would not save time (see `pays`), or if the system allows none. Any `concurrent.futures.Executor` can take
    its place, that of a cluster too; results do not depend on it.
    Raises `InputError` if one of its processes was killed from outside.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    n_processes = min(cores, MAX_PROCESSES)
    if not pays(n_bytes, n_cameras, n_processes, n_videos):
        yield None
        return
    # Threads of libraries do not survive a fork; a spawned process takes slightly longer to start and is safe on all systems.
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool: _LocalPool | None = None
    with suppress(OSError):  # semaphores are not available: a container without shared memory, or a limit on the file size
        pool = _LocalPool(n_processes, context, _begin_process, (os.getpid(),))
    if pool is None:
        yield None
        return
    pool.size = n_processes
    try:
        yield pool
    except BaseException as error:
        # The work failed or was interrupted: the other results are not needed any more.
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        pool.shutdown(wait=False)
        if isinstance(error, BrokenExecutor):
            raise InputError(BROKEN) from error
        raise
    pool.shutdown()


@dataclass(frozen=True, eq=False)
class EarlierResults(Generic[Job, Result]):
    """The last result of each key; it is used again while the job of this key stays the same."""

    same: Callable[[Job, Job], bool]
    """Whether two jobs of one key have the same result."""
    _done: dict[Hashable, tuple[Job, Result]] = field(default_factory=dict)

    def side_by_side(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], keys: Sequence[Hashable], executor: Executor | None,
        tell: Progress, stage: str, *, job_s: float | None = None,
    ) -> list[Result]:  # fmt: skip
        """Return the results of all jobs, in their order. Only jobs that have no earlier result run.

        Args:
            function: as in `parallel.side_by_side`.
            jobs: as in `parallel.side_by_side`.
            keys: one key for each job; all different.
            executor: as in `parallel.side_by_side`.
            tell: called with the stage and the number of finished jobs, of those that run.
            stage: name of the stage.
            job_s: as in `parallel.side_by_side`.
        """
        new = [k for k, key in enumerate(keys) if key not in self._done or not self.same(self._done[key][0], jobs[k])]
        for k, result in zip(
            new, side_by_side(function, [jobs[k] for k in new], executor, tell, stage, job_s=job_s), strict=True
        ):
            self._done[keys[k]] = jobs[k], result
        return [self._done[key][1] for key in keys]
