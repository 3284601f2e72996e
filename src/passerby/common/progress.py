"""How work that takes long tells how far it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol


class Progress(Protocol):
    """Called with each stage as it begins and, where a stage has parts that can be counted, of each part that is done."""

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        """A stage by its name; so many of its parts are done, of `total`, which is 0 where there is nothing to count.

        A stage that works on several things at once, such as cameras, tells of each by its name, `part`.
        """


class ProgressForm(StrEnum):
    """For whom the command line writes progress."""

    auto = "auto"
    """A person: bars on a terminal, a plain log elsewhere."""
    json = "json"
    """A program: one JSON object a line."""


def silent(stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
    """Reports to none."""


def tell_note(tell: Progress, note: str) -> None:
    """Tell what was just found, such as an odd input, to a listener that has a method `note` for it; others miss nothing that
    the result does not tell.
    """
    take = getattr(tell, "note", None)
    if take is not None:
        take(note)


def tell_warning(tell: Progress, text: str) -> None:
    """Tell at once what the user may want to act on before the run ends, such as a network that cannot be had.

    Listeners that keep silent on notes, such as the log of a run without a terminal, have a method `warning` for it.
    """
    take = getattr(tell, "warning", None) or getattr(tell, "note", None)
    if take is not None:
        take(text)


def tell_failure(tell: Progress, stage: str) -> None:
    """Tell that a stage has failed, to a listener that has a method `failed` for it: it must not look as if it were done."""
    take = getattr(tell, "failed", None)
    if take is not None:
        take(stage)


@dataclass(eq=False)
class Forward:
    """Passes on how far each part of one stage is, and never less than was reported before.

    Counts may come late, twice or out of order, as from other processes: of each part the largest is kept, and its first known
    total, which grows only where more is done than it says. So neither the parts nor their sum ever run backwards.
    """

    tell: Progress
    stage: str
    _parts: dict[str, tuple[int, int]] = field(default_factory=dict)

    def __call__(self, part: str, done: int, total: int) -> None:
        """So much of a part is done, of `total`; 0 where that is unknown."""
        before, known = self._parts.get(part, (0, 0))
        done, total = max(before, done), known or total
        self._parts[part] = done, max(done, total) if total else 0
        self.tell(self.stage, *self._parts[part], part=part)

    def finish(self, part: str) -> None:
        """All of a part is done, whether or not its work came out as long as was expected."""
        whole = max(self._parts.get(part, (0, 0)))
        self(part, whole, whole)
