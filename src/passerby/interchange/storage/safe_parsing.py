"""Files from anybody: opened only where they are files, and parsed so that none of them can do more than be wrong.

No parser here runs anything, opens another file, or takes memory or time out of all proportion to the text: XML has no
entities, YAML no objects and no merging, and what is nested too deep, or a number of thousands of digits, is an error as any
other. OpenCV's own parser is not used: version 5 reads beyond its text (a JSON file that ends too early kills the process).
"""

from __future__ import annotations

import errno
import json
import re
import stat
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from passerby.common.errors import InputError, cut
from passerby.common.text import shortened, shortened_text

LARGEST_BYTES = 2 << 30
"""Of a file that is read as a whole: the boxes of fifty people for a day at 25 frames per second take about as much."""
TOLD = 200
"""Characters of a parser's complaint that are shown."""
LARGEST_YAML = 1_000_000
"""Characters of a YAML file. The parser takes some 20 seconds for so many."""
NESTED = re.compile(r"(?:[\[{]\s*){64}")
"""Lists in lists before any value: the parser takes seconds to find out that they are too deep for it."""
LONG_NUMBER = re.compile(r"[0-9_]{1000}")
"""Floats end at 308 digits. YAML's own parser takes minutes for a number of 100,000 digits."""
MOST_DOTS = 5000
"""In one line of TOML. The parser keeps every beginning of a dotted key: one of 50,000 parts takes ten gigabytes."""
MOST_LEAVES = 1000
"""Values in one list that are looked at, where a few bytes of YAML may stand for endless ones."""
LISTED_FAULTS = 20
"""So many faults of one file are reported one by one; a broken exporter breaks every row alike."""


class NotParsed(ValueError):
    """Text that is not of its format. The message tells why, in one short line."""


def file_bytes(path: Path, kind: str) -> bytes:
    """The content of a file; `kind` tells in a message what was expected.

    Raises `InputError` where there is no file, it may not be read, or it is none: a folder, a pipe or a device, which might
    never end.
    """
    check_is_file(path, kind)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): {kind} is needed") from None
    except MemoryError:
        raise InputError(f"{path}: does not fit into memory: {kind} is needed: is it another kind of file?") from None


def check_is_file(path: Path, kind: str) -> None:
    """Raise `InputError` unless `path` is a file, not too large to be read as a whole."""
    try:
        found = path.stat()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: {kind} is needed here; check the path and its spelling") from None
    except ValueError:
        raise InputError(f"{shortened(str(path))}: is not a path, since it holds a zero byte: {kind} is needed here") from None
    except OSError as error:
        raise InputError(
            f"{shortened_text(str(path), 1000)}: cannot be read ({error.strerror or error}): {kind} is needed"
        ) from None
    if stat.S_ISDIR(found.st_mode):
        raise InputError(f"{path}: is a folder, but {kind} is needed: name the file itself")
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: is a pipe or a device, but {kind} is needed: name a file")
    if found.st_size > LARGEST_BYTES:
        raise InputError(
            f"{path}: has {found.st_size / 2**30:.0f} GB, but {kind} is needed: is it another kind of file? At most "
            f"{LARGEST_BYTES >> 30} GB are read"
        )


def path_problem(path: Path) -> str | None:
    """Why no file can be called so, or None; one that is only missing, or that may not be read, is reported when it is read."""
    try:
        path.stat()
    except ValueError:
        return "it holds a zero byte: give a path"
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return "no file can have so long a name: give a path"
    return None


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of TOML. Raises `NotParsed`."""
    _check_numbers(text)
    if max((line.count(".") for line in text.splitlines()), default=0) > MOST_DOTS:
        raise NotParsed("it is nested too deep")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError, OverflowError) as error:
        raise NotParsed(_shorten_complaint(error)) from None


def parse_json(text: str) -> Any:
    """The value of JSON. Raises `NotParsed`, whose cause is the `JSONDecodeError` where it is one."""
    _check_numbers(text)
    try:
        return json.loads(text)
    except (ValueError, RecursionError, OverflowError) as error:
        raise NotParsed(_shorten_complaint(error)) from error


def parse_xml(text: str) -> ElementTree.Element:
    """The root of XML. Raises `NotParsed`; also for entities, of which a few may stand for gigabytes or for other files."""
    if "<!ENTITY" in text:
        raise NotParsed("it declares entities, which no such file needs")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise NotParsed(_shorten_complaint(error)) from None


def parse_safe_yaml(text: str) -> Any:
    """The first document of YAML, a matrix of OpenCV's as a table. Raises `NotParsed`, which tells the line first."""
    if len(text) > LARGEST_YAML:
        raise NotParsed(f"is not YAML: it has more than {LARGEST_YAML} characters, which no calibration has")
    _check_numbers(text)
    if NESTED.search(text):
        raise NotParsed("is not YAML: it is nested too deep")
    text = re.sub(r"\A%YAML.*", "", text)  # OpenCV's %YAML:1.0 is no YAML
    try:
        return next(iter(yaml.load_all(text, Loader=Loader)), None)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise NotParsed(f"{line}is not YAML: {_shorten_complaint(error.problem or error.context or '')}") from None
    except (yaml.YAMLError, ValueError, RecursionError, OverflowError, TypeError, KeyError, AttributeError) as error:
        raise NotParsed(f"is not YAML: {_shorten_complaint(error)}") from None


class Loader(yaml.SafeLoader):
    """Plain YAML 1.1, but numbers such as 1e-05, which YAML writers of other languages make, are numbers and not text."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Merging (`<<: *other`) is refused: tables that merge each other ten times over, nine deep, take gigabytes."""
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                raise yaml.constructor.ConstructorError(None, None, "tables that are merged (<<) are not taken", key.start_mark)


def _opencv_matrix(loader: Loader, _: str, node: yaml.Node) -> Any:
    """A matrix of OpenCV's FileStorage, of any number of dimensions, as the table that it is."""
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(None, None, "an OpenCV matrix without rows, cols and data", node.start_mark)
    return loader.construct_mapping(node, deep=True)


Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", _opencv_matrix)


FLOAT = re.compile(r"^[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$")


Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))


def leaves(value: Any, most: int = MOST_LEAVES) -> list[Any]:
    """What is in lists in lists, one by one; of endless ones only the first `most`, and one more."""
    found, left = [], [value]
    for _ in range(most):
        if not left:
            break
        item = left.pop()
        if isinstance(item, list):
            left += reversed(item)
        else:
            found.append(item)
    return found + left[:1]


def _check_numbers(text: str) -> None:
    """Raise `NotParsed` where a number has so many digits that it is none: no float holds it, and parsers choke on it."""
    if LONG_NUMBER.search(text):
        raise NotParsed("it holds a number of a thousand digits")


def _shorten_complaint(error: Exception | str) -> str:
    """A complaint in one short line."""
    if isinstance(error, RecursionError):
        return "it is nested too deep"
    return shortened_text(" ".join(str(error).split()), TOLD)


class FileFaults(InputError):
    """A file, or a scene, that cannot be used. The message tells the first fault, `faults` all (up to `LISTED_FAULTS`)."""

    def __init__(self, faults: Sequence[str]) -> None:
        more = len(faults) - 1
        super().__init__(faults[0] + (f" (and {more} more fault{'s' if more > 1 else ''})" if more else ""))
        listed = tuple(map(cut, faults[:LISTED_FAULTS]))
        if len(faults) > LISTED_FAULTS:
            listed += (f"... and {len(faults) - LISTED_FAULTS} more faults",)
        self.faults = listed
        self._all = tuple(faults)

    def __reduce__(self) -> tuple[type[FileFaults], tuple[tuple[str, ...]]]:
        """Made again from its faults: an exception is otherwise made from its message, on its way from another process."""
        return type(self), (self._all,)


def faults_of(error: InputError) -> tuple[str, ...]:
    """All faults that an error tells of, one line each."""
    return error.faults if isinstance(error, FileFaults) else (str(error),)


def read_text(path: str | Path, kind: str) -> str:
    """The text of a file. `kind` names in a message what was expected ("the scene file").

    Raises `InputError` when the file is missing, a folder, a pipe or a device, unreadable or not UTF-8 text. All ends of
    lines become line feeds.
    """
    path = Path(path)
    content = file_bytes(path, kind)
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8 text, but {kind} is needed: is it another kind of file?"
        ) from None


def read_toml(path: str | Path, kind: str = "a configuration (TOML)") -> dict[str, Any]:
    """The tables of a TOML file. Raises `InputError` as `read_text` does, and for text that is not TOML."""
    try:
        return parse_toml(read_text(path, kind))
    except NotParsed as error:
        raise InputError(f"{path}: is not TOML: {error}") from None
