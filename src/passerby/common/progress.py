"""Progress reports of work that takes long."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol


class Progress(Protocol):
    """A listener that is called when a stage begins and, if a stage has parts that can be counted, when a part is done."""

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        """Report that `done` of the `total` parts of a stage are done; `total` is 0 if there is nothing to count.

        A stage that works on several things at once, such as cameras, reports each of them under its name, `part`.
        """


class ProgressForm(StrEnum):
    """The reader for which the command line writes progress."""

    auto = "auto"
    """For a person: bars on a terminal, a plain log elsewhere."""
    json = "json"
    """For a program: one JSON object per line."""


def silent(stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
    """Ignore the report: the `Progress` without a listener."""


def tell_note(tell: Progress, note: str) -> None:
    """Report a note, such as an unusual input, to a listener that has a method `note`. The result has this information, too."""
    take = getattr(tell, "note", None)
    if take is not None:
        take(note)


def tell_warning(tell: Progress, text: str) -> None:
    """Report at once a problem that the user may want to solve before the run ends, such as a network that is not available.

    A listener that ignores notes, such as the log of a run without a terminal, has a method `warning` for it.
    """
    take = getattr(tell, "warning", None) or getattr(tell, "note", None)
    if take is not None:
        take(text)


def tell_failure(tell: Progress, stage: str) -> None:
    """Report that a stage has failed to a listener that has a method `failed`: the stage must not appear to be done."""
    take = getattr(tell, "failed", None)
    if take is not None:
        take(stage)


@dataclass(eq=False)
class Forward:
    """Forwards the progress of each part of one stage; the reported progress never decreases.

    Counts from other processes may come late, twice or out of order. So the largest count of each part is kept, and its first
    known total, which grows only if the count exceeds it. Neither the parts nor their sum ever decrease.
    """

    tell: Progress
    stage: str
    _parts: dict[str, tuple[int, int]] = field(default_factory=dict)

    def __call__(self, part: str, done: int, total: int) -> None:
        """Report that `done` units of a part are done, of `total`; 0 if the total is unknown."""
        before, known = self._parts.get(part, (0, 0))
        done, total = max(before, done), known or total
        self._parts[part] = done, max(done, total) if total else 0
        self.tell(self.stage, *self._parts[part], part=part)

    def finish(self, part: str) -> None:
        """Report that all of a part is done, even if the work was shorter than its total."""
        whole = max(self._parts.get(part, (0, 0)))
        self(part, whole, whole)
