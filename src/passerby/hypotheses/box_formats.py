"""Do boxes lie on bodies as their format says?

Centres of boxes that are taken for their corners put boxes half a body too low. The heights of cameras absorb that for people
of one stature. Taller people then reach farther below the ground than shorter ones: by half of what their statures differ. So
the shift of boxes along their own height is one more unknown, of each camera or of all alike. It is estimated by one
linearisation at the optimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from passerby.common.arrays import Floats
from passerby.hypotheses.comparison import LOG_ODDS
from passerby.solver.lens_columns import WidenedLayout
from passerby.solver.optimizer.least_squares import NormalEquations
from passerby.solver.people import PeopleSolution
from passerby.solver.uncertainty import downweight

HALF = 0.5
"""Of a box's height: from its centre to its upper edge."""
SHIFT_SD = 0.05
"""What else moves boxes along bodies as their height grows, one sigma, as a share of it: lower edges that are too low, people
who stoop. Ordinary simulated scenes are within 0.02 (seeds 4711 to 4720)."""
ALL_WRONG, ONE_WRONG = 0.02, 0.01
"""Share of sites in which the boxes of all cameras, or those of one, are in another format than stated."""


@dataclass(frozen=True)
class ShiftedBoxes:
    """Boxes that lie half their height too low or too high."""

    cameras: tuple[str, ...]
    """Names."""
    shift: float
    """Downwards, as a share of the boxes' height."""
    sigma: float
    log_odds: float
    """Against boxes as stated."""


def find_shifted_boxes(solution: PeopleSolution) -> ShiftedBoxes | None:
    """The most probable format that boxes of one camera or of all have instead of the stated one; None where none has."""
    found = _shifts(solution)
    if found is None or solution.start is None:
        return None
    (gradient, information), names = found, solution.start.rig.names
    suspects = [_tested(names, gradient.sum(), information.sum(), ALL_WRONG)]
    for c, name in enumerate(names if len(names) > 1 else ()):
        suspects.append(_tested((name,), gradient[c], information[c, c], ONE_WRONG / len(names)))
    best = max(suspects, key=lambda one: one.log_odds)
    # A shift that is neither what a format makes nor nothing has another cause.
    far = abs(abs(best.shift) - HALF) > 3 * np.hypot(best.sigma, SHIFT_SD)
    return best if best.log_odds > LOG_ODDS and not far else None


def _tested(cameras: tuple[str, ...], gradient: float, information: float, prior: float) -> ShiftedBoxes:
    shift, sigma = (gradient / information, information**-0.5) if information > 0 else (0.0, np.inf)
    # The logarithm of the ratio of two normal densities: about half a height, and about none.
    evidence = 0.5 * (shift**2 - (abs(shift) - HALF) ** 2) / (sigma**2 + SHIFT_SD**2)
    return ShiftedBoxes(cameras, float(shift), float(sigma), float(evidence + np.log(prior)))


def _shifts(solution: PeopleSolution) -> tuple[Floats, Floats] | None:
    """(C,) gradient and (C, C) information of the shifts of the cameras' boxes, all else free; None where no box is used."""
    fit = solution.fit
    if fit is None or solution.covariance is None or not len(fit.model.problem.sightings):
        return None
    problem, state = fit.model.problem, fit.result.state
    extent = problem.sightings.extent_px
    down = np.zeros((len(extent), 2, 1))
    down[:, 1, 0] = -extent / problem.centre_sigma()
    columns = {"centres": down, "heights": np.zeros((len(extent), 1, 1))}
    wide = WidenedLayout.of(problem, 1)
    weighted = partial(downweight, inflation=solution.covariance.inflation)
    terms = [weighted(wide.widen(term, columns)) for term in problem.terms(state, jacobians=True)]
    system, own, new = NormalEquations(wide.layout, terms).reduce(), wide.own, wide.places.ravel()
    scale = 1 / np.sqrt(np.maximum(np.diag(system.H)[own], 1e-12))
    # Gauge freedoms of the rig have no information: the pseudo-inverse holds them.
    inverse = np.linalg.pinv(system.H[np.ix_(own, own)] * scale[:, None] * scale, rcond=1e-10, hermitian=True)
    back = system.H[np.ix_(new, own)] @ (inverse * scale[:, None] * scale)
    information = system.H[np.ix_(new, new)] - back @ system.H[np.ix_(own, new)]
    return system.gradient[new] - back @ system.gradient[own], np.asarray(information)
