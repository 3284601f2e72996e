"""What the user asks of the parts, and their cases, which are kept as soon as they are finished."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pages.cases import Outcomes, run_cases
from pages.kept import Kept, code_behind

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Wanted:
    """What the user asks of the parts."""

    kept: Path
    """Folder of finished cases."""
    quick: bool = False
    """A few cases of each kind: to see that all works, not to judge."""
    workers: int = 2
    data: Path | None = None
    """Folder of the real data sets; None where there is none."""


def kept(wanted: Wanted, name: str, cases: Mapping[str, Any], work: Callable[[Any], Mapping[str, Any]]) -> Outcomes:
    """The results of all cases by key, in the order of `cases`.

    Each is kept as soon as it is there; those of the same code are not run again.

    Args:
        wanted: where results are kept, and how many processes work.
        name: of the part; a quick run has results of its own.
        cases: key -> argument of `work`; both must be picklable, `work` a function of a module.
        work: JSON-ready figures of one case. Its exceptions end the run: a case that may fail has to say so in its figures.
    """
    store = Kept(wanted.kept, code_behind(work.__module__))
    *_, done = run_cases(store, f"{name}{' quick' if wanted.quick else ''}", cases, work, wanted.workers)
    return done


def percent(part: float, whole: float) -> str:
    """A share in percent; a dash where there is nothing to share."""
    return f"{100 * part / whole:.1f} %" if whole else "-"


def seeds(start: int, count: int) -> Sequence[int]:
    """Seeds of a published run start at 100,000 or above; those below are for trying things out."""
    return range(start, start + count)
