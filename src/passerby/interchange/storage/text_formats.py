"""CSV, JSON and TOML as text, and the versions of files that Passerby writes and reads again."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from passerby.common.arrays import ABSENT
from passerby.common.errors import InputError
from passerby.common.text import shortened

SIGNIFICANT_DIGITS = 12
"""Significant digits of numbers in TOML: a product such as 0.0125 * 1.72 is 0.021500000000000002 in binary floating point."""


def to_csv(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    """Format a header and its rows as CSV, with the same line ends on all systems."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def csv_rows(path: str | Path, text: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Parse a CSV text into its header and its rows, each with its line number (from 2). Empty lines are left out.

    `path` is for messages. Raises `InputError` for a text that is not CSV.
    """
    reader = csv.reader(io.StringIO(text))
    try:
        rows = [(reader.line_num, [field.strip() for field in line]) for line in reader if line]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: is not CSV ({error}): give fields separated by commas") from None
    return (rows[0][1], rows[1:]) if rows else ([], [])


def to_json(value: Any) -> str:
    """Format `value` as JSON text with a line end. NaN and infinity become null."""
    return json.dumps(plain(value), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def plain(value: Any) -> Any:
    """Convert dataclasses, mappings, sequences, numpy arrays and numbers to values that `json` writes, others to their text."""
    if is_dataclass(value) and not isinstance(value, type):
        hidden = {one.name for one in fields(value) if one.metadata == ABSENT and getattr(value, one.name) is None}
        # `vars` also has the keys of a file for which no field is declared.
        return {name.removesuffix("_"): plain(item) for name, item in vars(value).items() if name not in hidden}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


def to_toml(content: Mapping[str, Any]) -> str:
    """Format tables as the text of a TOML file, numbers with 12 significant digits. `write_rig` writes rigs with all digits."""
    return tomli_w.dumps({name: _round_values(one) for name, one in content.items()})


def _round_values(content: Any) -> Any:
    if isinstance(content, float):
        return float(f"{content:.{SIGNIFICANT_DIGITS}g}")
    if isinstance(content, Mapping):
        return {name: _round_values(one) for name, one in content.items()}
    return [_round_values(one) for one in content] if isinstance(content, list | tuple) else content


def key(name: str) -> str:
    """Format a name as a TOML key, in quotes where necessary."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else value(name)


def value(content: Any) -> str:
    """Format a TOML value on one line."""
    if isinstance(content, (list, tuple)):
        return f"[{', '.join(map(value, content))}]"
    return tomli_w.dumps({"x": content}).removeprefix("x = ").rstrip("\n")


def comment(text: str, indent: str = "") -> str:
    """Format a text as comment lines, each with `# ` before it. Characters that are not printable are left out."""
    lines = ("".join(letter for letter in line if letter.isprintable()) for line in text.splitlines())
    return "".join(f"{indent}# {line}".rstrip() + "\n" for line in lines)


def relative(path: Path, scene: Path) -> str:
    """Return a file's path for the scene file: relative to it where possible, else absolute, with forward slashes."""
    absolute = path.parent.resolve() / path.name
    try:
        return Path(os.path.relpath(absolute, scene.parent.resolve())).as_posix()
    except ValueError:  # another drive
        return absolute.as_posix()


class LaterVersionError(InputError):
    """A file that a later Passerby wrote."""


def check_version(path: str | Path, content: Mapping[str, Any], key: str, known: int, table: str = "") -> None:
    """Raise `LaterVersionError` for a file of a later version than `known`.

    Files without a version, of other tools or of an older Passerby, are read as the first version.

    Args:
        path: the file.
        content: its table that states the version.
        key: the table's key that states it.
        known: the latest version that this Passerby reads.
        table: name of the table in messages, with a space behind it.
    """
    version = content.get(key, known)
    if isinstance(version, int) and version > known:
        raise LaterVersionError(
            f"{path}: {table}{key} is {shortened(version)}, of a later Passerby; this one reads up to {known}: install a later "
            "one"
        )
