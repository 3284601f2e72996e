"""How work that takes long tells how far it is."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Told of each stage as it begins and, where a stage has parts that can be counted, of each part that is done."""

    def __call__(self, stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
        """A stage by its name; so many of its parts are done, of `total`, which is 0 where there is nothing to count.

        A stage that works on several things at once, such as cameras, tells of each by its name, `part`.
        """


def silent(stage: str, done: int = 0, total: int = 0, *, part: str = "") -> None:
    """Tells nobody."""


def tell_note(tell: Progress, note: str) -> None:
    """Tell what was just found, such as an odd input, to a listener that has a method `note` for it; others miss nothing that
    the result does not tell.
    """
    take = getattr(tell, "note", None)
    if take is not None:
        take(note)
