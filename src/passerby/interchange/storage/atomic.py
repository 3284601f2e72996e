"""Atomic writing of files: a reader never sees an incomplete file."""

from __future__ import annotations

import errno
import os
import re
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from passerby.common.errors import InputError

PART = ".part"
"""Ending of the names of temporary files. A process that is killed leaves at most one of them behind."""


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write `data` to `path` as a whole or not at all: a temporary file in the same folder, fsync, rename.

    Missing parent folders are made. Raises `InputError` when the folder or the file cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=PART)
    except OSError as error:
        raise cannot_write(path, error) from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
        sync_folder(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        Path(temporary).unlink(missing_ok=True)


def forget_halves(path: Path) -> None:
    """Delete the temporary files and folders of `path` that killed processes left. The caller must hold the folder's lock."""
    left = re.compile(re.escape(f".{path.name}.") + "[a-z0-9_]{8}" + re.escape(PART))
    for half in path.parent.glob(".*"):
        if left.fullmatch(half.name):
            if half.is_dir():
                shutil.rmtree(half, ignore_errors=True)
            else:
                half.unlink(missing_ok=True)


def sync_folder(path: Path) -> None:
    """Write the names of a folder's files to the disk, so that they survive a power failure, where the system supports this."""
    with suppress(OSError):  # Windows cannot open folders
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, where it is missing. Raises `InputError` where it cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error


def write_text(path: str | Path, text: str) -> None:
    """Write a text as UTF-8 by `write_bytes`, with Unix line ends on all systems."""
    write_bytes(path, text.encode("utf-8"))


def remove(path: str | Path) -> None:
    """Delete a file if it exists. Raises `InputError` where it cannot be deleted."""
    try:
        Path(path).unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(Path(path), error) from None


def _umask() -> int:
    """Return the process's file mask. It can only be read by setting it."""
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def cannot_write(path: Path, error: OSError) -> InputError:
    """Return the error for a file or folder that cannot be written."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    remedy = "make room there, or choose another folder" if full else "choose a folder that you may write to"
    return InputError(f"{path}: cannot be written ({error.strerror or error}): {remedy}")
