"""Files of a folder that change together: all of them or none, even where the process is killed in between.

The new files are written into a folder of their own, `.writing`. Its renaming to `.written` decides: before, the old files are
what counts, after, the new ones. Then each takes its place; a process that comes to a folder that a killed process left
in between ends that first (`recover`).
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import PART, cannot_write, sync_folder, write_text
from passerby.interchange.storage.locks import lock_folder

WRITING, WRITTEN = ".writing", ".written"
GONE = ".gone.json"
"""In `.written`: files of the folder that are to go, as no new ones take their places."""
WAIT_S = 10.0
"""For a process that is about to put files into their places, which takes it milliseconds."""


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
