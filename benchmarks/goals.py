"""Rows of goals: what is asked for, and what was measured."""

from __future__ import annotations

from collections.abc import Sequence

from pages.tables import reached


def goal_row(
    text: str, stated: tuple[str, str], said: str | None, values: Sequence[float | None], acceptable: Sequence[float],
    aim: Sequence[float],
) -> list[str]:  # fmt: skip
    """A goal, the figure beside what is `stated` to be acceptable and the aim, and the verdict; None: not run."""
    verdict = "" if said is None else reached(values, acceptable, aim)
    return [text, "not run" if said is None else said, *stated, verdict]
