"""Test whether boxes have another format than stated.

If centres of boxes are read as corners, boxes are half a body too low. For people of one stature, the heights of the cameras
absorb this shift. Taller people then reach farther below the ground than shorter ones, by half the difference of their
statures. So the shift of boxes along their own height is one more unknown, of each camera or common to all. It is estimated by
one linearisation at the optimum.
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
"""Distance from a box's centre to its upper edge, as a share of its height."""
SHIFT_SD = 0.05
"""One sigma of shifts in proportion to a box's height from other causes, as a share of it: lower edges that are too low, people
who stoop. Two ordinary simulated scenes show -0.012 and 0.015 (seeds 4711 and 4715), five real rigs up to 0.12."""
AGREE_SIGMAS, FAR_SIGMAS = 2.0, 3.0
"""Least significance of the shift by statures alone, and largest difference of the shift from half a height, in sigmas."""
ALL_WRONG, ONE_WRONG = 0.02, 0.01
"""Share of sites in which the boxes of all cameras, or those of one, are in another format than stated."""


@dataclass(frozen=True)
class ShiftedBoxes:
    """Boxes that lie half their height too low or too high."""

    cameras: tuple[str, ...]
    """Names of the cameras."""
    shift: float
    """Shift downwards, as a share of the boxes' height."""
    sigma: float
    log_odds: float
    """Logarithm of the odds against the stated format."""


def find_shifted_boxes(solution: PeopleSolution) -> ShiftedBoxes | None:
    """Find the most probable shift of the boxes of one camera or of all by a wrong format; None if the format is right.

    The shift is estimated twice: as a share of the heights of the detected boxes, and of the people's standing heights. The
    first is exact, but lower edges that vary more than upper ones, with the feet, have the same effect. The second uses only
    the differences of people's statures. Both have to show the shift.
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
    """Compare shifted boxes of cameras (K,) with the stated ones; None if the shift is not half a height."""
    (shift, sigma), (by_stature, its_sigma) = (_estimated(*one, cameras) for one in (seen, standing))
    if not np.sign(shift) * by_stature > AGREE_SIGMAS * its_sigma:
        return None
    # A shift that differs from half a height has another cause than a format.
    if abs(abs(shift) - HALF) > FAR_SIGMAS * np.hypot(sigma, SHIFT_SD):
        return None
    # The logarithm of the ratio of two normal densities: with mean half a height, and with mean 0.
    evidence = 0.5 * (shift**2 - (abs(shift) - HALF) ** 2) / (sigma**2 + SHIFT_SD**2)
    return ShiftedBoxes(tuple(names[c] for c in cameras), shift, sigma, float(evidence + np.log(prior)))


def _estimated(gradient: Floats, information: Floats, cameras: Ints) -> tuple[float, float]:
    """Return the common shift of some cameras (K,), and its standard deviation."""
    total = float(information[np.ix_(cameras, cameras)].sum())
    return (float(gradient[cameras].sum() / total), float(total**-0.5)) if total > 0 else (0.0, np.inf)


def _shifts(problem: PeopleProblem, state: AdjustmentState, extent: Floats, inflation: float) -> tuple[Floats, Floats]:
    """Return the gradient (C,) and the information (C, C) of the shifts of the cameras' boxes, with all else free.

    Args:
        problem: the person model.
        state: its optimum.
        extent: (M,) size, pixels; the shift is a share of it.
        inflation: factor by which correlation reduces the information of the sightings.
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
