"""Safe reading of untrusted files: only regular files are opened, and a malicious file causes no more than an error.

No parser here runs code, opens another file, or needs memory or time out of proportion to the text. XML has no entities, YAML
has no objects and no merging. Too deep nesting and numbers of thousands of digits are ordinary errors. OpenCV's own parser is
not used: version 5 reads beyond its text (a JSON file that ends too early kills the process).
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
"""Largest size of a file that is read as a whole: the boxes of fifty people for a day at 25 frames per second have about this
size."""
TOLD = 200
"""Largest number of characters of a parser's message that are shown."""
LARGEST_YAML = 1_000_000
"""Largest number of characters of a YAML file. The parser takes some 20 seconds for this number."""
NESTED = re.compile(r"(?:[\[{]\s*){64}")
"""Deeply nested lists before any value: the parser takes seconds until it rejects them."""
LONG_NUMBER = re.compile(r"[0-9_]{1000}")
"""A number with far more digits than any float (308). YAML's own parser takes minutes for a number of 100,000 digits."""
MOST_DOTS = 5000
"""Largest number of dots in one line of TOML. The parser keeps each prefix of a dotted key: 50,000 parts take ten gigabytes."""
MOST_LEAVES = 1000
"""Largest number of values of one list that are examined. A few bytes of YAML may represent an endless list."""
LISTED_FAULTS = 20
"""Largest number of faults of one file that are listed. A faulty exporter repeats the same fault in each row."""


class NotParsed(ValueError):
    """Text that is not of its format. The message states the reason in one short line."""


def file_bytes(path: Path, kind: str) -> bytes:
    """Read the content of a file; `kind` names in messages what was expected.

    Raises `InputError` where the path does not exist, may not be read, or is a folder, a pipe or a device, which might never
    end.
    """
    check_is_file(path, kind)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): {kind} is needed") from None
    except MemoryError:
        raise InputError(f"{path}: does not fit into memory: {kind} is needed: is it another kind of file?") from None


def check_is_file(path: Path, kind: str) -> None:
    """Raise `InputError` unless `path` is a regular file of at most `LARGEST_BYTES`."""
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
    """Return the reason why a path is impossible, or None. Missing and unreadable files are reported when they are read."""
    try:
        path.stat()
    except ValueError:
        return "it holds a zero byte: give a path"
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return "no file can have so long a name: give a path"
    return None


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text. Raises `NotParsed`."""
    _check_numbers(text)
    if max((line.count(".") for line in text.splitlines()), default=0) > MOST_DOTS:
        raise NotParsed("it is nested too deep")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError, OverflowError) as error:
        raise NotParsed(_shorten_complaint(error)) from None


def parse_json(text: str) -> Any:
    """Parse JSON text. Raises `NotParsed`; its cause is the parser's exception, usually a `JSONDecodeError`."""
    _check_numbers(text)
    try:
        return json.loads(text)
    except (ValueError, RecursionError, OverflowError) as error:
        raise NotParsed(_shorten_complaint(error)) from error


def parse_xml(text: str) -> ElementTree.Element:
    """Parse XML text, and return its root.

    Raises `NotParsed`, also for entities: a few of them may expand to gigabytes or to the content of other files.
    """
    if "<!ENTITY" in text:
        raise NotParsed("it declares entities, which no such file needs")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise NotParsed(_shorten_complaint(error)) from None


def parse_safe_yaml(text: str) -> Any:
    """Parse the first document of YAML text; OpenCV's matrices become tables. Raises `NotParsed`, which states the line."""
    if len(text) > LARGEST_YAML:
        raise NotParsed(f"is not YAML: it has more than {LARGEST_YAML} characters, which no calibration has")
    _check_numbers(text)
    if NESTED.search(text):
        raise NotParsed("is not YAML: it is nested too deep")
    text = re.sub(r"\A%YAML.*", "", text)  # OpenCV's %YAML:1.0 is not valid YAML
    try:
        return next(iter(yaml.load_all(text, Loader=Loader)), None)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise NotParsed(f"{line}is not YAML: {_shorten_complaint(error.problem or error.context or '')}") from None
    except (yaml.YAMLError, ValueError, RecursionError, OverflowError, TypeError, KeyError, AttributeError) as error:
        raise NotParsed(f"is not YAML: {_shorten_complaint(error)}") from None


class Loader(yaml.SafeLoader):
    """Loader of plain YAML 1.1 that also reads 1e-05, which YAML writers of other languages produce, as a number."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuse merging (`<<: *other`): tables that merge ten others each, in nine levels, take gigabytes."""
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                raise yaml.constructor.ConstructorError(None, None, "tables that are merged (<<) are not taken", key.start_mark)


def _opencv_matrix(loader: Loader, _: str, node: yaml.Node) -> Any:
    """Construct a table from a matrix of OpenCV's FileStorage, of any number of dimensions."""
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(None, None, "an OpenCV matrix without rows, cols and data", node.start_mark)
    return loader.construct_mapping(node, deep=True)


Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", _opencv_matrix)


FLOAT = re.compile(r"^[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$")


Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))


def leaves(value: Any, most: int = MOST_LEAVES) -> list[Any]:
    """Flatten nested lists. Of an endless list, at most `most` items are examined, and one more is returned if any is left."""
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
    """Raise `NotParsed` where a number has a thousand digits: no float holds it, and parsers take minutes for it."""
    if LONG_NUMBER.search(text):
        raise NotParsed("it holds a number of a thousand digits")


def _shorten_complaint(error: Exception | str) -> str:
    """Return the message of an error as one short line."""
    if isinstance(error, RecursionError):
        return "it is nested too deep"
    return shortened_text(" ".join(str(error).split()), TOLD)


class FileFaults(InputError):
    """A file or a scene that cannot be used. The message states the first fault, `faults` all (up to `LISTED_FAULTS`)."""

    def __init__(self, faults: Sequence[str]) -> None:
        more = len(faults) - 1
        super().__init__(faults[0] + (f" (and {more} more fault{'s' if more > 1 else ''})" if more else ""))
        listed = tuple(map(cut, faults[:LISTED_FAULTS]))
        if len(faults) > LISTED_FAULTS:
            listed += (f"... and {len(faults) - LISTED_FAULTS} more faults",)
        self.faults = listed
        self._all = tuple(faults)

    def __reduce__(self) -> tuple[type[FileFaults], tuple[tuple[str, ...]]]:
        """Return how to pickle the exception: from its faults. By default, an exception is rebuilt from its message only."""
        return type(self), (self._all,)


def faults_of(error: InputError) -> tuple[str, ...]:
    """Return all faults of an error, one line each."""
    return error.faults if isinstance(error, FileFaults) else (str(error),)


def read_text(path: str | Path, kind: str) -> str:
    """Read the text of a file. `kind` names in messages what was expected ("the scene file").

    All line ends become line feeds. Raises `InputError` when the file is missing, a folder, a pipe or a device, unreadable or
    not UTF-8 text.
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
    """Read the tables of a TOML file. Raises `InputError` as `read_text` does, and for text that is not TOML."""
    try:
        return parse_toml(read_text(path, kind))
    except NotParsed as error:
        raise InputError(f"{path}: is not TOML: {error}") from None
