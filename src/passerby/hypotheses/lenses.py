"""Which stated lenses do people contradict, and what becomes of it: nothing, a notice, a correction or a doubt."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.measuring import MeasuringErrors, measured_change
from passerby.hypotheses.alternatives import WRONG, Alternative, lens_alternatives, prior_scales
from passerby.hypotheses.case import Case
from passerby.hypotheses.comparison import Comparison, Refit, Screened, screen
from passerby.solver.people import PeopleSolution
from passerby.solver.uncertainty import RigCovariance

LOG_ODDS = float(np.log(3.0))
"""An explanation counts that is three times as probable as the one it is compared with, its prior odds included."""
LEAST_SCREENED = 12.0
"""Nats below which nothing is fitted. In simulated scenes with right lenses (three presets, seeds 700 to 723) at most 11, with
wrong ones 44 or more."""
MOST_REFITS = 4
"""Alternatives that are fitted, those with the largest scores."""
MOST_SIGMAS = 3.0
"""A lens that would go farther than so many of the standard deviations of wrong lenses (`WRONG`) is no explanation: the camera
stands elsewhere, or shows other people."""

Decision = Literal["nothing", "notice", "correct", "doubt"]


@dataclass(frozen=True, eq=False)
class Tested:
    """An alternative that was fitted."""

    alternative: Alternative
    refit: Refit
    over_base: Comparison
    change: MeasuringErrors | None
    """Of what the rig measures."""

    @property
    def log_odds(self) -> float:
        """Against the lenses as stated."""
        return self.over_base.log_evidence + self.alternative.log_prior


@dataclass(frozen=True, eq=False)
class LensResult:
    """What the alternatives about lenses come to."""

    decision: Decision
    screened: tuple[Screened, ...] = ()
    """All alternatives; empty where nothing could be compared."""
    suspects: tuple[Tested, ...] = ()
    """Those that count: one, or those that explain the observations about equally well; the likeliest first."""
    found: Rig | None = None
    """With the lenses that fit best, where there are suspects."""
    sigma: np.ndarray | None = None
    """(C, L) one standard deviation of their unknowns."""
    tested: tuple[Tested, ...] = ()
    """All that were fitted."""


def examine_lenses(
    solution: PeopleSolution, uncertainty_mm: float | None = None, corrected: Collection[tuple[str, tuple[int, ...]]] = ()
) -> LensResult:
    """Compare the stated lenses with the alternatives to them.

    Args:
        solution: a solution by stated lenses; where lenses were refined, they went where people put them.
        uncertainty_mm: one standard deviation of the points that the rig measures; from its poses where it is None.
        corrected: codes and cameras of alternatives that are not tried again.
    """
    case = None if solution.covariance is None or solution.covariance.free.cameras else Case.of(solution)
    if case is None or solution.covariance is None:
        return LensResult("nothing")
    base = case.fitted()
    screened = screen(base, lens_alternatives(base.stated))
    likely = [
        one.alternative
        for one in sorted(screened, key=lambda one: -one.gain)
        if one.gain >= LEAST_SCREENED and (one.alternative.code, one.alternative.cameras) not in corrected
    ]
    if not likely:
        return LensResult("nothing", tuple(screened))
    before, places = Refit.of(base), base.state.people[:, :2]
    tested = []
    for alternative in likely[:MOST_REFITS]:
        refit = Refit.of(base.with_problem(alternative.apply(base.problem, base.stated)))
        gain = Comparison.of(refit.predicted, before.predicted)
        tested.append(Tested(alternative, refit, gain, measured_change(base.rig(), refit.case.rig(), places)))
    tested.sort(key=lambda one: -(one.over_base.gain + one.alternative.log_prior))
    counted = [one for one in tested if one.log_odds > LOG_ODDS]
    if not counted:
        return LensResult("nothing", tuple(screened), tested=tuple(tested))
    best, *others = counted
    suspects = (best, *(one for one in others if not _explains_more(best, one)))
    own = [one for one in suspects if one.alternative.cameras == best.alternative.cameras]
    final = best.refit.case
    if len(own) > 1:  # parts of one lens stand in for each other: all of them are free
        both = own[0].alternative
        for one in own[1:]:
            both = both.with_parts_of(one.alternative)
        final = base.with_problem(both.apply(base.problem, base.stated)).fitted()
    moved = measured_change(base.rig(), final.rig(), places)
    uncertainty_mm = points_uncertainty_mm(solution.covariance) if uncertainty_mm is None else uncertainty_mm
    decision: Decision
    if moved is not None and effect(moved, uncertainty_mm) <= 1:
        decision = "notice"
    elif len(own) < len(suspects) or not _correctable(best.alternative, final):
        decision = "doubt"
    else:
        decision = "correct"
    return LensResult(decision, tuple(screened), suspects, final.rig(), final.lens_sigma(), tuple(tested))


def effect(change: MeasuringErrors, uncertainty_mm: float) -> float:
    """The change of what a rig measures, in its own standard deviations: points, or the ground of the camera that changes most."""
    ground = max((one.median_mm for one in change.cameras.values()), default=0.0)
    return max(change.points.median_mm, ground) / max(uncertainty_mm, 1e-9)


def points_uncertainty_mm(covariance: RigCovariance) -> float:
    """A stand-in for the uncertainty of measured points, one standard deviation: that of the middle camera's position."""
    variance = np.einsum("cii->c", covariance.shape[:, :3, :3])
    return float(1000 * np.sqrt(np.median(np.maximum(variance, 0.0))))


def _explains_more(best: Tested, other: Tested) -> bool:
    """Whether one alternative predicts so much better than another one that it leaves no choice."""
    between = Comparison.of(best.refit.predicted, other.refit.predicted)
    return between.log_evidence + best.alternative.log_prior - other.alternative.log_prior > LOG_ODDS


def _correctable(alternative: Alternative, case: Case) -> bool:
    """Whether the lenses go no farther than lenses are stated wrongly."""
    far = np.abs(case.state.lens) <= MOST_SIGMAS * prior_scales(case.stated, WRONG)
    return alternative.correctable and bool(far[list(alternative.cameras)].all())
