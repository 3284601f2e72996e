"""Folders that appear whole or not at all."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from passerby.errors import InputError
from passerby.interchange.atomic import PART, cannot_write, sync_folder
from passerby.interchange.locks import lock_file

NEW, OLD = "new", "old"


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
    new, old = workshop / NEW, workshop / OLD
    try:
        new.mkdir()
        yield new
        if target.exists():
            target.rename(old)
        new.rename(target)
        sync_folder(target.parent)
    except OSError as error:
        raise cannot_write(directory, error) from error
    finally:
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(workshop, ignore_errors=True)


def _recover(target: Path) -> None:
    """Put back what a process that was killed had moved away, and delete what it had not finished. Raises `OSError`."""
    left = re.compile(re.escape(f".{target.name}.") + "[a-z0-9_]{8}" + re.escape(PART))
    for workshop in sorted(target.parent.glob(".*")):
        if left.fullmatch(workshop.name) is None or not workshop.is_dir():
            continue
        if (workshop / OLD).exists() and not target.exists():
            (workshop / OLD).rename(target)
        shutil.rmtree(workshop, ignore_errors=True)
