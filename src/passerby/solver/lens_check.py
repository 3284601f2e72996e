"""Does a camera's focal length fit what it saw? A score test at the optimum, which holds the focal lengths fixed.

One unknown a camera is added, the logarithm of its focal length, and one Gauss-Newton step of the reduced system tells where
it would go and how surely (Rao's score test). A wrong focal length hides well: poses, slack and learnt noise take it up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Rig
from passerby.solver.least_squares import Layout, NormalEquations, Term
from passerby.solver.people_state import PeopleState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import deflated

Floats = NDArray[np.float64]

# People do not look equally tall at all distances: hidden feet, slopes and a detector's habits change with depth by
# a few percent, which a focal length would explain as well. The less depth a camera sees, as a share of its distance, the more.
SIZE_DRIFT = 0.03
# Between the largest of the sets that must pass (3.2, a camera of PETS2009) and the smallest of the wrong lenses to tell (3.9).
MIN_SIGMAS, MIN_CHANGE = 3.5, 0.05


@dataclass(frozen=True)
class FocalCheck:
    """Where one camera's focal length would go."""

    camera: str
    change: float
    """Relative change."""
    sigma: float
    """One sigma of it, with what the people's apparent size may drift over depth."""
    against_others: float
    """The change beyond the median of all cameras': what all have in common is the people's doing."""

    @property
    def wrong(self) -> bool:
        """Whether the focal length contradicts the people."""
        return abs(self.against_others) > max(MIN_SIGMAS * self.sigma, MIN_CHANGE)


def check_focals(rig: Rig, problem: PeopleProblem, state: PeopleState, inflation: float) -> list[FocalCheck]:
    """The step of each camera's focal length at the optimum.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
    """
    n = len(rig)
    old = problem.layout
    layout = replace(old, n_globals=old.n_globals + n)
    columns = _focal_columns(rig, problem)
    terms = []
    for term in problem.terms(state, jacobians=True):
        focal = columns.get(_kind(term, problem))
        terms.append(deflated(_widened(term, old, n, focal), inflation))
    reduced = NormalEquations(layout, terms).reduce()
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced.H), 1e-12))
    inverse = np.linalg.pinv(reduced.H * scale[:, None] * scale, rcond=1e-12, hermitian=True) * scale[:, None] * scale
    step = -inverse @ reduced.gradient
    own = old.n_shared + np.arange(n)
    change = step[own]
    sigma = np.hypot(np.sqrt(np.maximum(np.diag(inverse)[own], 0.0)), size_drift(problem, state))
    beyond = change - np.median(change)
    return [FocalCheck(camera.name, float(change[c]), float(sigma[c]), float(beyond[c])) for c, camera in enumerate(rig)]


def size_drift(problem: PeopleProblem, state: PeopleState) -> Floats:
    """(C,) one sigma of a focal length's logarithm for what people's apparent size may drift over depth."""
    return np.asarray(SIZE_DRIFT / np.maximum(_depth_spread(problem, state), 0.05))


def _depth_spread(problem: PeopleProblem, state: PeopleState) -> Floats:
    """(C,) range of the distances at which a camera sees people (10 to 90 %), as a share of their median."""
    out = np.zeros(problem.n_cameras)
    for c in range(problem.n_cameras):
        people = state.people[problem.sightings.block[problem.sightings.camera == c], :2]
        joints = state.joints[problem.joints.point[problem.joints.camera == c], :2]
        distance = np.linalg.norm(np.concatenate([people, joints]) - state.centre[c, :2], axis=1)
        if len(distance):
            near, middle, far = np.quantile(distance, (0.1, 0.5, 0.9))
            out[c] = (far - near) / max(middle, 1e-6)
    return out


def _kind(term: Term, problem: PeopleProblem) -> str:
    """Which residuals a term holds, by its shape: centres, heights, joints or neither."""
    if term.camera is None or term.block is None:
        return ""
    if term.family == 1:
        return "joints"
    return "centres" if term.residual.shape[1] == 2 else "heights"


def _focal_columns(rig: Rig, problem: PeopleProblem) -> dict[str, Floats]:
    """Whitened derivatives by the logarithm of the own camera's focal length, (M, k) for each kind of residual.

    A pixel moves away from the principal point by its distance from it, in the undistorted picture; the tangent of its ray
    turns the move into pixels.
    """
    s, o = problem.sightings, problem.joints
    top, bottom = _outward(s.top, s.top_tangent), _outward(s.bottom, s.bottom_tangent)
    return {
        "centres": 0.5 * (top + bottom) / problem.centre_sigma()[:, None],
        "heights": ((bottom - top)[:, 1] / problem.scale_px / problem.height_sigma())[:, None],
        "joints": _outward(o.bearing, o.tangent) / o.sigma_px[:, None],
    }


def _outward(ray: Floats, tangent: Floats) -> Floats:
    """(M, 2) pixels by which a ray's image moves for a focal length that is larger by a factor e."""
    if len(ray) == 0:
        return np.zeros((0, 2))
    depth = np.maximum(ray[:, 2], 0.1)
    plane = ray[:, :2] / depth[:, None]
    # In the plane z = 1 the point moves by itself; `tangent @ d / (b . d)` is how the image follows.
    moved = np.column_stack([plane, np.zeros(len(ray))])
    return np.asarray((tangent @ moved[:, :, None])[:, :, 0] * depth[:, None])


def _widened(term: Term, old: Layout, n: int, focal: Floats | None) -> Term:
    """The term with columns for the focal lengths behind its globals."""
    rows, k = term.residual.shape
    by_globals, by_shared = term.by_globals, term.by_shared
    if focal is not None and term.camera is not None:
        extra = np.zeros((rows, k, n))
        extra[np.arange(rows), :, term.camera] = focal
        before = np.zeros((rows, k, old.n_globals)) if by_globals is None else by_globals
        by_globals = np.concatenate([before, extra], axis=2)
    elif by_globals is not None:
        by_globals = np.concatenate([by_globals, np.zeros((rows, k, n))], axis=2)
    if by_shared is not None:
        by_shared = np.concatenate([by_shared, np.zeros((rows, k, n))], axis=2)
    return replace(term, by_globals=by_globals, by_shared=by_shared)
