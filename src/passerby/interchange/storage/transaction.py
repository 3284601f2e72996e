"""Files and folders that change as a whole or not at all, even where a process is killed, and locks on them.

The new files are written into a folder of their own, `.writing`. Its renaming to `.written` decides: before, the old files are
what counts, after, the new ones. Then each takes its place; a process that comes to a folder that a killed process left
in between ends that first (`recover`).

Folders that appear whole or not at all.

Places that one process at a time writes to. A lock ends with its process, even a killed one's.
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
"""In `.written`: files of the folder that are to go, as no new ones take their places."""
WAIT_S = 10.0
"""For a process that is about to put files into their places, which takes it milliseconds."""
NEW, OLD = "new", "old"
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""Of Linux: renameat2(2), <linux/fcntl.h> and <linux/fs.h>."""
FOLDER_LOCK = ".passerby.lock"
"""In a folder while a process works in it. It is the system's lock on this file that counts, not that the file is there: one
that a killed process left behind blocks no other."""
POLL_S = 0.05
GONE_FOR_S, GONE_TIMES = 2.0, 20
"""So long, seconds, and so many times at the least it is tried to make a folder and to open the lock in it. A try fails where
another process removes the folder between the two. A count of tries would do on a quiet machine only: on a busy one nearly all
fail for a while; and a time on one that never lets this process wait: else it has gone by before the second try."""


@contextmanager
def folder_lock(folder: Path, work: str) -> Iterator[None]:
    """Keep a folder for this process while the block runs, and end first what a killed one has begun there.

    Arguments and errors as of `alone_in`.
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
    """A new folder to write files into; when the block ends without an exception, all of them take their places in `folder`.

    Only one process at a time may do so: hold the folder's lock (`folder_lock`).

    Args:
        folder: made where it is missing; files in it with other names stay.
        gone: names of files in it that go when the new ones come, as far as no new ones take their places.

    Raises:
        InputError: the folder cannot be written. As long as `.written` is not there, nothing in it has changed then.
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
        # A disk that is full is found out now, while nothing is decided.
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
    """End what a killed process has begun in a folder; nothing to do in nearly all cases.

    Args:
        folder: that is about to be read.
        work: who reads, for others that are turned away meanwhile.

    Raises:
        InputError: the folder cannot be written, and has to be.
    """
    if not (folder / WRITTEN).is_dir():
        return
    try:
        with lock_folder(folder, work, WAIT_S):
            finish(folder)
    except OSError as error:
        raise cannot_write(folder, error) from error


def finish(folder: Path) -> None:
    """Put decided files into their places, by the holder of the folder's lock. Raises `OSError`."""
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
    """What is to go; names that lead out of the folder are none of ours."""
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
    """The files that are to be put into their places, relative, in the order of their names."""
    files = (path.relative_to(folder) for path in sorted(folder.rglob("*")) if path.is_file())
    return [path for path in files if path.name != GONE and not path.name.endswith(PART)]


@contextmanager
def whole_folder(directory: str | Path, marker: str, kind: str) -> Iterator[Path]:
    """A new folder to write into; it takes the place of `directory` when the block ends without an exception.

    One process at a time makes it; one that is killed loses nothing that was there before it.

    Args:
        directory: replaced as a whole where it holds the file `marker`; may be missing or empty.
        marker: a file that every folder of this kind has.
        kind: what a message calls it ("a scene made from a data set").

    Raises:
        InputError: `directory` is a file, holds something else, or cannot be written; another process makes it just now.
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
    """A folder beside the target, which changes places with it."""
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
        # Where the old folder could not be put back, it waits there for the next run.
        if target.exists() or not (workshop / OLD).exists():
            shutil.rmtree(workshop, ignore_errors=True)


def _take_place(new: Path, target: Path, old: Path) -> None:
    """Give a folder its name; one that has it goes to `old`, or to where the new one was. Raises `OSError`."""
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
    """Let two folders change places at once, so that there is no moment without either; False where the system cannot."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError, TypeError):  # not Linux, or an old library
        return False
    rename.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint)
    done: int = rename(AT_FDCWD, os.fsencode(one), AT_FDCWD, os.fsencode(other), RENAME_EXCHANGE)
    return done == 0


def _recover(target: Path) -> None:
    """Put back what a process that was killed had moved away, and delete what it had not finished. Raises `OSError`."""
    left = re.compile(re.escape(f".{target.name}.") + "[a-z0-9_]{8}" + re.escape(PART))
    for workshop in sorted(target.parent.glob(".*")):
        if left.fullmatch(workshop.name) is None or not workshop.is_dir():
            continue
        if (workshop / OLD).exists() and not target.exists():
            (workshop / OLD).rename(target)
        shutil.rmtree(workshop, ignore_errors=True)


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
    file = _take_lock(path, place, wait_s)
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


def _take_lock(path: Path, place: Path, wait_s: float) -> IO[bytes]:
    """The locked file. Raises `InputError`."""
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


def _has_name(file: IO[bytes], path: Path) -> bool:
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
