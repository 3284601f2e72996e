"""What the register says about a code."""

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
"""What a finding is about, the causes of others first: the files, cameras that move and clocks, intrinsics; what neither causes
others nor follows from them; and what follows from causes."""

Template = str | Callable[[Fields], str]
"""Text with fields in braces, or a function that makes it."""


@dataclass(frozen=True)
class Kind:
    """A kind of finding: the sentence is `problem`, then `joint` and `remedy` where there is a remedy."""

    severities: tuple[Severity, ...]
    """Those that it is found with."""
    meaning: str
    """In one line."""
    problem: Template
    """What is the matter."""
    remedy: Template = ""
    """What to do, as the sentence ends; empty where it says nothing of it."""
    joint: Template = ": "
    advice: str = ""
    """What to do where the sentence has no remedy."""
    subjects: tuple[Subject, ...] | Callable[[Fields], tuple[Subject, ...]] = ()
    """What it is about besides cameras."""
    common: bool = False
    """Whether the same of several cameras can be said at once, with all of them as `who`."""
    rank: Rank = "other"
    """Whether it causes other findings, or follows from them."""


@dataclass(frozen=True)
class Said:
    """A finding in words."""

    problem: str
    remedy: str
    """Of the sentence."""
    joint: str
    """Between the two."""
    text: str
    """The whole sentence."""


NOTICE: tuple[Severity, ...] = ("notice",)
DOUBT: tuple[Severity, ...] = ("doubt",)
REFUSAL: tuple[Severity, ...] = ("refusal",)


def longer(change: float) -> str:
    """A relative change as "8 % longer"."""
    return f"{100 * abs(change):.0f} % {'longer' if change > 0 else 'shorter'}"
