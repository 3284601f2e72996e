"""Output of the command line: rich tables and a progress bar on a terminal, plain lines otherwise."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from passerby.common.progress import Progress as Told
from passerby.common.progress import ProgressForm

MISSING, UNKNOWN = "-", "unknown"


def number(value: float | None, digits: int = 1, unit: str = "") -> str:
    """Write a figure as text; a dash if it is None or NaN, `UNKNOWN` if it is infinite."""
    if value is not None and math.isinf(value):
        return UNKNOWN
    # Adding zero turns -0.0 into 0.0.
    return MISSING if value is None or math.isnan(value) else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def show_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on standard output; the first column is text, the others are figures."""
    console = Console()
    if not console.is_terminal:
        widths = [max(len(row[index]) for row in (columns, *rows)) for index in range(len(columns))]
        print(title)
        for row in (columns, *rows):
            cells = [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
            print("  ".join([row[0].ljust(widths[0]), *cells]).rstrip())
        return
    # Strings are passed as Text: rich would interpret "[scale]" in a string as markup and omit it.
    table = Table(title=Text(title), title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(Text(column), justify="right" if index else "left")
    for row in rows:
        table.add_row(*map(Text, row))
    console.print(table)


LOG_AFTER_S, LOG_EVERY_S = 30.0, 30.0
"""Without a terminal: time until the first line about the progress of a run, and time between later lines."""

EVENT_EVERY_S = 0.25
"""Shortest time between two progress events of a part of a stage; its first and its last count are always written."""

PACE_SHARE = 0.02
"""Share of a stage that has to be done before the remaining time is estimated from its pace."""


@contextmanager
def stages(verbose: bool = False, form: ProgressForm = ProgressForm.auto) -> Iterator[Told]:
    """Show on standard error the current stage with a bar, its parts, the remaining time, and notes.

    If standard error is not a terminal, a plain log is written: with `verbose` each stage at its beginning and every note,
    otherwise the progress of a long run at intervals. The form `json` writes the events of docs/output.md for programs.
    """
    if form == ProgressForm.json:
        events = _Events()
        yield events
        events.end_stage()
        return
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines() if verbose else _Log()
        return
    columns = (
        SpinnerColumn(), TextColumn("{task.description}", markup=False), _Counted(bar_width=24), _Count(),
        TimeElapsedColumn(), _Left(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True) as bar:
        shown = _Bar(bar)
        yield shown
        shown.end_stage()


def is_interactive() -> bool:
    """Check whether standard output and standard error are terminals, so that the user has seen all messages."""
    return sys.stdout.isatty() and sys.stderr.isatty()


class StageTimes:
    """Passes all calls on to another listener, and adds up the wall time of each stage."""

    def __init__(self, tell: Told, began: float, clock: Callable[[], float] = time.perf_counter) -> None:
        self._tell, self._clock = tell, clock
        self._stage, self._since = "start", began
        self.seconds: dict[str, float] = {}
        """Wall time by stage; the time before the first stage is `start`."""

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        """Receive progress, as in `Progress`."""
        if stage != self._stage:
            self._count(stage)
        self._tell(stage, done, total, part=part)

    def __getattr__(self, name: str) -> Any:
        # `note`, `warning` and `failed`, if the other listener has them.
        return getattr(self._tell, name)

    def _count(self, after: str) -> None:
        now = self._clock()
        self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = after, now

    def show(self) -> None:
        """Print a table of the stages until now; their sum is the wall time."""
        self._count(self._stage)
        total = sum(self.seconds.values())
        rows = [(stage, f"{seconds:.1f}", f"{100 * seconds / total:.0f}") for stage, seconds in self.seconds.items()]
        show_table("wall time", ("stage", "seconds", "%"), [*rows, ("total", f"{total:.1f}", "100")])


class _Lines:
    """Prints each stage and each part of a stage once."""

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

    def note(self, text: str) -> None:
        """Print a note as a line."""
        print(f"  {' '.join(text.split())}", file=sys.stderr)

    def failed(self, stage: str) -> None:
        """Print a line: the stage has failed."""
        print(f"{stage}: failed", file=sys.stderr)


class _Events:
    """Writes each stage's begin, progress and end, one JSON object per line. Within a stage, no count of a part decreases."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._stage, self._began = "", 0.0
        self._written: dict[str, tuple[float, int, int]] = {}

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        now = self._clock()
        if stage != self._stage:
            self.end_stage()
            self._stage, self._began, self._written = stage, now, {}
            self._write("begin", stage=stage)
        if not total:
            return
        at, before, known = self._written.get(part, (-math.inf, -1, 0))
        ended = done >= total and (before, known) != (done, total)
        if done > before and (ended or now - at >= EVENT_EVERY_S):
            self._written[part] = now, done, total
            self._write("progress", stage=stage, part=part, done=done, total=total, seconds=round(now - self._began, 3))

    def end_stage(self) -> None:
        """Write the end of the current stage."""
        self._leave("end")

    def failed(self, stage: str) -> None:
        """Write that the stage has failed."""
        if stage != self._stage:
            self(stage)
        self._leave("failed")

    def note(self, text: str) -> None:
        """Write a note about an input."""
        self._write("note", text=" ".join(text.split()))

    def warning(self, text: str) -> None:
        """Write a warning that the user should see before the run ends."""
        self._write("warning", text=" ".join(text.split()))

    def _leave(self, event: str) -> None:
        if self._stage:
            self._write(event, stage=self._stage, seconds=round(self._clock() - self._began, 3))
            self._stage = ""

    def _write(self, event: str, **values: object) -> None:
        print(json.dumps({"event": event, **values}, ensure_ascii=False), file=sys.stderr, flush=True)


class _Log:
    """Prints the progress of a long run at intervals."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._next = clock() + LOG_AFTER_S
        self._stage = ""
        self._parts: dict[str, tuple[int, int]] = {}
        self._began: tuple[float, int] | None = None

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        now = self._clock()
        if stage != self._stage:
            self._stage, self._parts, self._began = stage, {}, None
        self._parts[part] = done, total
        counted = sum(part_done for part_done, _ in self._parts.values())
        # The pace is measured from the first count on, without the time for preparation.
        if counted and self._began is None:
            self._began = now, counted
        if now < self._next:
            return
        self._next = now + LOG_EVERY_S
        print(self._line(now, counted), file=sys.stderr)

    def warning(self, text: str) -> None:
        """Print a line, also in a short run."""
        print(f"note: {' '.join(text.split())}", file=sys.stderr)

    def _line(self, now: float, done: int) -> str:
        """Describe the progress of all parts of the stage together, and the remaining time if it can be estimated already."""
        total = sum(part_total for _, part_total in self._parts.values())
        if not total or not all(part_total for _, part_total in self._parts.values()):
            return self._stage
        told = f"{self._stage}: {done} of {total} ({100 * done // total} %)"
        since, before = self._began or (now, 0)
        if done - before < PACE_SHARE * total or done >= total:
            return told
        return f"{told}, about {_duration((now - since) * (total - done) / (done - before))} left"


def _duration(seconds: float) -> str:
    """Write a duration: 45 s, 3 min, 1 h 20 min."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


class _Counted(BarColumn):
    """A bar, only if the total is known."""

    def render(self, task: Task) -> Any:
        """Draw the bar, or nothing if the total is unknown."""
        return "" if task.total is None else super().render(task)


class _Left(ProgressColumn):
    """The remaining time at the current pace."""

    max_refresh = 0.5

    def render(self, task: Task) -> Text:
        """Write the remaining time; empty if it is unknown or zero."""
        left = task.time_remaining
        return Text("" if task.total is None or not left else f"about {_duration(left)} left", style="dim")


class _Count(ProgressColumn):
    """The count, as `5 of 21`."""

    def render(self, task: Task) -> Text:
        """Write the count and the total; empty if the total is unknown."""
        return Text("" if task.total is None else f"{int(task.completed)} of {int(task.total)}")


class _Bar:
    """Draws one stage at a time, with a bar for each of its parts; finished stages stay as lines."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._stage, self._began = bar, "", 0.0
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        if stage != self._stage:
            self.end_stage()
            for task in self._tasks.values():
                self._bar.remove_task(task)
            self._stage, self._began, self._tasks = stage, time.monotonic(), {}
        if part in self._tasks:
            self._bar.update(self._tasks[part], completed=done, total=total or None)
        else:
            self._tasks[part] = self._bar.add_task(f"{stage} {part}".strip(), total=total or None, completed=done)

    def end_stage(self) -> None:
        """Print a line about the finished stage, with its duration."""
        self._leave("• ", "green", "")

    def failed(self, stage: str) -> None:
        """Print a line about the failed stage, with its duration."""
        if stage != self._stage:
            self(stage)
        self._leave("✗ ", "red", ": failed")

    def _leave(self, sign: str, colour: str, how: str) -> None:
        if self._stage:
            took = Text(f"  {time.monotonic() - self._began:.1f} s", style="dim")
            line = Text.assemble((sign, colour), self._stage, (how, colour), took)
            self._bar.console.print(line, highlight=False)
            self._stage = ""

    def note(self, text: str) -> None:
        """Print a note as a line that stays."""
        self._bar.console.print(Text(f"  {' '.join(text.split())}", style="yellow"), highlight=False)
