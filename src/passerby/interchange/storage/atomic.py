"""Writing files so that no reader ever meets half of one."""

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
"""How the names of temporary files end; a process that is killed leaves one behind at most."""


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
    """Delete the temporary files and folders of `path` that killed processes left; for who holds the lock of its folder."""
    left = re.compile(re.escape(f".{path.name}.") + "[a-z0-9_]{8}" + re.escape(PART))
    for half in path.parent.glob(".*"):
        if left.fullmatch(half.name):
            if half.is_dir():
                shutil.rmtree(half, ignore_errors=True)
            else:
                half.unlink(missing_ok=True)


def sync_folder(path: Path) -> None:
    """Let the names of a folder's files outlast a power failure, where the system can do so."""
    with suppress(OSError):  # Windows opens no folders
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, where it is missing. Raises `InputError` where it cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error


def write_text(path: str | Path, text: str) -> None:
    """`write_bytes` of UTF-8 text with Unix line ends."""
    write_bytes(path, text.encode("utf-8"))


def remove(path: str | Path) -> None:
    """Delete a file if it is there. Raises `InputError` where that is not allowed."""
    try:
        Path(path).unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(Path(path), error) from None


def _umask() -> int:
    """The process's file mask; it can only be read by setting it."""
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def cannot_write(path: Path, error: OSError) -> InputError:
    """The error of a file or folder that cannot be written."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    remedy = "make room there, or choose another folder" if full else "choose a folder that you may write to"
    return InputError(f"{path}: cannot be written ({error.strerror or error}): {remedy}")
