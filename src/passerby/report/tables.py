"""Tables that scroll in their own box, can be sorted, and can be copied as CSV; figures as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from passerby.report.html import Html, element, join

LONG = 24
"""Rows beyond which a table scrolls up and down in its box too, and can be searched."""
MISSING = "–"
"""Stands where a figure is undefined."""
UNKNOWN = "unknown"
"""Stands where a figure has an infinite sigma: no evidence constrains it."""


@dataclass(frozen=True)
class Column:
    """The head of a column."""

    title: str
    unit: str = ""
    numeric: bool = True
    hint: str = ""
    """What the figures are, shown on hover and read out."""


@dataclass(frozen=True)
class Cell:
    """One entry of a table."""

    shown: str | Html
    value: str | float | None = None
    """What is sorted by and copied, in full precision; None: as shown, or nothing where `number` made it."""
    kind: str = ""
    """Class of the cell: stands-out, for what stands out."""
    numeric: bool = field(default=False)


def number(value: float | None, digits: int = 1, *, kind: str = "", sign: bool = False) -> Cell:
    """A cell with a figure; a dash where it is undefined."""
    shown = f"{value:+.{digits}f}" if sign and value is not None and round(value, digits) != 0 else figure(value, digits)
    return Cell(shown, value, kind, numeric=True)


def text(value: str | Html, copied: str | None = None, *, kind: str = "") -> Cell:
    """A cell with text."""
    return Cell(value, value if copied is None else copied, kind)


def data_table(
    identifier: str,
    caption: str,
    columns: Sequence[Column],
    rows: Sequence[Sequence[Cell]],
    *,
    sortable: bool = True,
    copy: bool = True,
) -> Html:
    """A table in a box that scrolls by itself; the first column names the row.

    Args:
        identifier: of the table, unique on the page.
        caption: what it holds, for those who cannot see it.
        columns: as many as each row has cells.
        rows: one or more.
        sortable: whether its heads are buttons that sort it.
        copy: whether a button copies it as CSV.
    """
    heads = [_head(column, sortable) for column in columns]
    body = [element("tr", _cells(row, columns)) for row in rows]
    table = element(
        "table",
        element("caption", caption, class_="unseen"),
        element("thead", element("tr", heads)),
        element("tbody", body),
        id=identifier,
    )
    # A box that scrolls must be reached by the keyboard, or it cannot be scrolled by it.
    box = element(
        "div",
        table,
        class_="table-box long" if len(rows) > LONG else "table-box",
        tabindex="0",
        role="region",
        aria_label=caption,
    )
    button = element("button", "Copy as CSV", type="button", class_="quiet copy", data_copies=identifier) if copy else None
    search = _search(identifier, len(rows)) if len(rows) > LONG else None
    return join(search, box, element("p", button, class_="tools") if copy else None)


def _search(identifier: str, rows: int) -> Html:
    """A field that leaves the rows of a table with a text, and how many they are."""
    field = element("input", type="search", data_filters=identifier, autocomplete="off", spellcheck="false")
    return element("p", element("label", "Search ", field), element("output", f"{rows} rows"), class_="tools search")


def _head(column: Column, sortable: bool) -> Html:
    """A column's head: its title, and its unit below."""
    unit = element("span", column.unit, class_="unit") if column.unit else None
    named = [column.title, unit] if unit is None else [column.title, " ", unit]
    inside = element("button", named, type="button") if sortable else join(named)
    csv = f"{column.title} {column.unit}".strip()
    return element(
        "th",
        inside,
        scope="col",
        class_="number" if column.numeric else None,
        title=column.hint or None,
        data_csv=csv,
        aria_sort="none" if sortable else None,
    )


def _cells(row: Sequence[Cell], columns: Sequence[Column]) -> list[Html]:
    """The cells of a row, the first as its head."""
    out = []
    for index, (cell, column) in enumerate(zip(row, columns, strict=True)):
        value = cell.value if cell.value is not None or cell.numeric else str(cell.shown)
        classes = " ".join(filter(None, ("number" if column.numeric else "", cell.kind)))
        attributes = {"class_": classes or None, "data_value": "" if value is None else _write_exactly(value)}
        out.append(element("td" if index else "th", cell.shown, **attributes, scope=None if index else "row"))
    return out


def _write_exactly(value: str | float) -> str:
    """A number with all its digits, as `calibration.json` has it."""
    return value if isinstance(value, str) else repr(value)


def figure(value: float | None, digits: int = 1, unit: str = "") -> str:
    """A figure as text; a dash where it is undefined."""
    # Adding zero turns -0.0 into 0.0.
    return MISSING if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def count(number: int, what: str, several: str | None = None) -> str:
    """`1 camera`, `2 cameras`."""
    return f"{number} {what if number == 1 else several or what + 's'}"


def listed(names: Sequence[str]) -> str:
    """`A, B and C`."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1] if names else ""
