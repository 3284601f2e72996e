"""Work that is done side by side."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

MIN_CAMERAS = 4
"""Fewer have so few pairs that starting processes takes longer than they save."""


@contextmanager
def pair_executor(n_cameras: int) -> Iterator[Executor | None]:
    """A pool of local processes for pairs of cameras, one a core; None where it would not pay.

    Any `concurrent.futures.Executor` can take its place, that of a cluster too. Results do not depend on it.
    """
    workers = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, 8)
    if workers < 2 or n_cameras < MIN_CAMERAS:
        yield None
        return
    # Threads of libraries do not survive a fork; a fresh process takes a moment longer and is safe everywhere.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool
