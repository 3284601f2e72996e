"""What the command line shows: rich tables and a spinner on a terminal, plain lines anywhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.table import Table

MISSING = "-"


def number(value: float | None, digits: int = 1, unit: str = "") -> str:
    """A figure as text; a dash where it is undefined."""
    # Adding zero turns -0.0 into 0.0.
    return MISSING if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def show_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on standard output; the first column is text, the others are figures."""
    console = Console()
    if not console.is_terminal:
        widths = [max(len(row[index]) for row in (columns, *rows)) for index in range(len(columns))]
        print(title)
        for row in (columns, *rows):
            cells = [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
            print("  ".join([row[0].ljust(widths[0]), *cells]).rstrip())
        return
    table = Table(title=escape(title), title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(column, justify="right" if index else "left")
    for row in rows:
        table.add_row(*map(escape, row))
    console.print(table)


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """A spinner on standard error that names the stage at work; silent where that is no terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda stage: None
        return
    with console.status("starting") as status:
        yield lambda stage: status.update(escape(stage))
