"""Entry of a code in the register."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from passerby.findings.finding import Severity

Fields = Mapping[str, Any]
"""A finding's values by name, with `camera` (the first), `second`, `cameras` (all, with commas) and `who` (`camera A`,
`cameras A, B`). A finding among the values is a `Said`."""

Subject = Literal["scale", "vertical"]

Rank = Literal["input", "motion", "lens", "other", "symptom"]
RANKS: tuple[Rank, ...] = get_args(Rank)
"""Subjects of findings, the causes of others first: the files; cameras that move, and clocks; intrinsics; then findings that
neither cause others nor follow from them; and findings that follow from causes."""

Template = str | Callable[[Fields], str]
"""Text with fields in braces, or a function that makes it."""


@dataclass(frozen=True)
class Kind:
    """A kind of finding: the sentence is `problem`, then `joint` and `remedy` where there is a remedy."""

    severities: tuple[Severity, ...]
    """Severities with which it occurs."""
    meaning: str
    """Meaning in one line."""
    problem: Template
    """The problem, the first part of the sentence."""
    remedy: Template = ""
    """The remedy, the last part of the sentence; empty if the sentence has none."""
    joint: Template = ": "
    advice: str = ""
    """The remedy if the sentence has none."""
    subjects: tuple[Subject, ...] | Callable[[Fields], tuple[Subject, ...]] = ()
    """Subjects other than cameras."""
    common: bool = False
    """Whether one sentence can state equal findings of several cameras, with all of them as `who`."""
    rank: Rank = "other"
    """Its place among causes and consequences."""


@dataclass(frozen=True)
class Said:
    """A finding in words."""

    problem: str
    remedy: str
    """Remedy in the sentence; empty without one."""
    joint: str
    """Text between problem and remedy."""
    text: str
    """The whole sentence."""


NOTICE: tuple[Severity, ...] = ("notice",)
DOUBT: tuple[Severity, ...] = ("doubt",)
REFUSAL: tuple[Severity, ...] = ("refusal",)


def longer(change: float) -> str:
    """Return a relative change in words, such as "8 % longer"."""
    return f"{100 * abs(change):.0f} % {'longer' if change > 0 else 'shorter'}"
