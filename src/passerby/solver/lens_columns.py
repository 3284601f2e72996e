"""Derivatives of residuals by lenses at an optimum that holds them: columns for additional unknowns of each camera.

Derivatives are taken at the predicted points, not at the observed ones. Observed points contain the same noise as the residual:
the product of both would have a mean of one sigma squared per residual, which enlarges a focal length. In 239 simulated scenes
with right lenses (5 to 20 s, 2 to 5 cameras, 1 to 6 people) this was a step of +1.05 in the logarithm where people determine it
weakly, and 2 to 4 sigmas elsewhere.

Points that are predicted far outside the image belong to outliers. Their derivatives are left out: pixels grow with the
tangent of the angle, and distortions with its cube, so that a single wrong person at 85 degrees would outweigh all others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Lens, Rig
from passerby.people.upright_body import body_ends
from passerby.solver.cue_terms import LENGTH
from passerby.solver.optimizer.least_squares import Layout, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import FOOT_SHIFT, JOINT, PeopleProblem

Derivative = Callable[[Lens, Floats], Floats]
"""Function that returns the derivatives (M, 2, u) of the pixels of rays (M, 3) by u parameters of a lens."""


def lens_columns(rig: Rig, problem: PeopleProblem, state: AdjustmentState, by: Derivative) -> dict[str, Floats]:
    """Compute whitened derivatives of the residuals by u parameters of their camera's lens, (M, k, u) for each kind.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model.
        state: state at which the derivatives are taken.
        by: derivatives of pixels by the parameters.
    """
    s, o = problem.sightings, problem.joints
    top, bottom, joint = _predicted(problem, state)

    def moved(camera: Ints, rays: Floats) -> Floats:
        out = np.zeros((len(rays), 2, by(rig.cameras[0].lens, np.zeros((0, 3))).shape[2]))
        for c, own in enumerate(rig):
            rows = np.flatnonzero(camera == c)
            rows = rows[_near_picture(own.lens, rays[rows])]
            out[rows] = by(own.lens, rays[rows])
        return np.nan_to_num(out)

    at_top, at_bottom = moved(s.camera, top), moved(s.camera, bottom)
    return {
        "centres": 0.5 * (at_top + at_bottom) / problem.centre_sigma()[:, None, None],
        "heights": (at_bottom - at_top)[:, 1:] / (problem.scale_px * problem.height_sigma())[:, None, None],
        "joints": moved(o.camera, joint) / o.sigma_px[:, None, None],
    }


def _near_picture(lens: Lens, rays: Floats) -> Bools:
    """Return whether rays (M, 3) would be in an image of twice the size (M,)."""
    size = np.array(lens.size)
    return np.asarray((np.abs(lens.project_rays(rays) - size / 2) <= size).all(axis=1))


def _predicted(problem: PeopleProblem, state: AdjustmentState) -> tuple[Floats, Floats, Floats]:
    """Predict highest and lowest points of people (M, 3), and joints (K, 3), in the frames of the cameras that see them."""
    s, o = problem.sightings, problem.joints
    height = state.heights[problem.person[s.block]]
    moved = (state.globals[FOOT_SHIFT] * s.has_foot * height)[:, None]
    top, bottom, _, _ = body_ends(state.centre[s.camera], state.people[s.block], moved, s.top_fraction, s.bottom_fraction)

    def seen(points: Floats, camera: Ints) -> Floats:
        return np.asarray((state.R[camera] @ (points - state.centre[camera])[:, :, None])[:, :, 0])

    return seen(top, s.camera), seen(bottom, s.camera), seen(state.joints[o.point], o.camera)


@dataclass(frozen=True, eq=False)
class WidenedLayout:
    """The layout of a problem with additional unknowns of each camera, after the camera's other ones."""

    layout: Layout
    own: Ints
    """Indices of the problem's shared unknowns, in their order, in the wider layout."""
    places: Ints
    """(C, u) indices of the new unknowns in the wider layout."""

    @classmethod
    def of(cls, problem: PeopleProblem, u: int) -> WidenedLayout:
        """Build the layout with u additional unknowns of each camera."""
        old = problem.layout
        layout = replace(old, camera_size=old.camera_size + u)
        every = np.arange(layout.n_shared)
        of_cameras = every[: old.n_cameras * layout.camera_size].reshape(old.n_cameras, -1)
        own = np.concatenate([of_cameras[:, : old.camera_size].ravel(), every[of_cameras.size :]])
        return cls(layout, own, of_cameras[:, old.camera_size :])

    def widen(self, term: Term, columns: Mapping[str, Floats]) -> Term:
        """Return the term with the columns of the new unknowns.

        Args:
            term: term of the problem, not weighted yet.
            columns: for each kind of residual, derivatives (M, k, u) by its camera's new unknowns, from `lens_columns`.
        """
        u = self.places.shape[1]
        by_camera, by_shared = term.by_camera, term.by_shared
        if by_camera is not None:
            extra = columns.get(_kind(term))
            if extra is None:
                extra = np.zeros((*by_camera.shape[:2], u))
            by_camera = np.concatenate([by_camera, extra], axis=2)
        if by_shared is not None:
            widened = np.zeros((*by_shared.shape[:2], self.layout.n_shared))
            widened[:, :, self.own] = by_shared
            by_shared = widened
        return replace(term, by_camera=by_camera, by_shared=by_shared)


def _kind(term: Term) -> str:
    """Return the kind of a term's residuals, from its shape: centres, heights or joints; empty for others."""
    if term.camera is None or term.block is None or term.family == LENGTH:
        return ""
    if term.family == JOINT:
        return "joints"
    return "centres" if term.residual.shape[1] == 2 else "heights"
