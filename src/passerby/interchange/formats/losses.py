"""What a format cannot hold, and what of a file is not read.

A loss is whatever would make points project elsewhere, or drops a camera or a person: a lens that the format has no model for,
a camera without a pose where poses are needed. Sigmas and the verdict are no losses: no other tool knows them.

What a file holds beyond lenses and poses, such as residuals and dates, moves no point. It is not read, and one line lists it,
so that nothing is dropped without a word.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping

from passerby.common.errors import InputError
from passerby.common.text import shortened_text

LISTED = 20
"""Things that are named on the line of what is not read."""


class Losses:
    """Gathers losses, so that all are reported at once."""

    def __init__(self) -> None:
        self._told: list[str] = []

    def add(self, what: str) -> None:
        """One loss: a sentence without full stop that names the camera, and how large the error is where that is known."""
        if what not in self._told:
            self._told.append(what)

    @property
    def told(self) -> tuple[str, ...]:
        """All of them, as they came."""
        return tuple(self._told)

    def forbid(self, place: str, format_name: str) -> None:
        """Raise `InputError` that tells all losses where there are any."""
        if self._told:
            raise InputError(
                f"{place}: format {format_name} cannot hold everything: {'; '.join(self._told)}: add --lossy to continue, or "
                f"choose a format that can (`passerby formats`)"
            )


class Unread:
    """Counts what readers find in a file and do not read, so that one line tells all of it."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, what: str) -> None:
        """One thing that is not read: a key, or a few words."""
        self._counts[what] += 1

    def keys(self, found: Iterable[object], read: Collection[object]) -> None:
        """The keys that are not among those that the reader knows; of a mapping, those with a value that says something."""
        for key in found:
            if key not in read and not (isinstance(found, Mapping) and _says_nothing(found[key])):
                self.add(shortened_text(str(key)))

    @property
    def told(self) -> tuple[str, ...]:
        """One sentence that lists everything, as it came; none where all was read."""
        if not self._counts:
            return ()
        listed = [what if count == 1 else f"{what} ({count} times)" for what, count in self._counts.items()]
        more = f" and {len(listed) - LISTED} more" if len(listed) > LISTED else ""
        return (f"not read: {', '.join(listed[:LISTED])}{more}",)


def _says_nothing(value: object) -> bool:
    """Whether a value is empty, or what tools write where they have none."""
    if isinstance(value, dict):
        return all(map(_says_nothing, value.values()))
    if isinstance(value, (list, tuple)):
        return not value
    return value is None or (isinstance(value, (str, int, float)) and value in ("", "null", 0, False))
