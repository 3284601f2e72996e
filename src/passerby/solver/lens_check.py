"""Does a camera's focal length fit what it saw? A score test at the optimum, which holds the focal lengths fixed.

One unknown a camera is added, the logarithm of its focal length, and one Gauss-Newton step of the reduced system tells where
it would go and how surely (Rao's score test). A wrong focal length hides well: poses, slack and learnt noise take it up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Lens, Rig
from passerby.solver.least_squares import Layout, NormalEquations, Term
from passerby.solver.lens_sigmas import BOXES_MISLEAD, by_boxes
from passerby.solver.people_state import PeopleState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import deflated

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# People do not look equally tall at all distances: hidden feet, slopes and a detector's habits change with depth by
# a few percent, which a focal length would explain as well. The less depth a camera sees, as a share of its distance, the more.
SIZE_DRIFT = 0.03
# Either of: sigmas, and change. A fifth too short in one camera of four is 3.1 to 4.4 sigmas (terrace, basketball,
# construction; 20 s, boxes with 2 % noise), and told in 7 of 7 scenes; all lenses a fifth too long are told in 7 of 7; right
# ones are at most 0.8 sigmas, and 1.5 in ordinary scenes of more noise. 5 % in one camera is never told, 10 % seldom: PETS2009,
# which must pass, has cameras of 2.3 sigmas and 10 %, and of 1.8 and 46 %. The lenses of two cameras exchanged come to 2.3 to
# 2.6 sigmas and 12 to 14 %.
WRONG = ((3.5, 0.05), (2.25, 0.115))
# What all cameras have in common is told where it is more than this: 5 % at PETS2009, 2 % over simulated scenes of right
# lenses, 16 to 22 % where all are stated a fifth too long.
# Two cameras that see few people would like another focal length altogether (twice or thrice as long), which a linear step
# cannot tell: there have to be three, and it has to be known to `KNOWN_COMMON`.
MIN_COMMON, MIN_COMMON_SIGMAS, KNOWN_COMMON, MIN_CAMERAS = 0.12, 2.0, 0.1, 3
# Right distortions: at most 2.9 sigmas over simulated scenes, 1.8 at PETS2009; a first coefficient wrong by 0.1 is 2.9 to 4.3
# at basketball and construction, and below 1 at terrace, where people keep to the middle of the pictures and it costs 8 mm.
MIN_DISTORTION_SIGMAS, MIN_DISTORTION = 3.2, 0.01
# A principal point 30 pixels off is 1 to 1.6 sigmas by boxes, and wrong focal lengths move it by whole pictures: it is only
# told where it is known to this share of the width, as by joints.
MIN_POINT_SIGMAS, MIN_POINT, KNOWN_POINT = 3.5, 0.02, 0.01


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
        # Of three cameras two may be right and make the third look wrong that changes little itself.
        least = min(abs(self.against_others), abs(self.change)) if self.against_others * self.change > 0 else 0.0
        return any(least > max(sigmas * self.sigma, change) for sigmas, change in WRONG)


@dataclass(frozen=True)
class ShapeCheck:
    """Where one camera's principal point or distortion would go."""

    camera: str
    part: Literal["principal point", "distortion"]
    change: tuple[float, ...]
    """Pixels in x and y; of the distortion, of its first coefficient."""
    sigma: tuple[float, ...]
    """One sigma of each."""
    moved: float
    """By how much the change moves points of the picture, as a share of its width: the principal point by itself, a distortion
    the middle of the picture's left and right edge."""

    known: bool = True
    """Whether people tell it well enough for a contradiction to mean anything."""

    @property
    def wrong(self) -> bool:
        """Whether it contradicts the people."""
        sigmas = max(abs(change) / sigma for change, sigma in zip(self.change, self.sigma, strict=True))
        if self.part == "distortion":
            return sigmas > MIN_DISTORTION_SIGMAS and self.moved > MIN_DISTORTION
        return self.known and sigmas > MIN_POINT_SIGMAS and self.moved > MIN_POINT


def common_change(focals: Sequence[FocalCheck]) -> float | None:
    """What all focal lengths would change by alike, where it is beyond what people and boxes explain; else None."""
    if len(focals) < MIN_CAMERAS:
        return None
    change = float(np.median([check.change for check in focals]))
    sigma = float(np.median([check.sigma for check in focals]))
    return change if sigma < KNOWN_COMMON and abs(change) > max(MIN_COMMON, MIN_COMMON_SIGMAS * sigma) else None


def check_focals(rig: Rig, problem: PeopleProblem, state: PeopleState, inflation: float) -> list[FocalCheck]:
    """The step of each camera's focal length at the optimum.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
    """
    step, sd = _score(problem, state, inflation, _focal_columns(problem))
    change, sigma = step[:, 0], np.hypot(sd[:, 0], size_drift(problem, state))
    beyond = change - np.median(change)
    return [FocalCheck(camera.name, float(change[c]), float(sigma[c]), float(beyond[c])) for c, camera in enumerate(rig)]


def check_shapes(rig: Rig, problem: PeopleProblem, state: PeopleState, inflation: float) -> list[ShapeCheck]:
    """The steps of each camera's principal point, and of its distortion's first coefficient; arguments as of `check_focals`."""
    out: list[ShapeCheck] = []
    misled = np.where(by_boxes(problem), BOXES_MISLEAD, 1.0)
    width = np.array([camera.lens.size[0] for camera in rig], dtype=np.float64)
    step, sd = _score(problem, state, inflation, _pixel_columns(rig, problem, _by_principal_point))
    for c, camera in enumerate(rig):
        moved = float(np.linalg.norm(step[c]) / width[c])
        sigma = misled[c] * sd[c]
        known = float(sigma.max()) < KNOWN_POINT * width[c]
        out.append(ShapeCheck(camera.name, "principal point", tuple(step[c]), tuple(sigma), moved, known))
    step, sd = _score(problem, state, inflation, _pixel_columns(rig, problem, _by_distortion))
    for c, camera in enumerate(rig):
        lens = camera.lens
        edge = lens.bearings(np.array([[0.0, lens.size[1] / 2], [lens.size[0] - 1.0, lens.size[1] / 2]]))
        per_unit = np.nanmax(np.abs(_by_distortion(lens, edge)), initial=0.0)
        moved = float(abs(step[c, 0]) * per_unit / width[c])
        out.append(ShapeCheck(camera.name, "distortion", tuple(step[c]), tuple(misled[c] * sd[c]), moved))
    return out


def _score(problem: PeopleProblem, state: PeopleState, inflation: float, columns: dict[str, Floats]) -> tuple[Floats, Floats]:
    """(C, u) Gauss-Newton steps of u more unknowns a camera, and their standard deviations.

    Args:
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
        columns: (M, k, u) whitened derivatives by the own camera's unknowns, for each kind of residual.
    """
    old, u = problem.layout, next(iter(columns.values())).shape[2]
    n = problem.n_cameras
    layout = replace(old, n_globals=old.n_globals + n * u)
    terms = []
    for term in problem.terms(state, jacobians=True):
        terms.append(deflated(_widened(term, old, n, columns.get(_kind(term, problem)), u), inflation))
    reduced = NormalEquations(layout, terms).reduce()
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced.H), 1e-12))
    inverse = np.linalg.pinv(reduced.H * scale[:, None] * scale, rcond=1e-12, hermitian=True) * scale[:, None] * scale
    step = -inverse @ reduced.gradient
    own = old.n_shared + np.arange(n * u).reshape(n, u)
    return step[own], np.sqrt(np.maximum(np.diag(inverse)[own], 1e-18))


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


def _focal_columns(problem: PeopleProblem) -> dict[str, Floats]:
    """Whitened derivatives by the logarithm of the own camera's focal length, (M, k, 1) for each kind of residual.

    A pixel moves away from the principal point by its distance from it, in the undistorted picture; the tangent of its ray
    turns the move into pixels.
    """
    s, o = problem.sightings, problem.joints
    top, bottom = _outward(s.top, s.top_tangent), _outward(s.bottom, s.bottom_tangent)
    return _whitened(problem, top[:, :, None], bottom[:, :, None], _outward(o.bearing, o.tangent)[:, :, None])


def _whitened(problem: PeopleProblem, top: Floats, bottom: Floats, joint: Floats) -> dict[str, Floats]:
    """Derivatives of pixels, (M, 2, u) each, as those of the residuals."""
    return {
        "centres": 0.5 * (top + bottom) / problem.centre_sigma()[:, None, None],
        "heights": (bottom - top)[:, 1:] / (problem.scale_px * problem.height_sigma())[:, None, None],
        "joints": joint / problem.joints.sigma_px[:, None, None],
    }


def _pixel_columns(rig: Rig, problem: PeopleProblem, by: Callable[[Lens, Floats], Floats]) -> dict[str, Floats]:
    """Whitened derivatives of residuals by what moves the pixels of a lens's rays (M, 3) by `by`, (M, 2, u)."""
    s, o = problem.sightings, problem.joints

    def moved(camera: Ints, rays: Floats) -> Floats:
        out = np.zeros((len(rays), 2, by(rig.cameras[0].lens, np.zeros((0, 3))).shape[2]))
        for c, own in enumerate(rig):
            out[camera == c] = by(own.lens, rays[camera == c])
        return np.nan_to_num(out)

    return _whitened(problem, moved(s.camera, s.top), moved(s.camera, s.bottom), moved(o.camera, o.bearing))


def _by_principal_point(lens: Lens, rays: Floats) -> Floats:
    """(M, 2, 2)"""
    return np.broadcast_to(np.eye(2), (len(rays), 2, 2))


def _by_distortion(lens: Lens, rays: Floats) -> Floats:
    """(M, 2, 1) by the first coefficient, radial in all models."""
    few = np.zeros(max(len(lens.distortions), 4))
    few[: len(lens.distortions)] = lens.distortions
    step = np.zeros_like(few)
    step[0] = 1e-4
    ends = [replace(lens, distortions=few + sign * step).project_rays(rays) for sign in (1, -1)]
    return np.asarray((ends[0] - ends[1]) / 2e-4)[:, :, None]


def _outward(ray: Floats, tangent: Floats) -> Floats:
    """(M, 2) pixels by which a ray's image moves for a focal length that is larger by a factor e."""
    if len(ray) == 0:
        return np.zeros((0, 2))
    depth = np.maximum(ray[:, 2], 0.1)
    plane = ray[:, :2] / depth[:, None]
    # In the plane z = 1 the point moves by itself; `tangent @ d / (b . d)` is how the image follows.
    moved = np.column_stack([plane, np.zeros(len(ray))])
    return np.asarray((tangent @ moved[:, :, None])[:, :, 0] * depth[:, None])


def _widened(term: Term, old: Layout, n: int, own: Floats | None, u: int) -> Term:
    """The term with columns for u more unknowns of each of n cameras behind its globals."""
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
