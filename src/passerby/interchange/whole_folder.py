"""Folders that appear whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from passerby.errors import InputError
from passerby.interchange.atomic import cannot_write


@contextmanager
def whole_folder(directory: str | Path, marker: str, kind: str) -> Iterator[Path]:
    """A new folder to write into; it takes the place of `directory` when the block ends without an exception.

    Args:
        directory: replaced as a whole where it holds the file `marker`; may be missing or empty.
        marker: a file that every folder of this kind has.
        kind: what a message calls it ("a scene made from a data set").

    Raises:
        InputError: `directory` is a file, holds something else, or cannot be written.
    """
    directory = Path(directory)
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file: give a folder")
    if directory.is_dir() and any(directory.iterdir()) and not (directory / marker).is_file():
        raise InputError(f"{directory}: holds something other than {kind}: give a new or an empty folder")
    target = directory.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        workshop = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        raise cannot_write(directory, error) from error
    new, old = workshop / "new", workshop / "old"
    try:
        new.mkdir()
        yield new
        if target.exists():
            target.rename(old)
        new.rename(target)
    except OSError as error:
        raise cannot_write(directory, error) from error
    finally:
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(workshop, ignore_errors=True)
