"""Files of a folder that change together: all of them or none, even where the process is killed in between.

The new files are written into a folder of their own, `.writing`. Its renaming to `.written` decides: before, the old files are
what counts, after, the new ones. Then each takes its place; whoever comes to a folder that a killed process left in between
ends that first (`recover`).

Folders that appear whole or not at all.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import PART, cannot_write, sync_folder, write_text
from passerby.interchange.storage.locks import lock_file, lock_folder

WRITING, WRITTEN = ".writing", ".written"
GONE = ".gone.json"
"""In `.written`: files of the folder that are to go, as no new ones take their places."""
WAIT_S = 10.0
"""For a process that is about to put files into their places, which takes it milliseconds."""
NEW, OLD = "new", "old"
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""Of Linux: renameat2(2), <linux/fcntl.h> and <linux/fs.h>."""


@contextmanager
def folder_lock(folder: Path, work: str) -> Iterator[None]:
    """Keep a folder for this process while the block runs, and end first what a killed one has begun there.

    Arguments and errors as of `locks.alone_in`.
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
        come = {path.as_posix() for path in _below(new)}
        write_text(new / GONE, json.dumps(sorted({*gone} - come)))
        # A disk that is full is found out now, while nothing is decided.
        for path in _below(new):
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
    for name in _gone(written):
        (folder / name).unlink(missing_ok=True)
    paths = _below(written)
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        os.replace(written / path, folder / path)
    for place in {folder, *((folder / path).parent for path in paths)}:
        sync_folder(place)
    shutil.rmtree(written)


def _gone(written: Path) -> list[str]:
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


def _below(folder: Path) -> list[Path]:
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
