"""What boxes are off by alike for as long as a camera looks, and what that does to the cameras.

Boxes are no points: how people bend, swing and hide their feet shifts the middles and the heights of their boxes, and not in
the same way near the left of a picture as near its right, or near the camera as far from it. More of the same people do not
average that out. It is no unknown of the adjustment, which could not tell it from poses; its share in the cameras' covariance
is that of *consider parameters* (Schmidt 1966, *Application of State-Space Methods to Navigation Problems*): with the normal
equations `H` and their coupling `H_cb` to parameters of the covariance `Q`, `H^-1 H_cb Q H_cb^T H^-1`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.solver.lens_columns import WidenedLayout, by_focal, lens_columns
from passerby.solver.optimizer.least_squares import Layout, NormalEquations, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem

Weighted = Callable[[Term], Term]

SIGMAS = (0.0045, 0.004)
"""Standard deviations of each camera's parameters, as shares of the person's height: middles up, all alike; heights growing
with the logarithm of depth. (What heights are off by alike is the slack, an unknown.)

Fitted by maximum likelihood to the errors of 61 simulated scenes of all presets, together with the design effect's
`MODEL_EXCESS`; middles to the side, alike or growing to the side, and middles up growing with depth came out below 0.0006.
"""


def add_systematic_errors(
    problem: PeopleProblem, state: AdjustmentState, terms: Sequence[Term]
) -> tuple[list[Term], Layout, Ints, Ints]:
    """The terms with columns for what is systematic, at the end of each camera's block.

    Args:
        problem: the person model.
        state: its optimum.
        terms: linearised there.

    Returns:
        The terms and their layout; which shared unknowns of it are the problem's own, in their order; and which are new,
        (C, K) camera by camera in the order of `SIGMAS`.
    """
    wide, s = WidenedLayout.of(problem, len(SIGMAS)), problem.sightings
    middle, tall = np.zeros((len(s), 2, len(SIGMAS))), np.zeros((len(s), 1, len(SIGMAS)))
    if len(s):
        middle[:, 1, 0], tall[:, 0, 1] = problem.scale_px, _depth(problem, state)
        middle, tall = middle / problem.centre_sigma()[:, None, None], tall / problem.height_sigma()[:, None, None]
    columns = {"centres": middle, "heights": tall}
    return [wide.widen(term, columns) for term in terms], wide.layout, wide.own, wide.places


def _depth(problem: PeopleProblem, state: AdjustmentState) -> Floats:
    """(M,) logarithm of people's distance over the ground, less its mean in the camera, over its root mean square there.

    0 where all are equally far.
    """
    s, n = problem.sightings, problem.n_cameras
    away = np.linalg.norm(state.people[s.block, :2] - state.centre[s.camera, :2], axis=1)
    value = np.log(np.maximum(away, 0.1))
    count = np.maximum(np.bincount(s.camera, minlength=n), 1)
    value = value - (np.bincount(s.camera, value, n) / count)[s.camera]
    spread = np.sqrt(np.bincount(s.camera, value**2, n) / count)[s.camera]
    return np.asarray(np.where(spread > 1e-6, value / np.maximum(spread, 1e-6), 0.0))


@dataclass(frozen=True, eq=False)
class StatedFocals:
    """Focal lengths that are guesses: what their errors do to the residuals, and how large they may be."""

    columns: dict[str, Floats]
    """Whitened derivatives by the logarithms of the focal lengths (`lens_columns`)."""
    covariance: Floats
    """(C, C) of these logarithms; 0 for the lenses that are taken to be right."""

    @classmethod
    def of(cls, rig: Rig, problem: PeopleProblem, state: AdjustmentState) -> StatedFocals | None:
        """Those of a rig at an optimum; None where no lens states a `focal_sd`."""
        sd = np.array([camera.lens.focal_sd or 0.0 for camera in rig])
        if not sd.any():
            return None
        return cls(lens_columns(rig, problem, state, by_focal), covariance_of_guesses(sd))

    def moved(self, inverse: Floats, problem: PeopleProblem, terms: Sequence[Term], weighted: Weighted) -> Floats:
        """(n_shared, n_shared) what they add to the covariance of the problem's shared unknowns.

        The lenses are held while poses are adjusted, so they are consider parameters.

        Args:
            inverse: (n_shared, n_shared) of the reduced normal equations.
            problem: the person model.
            terms: linearised at the optimum, not weighted yet.
            weighted: weights a term as those are that `inverse` is made of.
        """
        wide = WidenedLayout.of(problem, 1)
        H = NormalEquations(wide.layout, [weighted(wide.widen(term, self.columns)) for term in terms]).reduce().H
        moved = inverse @ H[np.ix_(wide.own, wide.places[:, 0])]
        return np.asarray(moved @ self.covariance @ moved.T)


def covariance_of_guesses(sd: Floats) -> Floats:
    """(C, C) covariance of guessed focal lengths of standard deviations (C,), 0 where they are right.

    Whether guesses err alike (one data sheet for all cameras) or each on its own is not known, and it matters: the first is a
    matter of scale, the second of shape. The smallest covariance that is as large as both.
    """
    guessed = int(np.count_nonzero(sd))
    alike = (guessed - 1) / max(guessed, 1)
    return np.asarray(np.diag(sd**2) + alike * np.outer(sd, sd))
