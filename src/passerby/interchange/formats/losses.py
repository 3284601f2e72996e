"""What a format cannot hold.

A loss is whatever would make points project elsewhere, or drops a camera or a person: a lens that the format has no model for,
a camera without a pose where poses are needed. Sigmas and the verdict are no losses: no other tool knows them.
"""

from __future__ import annotations

from passerby.common.errors import InputError


class Losses:
    """Gathers losses, so that all are told at once."""

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
