"""Cases that are run side by side, each kept as soon as it is finished, so that a stopped run goes on."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

from pages.kept import Kept

ROOT = Path(__file__).resolve().parents[2]
CODE = ("reliability",)
"""Folders of the benchmarks that the figures depend on, beside the package."""
TOLD_EVERY_S = 20.0


@dataclass(frozen=True)
class Wanted:
    """What the user asks of the parts."""

    kept: Path
    """Folder of finished cases."""
    quick: bool = False
    """A few cases of each kind: to see that all works, not to judge."""
    workers: int = 2
    data: Path | None = None
    """Folder of the real data sets; None where there is none."""


def kept(
    wanted: Wanted, name: str, cases: Mapping[str, Any], work: Callable[[Any], Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """The results of all cases by key, in the order of `cases`.

    Each is kept as soon as it is there; those of the same code are not run again.

    Args:
        wanted: where results are kept, and how many processes work.
        name: of the part; a quick run has results of its own.
        cases: key -> argument of `work`; both must be picklable, `work` a function of a module.
        work: JSON-ready figures of one case. Its exceptions end the run: a case that may fail has to say so in its figures.
    """
    store, run = Kept(wanted.kept, CODE), f"{name}{' quick' if wanted.quick else ''}"
    known = {key: store.get(f"{run} {key}") for key in cases}
    done = {key: result for key, result in known.items() if result is not None}
    todo = [key for key in cases if key not in done]
    began = told = time.monotonic()
    with ProcessPoolExecutor(wanted.workers, initializer=_one_thread) as pool:
        futures: dict[Future[Mapping[str, Any]], str] = {pool.submit(work, cases[key]): key for key in todo}
        for count, future in enumerate(as_completed(futures), 1):
            key = futures[future]
            done[key] = dict(future.result())
            store.put(f"{run} {key}", done[key])
            if time.monotonic() - told > TOLD_EVERY_S or count == len(todo):
                told = time.monotonic()
                left = (told - began) / count * (len(todo) - count)
                print(f"{name}: {count} of {len(todo)} cases, about {left / 60:.0f} min left", file=sys.stderr, flush=True)
    return {key: done[key] for key in cases}


def _one_thread() -> None:
    """Processes that share the cores do not fight for them with threads of their own, nor for their parent's fork server."""
    from threadpoolctl import threadpool_limits

    server: Any = forkserver._forkserver
    server._forkserver_address = server._forkserver_alive_fd = server._forkserver_pid = None
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    threadpool_limits(limits=1)


def percent(part: float, whole: float) -> str:
    """A share in percent; a dash where there is nothing to share."""
    return f"{100 * part / whole:.1f} %" if whole else "-"


def seeds(start: int, count: int) -> Sequence[int]:
    """Seeds of a published run start at 100,000 or above; those below are for trying things out."""
    return range(start, start + count)
