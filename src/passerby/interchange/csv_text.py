"""Tables as CSV text."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable


def to_csv(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    """A header and its rows, parted by commas, lines ended alike on every system."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
