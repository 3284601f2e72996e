"""Work on other machines: an executor for the workers of a Dask cluster, which are looked at before anything is given to them.

Videos, models and the output folder are shared storage: every worker sees them under the same paths. A job is a function of its
arguments alone, so that results do not depend on who did it, nor on a worker that died: Dask gives its jobs to others.
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
"""How long a scheduler may take to answer."""
LEAST_S = 2.0
"""What is given to a worker at once takes so long or more: small jobs would spend their time on the way."""
OTHER_VERSION = "{worker}: has {what} {theirs}, here is {ours}: install the same version on all machines"
FAILING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE)
"""Of a machine that cannot work on, whatever the job."""


class ClusterExecutor(Executor):
    """Gives jobs to the workers of a cluster, each job with the folder that it was given in."""

    least_s = LEAST_S

    def __init__(self, client: Client) -> None:
        from distributed import KilledWorker

        self.died: tuple[type[Exception], ...] = (KilledWorker,)
        """What a job ends with whose workers died one after the other: by its fault, or because it was long and many died."""
        # Nothing is known of a job by its arguments: tokens of arrays would cost more than they save.
        self._inner: Executor = client.get_executor(pure=False)  # type: ignore[no-untyped-call]
        self._folder, self._versions = Path.cwd(), _versions()

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """As of every executor."""
        future: Future[Result] = self._inner.submit(_run_in_folder, self._folder, self._versions, fn, args, kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of every executor."""
        self._inner.shutdown(wait=wait and not cancel_futures)


@contextmanager
def cluster_workers(address: str, shared: Path, files: Sequence[Path] = ()) -> Iterator[Executor]:
    """The workers of a Dask cluster as an executor.

    Args:
        address: of the scheduler, as tcp://host:8786.
        shared: a folder that all workers write to.
        files: what they read.

    Raises:
        InputError: distributed is not installed; no scheduler there; no workers; a scheduler or a worker of another version, or
            a worker that does not see a file or the folder, or cannot write into it; and at the end, where all workers that
            tried a job died, or the scheduler did.
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
    """A client of the scheduler."""
    try:
        # Dask never closes a client that finds no scheduler: its end, by the garbage collector, stops any thread for 30 s.
        with ThreadPoolExecutor(1) as thread:
            theirs = thread.submit(asyncio.run, _version_of(address)).result()
        if theirs != _dask():  # what those of two versions say to each other is not fixed
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
    """The scheduler's version of distributed. Raises `OSError` or `ValueError` where no scheduler answers."""
    from distributed.core import rpc

    async with rpc(address, timeout=CONNECT_S) as scheduler:  # type: ignore[no-untyped-call]
        told = await asyncio.wait_for(scheduler.versions(), CONNECT_S)
    version = told["packages"].get("distributed")
    return None if version is None else str(version)


def _check_workers(client: Client, address: str, shared: Path, files: Sequence[Path]) -> None:
    """Raise `InputError` with all that is wrong with the workers."""
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
    """On a worker: its versions, which paths it does not see, and why it cannot write beside the file `written`."""
    missing = [path for path in (folder, *paths) if not os.path.exists(path)]
    why = None if written is None or written in missing else _explain_unwritable(Path(f"{written}-{uuid4().hex}"))
    return {"versions": _versions(), "missing": missing, "unwritable": why}


def _explain_unwritable(path: Path) -> str | None:
    """Why a file cannot be written; None where it can be."""
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
    """Of all that can change the last digits of a result, and of what the machines talk by."""
    python = ".".join(platform.python_version_tuple()[:2])
    by = {"passerby": __version__, "Python": python, "numpy": np.__version__, "scipy": scipy.__version__}
    return by | {"distributed": _dask()}


@cache
def _dask() -> str:
    return metadata.version("distributed")


def _faults(worker: str, found: Any, mark: Path, shared: Path) -> list[str]:
    """What is wrong with a worker, one line each."""
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
    """On a worker: a job, in the folder that it was given in."""
    if versions != _versions():  # of a worker that came later
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
