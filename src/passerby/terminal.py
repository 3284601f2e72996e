"""What the command line shows: rich tables and a progress bar on a terminal, plain lines anywhere else."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from passerby.progress import Progress as Told
from passerby.progress import silent

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
def stages(verbose: bool = False) -> Iterator[Told]:
    """A bar on standard error that names the stage at work and counts its parts.

    Where standard error is no terminal: a line for each stage with `verbose`, else nothing.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines() if verbose else silent
        return
    columns = SpinnerColumn(), TextColumn("{task.description}"), _Counted(bar_width=24), _Count(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        yield _Bar(bar)


class _Lines:
    """Tells each stage once, and each thing that it works on."""

    def __init__(self) -> None:
        self._told: tuple[str, set[str]] = "", set()

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        if stage != self._told[0]:
            self._told = stage, set()
        if part in self._told[1]:
            return
        self._told[1].add(part)
        name = f"{stage} {part}".strip()
        print(f"{name}: {total}" if total else name, file=sys.stderr)


class _Counted(BarColumn):
    """A bar where there is something to count."""

    def render(self, task: Task) -> Any:
        """The bar, or nothing where the total is unknown."""
        return "" if task.total is None else super().render(task)


class _Count(ProgressColumn):
    """5 of 21."""

    def render(self, task: Task) -> Text:
        """Done and total, or nothing where the total is unknown."""
        return Text("" if task.total is None else f"{int(task.completed)} of {int(task.total)}")


class _Bar:
    """Draws one stage at a time, a bar for each thing that it works on at once."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._stage = bar, ""
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        if stage != self._stage:
            for task in self._tasks.values():
                self._bar.remove_task(task)
            self._stage, self._tasks = stage, {}
        if part in self._tasks:
            self._bar.update(self._tasks[part], completed=done, total=total or None)
        else:
            self._tasks[part] = self._bar.add_task(escape(f"{stage} {part}".strip()), total=total or None, completed=done)
