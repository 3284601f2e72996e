"""Tables as CSV text."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from passerby.common.errors import InputError


def to_csv(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    """A header and its rows, separated by commas, lines ended alike on every system."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def csv_rows(path: str | Path, text: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The header of a table, and its rows with the number of their line, from 2; without empty lines.

    `path` is for messages. Raises `InputError` for what is no CSV.
    """
    reader = csv.reader(io.StringIO(text))
    try:
        rows = [(reader.line_num, [field.strip() for field in line]) for line in reader if line]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: is not CSV ({error}): give fields separated by commas") from None
    return (rows[0][1], rows[1:]) if rows else ([], [])
