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

from passerby.common.arrays import Floats, Ints
from passerby.common.symmetric import inverse_of
from passerby.hypotheses.comparison import LOG_ODDS
from passerby.solver.adjustment_problem import standing_extents
from passerby.solver.lens_columns import WidenedLayout
from passerby.solver.optimizer.least_squares import NormalEquations
from passerby.solver.people import PeopleSolution
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import downweight

HALF = 0.5
"""Of a box's height: from its centre to its upper edge."""
SHIFT_SD = 0.05
"""What else moves boxes along bodies as their height grows, one sigma, as a share of it: lower edges that are too low, people
who stoop. Two ordinary simulated scenes show -0.012 and 0.015 (seeds 4711 and 4715), five real rigs up to 0.12."""
AGREE_SIGMAS, FAR_SIGMAS = 2.0, 3.0
"""Sigmas by which statures alone have to show the shift, and by which it may differ from half a height."""
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
    """The most probable format that boxes of one camera or of all have instead of the stated one; None where none has.

    The shift is estimated twice: as a share of the heights of the boxes that were seen, and of the people's standing heights.
    The first is exact, but lower edges that vary more than upper ones, with the feet, look the same. The second is what people
    of different statures show alone. Both have to say it.
    """
    fit = solution.fit
    if fit is None or solution.covariance is None or solution.start is None or not len(fit.model.problem.sightings):
        return None
    problem, state, names = fit.model.problem, fit.result.state, solution.start.rig.names
    s, middle = problem.sightings, state.people[:, 2:].mean(axis=1)
    points = np.column_stack([state.people[:, :2], middle])
    standing_px = standing_extents(s, state.centre, points, state.heights[problem.person])
    inflation = solution.covariance.inflation
    seen, standing = (_shifts(problem, state, s.has_foot * px, inflation) for px in (s.extent_px, standing_px))
    every = np.arange(len(names))
    suspects = [(every, ALL_WRONG), *((every[c : c + 1], ONE_WRONG / len(names)) for c in every if len(names) > 1)]
    tested = [_tested(names, cameras, seen, standing, prior) for cameras, prior in suspects]
    found = [one for one in tested if one is not None and one.log_odds > LOG_ODDS]
    return max(found, key=lambda one: one.log_odds, default=None)


def _tested(
    names: tuple[str, ...], cameras: Ints, seen: tuple[Floats, Floats], standing: tuple[Floats, Floats], prior: float
) -> ShiftedBoxes | None:
    """Boxes of cameras (K,) against those as stated; None where they are shifted by something else than half a height."""
    (shift, sigma), (by_stature, its_sigma) = (_estimated(*one, cameras) for one in (seen, standing))
    if not np.sign(shift) * by_stature > AGREE_SIGMAS * its_sigma:
        return None
    # A shift that is neither what a format makes nor nothing has another cause.
    if abs(abs(shift) - HALF) > FAR_SIGMAS * np.hypot(sigma, SHIFT_SD):
        return None
    # The logarithm of the ratio of two normal densities: about half a height, and about none.
    evidence = 0.5 * (shift**2 - (abs(shift) - HALF) ** 2) / (sigma**2 + SHIFT_SD**2)
    return ShiftedBoxes(tuple(names[c] for c in cameras), shift, sigma, float(evidence + np.log(prior)))


def _estimated(gradient: Floats, information: Floats, cameras: Ints) -> tuple[float, float]:
    """The shift that some cameras (K,) have in common, and its standard deviation."""
    total = float(information[np.ix_(cameras, cameras)].sum())
    return (float(gradient[cameras].sum() / total), float(total**-0.5)) if total > 0 else (0.0, np.inf)


def _shifts(problem: PeopleProblem, state: AdjustmentState, extent: Floats, inflation: float) -> tuple[Floats, Floats]:
    """(C,) gradient and (C, C) information of the shifts of the cameras' boxes, all else free.

    Args:
        problem: the person model.
        state: its optimum.
        extent: (M,) pixels that the shift is a share of.
        inflation: how many times less the sightings tell than as many independent ones would.
    """
    down = np.zeros((len(extent), 2, 1))
    down[:, 1, 0] = -extent / problem.centre_sigma()
    columns = {"centres": down, "heights": np.zeros((len(extent), 1, 1))}
    wide = WidenedLayout.of(problem, 1)
    weighted = partial(downweight, inflation=inflation)
    terms = [weighted(wide.widen(term, columns)) for term in problem.terms(state, jacobians=True)]
    system, own, new = NormalEquations(wide.layout, terms).reduce(), wide.own, wide.places.ravel()
    # Gauge freedoms of the rig have no information.
    back = system.H[np.ix_(new, own)] @ inverse_of(system.H[np.ix_(own, own)])
    information = system.H[np.ix_(new, new)] - back @ system.H[np.ix_(own, new)]
    return system.gradient[new] - back @ system.gradient[own], np.asarray(information)
