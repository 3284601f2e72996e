"""Work that is done side by side, and results of jobs that several estimates share."""

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
"""What processes take to start: most of it is the import of numpy and scipy, side by side."""
BYTE_S, PAIR_S = 3e-6, 0.07
"""What a byte of boxes takes to be made into tracklets, and a pair of cameras to be registered: measured on scenes of 4 to 8
cameras, a minute long. Rough figures do: near the threshold nothing is gained or lost."""
VIDEO_S = 5.0
"""What a video takes at the least; usually it is far more."""
ORPHANED_EVERY_S = 1.0
BROKEN = (
    "a process that worked on a camera was killed by the system, usually because memory ran out: close other programs and run "
    "the same command again; results of the videos so far are cached"
)


def side_by_side(
    function: Callable[[Job], Result], jobs: Sequence[Job], executor: Executor | None, tell: Progress, stage: str, *,
    job_s: float | None = None,
) -> list[Result]:  # fmt: skip
    """The results of all jobs, in their order.

    Args:
        function: of one job; a function of a module, and picklable with its jobs and results.
        jobs: what to do.
        executor: does them side by side; one after the other where it is None.
        tell: called with the stage, and each job that is done.
        stage: its name.
        job_s: what a job takes, roughly, seconds: an executor that has `least_s` is given so many at once that they take that.

    Where jobs end with one of the exceptions that an executor names as `died`, they are given to it again, one by one.
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
    # What several jobs of a batch have in common is sent once.
    batches = [jobs[begin : begin + size] for begin in range(0, len(jobs), size)]
    for batch in _results(executor, partial(_run_serially, function), batches):
        results.extend(batch)
        tell(stage, len(results), len(jobs))
    return results


def _results(
    executor: Executor, function: Callable[[Sequence[Job]], list[Result]], batches: Sequence[Sequence[Job]]
) -> Iterator[list[Result]]:
    """The results of an executor, in the order of the batches of jobs; those that wait are cancelled where one fails.

    Not so in a local pool, which is about to end: when its processes end before it has taken note that a job was cancelled,
    Python 3.11's pool reports that as an error of its own.
    """
    died: tuple[type[Exception], ...] = getattr(executor, "died", ())
    futures: list[Future[list[Result]]] = []
    try:
        with interrupted_later():  # Jobs are given one by one, and a process is begun for some of them.
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
    """A pool of `open_local_processes`, which kills its processes where a job fails or the work is interrupted."""

    size: int = 0
    begun: bool = False
    """Whether a job was given: a process begins with its first one."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As of `Executor`."""
        self.begun = True
        return super().submit(fn, *args, **kwargs)


@contextmanager
def interrupted_later() -> Iterator[None]:
    """Keep an interruption (Ctrl-C) waiting until the block has ended; in processes of a local pool, until they are prepared.

    For the block that gives jobs to an executor: a process that is half begun would say on the terminal at which line it was
    interrupted.
    """
    usual = signal.getsignal(signal.SIGINT)
    if usual is None or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    waiting: list[int] = []
    # The mask is for the new processes, which inherit it; the handler is for this one, of which any thread may get the signal.
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
    """The results of jobs, by one thread: more would wait for each other, and their number would change the last bits."""
    with threadpool_limits(limits=1, user_api="blas"):
        return [function(job) for job in jobs]


def _begin_process(parent: int) -> None:
    """Prepare a process of a pool: an interruption is its parent's to deal with, and it ends when its parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent is no more: a pool's processes would wait for work without end."""
    while os.getppid() == parent:
        time.sleep(ORPHANED_EVERY_S)
    os._exit(1)


def pays(n_bytes: int, n_cameras: int, n_processes: int, n_videos: int = 0) -> bool:
    """Whether processes save more time than they take to start.

    Args:
        n_bytes: size of the files of boxes and joints, together.
        n_cameras: number of cameras.
        n_processes: processes that would share the work.
        n_videos: number of videos in which people have to be found.
    """
    work_s = n_bytes * BYTE_S + n_cameras * (n_cameras - 1) / 2 * PAIR_S + n_videos * VIDEO_S
    return n_processes > 1 and work_s * (1 - 1 / n_processes) > STARTING_S


def worthwhile(executor: Executor | None, n_bytes: int, n_cameras: int) -> Executor | None:
    """The executor for what is left when the videos are processed.

    None for a pool of `open_local_processes` that has not begun, as where all results of videos were kept, and would not pay
    for the rest (see `pays`).
    """
    idle = isinstance(executor, _LocalPool) and not executor.begun and not pays(n_bytes, n_cameras, executor.size)
    return None if idle else executor


@contextmanager
def open_local_processes(n_bytes: int, n_cameras: int, n_videos: int = 0) -> Iterator[Executor | None]:
    """A pool of local processes, one a core; None where it would not pay (see `pays`), or where the system allows none.

    Any `concurrent.futures.Executor` can take its place, that of a cluster too. Results do not depend on it.
    Raises `InputError` where one of its processes was killed from outside.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    n_processes = min(cores, MAX_PROCESSES)
    if not pays(n_bytes, n_cameras, n_processes, n_videos):
        yield None
        return
    # Threads of libraries do not survive a fork; a fresh process takes a moment longer and is safe everywhere.
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool: _LocalPool | None = None
    with suppress(OSError):  # no semaphores: containers without shared memory, a limit on the size of files
        pool = _LocalPool(n_processes, context, _begin_process, (os.getpid(),))
    if pool is None:
        yield None
        return
    pool.size = n_processes
    try:
        yield pool
    except BaseException as error:
        # Interrupted: the rest is not needed any more.
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        pool.shutdown(wait=False)
        if isinstance(error, BrokenExecutor):
            raise InputError(BROKEN) from error
        raise
    pool.shutdown()


@dataclass(frozen=True, eq=False)
class EarlierResults(Generic[Job, Result]):
    """The last result of each key, used again for as long as its job is the same."""

    same: Callable[[Job, Job], bool]
    """Whether two jobs of one key have the same result."""
    _done: dict[Hashable, tuple[Job, Result]] = field(default_factory=dict)

    def side_by_side(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], keys: Sequence[Hashable], executor: Executor | None,
        tell: Progress, stage: str, *, job_s: float | None = None,
    ) -> list[Result]:  # fmt: skip
        """The results of all jobs, in their order: those that were not done before as of `parallel.side_by_side`.

        Args:
            function: of one job, as of `parallel.side_by_side`.
            jobs: what is to be done.
            keys: of each job; all different.
            executor: as of `parallel.side_by_side`.
            tell: called with the stage, and each job that is done again.
            stage: its name.
            job_s: as of `parallel.side_by_side`.
        """
        new = [k for k, key in enumerate(keys) if key not in self._done or not self.same(self._done[key][0], jobs[k])]
        for k, result in zip(
            new, side_by_side(function, [jobs[k] for k in new], executor, tell, stage, job_s=job_s), strict=True
        ):
            self._done[keys[k]] = jobs[k], result
        return [self._done[key][1] for key in keys]
