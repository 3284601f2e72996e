"""Systematic errors of boxes and of stated lenses, which data cannot separate from poses, and their effect on the cameras.

A detector puts the lower edge of each box at another height than the sole of the foot. More people do not average out this
error, and they do not show small errors of a stated lens. Neither is an unknown of the adjustment, which could not separate it
from poses. Their part of the cameras' covariance is that of *consider parameters* (Schmidt 1966, *Application of State-Space
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
"""One sigma of the height of the lower edges of boxes above or below people's feet, as a share of people's height, common to
all cameras: it depends on where a detector sees feet. Root mean square over five rendered films, boxes from the pixels (seeds
950 to 955, without one whose rig was wrong): 2.0 %."""

OWN_SHIFT, OWN_GROWTH = 0.0045, 0.004
"""One sigma of two errors common to all boxes of a camera, as shares of the person's height: a shift of the middles up, and a
growth of the heights with the logarithm of distance, over its spread. A detector makes boxes of far people too large or too
small.

Maximum likelihood over the errors of 61 simulated scenes of all presets. Shifts of the middles to the side, or up with
distance, were below 0.0006. Without both errors, the priors of lenses without intrinsics have too little weight: points of 36
simulated scenes (seeds 304711 to 304722) were less accurate by 8 %, and 31 of them instead of 36 were within two sigmas."""

FAR = 2.0
"""Sigmas of the prior on the slack above which a camera's boxes are taken to be cut off or too long at one end."""

LENS_PRIORS: Mapping[LensPart, float] = MappingProxyType({"focal": 0.005, "principal_point": 0.005, "distortion": 0.01})
"""One sigma of the errors of a camera's stated intrinsics: shares of the focal length and of the image's width, and the first
distortion coefficient. Careful calibrations with a board repeat to a few tenths of a per cent of the focal length and to some
pixels of the principal point; focus and temperature change a lens by as much again."""


def stated_sd(lens: Lens) -> dict[LensPart, float]:
    """Return one sigma of the errors of each part of a lens, in the units of `LENS_PRIORS`: stated with the lens, or these."""
    own: dict[LensPart, float | None] = {
        "focal": lens.focal_sd, "principal_point": lens.principal_point_sd, "distortion": lens.distortion_sd
    }  # fmt: skip
    return {part: LENS_PRIORS[part] if sd is None else sd for part, sd in own.items()}


@dataclass(frozen=True, eq=False)
class ConsiderParameters:
    """Parameters that the adjustment does not estimate: their derivatives and their covariance."""

    columns: dict[str, Floats]
    """For each kind of residual, whitened derivatives (M, k, u) by the u parameters of the residual's own camera."""
    root: Floats
    """(C u, K) a root of the parameters' covariance."""

    @classmethod
    def of_boxes(cls, problem: PeopleProblem, state: AdjustmentState) -> ConsiderParameters:
        """Return the common errors of boxes.

        The error of the lower ends of people (edges of boxes or ankles) is one number for all cameras, `LOWER_EDGE`. The common
        errors of each camera's own boxes are `OWN_SHIFT` and `OWN_GROWTH`.

        Where a camera's boxes are taller or shorter than people by far more than usual (`state.slack`), one end is cut off or
        too long, and it is not known which. Half of the slack is then one sigma of the camera's own error of the lower ends.
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
        """Return the errors of the parts of lenses that the adjustment holds: `LENS_PRIORS`, and stated sigmas of lenses.

        Args:
            rig: the lenses, in the order of the problem's cameras.
            problem: the person model.
            state: its optimum.
            estimated: parts that are unknowns of the adjustment; with lenses without intrinsics, only in those lenses.
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
        """Return the change (n_shared, K) of the problem's shared unknowns for parameters as large as their sigmas.

        Args:
            inverse: (n_shared, n_shared) inverse of the reduced normal equations.
            problem: the person model.
            terms: terms linearised at the optimum, not weighted yet.
            weighted: function that weights a term as for `inverse`.
        """
        if not self.root.any():
            return np.zeros((len(inverse), self.root.shape[1]))
        wide = WidenedLayout.of(problem, len(self.root) // problem.n_cameras)
        widened = [weighted(wide.widen(term, self.columns)) for term in terms]
        H = NormalEquations(wide.layout, widened).reduce().H
        return np.asarray(-inverse @ H[np.ix_(wide.own, wide.places.ravel())] @ self.root)


def _log_distances(problem: PeopleProblem, state: AdjustmentState) -> Floats:
    """Return the logarithms (M,) of people's distances over the ground, minus their mean in the camera, over their standard
    deviation there; 0 where all distances are equal.
    """
    s, n = problem.sightings, problem.n_cameras
    away = np.log(np.maximum(np.linalg.norm(state.people[s.block, :2] - state.centre[s.camera, :2], axis=1), 0.1))
    count = np.maximum(np.bincount(s.camera, minlength=n), 1)
    away = away - (np.bincount(s.camera, away, n) / count)[s.camera]
    spread = np.sqrt(np.bincount(s.camera, away**2, n) / count)[s.camera]
    return np.asarray(np.where(spread > 1e-6, away / np.maximum(spread, 1e-6), 0.0))


def _estimated(lens: Lens, parts: Sequence[LensPart]) -> tuple[bool, ...]:
    """Return which of `LENS_PARTS` of a camera's lens the adjustment estimates, where `parts` are among its unknowns."""
    if "distortion" not in parts or lens.uncalibrated:
        return tuple(part in parts for part in LENS_PARTS)
    return tuple(part == "focal" and lens.focal_sd is not None for part in LENS_PARTS)


def covariance_of_guesses(sd: Floats) -> Floats:
    """Return the covariance (C, C) of guessed focal lengths with standard deviations (C,); 0 for focal lengths not guessed.

    It is not known whether guesses have a common error (one data sheet for all cameras) or independent ones. The first changes
    the scale, the second the shape of the rig. The result is the smallest covariance that is as large as both.
    """
    guessed = int(np.count_nonzero(sd))
    alike = (guessed - 1) / max(guessed, 1)
    return np.asarray(np.diag(sd**2) + alike * np.outer(sd, sd))
