"""Places that one process at a time writes to. A lock ends with its process, even a killed one's."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import cannot_write

FOLDER_LOCK = ".passerby.lock"
"""In a folder while a process works in it. It is the system's lock on this file that counts, not that the file is there: one
that a killed process left behind blocks no other."""
POLL_S = 0.05
GONE_FOR_S, GONE_TIMES = 2.0, 20
"""So long, seconds, and so many times at the least it is tried to make a folder and to open the lock in it. A try fails where
another process removes the folder between the two. A count of tries would do on a quiet machine only: on a busy one nearly all
fail for a while; and a time on one that never lets this process wait: else it has gone by before the second try."""


@contextmanager
def lock_folder(folder: Path, work: str, wait_s: float = 0.0) -> Iterator[None]:
    """Keep a folder for this process while the block runs.

    The folder is made where it is missing, and removed again where nothing was put into it. Where the file system knows no
    locks, processes are not kept apart.

    Args:
        folder: of results.
        work: what is done, for those who are turned away: "passerby calibrate".
        wait_s: so long another process is waited for, seconds.

    Raises:
        InputError: another process has the folder (its number is stated), or the folder cannot be written.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        with lock_file(folder / FOLDER_LOCK, folder, work, wait_s):
            yield
    finally:
        for path in made:
            with suppress(OSError):  # not empty
                path.rmdir()


@contextmanager
def lock_file(path: Path, place: Path, work: str, wait_s: float = 0.0) -> Iterator[None]:
    """Hold the lock `path`, which stands for `place`; arguments and errors as of `lock_folder`."""
    file = _taken(path, place, wait_s)
    try:
        _sign(file, work)
        yield
    finally:
        # Deleted while it is held: a process that opened it meanwhile sees that the file with this name is another one.
        with suppress(OSError):
            path.unlink()
        file.close()


def try_lock(file: IO[bytes]) -> bool:
    """Try to lock a file, which lasts until it is closed. False where another process has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _taken(path: Path, place: Path, wait_s: float) -> IO[bytes]:
    """The locked file. Raises `InputError`."""
    until = time.monotonic() + wait_s
    while True:
        file = _opened(path, place)
        try:
            free = try_lock(file)
        except OSError:  # a file system without locks
            return file
        if free and _still_named(file, path):
            return file
        who = _holder(file)
        file.close()
        if not free and time.monotonic() >= until:
            raise InputError(f"{place}: {who} is running there now: wait until it has finished, or give another place")
        if not free:
            time.sleep(POLL_S)


def _opened(path: Path, place: Path) -> IO[bytes]:
    """The lock's file, open, in its folder. Raises `InputError` where it cannot be made.

    The folder is removed by a holder that has put nothing into it. That may happen between any two calls here, and a third
    process may have made it anew before one asks whether it is there; so nothing is asked, and all of it is tried again.
    """
    until, tries = time.monotonic() + GONE_FOR_S, 0
    while True:
        tries += 1
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            return path.open("a+b", buffering=0)  # what a full disk does not take is not tried again at the end
        except (FileNotFoundError, FileExistsError) as error:
            if tries >= GONE_TIMES and time.monotonic() >= until:
                raise cannot_write(place, error) from error
            time.sleep(0.001)
        except OSError as error:
            raise cannot_write(place, error) from error


def _still_named(file: IO[bytes], path: Path) -> bool:
    """Whether the open file is the one that has this name now, and not one whose holder has just deleted it."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _sign(file: IO[bytes], work: str) -> None:
    """Say who holds the lock. A disk that is full does not matter here: it is the lock that counts."""
    with suppress(OSError):
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()} ({work})".encode())
        file.flush()


def _holder(file: IO[bytes]) -> str:
    """Who holds a lock, as it signed."""
    try:
        file.seek(0)
        told = file.read(200).decode("utf-8", "replace")
    except OSError:  # Windows: what is locked cannot be read
        told = ""
    return " ".join(told.split()) or "another process"
