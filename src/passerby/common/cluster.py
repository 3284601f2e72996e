"""Work on other machines: an executor for the workers of a Dask cluster. The workers are checked before they get jobs.

Videos, models and the output folder are on shared storage: every worker sees them under the same paths. A job is a function of
its arguments alone. So results do not depend on which worker did a job. Dask gives the jobs of a worker that died to others.
"""

from __future__ import annotations

import asyncio
import errno
import os
import platform
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

import numpy as np
import scipy

from passerby._version import __version__
from passerby.common.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")

EXTRA = "a Dask cluster needs the package distributed: install passerby[cluster]"
CONNECT_S = 15.0
"""Maximum time in which a scheduler must answer, seconds."""
LEAST_S = 2.0
"""Minimum duration of the jobs that a worker gets at once, seconds: for small jobs the transfer would take most of the time."""
OTHER_VERSION = "{worker}: has {what} {theirs}, here is {ours}: install the same version on all machines"
FAILING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE)
"""Error numbers of a machine that cannot do any job."""


class ClusterExecutor(Executor):
    """Gives jobs to the workers of a cluster. Each job runs in the folder from which it was submitted."""

    least_s = LEAST_S

    def __init__(self, client: Client) -> None:
        from distributed import KilledWorker

        self.died: tuple[type[Exception], ...] = (KilledWorker,)
        """Exceptions of a job whose workers died one after the other: by its fault, or because it was long and many died."""
        # Dask does not recognise equal jobs by their arguments: hashes of arrays would cost more time than they save.
        self._inner: Executor = client.get_executor(pure=False)  # type: ignore[no-untyped-call]
        self._folder, self._versions = Path.cwd(), _versions()

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Submit a job, as `Executor.submit` does."""
        future: Future[Result] = self._inner.submit(_run_in_folder, self._folder, self._versions, fn, args, kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut down the executor, as `Executor.shutdown` does."""
        self._inner.shutdown(wait=wait and not cancel_futures)


@contextmanager
def cluster_workers(address: str, shared: Path, files: Sequence[Path] = ()) -> Iterator[Executor]:
    """Provide the workers of a Dask cluster as an executor.

    Args:
        address: address of the scheduler, as tcp://host:8786.
        shared: a folder into which all workers write.
        files: the files that the workers read.

    Raises:
        InputError: distributed is not installed; no scheduler answers, or it has no workers; the scheduler or a worker has
            another version; a worker does not see a file or the folder, or cannot write into it. Raised at the end if all
            workers that tried a job died, or if the scheduler died.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed.comm.core import CommClosedError
    except ImportError:
        raise InputError(EXTRA) from None
    with _connect(Client, address) as client:
        _check_workers(client, address, shared, files)
        executor = ClusterExecutor(client)
        try:
            yield executor
        except KilledWorker as error:
            raise InputError(
                f"{address}: workers died again and again at one job ({error.last_worker.address} the last): usually memory "
                "ran out: give each worker more memory, and run the same command again; what is finished is kept"
            ) from error
        except (CancelledError, CommClosedError) as error:
            raise InputError(
                f"{address}: the scheduler does not answer any more: start it, and run the same command again; what is "
                "finished is kept"
            ) from error
        finally:
            executor.shutdown(wait=False)


@contextmanager
def _connect(kind: type[Client], address: str) -> Iterator[Client]:
    """Connect a client to the scheduler and close it at the end."""
    try:
        # Dask never closes a client that finds no scheduler. Its garbage collection then blocks any thread for 30 s.
        with ThreadPoolExecutor(1) as thread:
            theirs = thread.submit(asyncio.run, _version_of(address)).result()
        if theirs != _dask():  # the protocol between two different versions is not defined
            who = f"--scheduler {address}"
            raise InputError(OTHER_VERSION.format(worker=who, what="distributed (Dask)", theirs=theirs, ours=_dask()))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # versions are compared below
            client = kind(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({why}): start one by `dask scheduler`, and give its "
            "address, as tcp://host:8786"
        ) from None
    try:
        yield client
    finally:
        client.close(timeout=1)  # type: ignore[no-untyped-call]


async def _version_of(address: str) -> str | None:
    """Ask the scheduler for its version of distributed; None if it has none.

    Raises `OSError` or `ValueError` if no scheduler answers.
    """
    from distributed.core import rpc

    async with rpc(address, timeout=CONNECT_S) as scheduler:  # type: ignore[no-untyped-call]
        told = await asyncio.wait_for(scheduler.versions(), CONNECT_S)
    version = told["packages"].get("distributed")
    return None if version is None else str(version)


def _check_workers(client: Client, address: str, shared: Path, files: Sequence[Path]) -> None:
    """Raise an `InputError` that lists all faults of the workers."""
    names = sorted(client.scheduler_info(n_workers=-1)["workers"])
    if not names:
        raise InputError(f"{address}: the scheduler has no workers: start some by `dask worker {address} --nthreads 1`")
    shared.mkdir(parents=True, exist_ok=True)
    mark = shared / f".shared-{uuid4().hex}"
    mark.write_bytes(b"")
    try:
        paths = [os.path.abspath(path) for path in (*files, mark)]
        written = str(mark) if files else None
        found = client.run(_inspect_worker, str(Path.cwd()), paths, written, on_error="return")
    finally:
        mark.unlink(missing_ok=True)
    faults = [fault for name in sorted(found) for fault in _faults(name, found[name], mark, shared)]
    if faults:
        raise InputError("\n".join(faults))


def _inspect_worker(folder: str, paths: Sequence[str], written: str | None) -> dict[str, Any]:
    """Find, on a worker, its versions, the paths that it does not see, and why it cannot write beside the file `written`."""
    missing = [path for path in (folder, *paths) if not os.path.exists(path)]
    why = None if written is None or written in missing else _explain_unwritable(Path(f"{written}-{uuid4().hex}"))
    return {"versions": _versions(), "missing": missing, "unwritable": why}


def _explain_unwritable(path: Path) -> str | None:
    """Return the reason why a file cannot be written; None if it can be."""
    try:
        with path.open("wb", buffering=0) as file:
            file.write(b"passerby")
            os.fsync(file.fileno())
    except OSError as error:
        return error.strerror or str(error)
    finally:
        with suppress(OSError):
            path.unlink()
    return None


def _versions() -> dict[str, str]:
    """Return the versions of what affects the last digits of a result, and of the protocol between the machines."""
    python = ".".join(platform.python_version_tuple()[:2])
    by = {"passerby": __version__, "Python": python, "numpy": np.__version__, "scipy": scipy.__version__}
    return by | {"distributed": _dask()}


@cache
def _dask() -> str:
    return metadata.version("distributed")


def _faults(worker: str, found: Any, mark: Path, shared: Path) -> list[str]:
    """List the faults of a worker, one line each."""
    if not isinstance(found, Mapping):
        told = f"{type(found).__name__}: {found}".splitlines()[0]
        return [f"{worker}: cannot run Passerby ({told}): install passerby {__version__} there"]
    faults = [
        OTHER_VERSION.format(worker=worker, what=what, theirs=found["versions"].get(what), ours=ours)
        for what, ours in _versions().items()
        if found["versions"].get(what) != ours
    ]
    for path in found["missing"]:
        seen = shared if Path(path).name == mark.name else Path(path)
        faults.append(f"{worker}: does not see {seen}: put it on storage that all machines share, under the same path")
    if found["unwritable"] is not None:
        faults.append(f"{worker}: cannot write into {shared} ({found['unwritable']}): make room there, or let it write there")
    return faults


def _run_in_folder(
    folder: Path, versions: Mapping[str, str], function: Callable[..., Result], args: Sequence[Any], kwargs: Mapping[str, Any]
) -> Result:
    """Run a job, on a worker, in the folder from which it was submitted."""
    if versions != _versions():  # a worker that joined later was not checked
        what = next(name for name, ours in versions.items() if _versions().get(name) != ours)
        theirs, ours = _versions().get(what), versions[what]
        raise InputError(OTHER_VERSION.format(worker=platform.node(), what=what, theirs=theirs, ours=ours))
    try:
        if Path.cwd() != folder:
            os.chdir(folder)
        return function(*args, **kwargs)
    except OSError as error:
        if error.errno not in FAILING:
            raise
        what = error.filename or "a temporary file"
        raise InputError(
            f"{platform.node()}: {what}: cannot be written or read ({error.strerror}): make room on that machine, or stop its "
            "workers, and run the same command again; what is finished is kept"
        ) from error
