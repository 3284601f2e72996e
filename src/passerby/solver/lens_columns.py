"""How residuals follow the lenses at an optimum that holds them fixed: columns for more unknowns of each camera.

Derivatives are taken at the predicted points, not at the observed ones. Those observed carry the very noise that is in the
residual: their product would have a mean of one sigma squared a residual, which a focal length grows by. In 239 simulated
scenes with right lenses (5 to 20 s, 2 to 5 cameras, 1 to 6 people) that was a step of +1.05 in the logarithm where people tell
little, and 2 to 4 sigmas elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Rig
from passerby.people.upright_body import body_ends
from passerby.solver.optimizer.least_squares import Layout, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import FOOT_SHIFT, JOINT, PeopleProblem

Derivative = Callable[[Lens, Floats], Floats]
"""(M, 2, u) how the pixels of rays (M, 3) move with u numbers of a lens."""


def by_focal(lens: Lens, rays: Floats) -> Floats:
    """(M, 2, 1) by the logarithm of both focal lengths; distortions are shares of them and grow with them."""
    return np.asarray((lens.project_rays(rays) - lens.matrix[:2, 2])[:, :, None])


def by_principal_point(lens: Lens, rays: Floats) -> Floats:
    """(M, 2, 2) by its two coordinates, pixels."""
    return np.broadcast_to(np.eye(2), (len(rays), 2, 2))


def lens_columns(rig: Rig, problem: PeopleProblem, state: AdjustmentState, by: Derivative) -> dict[str, Floats]:
    """Whitened derivatives of the residuals by u numbers of the own camera's lens, (M, k, u) for each kind of residual.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model.
        state: where the derivatives are taken.
        by: what the numbers do to pixels.
    """
    s, o = problem.sightings, problem.joints
    top, bottom, joint = _predicted(problem, state)

    def moved(camera: Ints, rays: Floats) -> Floats:
        out = np.zeros((len(rays), 2, by(rig.cameras[0].lens, np.zeros((0, 3))).shape[2]))
        for c, own in enumerate(rig):
            out[camera == c] = by(own.lens, rays[camera == c])
        return np.nan_to_num(out)

    at_top, at_bottom = moved(s.camera, top), moved(s.camera, bottom)
    return {
        "centres": 0.5 * (at_top + at_bottom) / problem.centre_sigma()[:, None, None],
        "heights": (at_bottom - at_top)[:, 1:] / (problem.scale_px * problem.height_sigma())[:, None, None],
        "joints": moved(o.camera, joint) / o.sigma_px[:, None, None],
    }


def _predicted(problem: PeopleProblem, state: AdjustmentState) -> tuple[Floats, Floats, Floats]:
    """Highest and lowest points of the people seen (M, 3) and joints (K, 3), in the frames of the cameras that see them."""
    s, o = problem.sightings, problem.joints
    height = state.heights[problem.person[s.block]]
    moved = (state.globals[FOOT_SHIFT] * s.has_foot * height)[:, None]
    top, bottom, _, _ = body_ends(state.centre[s.camera], state.people[s.block], moved, s.top_fraction, s.bottom_fraction)

    def seen(points: Floats, camera: Ints) -> Floats:
        return np.asarray((state.R[camera] @ (points - state.centre[camera])[:, :, None])[:, :, 0])

    return seen(top, s.camera), seen(bottom, s.camera), seen(state.joints[o.point], o.camera)


def widen_terms(term: Term, problem: PeopleProblem, columns: dict[str, Floats]) -> Term:
    """The term with columns for u more unknowns of each camera behind its globals: camera by camera, (C * u) in all.

    Args:
        term: of the problem, not weighted yet.
        problem: the person model.
        columns: from `lens_columns`.
    """
    old, n, u = problem.layout, problem.n_cameras, next(iter(columns.values())).shape[2]
    own = columns.get(_kind(term))
    rows, k = term.residual.shape
    by_globals, by_shared = term.by_globals, term.by_shared
    if own is not None and term.camera is not None:
        extra = np.zeros((rows, k, n, u))
        extra[np.arange(rows), :, term.camera] = own
        before = np.zeros((rows, k, old.n_globals)) if by_globals is None else by_globals
        by_globals = np.concatenate([before, extra.reshape(rows, k, n * u)], axis=2)
    elif by_globals is not None:
        by_globals = np.concatenate([by_globals, np.zeros((rows, k, n * u))], axis=2)
    if by_shared is not None:
        by_shared = np.concatenate([by_shared, np.zeros((rows, k, n * u))], axis=2)
    return replace(term, by_globals=by_globals, by_shared=by_shared)


def widened_layout(problem: PeopleProblem, u: int) -> tuple[Layout, Ints]:
    """The layout of widened terms, and the places (C, u) of the new unknowns among the shared ones."""
    old, n = problem.layout, problem.n_cameras
    return replace(old, n_globals=old.n_globals + n * u), old.n_shared + np.arange(n * u).reshape(n, u)


def _kind(term: Term) -> str:
    """Which residuals a term holds, by its shape: centres, heights, joints or neither."""
    if term.camera is None or term.block is None:
        return ""
    if term.family == JOINT:
        return "joints"
    return "centres" if term.residual.shape[1] == 2 else "heights"
