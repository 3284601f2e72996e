"""Bundle adjustment of camera poses and 3D points on reprojection error.

Poses move by `R <- exp(w) R`, `C <- C + c`: a rotation vector in the camera's frame and the centre in the world. The residual
of a point seen near the ray b is `tangent @ d / (b . d)` with `d = R (X - C)` (see `Lens.tangents`), in pixels, for any lens.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose
from passerby.geometry.triangulation import MIN_COSINE, POSE_SIZE, PointObservations, retract_poses
from passerby.solver.optimizer.least_squares import Cauchy, Family, Layout, Loss, Step, Stopping, Term, minimise


@dataclass(frozen=True, eq=False)
class PointAdjustment:
    """Adjusted poses and points."""

    poses: tuple[Pose, ...]
    points: Floats
    """(N, 3) world, metres."""
    residuals_px: Floats
    """(M, 2) residuals in the order of the given sightings."""
    rms_px: float
    """Root mean square of the residual lengths, with their robust weights."""
    iterations: int
    converged: bool
    pose_covariance: Floats
    """(C, 6, 6) centre (metres), rotation vector (radians, camera frame); scaled by the residuals' variance."""


@dataclass(frozen=True, eq=False)
class _PointState:
    R: Floats
    centre: Floats
    points: Floats


class _PointProblem:
    """Poses and points as a problem of `least_squares`."""

    def __init__(self, n_cameras: int, n_points: int, observations: PointObservations, loss: Loss) -> None:
        order = np.argsort(observations.camera, kind="stable")
        self.order = order
        self.observations = o = observations.take(order)
        self.loss = loss
        self.layout = Layout(n_cameras, POSE_SIZE, families=(Family(n_points, 3),))
        # Stored by component, each a row of M numbers: many tiny matrices cost more in calls than in arithmetic.
        self.bearing = np.ascontiguousarray(o.bearing.T)
        self.tangent = np.ascontiguousarray((o.tangent / o.sigma_px[:, None, None]).transpose(1, 2, 0))
        bounds = np.searchsorted(o.camera, np.arange(n_cameras + 1))
        self.rows = [slice(i, j) for i, j in itertools.pairwise(bounds)]

    def terms(self, state: _PointState, *, jacobians: bool) -> list[Term]:
        """Return the residuals of `project_near`, in sigmas, and their Jacobians, stored by component."""
        o, bearing, tangent = self.observations, self.bearing, self.tangent
        count = len(o.camera)
        world = np.ascontiguousarray(state.points.T)
        d = np.empty((3, count))
        for c, rows in enumerate(self.rows):
            np.matmul(state.R[c], np.take(world, o.point[rows], axis=1) - state.centre[c][:, None], out=d[:, rows])
        depth = (bearing * d).sum(axis=0)
        depth = np.maximum(depth, MIN_COSINE * np.sqrt((d * d).sum(axis=0)) + 1e-9)
        inverse = 1.0 / depth
        r = (tangent[:, 0] * d[0] + tangent[:, 1] * d[1] + tangent[:, 2] * d[2]) * inverse
        if not jacobians:
            return [Term(r.T, self.loss)]
        by_pose = np.empty((2, POSE_SIZE, count))
        by_d = (tangent - r[:, None] * bearing) * inverse
        # g . (d x w) = w . (g x d); the residual's derivative by the rotation is the negative of this.
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            by_pose[:, i] = d[j] * by_d[:, k] - d[k] * by_d[:, j]
        by_point = np.empty((2, 3, count))
        for c, rows in enumerate(self.rows):
            by_point[:, :, rows] = state.R[c].T @ by_d[:, :, rows]
        np.negative(by_point, out=by_pose[:, 3:])
        by_camera, by_block = by_pose.transpose(2, 0, 1), by_point.transpose(2, 0, 1)
        return [Term(r.T, self.loss, camera=o.camera, by_camera=by_camera, block=o.point, by_block=by_block)]

    def retract(self, state: _PointState, step: Step) -> _PointState:
        """Return the state after a step of rotations, centres and points."""
        R, centre = retract_poses(state.R, state.centre, step.shared.reshape(-1, POSE_SIZE))
        return _PointState(R, centre, state.points + step.blocks[0])


def adjust_points(
    poses: Sequence[Pose],
    points: Floats,
    observations: PointObservations,
    *,
    fixed_cameras: Sequence[int] = (0,),
    loss_scale_px: float = 2.0,
    max_iterations: int = 100,
    fix_scale: bool = True,
) -> PointAdjustment:
    """Refine poses and points on robust reprojection error.

    Args:
        poses: C poses.
        points: (N, 3) world points, metres.
        observations: M sightings; a camera sees a point at most once.
        fixed_cameras: cameras whose pose is held.
        loss_scale_px: scale of the Cauchy loss, in units of the sightings' sigma.
        max_iterations: limit of the solver.
        fix_scale: whether to keep the distance between the fixed camera and the camera farthest from it, by rescaling the
            result about the fixed camera; the residuals do not depend on it. Used with one fixed camera only.
    """
    R = np.array([pose.R_cw for pose in poses])
    centre = np.array([pose.centre for pose in poses])
    n_cameras, n_points = len(R), len(points)
    problem = _PointProblem(n_cameras, n_points, observations, Cauchy(loss_scale_px))
    free = np.ones((n_cameras, POSE_SIZE), dtype=bool)
    free[list(fixed_cameras)] = False
    start = _PointState(R, centre, np.array(points, dtype=np.float64))
    result = minimise(problem, start, Stopping(max_iterations), free=free.ravel())
    state = result.state
    if fix_scale and len(fixed_cameras) == 1:
        state = _rescaled(state, start, fixed_cameras[0])
    term = problem.terms(state, jacobians=False)[0]
    squared = np.einsum("mk,mk->m", term.residual, term.residual)
    weight = problem.loss.weight(squared)
    residuals = np.empty_like(term.residual)
    residuals[problem.order] = term.residual * problem.observations.sigma_px[:, None]
    sigma2 = problem.observations.sigma_px**2
    variance = _robust_variance(squared, weight, loss_scale_px, int(np.count_nonzero(free)) + 3 * n_points)
    rms = float(np.sqrt(np.sum(weight * squared * sigma2) / max(np.sum(weight), 1e-12)))
    return PointAdjustment(
        poses=tuple(Pose.from_centre(state.R[c], state.centre[c]) for c in range(n_cameras)),
        points=state.points,
        residuals_px=residuals,
        rms_px=rms,
        iterations=result.iterations,
        converged=result.converged,
        pose_covariance=_pose_covariance(result.normal.reduce().H, free.ravel(), n_cameras) * variance,
    )


def _rescaled(state: _PointState, start: _PointState, fixed: int) -> _PointState:
    """Scale about the fixed camera's centre so that the farthest camera keeps its distance."""
    origin = start.centre[fixed]
    before = np.linalg.norm(start.centre - origin, axis=1)
    far = int(np.argmax(before))
    now = float(np.linalg.norm(state.centre[far] - origin))
    if before[far] < 1e-9 or now < 1e-9:
        return state
    scale = before[far] / now
    return _PointState(state.R, origin + scale * (state.centre - origin), origin + scale * (state.points - origin))


def _robust_variance(squared: Floats, weight: Floats, scale: float, unknowns: int) -> float:
    """Return the factor by which the inverse of the reweighted normal equations becomes a covariance.

    An M-estimator's covariance is `mean(psi^2) / mean(psi')^2` times the inverse of the unweighted equations, with a
    correction for the unknowns, each of which absorbs a residual (Huber, *Robust Statistics*, 1981, section 7.6). The mean of
    the weights converts one inverse into the other.
    """
    count = 2 * len(squared)
    spread = 0.5 * np.mean(weight**2 * squared)
    slope = np.mean(weight - squared * weight**2 / scale**2)
    return float(spread / slope**2 * np.mean(weight) * count / max(count - unknowns, 1))


def _pose_covariance(H: Floats, free: NDArray[np.bool_], n_cameras: int) -> Floats:
    """Return the covariance (C, 6, 6), centre first; the pseudo-inverse leaves out the unobservable scale."""
    full = np.zeros_like(H)
    index = np.flatnonzero(free)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H)[index], 1e-12))
    inverse = np.linalg.pinv(H[np.ix_(index, index)] * scale[:, None] * scale, rcond=1e-10, hermitian=True)
    full[np.ix_(index, index)] = inverse * scale[:, None] * scale
    blocks = np.array([full[c * 6 : c * 6 + 6, c * 6 : c * 6 + 6] for c in range(n_cameras)])
    order = [3, 4, 5, 0, 1, 2]
    return np.asarray(blocks[:, order][:, :, order])
