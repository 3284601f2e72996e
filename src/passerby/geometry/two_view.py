"""Relative pose of two cameras that see the same points, from a robust estimate of the essential matrix.

Frames: `x_b = R_ba x_a + t_ba`; the essential matrix fulfils `ray_b^T E ray_a = 0` with `E = [t_ba]x R_ba`. The length of the
baseline is not observable, so `t_ba` is a unit vector.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import poselib

from passerby.common.arrays import Bools, Floats
from passerby.common.errors import EvidenceError
from passerby.geometry.rotations import skew
from passerby.geometry.triangulation import depths, triangulate_two_views

# PoseLib takes points on the image plane z = 1, where the coordinates of a ray near 90 degrees and their noise go to infinity.
# Rays of a fisheye beyond this angle from the axis are left out of the search, but afterwards judged by angle like all others.
MAX_OFF_AXIS = np.deg2rad(80.0)
# PoseLib measures in pixels: normalised coordinates are passed to it as those of a camera with this focal length.
FOCAL_PX = 1000.0
# An essential matrix needs five points; PoseLib's local optimisation and a judgement of the fit need some more.
MIN_POINTS = 8


class NoRelativePoseError(EvidenceError):
    """The rays of two cameras fix no relative pose."""

    def __init__(self, common: int, usable: int, agreeing: int | None = None) -> None:
        """Store the counts of ray pairs: `common`, `usable` for the search, `agreeing` with the best pose (None: no pose)."""
        found = "no pose" if agreeing is None else f"{agreeing} agree with the best pose"
        super().__init__(f"{common} common points, {usable} usable: {found}; at least {MIN_POINTS} are needed")
        self.common, self.usable, self.agreeing = common, usable, agreeing

    def __reduce__(self) -> tuple[type[NoRelativePoseError], tuple[int, int, int | None]]:
        # An exception that another process raised is built again from its arguments.
        return type(self), (self.common, self.usable, self.agreeing)


@dataclass(frozen=True, eq=False)
class TwoView:
    """The relative pose of two cameras, up to the length of the baseline."""

    R_ba: Floats
    """(3, 3) rotation, camera a to camera b."""
    t_ba: Floats
    """(3,) unit translation, camera a to camera b."""
    inliers: Bools
    """(N,) whether a ray pair agrees: epipolar error within the threshold, and the point in front of both cameras."""
    score: float
    """Sum over the inliers of `1 - (error / threshold)^2` (MSAC); higher is better, N is the maximum."""

    @property
    def essential(self) -> Floats:
        """(3, 3) essential matrix of this pose."""
        return essential_matrix(self.R_ba, self.t_ba)


def estimate_relative_pose(
    rays_a: Floats,
    rays_b: Floats,
    *,
    threshold: float,
    rng: np.random.Generator,
    max_points: int = 2000,
    min_iterations: int = 1000,
    max_iterations: int = 10_000,
) -> TwoView:
    """Estimate the relative pose that agrees with most ray pairs: five-point RANSAC with local optimisation, by PoseLib.

    PoseLib is 3 to 5 times more accurate than OpenCV at the noise of people's boxes. Where more than `max_points` ray pairs are
    usable, a random subset of this size is searched; inliers and score are computed on all ray pairs.

    Args:
        rays_a: (N, 3) unit rays in camera a's frame.
        rays_b: (N, 3) unit rays to the same points in camera b's frame.
        threshold: largest epipolar error (Sampson) of an inlier, radians: pixels over the focal length.
        rng: draws the subset and PoseLib's seed: the same state gives the same pose, bit for bit.
        max_points: largest number of ray pairs passed to PoseLib.
        min_iterations: smallest number of RANSAC iterations.
        max_iterations: largest number of RANSAC iterations.

    Raises:
        NoRelativePoseError: fewer than 8 usable ray pairs, or no pose with at least 8 inliers.
    """
    rays_a, rays_b = np.asarray(rays_a, dtype=np.float64), np.asarray(rays_b, dtype=np.float64)
    usable = np.flatnonzero(_find_near_axis(rays_a) & _find_near_axis(rays_b))
    if len(usable) < MIN_POINTS:
        raise NoRelativePoseError(len(rays_a), len(usable))
    if len(usable) > max_points:
        usable = np.sort(rng.choice(usable, max_points, replace=False))
    lens = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [FOCAL_PX, 0.0, 0.0]}
    found, _ = poselib.estimate_relative_pose(
        FOCAL_PX * rays_a[usable, :2] / rays_a[usable, 2:],
        FOCAL_PX * rays_b[usable, :2] / rays_b[usable, 2:],
        lens,
        lens,
        {
            "max_epipolar_error": FOCAL_PX * threshold,
            "min_iterations": min_iterations,
            "max_iterations": max_iterations,
            "seed": int(rng.integers(2**31)),
        },
        {"loss_type": "CAUCHY", "loss_scale": 0.5 * FOCAL_PX * threshold},
    )
    R_ba = np.asarray(found.R, dtype=np.float64)
    t_ba = np.asarray(found.t, dtype=np.float64)
    length = float(np.linalg.norm(t_ba))
    if not (np.isfinite(R_ba).all() and length > 0):
        raise NoRelativePoseError(len(rays_a), len(usable))
    view = judge_pose(R_ba, t_ba / length, rays_a, rays_b, threshold)
    if np.count_nonzero(view.inliers) < MIN_POINTS:
        raise NoRelativePoseError(len(rays_a), len(usable), int(np.count_nonzero(view.inliers)))
    return view


def judge_pose(R_ba: Floats, t_ba: Floats, rays_a: Floats, rays_b: Floats, threshold: float) -> TwoView:
    """Return a relative pose with its inliers and score among rays (N, 3); `threshold` in radians."""
    error = epipolar_errors(essential_matrix(R_ba, t_ba), rays_a, rays_b)
    inliers = (error <= threshold) & find_in_front_of_both(R_ba, t_ba, rays_a, rays_b)
    return TwoView(R_ba, t_ba, inliers, float((1.0 - (error[inliers] / threshold) ** 2).sum()))


def essential_matrix(R_ba: Floats, t_ba: Floats) -> Floats:
    """Return the essential matrix (3, 3) `[t_ba]x R_ba`: `ray_b^T E ray_a = 0` for every point that both cameras see."""
    return np.asarray(skew(t_ba) @ R_ba)


def decompose_essential(essential: Floats) -> tuple[tuple[Floats, Floats], ...]:
    """Return the four relative poses (R_ba (3, 3), unit t_ba (3,)) of an essential matrix (3, 3) of any scale and sign.

    Hartley, Zisserman, "Multiple View Geometry", 2nd edition, result 9.19.
    """
    U, _, Vt = np.linalg.svd(np.asarray(essential, dtype=np.float64))
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turns, t = (U @ W @ Vt, U @ W.T @ Vt), U[:, 2]
    return tuple((R, sign * t) for R in turns for sign in (1.0, -1.0))


def choose_by_cheirality(
    candidates: tuple[tuple[Floats, Floats], ...], rays_a: Floats, rays_b: Floats
) -> tuple[Floats, Floats, Bools]:
    """Choose the candidate pose with the most points in front of both cameras.

    Args:
        candidates: poses (R_ba, t_ba), as from `decompose_essential`.
        rays_a: (N, 3) unit rays in camera a's frame.
        rays_b: (N, 3) unit rays in camera b's frame.

    Returns:
        R_ba (3, 3), t_ba (3,), and (N,) whether each point lies in front of both; the first pose of several equal ones.
    """
    masks = [find_in_front_of_both(R, t, rays_a, rays_b) for R, t in candidates]
    best = int(np.argmax([np.count_nonzero(mask) for mask in masks]))
    return (*candidates[best], masks[best])


def find_in_front_of_both(R_ba: Floats, t_ba: Floats, rays_a: Floats, rays_b: Floats) -> Bools:
    """Return whether the point of each ray pair (N,) is in front of both cameras, along the rays; False for parallel rays."""
    points = triangulate_two_views(rays_a, rays_b, R_ba, t_ba)
    with np.errstate(invalid="ignore"):
        return np.asarray((depths(points, rays_a) > 0) & (depths(points @ np.asarray(R_ba).T + t_ba, rays_b) > 0))


def epipolar_errors(essential: Floats, rays_a: Floats, rays_b: Floats) -> Floats:
    """Compute the Sampson errors (N,) of ray pairs (N, 3) on the viewing sphere, radians.

    To first order, this is the angle by which both rays together have to turn to meet. On the sphere, unlike on the image
    plane, it means the same at the border of a wide lens as in the middle.
    """
    to_b, to_a = rays_a @ essential.T, rays_b @ essential
    product = (rays_b * to_b).sum(axis=1)
    # The gradient by a ray on the unit sphere is the component of the full gradient that is orthogonal to the ray.
    slope = (to_b**2).sum(axis=1) + (to_a**2).sum(axis=1) - 2 * product**2
    return np.asarray(np.abs(product) / np.sqrt(np.maximum(slope, np.finfo(float).tiny)))


def _find_near_axis(rays: Floats) -> Bools:
    with np.errstate(invalid="ignore"):
        return np.asarray(rays[:, 2] > np.cos(MAX_OFF_AXIS) * np.linalg.norm(rays, axis=1))


@dataclass(frozen=True, eq=False)
class PairHypothesis:
    """One hypothesis of the relative pose of cameras a and b: `x_b = R_ba x_a + t_ba`, metres."""

    a: int
    b: int
    R_ba: Floats
    t_ba: Floats
    route: str
    """ground | epipolar | joints; tracks: given from outside, found before any person was identified in both cameras."""
    inliers: int
    matches: int

    def among(self, cameras: Sequence[int]) -> PairHypothesis | None:
        """Return the same hypothesis in a rig of these cameras only; None where one of its two cameras is not among them."""
        if self.a not in cameras or self.b not in cameras:
            return None
        return replace(self, a=list(cameras).index(self.a), b=list(cameras).index(self.b))

    @property
    def inverse(self) -> PairHypothesis:
        """The same hypothesis from b to a."""
        return PairHypothesis(self.b, self.a, self.R_ba.T, -self.R_ba.T @ self.t_ba, self.route, self.inliers, self.matches)
