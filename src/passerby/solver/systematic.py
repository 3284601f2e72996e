"""What data cannot separate from poses, and what it does to the cameras: errors of boxes and of stated lenses.

A detector puts the lower edge of each box at another height than the sole of the foot. More people do not average that out,
and they do not show small errors of a stated lens. Neither is an unknown of the adjustment, which could not separate it from
poses. Their share in the cameras' covariance is that of *consider parameters* (Schmidt 1966, *Application of State-Space
Methods to Navigation Problems*): with the normal equations `H` and their coupling `H_cb` to parameters of the covariance `Q`,
`H^-1 H_cb Q H_cb^T H^-1`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Rig
from passerby.core.lens import INTRINSICS
from passerby.solver.lens_columns import WidenedLayout, lens_columns
from passerby.solver.lens_unknowns import LENS_PARTS, LensPart
from passerby.solver.optimizer.least_squares import NormalEquations, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem

Weighted = Callable[[Term], Term]

LOWER_EDGE = 0.02
"""One sigma of how far above or below people's feet the lower edges of their boxes lie, as a share of their height, in all
cameras alike: it depends on what a detector takes for feet. Root mean square over five rendered films, boxes from the pixels
(seeds 950 to 955, without one whose rig was wrong): 2.0 %."""

OWN_SHIFT, OWN_GROWTH = 0.0045, 0.004
"""One sigma of what each camera's boxes are off by alike, as shares of the person's height: their middles up, and their heights
growing with the logarithm of distance, over its spread. A detector makes boxes of far people too large or too small.

Maximum likelihood over the errors of 61 simulated scenes of all presets. Middles to the side or up with distance came out below
0.0006. Without both, the priors of lenses without intrinsics count too little: points of 36 simulated scenes (seeds 304711 to
304722) were less exact by 8 %, and 31 of them instead of 36 within two sigmas."""

FAR = 2.0
"""Sigmas of the prior from which on a camera's boxes differ from people in another way than boxes do."""

LENS_PRIORS: Mapping[LensPart, float] = MappingProxyType({"focal": 0.005, "principal_point": 0.005, "distortion": 0.01})
"""What the stated intrinsics of a camera are off by, one sigma: shares of the focal length and of the image's width, and the
first distortion coefficient. Careful calibrations with a board repeat to a few tenths of a per cent of the focal length and to
some pixels of the principal point; focus and temperature move a lens by as much again."""


def stated_sd(lens: Lens) -> dict[LensPart, float]:
    """What the parts of a lens are off by, one sigma, in the units of `LENS_PRIORS`: what it says itself, or else these."""
    own: dict[LensPart, float | None] = {
        "focal": lens.focal_sd, "principal_point": lens.principal_point_sd, "distortion": lens.distortion_sd
    }  # fmt: skip
    return {part: LENS_PRIORS[part] if sd is None else sd for part, sd in own.items()}


@dataclass(frozen=True, eq=False)
class ConsiderParameters:
    """Numbers that the adjustment does not estimate: what each does to the residuals, and how large it may be."""

    columns: dict[str, Floats]
    """(M, k, u) whitened derivatives of the residuals by the u numbers of the own camera, for each kind of residual."""
    root: Floats
    """(C u, K) a root of the numbers' covariance."""

    @classmethod
    def of_boxes(cls, problem: PeopleProblem, state: AdjustmentState) -> ConsiderParameters:
        """What boxes are off by alike.

        How much too low the lower ends of people are, edges of boxes or ankles: one number for all cameras, `LOWER_EDGE`; and
        what the boxes of each camera are off by on their own, `OWN_SHIFT` and `OWN_GROWTH`.

        Where a camera's boxes are taller or shorter than people by far more than boxes are (`state.slack`), one end is cut off
        or too long, and it is not known which: half of that, one sigma, is the camera's own.
        """
        n, rows = problem.n_cameras, len(problem.sightings)
        longer, up = problem.sightings.extent_px / problem.scale_px, problem.scale_px / problem.centre_sigma()
        middle, tall = np.zeros((rows, 2, 3)), np.zeros((rows, 1, 3))
        middle[:, 1, 0], tall[:, 0, 0] = -0.5 * longer * up, -longer / problem.height_sigma()
        middle[:, 1, 1] = up
        tall[:, 0, 2] = _log_distances(problem, state) / problem.height_sigma()
        cut = np.flatnonzero(np.abs(state.slack) > FAR * problem.priors.slack)
        root = np.zeros((n, 3, 1 + len(cut) + 2 * n))
        root[:, 0, 0] = LOWER_EDGE
        root[cut, 0, 1 + np.arange(len(cut))] = 0.5 * state.slack[cut]
        for part, sd in ((1, OWN_SHIFT), (2, OWN_GROWTH)):
            root[np.arange(n), part, len(cut) + 2 * np.arange(n) + part] = sd
        return cls({"centres": middle, "heights": tall}, root.reshape(3 * n, -1))

    @classmethod
    def of_lenses(
        cls, rig: Rig, problem: PeopleProblem, state: AdjustmentState, estimated: Sequence[LensPart] = ()
    ) -> ConsiderParameters:
        """The parts of the lenses that the adjustment holds: `LENS_PRIORS`, and what the scene states of focal lengths.

        Args:
            rig: the lenses, in the order of the problem's cameras.
            problem: the person model.
            state: its optimum.
            estimated: parts that are unknowns of the adjustment. Where lenses without intrinsics are, only theirs are.
        """
        free = [_estimated(camera.lens, estimated) for camera in rig]
        focal = [0.0 if own[0] else camera.lens.focal_sd or 0.0 for own, camera in zip(free, rig, strict=True)]
        covariance = np.zeros((len(rig), INTRINSICS, len(rig), INTRINSICS))
        covariance[:, 0, :, 0] = covariance_of_guesses(np.array(focal))
        for c, (camera, own) in enumerate(zip(rig, free, strict=True)):
            sd = stated_sd(camera.lens)
            if not own[0] and not focal[c]:
                covariance[c, 0, c, 0] = sd["focal"] ** 2
            if not own[1]:
                covariance[c, 1, c, 1] = covariance[c, 2, c, 2] = (sd["principal_point"] * camera.lens.size[0]) ** 2
            if not own[2]:
                covariance[c, 3, c, 3] = sd["distortion"] ** 2
        size = len(rig) * INTRINSICS
        value, vector = np.linalg.eigh(covariance.reshape(size, size))
        columns = lens_columns(rig, problem, state, Lens.by_intrinsics) if covariance.any() else {}
        return cls(columns, vector * np.sqrt(np.maximum(value, 0.0)))

    def moved(self, inverse: Floats, problem: PeopleProblem, terms: Sequence[Term], weighted: Weighted) -> Floats:
        """(n_shared, K) what the numbers, as large as their sigmas, do to the problem's shared unknowns.

        Args:
            inverse: (n_shared, n_shared) of the reduced normal equations.
            problem: the person model.
            terms: linearised at the optimum, not weighted yet.
            weighted: weights a term as those are that `inverse` is made of.
        """
        if not self.root.any():
            return np.zeros((len(inverse), self.root.shape[1]))
        wide = WidenedLayout.of(problem, len(self.root) // problem.n_cameras)
        widened = [weighted(wide.widen(term, self.columns)) for term in terms]
        H = NormalEquations(wide.layout, widened).reduce().H
        return np.asarray(-inverse @ H[np.ix_(wide.own, wide.places.ravel())] @ self.root)


def _log_distances(problem: PeopleProblem, state: AdjustmentState) -> Floats:
    """(M,) logarithms of people's distances over the ground, less their mean in the camera, over their spread there; 0 where
    all are equally far.
    """
    s, n = problem.sightings, problem.n_cameras
    away = np.log(np.maximum(np.linalg.norm(state.people[s.block, :2] - state.centre[s.camera, :2], axis=1), 0.1))
    count = np.maximum(np.bincount(s.camera, minlength=n), 1)
    away = away - (np.bincount(s.camera, away, n) / count)[s.camera]
    spread = np.sqrt(np.bincount(s.camera, away**2, n) / count)[s.camera]
    return np.asarray(np.where(spread > 1e-6, away / np.maximum(spread, 1e-6), 0.0))


def _estimated(lens: Lens, parts: Sequence[LensPart]) -> tuple[bool, ...]:
    """Which of `LENS_PARTS` of a camera the adjustment estimates, where `parts` are among its unknowns."""
    if "distortion" not in parts or lens.uncalibrated:
        return tuple(part in parts for part in LENS_PARTS)
    return tuple(part == "focal" and lens.focal_sd is not None for part in LENS_PARTS)


def covariance_of_guesses(sd: Floats) -> Floats:
    """(C, C) covariance of guessed focal lengths of standard deviations (C,), 0 where they are right.

    Whether guesses err alike (one data sheet for all cameras) or each on its own is not known, and it matters: the first is a
    matter of scale, the second of shape. The smallest covariance that is as large as both.
    """
    guessed = int(np.count_nonzero(sd))
    alike = (guessed - 1) / max(guessed, 1)
    return np.asarray(np.diag(sd**2) + alike * np.outer(sd, sd))
