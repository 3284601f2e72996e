"""Test whether people contradict stated lenses, and the decision: nothing, a notice, a correction or a doubt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.lens import LARGEST_FOCAL_SD, Lens
from passerby.core.measuring import MeasuringErrors, measure_change
from passerby.hypotheses.alternatives import LENS, WRONG, Alternative, lens_alternatives, prior_scales
from passerby.hypotheses.case import Case
from passerby.hypotheses.comparison import LOG_ODDS, Comparison, Refit, Screened, effect, may_convince, screen
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.people import PeopleSolution

LEAST_SCREENED = 12.0
"""Least gain of the score test, nats, at which an alternative is fitted. Of 39 simulated scenes with right lenses 37 have 11 or
less (three presets, seeds 700 to 733; two with two cameras each have 28 and 69), and those with wrong ones 42 or more."""
MOST_REFITS = 3
"""Largest number of alternatives that are fitted: those with the largest scores."""
MOST_SIGMAS = 3.0
"""A change of a lens by more than this many standard deviations of wrong lenses (`WRONG`) is not plausible: the camera has
another pose, or shows other people."""

Decision = Literal["nothing", "notice", "correct", "unsettled", "doubt"]
"""`unsettled`: several explanations fit about as well. The lenses stay as stated, and the sigmas include the possible error."""


@dataclass(frozen=True, eq=False)
class FittedAlternative:
    """An alternative that was fitted."""

    alternative: Alternative
    refit: Refit
    over_base: Comparison

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds against the stated lenses."""
        return self.over_base.log_evidence + self.alternative.log_prior


@dataclass(frozen=True, eq=False)
class FoundLenses:
    """Lenses that fit better than those stated."""

    alternative: Alternative
    """The free parameters; several parts of a lens if they explain the observations about equally well."""
    stated: Rig
    change: Floats
    """(C, L) differences of the free unknowns from the stated lenses; 0 for the others."""
    sigma: Floats
    """(C, L) one standard deviation of each unknown."""
    moved: MeasuringErrors | None
    """Differences between measurements with these lenses and with the stated ones; None where they cannot be computed."""

    @classmethod
    def of(cls, alternative: Alternative, base: Case, case: Case, corrected: Sequence[Alternative] = ()) -> FoundLenses:
        """Compare the base model with a model in which the alternative is free, both at their optima.

        The alternatives that were `corrected` before are free in both.
        """
        change = np.zeros_like(case.state.lens)
        for one in (*corrected, alternative):
            at = np.ix_(np.array(one.cameras), one.columns)
            change[at] = case.state.lens[at].mean(axis=0) if one.alike else case.state.lens[at]
        moved = measure_change(base.rig(), case.rig(), base.state.people[:, :2])
        return cls(alternative, case.stated, change, case.lens_sigma(), moved)

    @property
    def is_plausible(self) -> bool:
        """Whether the changes are within `MOST_SIGMAS` of wrongly stated lenses."""
        return bool((np.abs(self.change) <= MOST_SIGMAS * prior_scales(self.stated, WRONG)).all())

    def corrected(self, rig: Rig) -> Rig:
        """Return a rig with these lenses and their uncertainty; cameras are identified by their names."""
        lenses = {}
        for c in np.flatnonzero(self.change.any(axis=1)).tolist():
            lens = LENS.moved(rig[self.stated.names[c]].lens, self.change[c])
            lenses[self.stated.names[c]] = self._with_sd(c, lens)
        return replace(
            rig, cameras=tuple(replace(one, lens=lenses.get(one.name, one.lens)) for one in rig)
        )  # fmt: skip

    def _with_sd(self, c: int, lens: Lens) -> Lens:
        """Return a camera's lens with the standard deviations of the parts that changed."""
        focal, *point, distortion = np.maximum(self.sigma[c], 1e-6).tolist()
        differs = {part: bool(self.change[c, LENS.columns_of(part)].any()) for part in LENS_PARTS}
        if differs["focal"]:
            lens = replace(lens, focal_sd=min(focal, LARGEST_FOCAL_SD))
        if differs["principal_point"]:
            lens = replace(lens, principal_point_sd=max(point) / lens.size[0])
        return replace(lens, distortion_sd=distortion) if differs["distortion"] else lens


@dataclass(frozen=True, eq=False)
class LensResult:
    """Result of the test of the stated lenses."""

    decision: Decision
    screened: tuple[Screened, ...] = ()
    """Score tests of all alternatives; empty if they could not be computed."""
    suspects: tuple[FittedAlternative, ...] = ()
    """The significant alternatives: one, or several that explain the observations about equally well; the most likely first."""
    found: FoundLenses | None = None
    """The lenses of the most likely suspect; None without any."""
    tested: tuple[FittedAlternative, ...] = ()
    """All alternatives whose predictions were compared."""


def examine_lenses(solution: PeopleSolution, corrected: Sequence[Alternative] = ()) -> LensResult:
    """Compare the stated lenses with the alternatives to them.

    Args:
        solution: a solution by stated lenses; if it refined lenses, the decision is "nothing": they already fit the people.
        corrected: alternatives that were adopted before; their parameters stay free.
    """
    case = None if solution.covariance is None or solution.covariance.free.cameras else Case.of(solution)
    if case is None or solution.covariance is None:
        return LensResult("nothing")
    for adopted in corrected:
        case = case.with_problem(adopted.apply(case.problem, case.stated))
    base = case.fitted()
    screened = screen(base, lens_alternatives(base.stated))
    likely = [
        one.alternative
        for one in sorted(screened, key=lambda one: -one.gain)
        if one.gain >= LEAST_SCREENED and one.alternative not in corrected
    ]
    fitted = [(one, base.with_problem(one.apply(base.problem, base.stated)).fitted()) for one in likely[:MOST_REFITS]]
    costs = base.costs()
    convincing = [(one, case) for one, case in fitted if may_convince(case.costs(), costs, one.log_prior)]
    if not convincing:
        return LensResult("nothing", tuple(screened))
    before = Refit.of(base, fitted=True)
    tested = []
    for alternative, case in convincing:
        refit = Refit.of(case, fitted=True)
        tested.append(FittedAlternative(alternative, refit, Comparison.of(refit.predicted, before.predicted)))
    tested.sort(key=lambda one: -(one.over_base.gain + one.alternative.log_prior))
    counted = [one for one in tested if one.log_odds > LOG_ODDS]
    if not counted:
        return LensResult("nothing", tuple(screened), tested=tuple(tested))
    best, *others = counted
    suspects = (best, *(one for one in others if not _explains_more(best, one)))
    own = [one for one in suspects if one.alternative.cameras == best.alternative.cameras]
    freed, case = best.alternative, best.refit.case
    if len(own) > 1:  # several parts of one lens explain the observations: all of them are free
        for one in own[1:]:
            freed = freed.with_parts_of(one.alternative)
        case = base.with_problem(freed.apply(base.problem, base.stated)).fitted()
    found = FoundLenses.of(freed, base, case, corrected)
    measuring = adjusted(solution.figures).measuring
    decision: Decision = "correct"
    if found.moved is not None and measuring is not None and effect(found.moved, measuring) <= 1:
        decision = "notice"
    elif not found.is_plausible or not freed.correctable:
        decision = "doubt"
    elif len(own) < len(suspects):
        decision = "unsettled"
    return LensResult(decision, tuple(screened), suspects, found, tuple(tested))


def _explains_more(best: FittedAlternative, other: FittedAlternative) -> bool:
    """Check whether one alternative predicts significantly better than another one, priors included."""
    between = Comparison.of(best.refit.predicted, other.refit.predicted)
    return between.log_evidence + best.alternative.log_prior - other.alternative.log_prior > LOG_ODDS
