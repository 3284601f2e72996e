"""A Dask cluster of real processes on loopback, and a hand that kills its workers in turn. For the tests of clusters too."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
PATIENCE_S = 120  # how long a process may take to begin: seconds, on a busy machine many
UNTOLD = (".lock",)  # endings of files that only help the next run

Process = subprocess.Popen[bytes]


def begin(*arguments: str, cwd: Path | None = None) -> Process:
    """A process of `dask`."""
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    return subprocess.Popen(command, env=ENVIRONMENT, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wait_for(condition: Callable[[], bool]) -> None:
    """Raises `TimeoutError` where it does not come true."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(0.1)


SCHEDULER, WORKER = ("scheduler",), ("worker", "tcp://host:8786", "--nthreads", "1")


@contextmanager
def scheduler(command: Sequence[str] = SCHEDULER) -> Iterator[tuple[str, Process]]:
    """Its address and process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = begin(*command, "--host", "127.0.0.1", "--port", str(port))
    try:
        wait_for(lambda: _answers(port))
        yield f"tcp://127.0.0.1:{port}", process
    finally:
        end_all([process])


@contextmanager
def workers(address: str, folder: Path, count: int, command: Sequence[str] = WORKER) -> Iterator[list[Process]]:
    """Worker processes with their files in `folder`, each with a nanny that begins it again when it dies."""
    from distributed import Client

    folder.mkdir()
    name, _, *options = command
    found = [begin(name, address, *options, "--local-directory", str(folder)) for _ in range(count)]
    try:
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=PATIENCE_S)
        yield found
    finally:
        end_all(found)


@contextmanager
def killing(nannies: Sequence[Process], first_s: float, every_s: float) -> Iterator[list[int]]:
    """Workers die in turn, without warning, while the block runs; the numbers of the processes that were killed."""
    import psutil

    killed: list[int] = []
    done = threading.Event()

    def kill_in_turn() -> None:
        turn = 0
        while not done.wait(every_s if turn else first_s):
            children = psutil.Process(nannies[turn % len(nannies)].pid).children(recursive=True)
            for one in [child for child in children if child.is_running()][-1:]:
                one.send_signal(signal.SIGKILL)
                killed.append(one.pid)
            turn += 1

    thread = threading.Thread(target=kill_in_turn)
    thread.start()
    try:
        yield killed
    finally:
        done.set()
        thread.join()


def contents(folder: Path) -> dict[str, bytes]:
    """All files of an output folder, but for those that only help the next run."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "association" not in path.parts and path.suffix not in UNTOLD
    }


def end_all(processes: Sequence[Process]) -> None:
    """End processes with all that they began."""
    import psutil

    for process in processes:
        if process.poll() is None:
            for one in [*psutil.Process(process.pid).children(recursive=True), process]:
                with suppress(psutil.NoSuchProcess):  # ended meanwhile by itself
                    one.kill()
        process.wait()


def _answers(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0
