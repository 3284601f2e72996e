"""Arrays out of numpy's archives (npz) from anybody: no Python objects, and no more memory than the file can account for."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from passerby.common.errors import InputError
from passerby.interchange.storage.safe_parsing import LARGEST_BYTES, NotParsed, check_is_file

ENDING = ".npy"

_BROKEN = (
    ValueError, TypeError, SyntaxError, RecursionError, MemoryError, OverflowError, EOFError, OSError, KeyError, IndexError,
    AttributeError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, TokenError,
)  # fmt: skip
"""What zipfile and numpy raise for bytes that mean something else."""


class Archive:
    """The arrays of a file, read one by one."""

    def __init__(self, file: zipfile.ZipFile) -> None:
        self._file = file
        self.names = tuple(name.removesuffix(ENDING) for name in file.namelist() if name.endswith(ENDING))
        """Of the arrays."""

    def dimensions(self, name: str) -> int:
        """How many an array has by its header. Raises `NotParsed`."""
        with self._opened(name) as (_, shape, _, _):
            return len(shape)

    def array(self, name: str) -> NDArray[Any]:
        """An array of numbers, or of what else its header says. Raises `NotParsed`.

        The header must say what the archive holds: numpy itself asks for the memory before it looks.
        """
        with self._opened(name) as (file, shape, kind, left):
            size = kind.itemsize
            for length in shape:
                size *= length
            if kind.hasobject:
                raise NotParsed("it holds pickled Python objects")
            if size > LARGEST_BYTES:
                raise NotParsed(f"{name} has {size / 2**30:.0f} GB: at most {LARGEST_BYTES >> 30} GB are read")
            if size != left:
                raise NotParsed(f"{name} says that it has {size} bytes, but {left} are there")
            file.seek(0)
            return np.asarray(npy.read_array(file, allow_pickle=False))

    @contextmanager
    def _opened(self, name: str) -> Iterator[tuple[IO[bytes], tuple[int, ...], np.dtype[Any], int]]:
        """An array's file, its shape and type, and how many bytes follow its header."""
        with as_not_parsed(), self._file.open(name + ENDING) as file:
            version = npy.read_magic(file)
            read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
            if read is None:
                raise NotParsed(f"{name} is of version {version} of numpy's format, which arrays of numbers do not need")
            shape, _, kind = read(file)
            if min(shape, default=0) < 0:
                raise NotParsed(f"{name} has the shape {shape}")
            yield file, shape, kind, self._file.getinfo(name + ENDING).file_size - file.tell()


def is_single_array(path: Path, kind: str) -> bool:
    """Whether a file is an array by itself (npy). Raises `InputError` where there is no file."""
    check_is_file(path, kind)
    try:
        with path.open("rb") as file:
            return file.read(len(npy.MAGIC_PREFIX)) == npy.MAGIC_PREFIX
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): {kind} is needed") from None


@contextmanager
def open_archive(path: Path, kind: str) -> Iterator[Archive]:
    """A file of arrays. Raises `InputError` where there is no file, `NotParsed` where it is no archive."""
    check_is_file(path, kind)
    with as_not_parsed():
        if path.stat().st_size == 0:
            raise NotParsed("it is empty")
        with zipfile.ZipFile(path) as file:
            yield Archive(file)


@contextmanager
def as_not_parsed() -> Iterator[None]:
    """Whatever zipfile and numpy raise becomes `NotParsed`."""
    try:
        yield
    except NotParsed:
        raise
    except _BROKEN as error:
        text = " ".join(str(error).split())
        if isinstance(error, MemoryError):
            text = "it does not fit into memory"
        raise NotParsed((text or type(error).__name__)[:200]) from None
