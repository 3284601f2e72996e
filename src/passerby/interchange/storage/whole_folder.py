"""Folders that appear whole or not at all."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import PART, cannot_write, sync_folder
from passerby.interchange.storage.locks import lock_file

NEW, OLD = "new", "old"
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""Of Linux: renameat2(2), <linux/fcntl.h> and <linux/fs.h>."""


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
