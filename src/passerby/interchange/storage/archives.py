"""Safe reading of arrays from untrusted numpy archives and pickles: no code is run, and memory is bounded.

A pickle is a program for a stack machine, and Python's own reader calls each function that the program names. This reader
has its own machine. It knows only the instructions that make numbers, texts, bytes, lists, tables and arrays, and the few
names that numpy writes for an array. Every other name is an error, and no name is imported.

The instructions are those of `pickletools` (protocols 0 to 5); numpy's names are those of `ndarray.__reduce__` and
`dtype.__reduce__` in numpy 1 and 2.
"""

from __future__ import annotations

import lzma
import math
import pickletools
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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
"""Exceptions that zipfile and numpy raise for bytes that are not an archive or an array."""
LARGEST_PICKLE = 1_000_000
"""Largest number of bytes of a pickle. A camera's calibration has a few hundred."""
MOST_AXES = 8
MOST_VALUES = 10_000
"""Largest number of values in lists and tables. A few bytes of a pickle may represent endless lists."""
NUMBERS = re.compile(r"[<>=|]?[fiub][1248]")
"""Names of numpy's numerical types; objects, texts and records are not read."""
_MODULES = ("numpy.core.multiarray", "numpy._core.multiarray", "numpy.core.numeric", "numpy._core.numeric")
_NAMES = {
    **{(module, name): name for module in _MODULES for name in ("_reconstruct", "scalar", "_frombuffer")},
    ("numpy", "ndarray"): "ndarray",
    ("numpy", "dtype"): "dtype",
    ("_codecs", "encode"): "encode",
    ("__builtin__", "bytes"): "bytes",
    ("builtins", "bytes"): "bytes",
}
"""Module and name of each function that may occur in a pickle -> the kind of value that this reader makes for it."""
_MARK = object()
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_VALUES = frozenset({
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT", "UNICODE", "BINUNICODE",
    "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8",
})  # fmt: skip
_IDLE = frozenset({"PROTO", "FRAME"})


class Archive:
    """The arrays of an archive, which are read one by one."""

    def __init__(self, file: zipfile.ZipFile) -> None:
        self._file = file
        self.names = tuple(name.removesuffix(ENDING) for name in file.namelist() if name.endswith(ENDING))
        """Names of the arrays."""

    def dimensions(self, name: str) -> int:
        """Return the number of dimensions of an array by its header. Raises `NotParsed`."""
        with self._open_array(name) as (_, shape, _, _):
            return len(shape)

    def array(self, name: str) -> NDArray[Any]:
        """Read an array, of numbers or of another type without objects. Raises `NotParsed`.

        The size by the header must equal the size in the archive: numpy itself allocates the memory before it checks this.
        """
        with self._open_array(name) as (file, shape, kind, left):
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
    def _open_array(self, name: str) -> Iterator[tuple[IO[bytes], tuple[int, ...], np.dtype[Any], int]]:
        """Open an array: its file, its shape, its type, and the number of bytes that follow its header."""
        with translate_errors(), self._file.open(name + ENDING) as file:
            version = npy.read_magic(file)
            read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
            if read is None:
                raise NotParsed(f"{name} is of version {version} of numpy's format, which arrays of numbers do not need")
            shape, _, kind = read(file)
            if min(shape, default=0) < 0:
                raise NotParsed(f"{name} has the shape {shape}")
            yield file, shape, kind, self._file.getinfo(name + ENDING).file_size - file.tell()


def is_single_array(path: Path, kind: str) -> bool:
    """Check whether a file is a single array (npy). Raises `InputError` where there is no file."""
    check_is_file(path, kind)
    try:
        with path.open("rb") as file:
            return file.read(len(npy.MAGIC_PREFIX)) == npy.MAGIC_PREFIX
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): {kind} is needed") from None


@contextmanager
def open_archive(path: Path, kind: str) -> Iterator[Archive]:
    """Open an archive of arrays (npz). Raises `InputError` where there is no file, `NotParsed` where it is no archive."""
    check_is_file(path, kind)
    with translate_errors():
        if path.stat().st_size == 0:
            raise NotParsed("it is empty")
        with zipfile.ZipFile(path) as file:
            yield Archive(file)


@contextmanager
def translate_errors() -> Iterator[None]:
    """Convert the exceptions of zipfile and numpy (`_BROKEN`) to `NotParsed`."""
    try:
        yield
    except NotParsed:
        raise
    except _BROKEN as error:
        text = " ".join(str(error).split())
        if isinstance(error, MemoryError):
            text = "it does not fit into memory"
        raise NotParsed((text or type(error).__name__)[:200]) from None


@dataclass(frozen=True)
class _Name:
    """A name in the pickle that represents one of numpy's functions."""

    kind: str


@dataclass
class _Type:
    """A numpy type while it is built."""

    text: str


@dataclass
class _Array:
    """An array while it is built; `value` is None until its numbers are read."""

    value: Any = None


def parse_pickled_arrays(content: bytes) -> Any:
    """Parse a pickle of arrays, numbers, texts, bytes and None, in lists, tuples and dicts.

    Raises `NotParsed` for content that is no pickle, is cut off, or has anything else.
    """
    if len(content) > LARGEST_PICKLE:
        raise NotParsed(f"it has more than {LARGEST_PICKLE} bytes, which no calibration has")
    try:
        return _finish_value(_Machine().run(content), [MOST_VALUES])
    except NotParsed:
        raise
    except (ValueError, TypeError, IndexError, KeyError, OverflowError, RecursionError, UnicodeError):
        raise NotParsed("it is not a whole pickle of numbers and arrays") from None


class _Machine:
    """A stack machine that runs a pickle: its stack and its memory."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memory: dict[int, Any] = {}

    def run(self, content: bytes) -> Any:
        """Run the pickle's program, and return the last value on the stack when it stops."""
        for instruction, argument, _ in pickletools.genops(content):
            if instruction.name == "STOP":
                return self.stack.pop()
            self._step(instruction.name, argument)
        raise NotParsed("it is cut off")

    def _step(self, name: str, argument: Any) -> None:
        stack = self.stack
        if name in _IDLE:
            return
        if name in _VALUES:
            stack.append(argument)
        elif name in _CONSTANTS:
            stack.append(_CONSTANTS[name])
        elif name in _STEPS:
            _STEPS[name](self, argument)
        else:
            raise NotParsed(f"it asks for {name}, which no table of arrays needs")

    def since_mark(self) -> list[Any]:
        """Remove the values above the last mark, and the mark, from the stack, and return the values."""
        index = max(position for position, value in enumerate(self.stack) if value is _MARK)
        values = self.stack[index + 1 :]
        del self.stack[index:]
        return values

    def last(self, count: int) -> list[Any]:
        """Remove the last `count` values from the stack, and return them."""
        if count > len(self.stack):
            raise IndexError
        values = self.stack[len(self.stack) - count :]
        del self.stack[len(self.stack) - count :]
        return values

    def named(self, module: str, name: str) -> None:
        """Put one of the names in `_NAMES` on the stack."""
        if (module, name) not in _NAMES:
            raise NotParsed(f"it asks for {str(module)[:40]}.{str(name)[:40]}, which no table of arrays needs")
        self.stack.append(_Name(_NAMES[module, name]))


def _set_items(machine: _Machine, values: list[Any]) -> None:
    table = machine.stack[-1]
    if not isinstance(table, dict) or not all(isinstance(key, (str, int)) for key in values[::2]):
        raise TypeError
    table.update(zip(values[::2], values[1::2], strict=True))


def _append(machine: _Machine, values: list[Any]) -> None:
    listed = machine.stack[-1]
    if not isinstance(listed, list):
        raise TypeError
    listed.extend(values)


def _call(machine: _Machine) -> None:
    """Run REDUCE: call one of the names with its arguments."""
    function, arguments = machine.last(2)
    if not isinstance(function, _Name) or not isinstance(arguments, tuple):
        raise NotParsed("it calls something that is no array")
    machine.stack.append(_make_value(function.kind, arguments))


def _make_value(kind: str, arguments: tuple[Any, ...]) -> Any:
    """Return the value that one of numpy's functions would make."""
    if kind == "_reconstruct":
        return _Array()
    if kind == "dtype":
        return _Type(str(arguments[0]))
    if kind == "encode" and isinstance(arguments[0], str):
        return arguments[0].encode("latin-1")
    if kind == "bytes" and not arguments:
        return b""
    if kind == "scalar":
        return _numbers((), arguments[0], arguments[1], False).item()
    if kind == "_frombuffer":
        content, form, shape, order = arguments
        return _Array(_numbers(shape, form, content, order == "F"))
    raise NotParsed("it calls something that is no array")


def _build(machine: _Machine) -> None:
    """Run BUILD: set the state of a type, which is its byte order, or of an array."""
    built, state = machine.last(2)
    if isinstance(built, _Type):
        order = state[1]
        built.text = order + built.text.lstrip("<>=|") if order in ("<", ">") else built.text
    elif isinstance(built, _Array):
        _, shape, form, fortran, content = state
        built.value = _numbers(shape, form, content, bool(fortran))
    else:
        raise NotParsed("it builds something that is no array")
    machine.stack.append(built)


def _numbers(shape: Any, form: Any, content: Any, fortran: bool) -> Any:
    """Make an array of numbers from its bytes."""
    if not isinstance(form, _Type) or not isinstance(content, (bytes, bytearray)):
        raise TypeError
    axes = tuple(int(length) for length in shape)
    if not NUMBERS.fullmatch(form.text) or len(axes) > MOST_AXES or min(axes, default=0) < 0:
        raise NotParsed("it holds an array of something else than numbers")
    dtype = np.dtype(form.text)
    if math.prod(axes) * dtype.itemsize != len(content):
        raise NotParsed("it holds an array that is cut off")
    return np.frombuffer(bytes(content), dtype).reshape(axes, order="F" if fortran else "C")


def _finish_value(value: Any, left: list[int]) -> Any:
    """Replace the `_Array` objects in a value by their arrays. `left` holds the number of values that are still permitted."""
    left[0] -= 1
    if left[0] < 0:
        raise NotParsed(f"it holds more than {MOST_VALUES} values")
    if isinstance(value, _Array):
        if value.value is None:
            raise NotParsed("it holds an array without numbers")
        return value.value
    if isinstance(value, (list, tuple)):
        return type(value)(_finish_value(item, left) for item in value)
    if isinstance(value, dict):
        return {key: _finish_value(item, left) for key, item in value.items()}
    if isinstance(value, (_Name, _Type)) or value is _MARK:
        raise NotParsed("it is no table of arrays")
    return value


def _memorise(machine: _Machine, place: int | None) -> None:
    machine.memory[len(machine.memory) if place is None else place] = machine.stack[-1]


def _start_dict(machine: _Machine) -> None:
    values = machine.since_mark()
    machine.stack.append({})
    _set_items(machine, values)


_STEPS: dict[str, Callable[[_Machine, Any], None]] = {
    "MARK": lambda machine, _: machine.stack.append(_MARK),
    "POP": lambda machine, _: machine.stack.pop() and None,
    "EMPTY_DICT": lambda machine, _: machine.stack.append({}),
    "EMPTY_LIST": lambda machine, _: machine.stack.append([]),
    "EMPTY_TUPLE": lambda machine, _: machine.stack.append(()),
    "DICT": lambda machine, _: _start_dict(machine),
    "LIST": lambda machine, _: machine.stack.append(machine.since_mark()),
    "TUPLE": lambda machine, _: machine.stack.append(tuple(machine.since_mark())),
    "TUPLE1": lambda machine, _: machine.stack.append(tuple(machine.last(1))),
    "TUPLE2": lambda machine, _: machine.stack.append(tuple(machine.last(2))),
    "TUPLE3": lambda machine, _: machine.stack.append(tuple(machine.last(3))),
    "SETITEM": lambda machine, _: _set_items(machine, machine.last(2)),
    "SETITEMS": lambda machine, _: _set_items(machine, machine.since_mark()),
    "APPEND": lambda machine, _: _append(machine, machine.last(1)),
    "APPENDS": lambda machine, _: _append(machine, machine.since_mark()),
    "PUT": lambda machine, place: _memorise(machine, int(place)),
    "BINPUT": _memorise,
    "LONG_BINPUT": _memorise,
    "MEMOIZE": lambda machine, _: _memorise(machine, None),
    "GET": lambda machine, place: machine.stack.append(machine.memory[int(place)]),
    "BINGET": lambda machine, place: machine.stack.append(machine.memory[place]),
    "LONG_BINGET": lambda machine, place: machine.stack.append(machine.memory[place]),
    "GLOBAL": lambda machine, names: machine.named(*names.split(" ", 1)),
    "STACK_GLOBAL": lambda machine, _: machine.named(*machine.last(2)),
    "REDUCE": lambda machine, _: _call(machine),
    "BUILD": lambda machine, _: _build(machine),
}
