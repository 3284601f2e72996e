"""Versions of files that Passerby writes and reads again: a file of a later Passerby is an error, never half understood."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.common.text import shortened


class LaterVersionError(InputError):
    """A file that a later Passerby wrote."""


def check_version(path: str | Path, content: Mapping[str, Any], key: str, known: int, table: str = "") -> None:
    """Raise `LaterVersionError` for a file of a later version than the one known.

    Files without a version, of other tools or of an older Passerby, are read as of the first one.

    Args:
        path: the file.
        content: its table that states the version.
        key: the table's key that states it.
        known: the latest version that this Passerby reads.
        table: what errors call the table, with a space behind it.
    """
    version = content.get(key, known)
    if isinstance(version, int) and version > known:
        raise LaterVersionError(
            f"{path}: {table}{key} is {shortened(version)}, of a later Passerby; this one reads up to {known}: install a later "
            "one"
        )
