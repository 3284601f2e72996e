"""Outcomes of one condition over several seeds, as cells of a table: medians, quartiles, the worst seed, and who failed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pages.tables import errors, number

if TYPE_CHECKING:
    from paper.conditions import Outcome

FAILS = "fails"

HEAD = (
    "similarity, median", "quartiles, mm", "worst seed", "metric, median", "worst", "scale error", "worst", "failed",
    "verdicts",
)  # fmt: skip
"""Of the cells of `spread_cells`."""


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile of figures of which some may be infinite.

    Interpolated as by numpy; one that lies between a finite and an infinite figure is infinite.
    """
    order = sorted(values)

    def at(share: float) -> float:
        place = share * (len(order) - 1)
        low, high = order[math.floor(place)], order[math.ceil(place)]
        return high if math.isinf(high) else low + (place % 1) * (high - low)

    return at(0.25), at(0.5), at(0.75)


def of(outcomes: Sequence[Outcome], figure: str) -> tuple[float, ...]:
    """One figure of all outcomes, in the order of the seeds."""
    return tuple(float(getattr(outcome, figure)) for outcome in outcomes)


def median(outcomes: Sequence[Outcome], figure: str) -> float:
    """The median of a figure; infinite where half of the seeds fail."""
    return quartiles(of(outcomes, figure))[1]


def spread_cells(outcomes: Sequence[Outcome]) -> list[str]:
    """The cells under `HEAD`."""
    low, _, high = quartiles(of(outcomes, "similarity_mm"))
    scale = of(outcomes, "scale_error")
    return [
        median_errors(outcomes, "similarity"),
        FAILS if math.isinf(low) else f"{number(low)} to {FAILS if math.isinf(high) else number(high)}",
        worst_errors(outcomes, "similarity"),
        median_errors(outcomes, "metric"),
        worst_errors(outcomes, "metric"),
        percent(quartiles(scale)[1]),
        percent(max(scale)),
        failures(outcomes),
        verdicts(outcomes),
    ]


def median_errors(outcomes: Sequence[Outcome], placement: str) -> str:
    """The medians of position and orientation error."""
    return pose_errors(median(outcomes, f"{placement}_mm"), median(outcomes, f"{placement}_deg"))


def worst_errors(outcomes: Sequence[Outcome], placement: str) -> str:
    """The largest position and the largest orientation error."""
    return pose_errors(max(of(outcomes, f"{placement}_mm")), max(of(outcomes, f"{placement}_deg")))


def pose_errors(mm: float, degrees: float) -> str:
    """Position and orientation error, or that there is none to speak of."""
    return errors(mm, degrees) if math.isfinite(mm) and math.isfinite(degrees) else FAILS


def percent(share: float, digits: int = 1) -> str:
    """A share in percent."""
    return f"{number(100 * share, digits)} %" if math.isfinite(share) else FAILS


def failures(outcomes: Sequence[Outcome]) -> str:
    """How many of the seeds failed."""
    count = sum(outcome.failed for outcome in outcomes)
    return f"{count} of {len(outcomes)}"


def verdicts(outcomes: Sequence[Outcome]) -> str:
    """How often which verdict was given."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("accepted", "doubtful", "refused") if counts[verdict])
