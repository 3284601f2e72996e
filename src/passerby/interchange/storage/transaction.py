"""Files and folders that change as a whole or not at all, even if a process is killed, and locks on them.

A transaction writes the new files into a separate folder, `.writing`. Renaming this folder to `.written` commits it: before,
the old files are valid, afterwards the new ones. Then each new file is moved to its place. If a process was killed in between,
the next process that uses the folder completes the move first (`recover`).

`whole_folder` replaces a folder as a whole or not at all.

Locks let only one process at a time write to a place. A lock ends with its process, even if the process is killed.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import PART, cannot_write, sync_folder, write_text

WRITING, WRITTEN = ".writing", ".written"
GONE = ".gone.json"
"""File in `.written` with the names of the folder's files that are to be deleted, because no new files replace them."""
WAIT_S = 10.0
"""Time to wait for a process that moves files to their places, seconds. The move itself takes milliseconds."""
NEW, OLD = "new", "old"
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""Constants of Linux: renameat2(2), <linux/fcntl.h> and <linux/fs.h>."""
FOLDER_LOCK = ".passerby.lock"
"""File in a folder while a process works in it. The system's lock on this file counts, not its existence: a file that a killed
process left behind blocks no other process."""
POLL_S = 0.05
GONE_FOR_S, GONE_TIMES = 2.0, 20
"""Least time, seconds, and least number of attempts to make a folder and to open the lock in it. An attempt fails if another
process removes the folder between the two steps. A number alone is not enough on a busy machine, where nearly all attempts fail
for a while. A time alone is not enough if this process is suspended: the time may be over before the second attempt."""


@contextmanager
def folder_lock(folder: Path, work: str) -> Iterator[None]:
    """Lock a folder for this process while the block runs. First complete or discard what a killed process left there.

    Arguments and errors as of `lock_folder`.
    """
    with lock_folder(folder, work):
        try:
            finish(folder)
            shutil.rmtree(folder / WRITING, ignore_errors=True)
        except OSError as error:
            raise cannot_write(folder, error) from error
        yield


@contextmanager
def transaction(folder: Path, gone: Iterable[str] = ()) -> Iterator[Path]:
    """Make a new folder to write files into. When the block ends without an exception, they all move to `folder`.

    Only one process at a time may do so: the caller must hold the folder's lock (`folder_lock`).

    Args:
        folder: made where it is missing; files in it with other names stay.
        gone: names of files in it that are deleted when the new files are moved, unless new files replace them.

    Raises:
        InputError: the folder cannot be written. If `.written` does not exist then, nothing in the folder has changed.
    """
    new = folder / WRITING
    try:
        shutil.rmtree(new, ignore_errors=True)
        new.mkdir(parents=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    try:
        yield new
        come = {path.as_posix() for path in _list_files(new)}
        write_text(new / GONE, json.dumps(sorted({*gone} - come)))
        # A full disk is detected here, before the commit.
        for path in _list_files(new):
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            if (folder / path).is_dir():
                raise IsADirectoryError(errno.EISDIR, f"{path} is a folder")
        os.rename(new, folder / WRITTEN)
        sync_folder(folder)
        finish(folder)
    except OSError as error:
        raise cannot_write(folder, error) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def recover(folder: Path, work: str) -> None:
    """Complete the committed transaction of a killed process in a folder, if there is one.

    Args:
        folder: the folder, which is about to be read.
        work: name of this work, for the messages of other processes that find the folder locked.

    Raises:
        InputError: a transaction has to be completed, but the folder cannot be written.
    """
    if not (folder / WRITTEN).is_dir():
        return
    try:
        with lock_folder(folder, work, WAIT_S):
            finish(folder)
    except OSError as error:
        raise cannot_write(folder, error) from error


def finish(folder: Path) -> None:
    """Move committed files to their places. The caller must hold the folder's lock. Raises `OSError`."""
    written = folder / WRITTEN
    if not written.is_dir():
        return
    for name in _list_deletions(written):
        (folder / name).unlink(missing_ok=True)
    paths = _list_files(written)
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        os.replace(written / path, folder / path)
    for place in {folder, *((folder / path).parent for path in paths)}:
        sync_folder(place)
    shutil.rmtree(written)


def _list_deletions(written: Path) -> list[str]:
    """Read the names of the files to delete. Names that lead out of the folder are ignored."""
    try:
        names = json.loads((written / GONE).read_text(encoding="utf-8"))
        if not isinstance(names, list):
            raise ValueError("it is no list of names")
    except FileNotFoundError:
        return []
    except ValueError as error:
        raise InputError(f"{written / GONE}: is damaged ({error}): delete {written} and run the last command again") from None
    return [name for name in names if isinstance(name, str) and not Path(name).is_absolute() and ".." not in Path(name).parts]


def _list_files(folder: Path) -> list[Path]:
    """List the files to move, relative to the folder, in the order of their names."""
    files = (path.relative_to(folder) for path in sorted(folder.rglob("*")) if path.is_file())
    return [path for path in files if path.name != GONE and not path.name.endswith(PART)]


@contextmanager
def whole_folder(directory: str | Path, marker: str, kind: str) -> Iterator[Path]:
    """Make a new folder to write into. It replaces `directory` when the block ends without an exception.

    One process at a time makes it. If this process is killed, the old content is not lost.

    Args:
        directory: replaced as a whole where it holds the file `marker`; may be missing or empty.
        marker: a file that every folder of this kind has.
        kind: name of this kind of folder in messages ("a scene made from a data set").

    Raises:
        InputError: `directory` is a file, holds something else, or cannot be written; or another process is writing it.
    """
    directory = Path(directory)
    target = directory.resolve()
    with lock_file(target.with_name(f".{target.name}.lock"), directory, f"writes {kind}"):
        try:
            _recover(target)
        except OSError as error:
            raise cannot_write(directory, error) from error
        _check(directory, marker, kind)
        with _workshop(directory, target) as new:
            yield new


def _check(directory: Path, marker: str, kind: str) -> None:
    """Raise `InputError` where a folder may not be replaced."""
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file: give a folder")
    if directory.is_dir() and any(directory.iterdir()) and not (directory / marker).is_file():
        raise InputError(f"{directory}: holds something other than {kind}: give a new or an empty folder")


@contextmanager
def _workshop(directory: Path, target: Path) -> Iterator[Path]:
    """Make a temporary folder beside the target, which replaces the target when the block ends without an exception."""
    try:
        workshop = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=PART))
    except OSError as error:
        raise cannot_write(directory, error) from error
    new = workshop / NEW
    try:
        new.mkdir()
        yield new
        _take_place(new, target, workshop / OLD)
        sync_folder(target.parent)
    except OSError as error:
        raise cannot_write(directory, error) from error
    finally:
        # If the old folder could not be put back, it stays there for the next run.
        if target.exists() or not (workshop / OLD).exists():
            shutil.rmtree(workshop, ignore_errors=True)


def _take_place(new: Path, target: Path, old: Path) -> None:
    """Rename `new` to `target`. An existing target is moved to `old`, or exchanged with `new`. Raises `OSError`."""
    if not target.exists():
        new.rename(target)
    elif not exchange_folders(new, target):
        target.rename(old)
        try:
            new.rename(target)
        except OSError:
            old.rename(target)
            raise


def exchange_folders(one: Path, other: Path) -> bool:
    """Exchange two folders in one step, so that both exist at all times. Return False where the system cannot do this."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError, TypeError):  # not Linux, or an old library
        return False
    rename.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint)
    done: int = rename(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE)
    return done == 0


def _recover(target: Path) -> None:
    """Restore the folder that a killed process had moved away, and delete its unfinished folders. Raises `OSError`."""
    left = re.compile(re.escape(f".{target.name}.") + "[a-z0-9_]{8}" + re.escape(PART))
    for workshop in sorted(target.parent.glob(".*")):
        if left.fullmatch(workshop.name) is None or not workshop.is_dir():
            continue
        if (workshop / OLD).exists() and not target.exists():
            (workshop / OLD).rename(target)
        shutil.rmtree(workshop, ignore_errors=True)


@contextmanager
def lock_folder(folder: Path, work: str, wait_s: float = 0.0) -> Iterator[None]:
    """Lock a folder for this process while the block runs.

    The folder is made where it is missing, and removed again if nothing was put into it. On a file system without locks, other
    processes are not excluded.

    Args:
        folder: the folder of results.
        work: name of the work, as in "passerby calibrate", for the messages of processes that find the folder locked.
        wait_s: time to wait for another process, seconds.

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
    """Hold the lock file `path`, which protects `place`; arguments and errors as of `lock_folder`."""
    file = _take_lock(path, place, wait_s)
    try:
        _sign(file, work)
        yield
    finally:
        # Delete the file while it is locked: a process that has opened it sees that the file no longer has this name.
        with suppress(OSError):
            path.unlink()
        file.close()


def try_lock(file: IO[bytes]) -> bool:
    """Try to lock a file until it is closed. Return False where another process has locked it."""
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


def _take_lock(path: Path, place: Path, wait_s: float) -> IO[bytes]:
    """Open and lock the lock's file, and return it. Raises `InputError`."""
    until = time.monotonic() + wait_s
    while True:
        file = _open_lock(path, place)
        try:
            free = try_lock(file)
        except OSError:  # a file system without locks
            return file
        if free and _has_name(file, path):
            return file
        who = _holder(file)
        file.close()
        if not free and time.monotonic() >= until:
            raise InputError(f"{place}: {who} is running there now: wait until it has finished, or give another place")
        if not free:
            time.sleep(POLL_S)


def _open_lock(path: Path, place: Path) -> IO[bytes]:
    """Make the folder of a lock, and open the lock's file in it. Raises `InputError` where it cannot be made.

    A holder that has put nothing into the folder removes it. This may happen between any two calls here, and a third process
    may make the folder again in between. Therefore its existence is not checked; both steps are repeated instead.
    """
    until, tries = time.monotonic() + GONE_FOR_S, 0
    while True:
        tries += 1
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            return path.open("a+b", buffering=0)  # unbuffered: no second attempt to write at closing on a full disk
        except (FileNotFoundError, FileExistsError) as error:
            if tries >= GONE_TIMES and time.monotonic() >= until:
                raise cannot_write(place, error) from error
            time.sleep(0.001)
        except OSError as error:
            raise cannot_write(place, error) from error


def _has_name(file: IO[bytes], path: Path) -> bool:
    """Check whether the open file still has this name, and was not deleted by its holder."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _sign(file: IO[bytes], work: str) -> None:
    """Write the holder of the lock into its file. Errors, as of a full disk, are ignored: only the lock counts."""
    with suppress(OSError):
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()} ({work})".encode())
        file.flush()


def _holder(file: IO[bytes]) -> str:
    """Read the holder of a lock, as `_sign` wrote it."""
    try:
        file.seek(0)
        told = file.read(200).decode("utf-8", "replace")
    except OSError:  # Windows: a locked file cannot be read
        told = ""
    return " ".join(told.split()) or "another process"
