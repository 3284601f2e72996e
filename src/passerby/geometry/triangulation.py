"""Linear, vectorised triangulation of points from viewing rays, their residuals, and the derivatives of reprojection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Columns, Floats, Ints
from passerby.geometry.groups import group_sums
from passerby.geometry.rotations import direction_angle, skew

# Two rays whose angle is smaller than this (radians) count as parallel: a pixel's noise would move their point by kilometres.
PARALLEL = 1e-6
TWO_VIEW_ROUNDS = 3
POSE_SIZE = 6
# Smallest cosine of the angle between a point and its ray at which the point still counts as in the camera's view.
MIN_COSINE = 0.05


def triangulate(
    camera: Ints,
    point: Ints,
    bearing: Floats,
    rotations: Floats,
    translations: Floats,
    n_points: int,
    *,
    weights: Floats | None = None,
    iterations: int = 3,
) -> Floats:
    """Triangulate points: find the point nearest to its viewing rays, for any number of rays a point.

    The sum of squared distances to the rays is quadratic in the point. Each distance is divided by the point's distance from
    that camera, found in the iteration before: this gives the sum of squared angles, and angles are what a camera measures.

    Args:
        camera: (M,) index of the camera of each ray, 0 to C - 1.
        point: (M,) index of the point that the ray sees, 0 to `n_points` - 1.
        bearing: (M, 3) unit rays in their camera's frame.
        rotations: (C, 3, 3) world to camera.
        translations: (C, 3) world to camera; the points have the same unit.
        n_points: number of points N.
        weights: (M,) weight of each ray, 1 over the variance of its angle; equal weights when None.
        iterations: number of solutions; 1 gives the plain nearest point ("midpoint"), further ones divide by the distances.

    Returns:
        (N, 3) points in the world; NaN for a point with fewer than two rays or with parallel rays only. A point may lie
        behind a camera: see `depths`.
    """
    camera, point = np.asarray(camera, dtype=np.int64), np.asarray(point, dtype=np.int64)
    R = np.asarray(rotations, dtype=np.float64)[camera]
    direction = np.einsum("mji,mj->mi", R, np.asarray(bearing, dtype=np.float64))
    centre = -np.einsum("mji,mj->mi", R, np.asarray(translations, dtype=np.float64)[camera])
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    base = np.ones(len(camera)) if weights is None else np.asarray(weights, dtype=np.float64)
    distance = np.ones(len(camera))
    points = np.full((n_points, 3), np.nan)
    for _ in range(max(1, iterations)):
        weighted = (base / distance**2)[:, None, None] * across
        normal = group_sums(point, weighted.reshape(-1, 9), n_points).reshape(-1, 3, 3)
        right = group_sums(point, np.einsum("mij,mj->mi", weighted, centre), n_points)
        # For two rays of equal weight the eigenvalues are 1 - cos(angle), 1 + cos(angle) and 2.
        values = np.linalg.eigvalsh(normal)
        sound = values[:, 0] > PARALLEL**2 * np.maximum(values[:, 2], np.finfo(float).tiny)
        points[~sound] = np.nan
        points[sound] = np.linalg.solve(normal[sound], right[sound][:, :, None])[:, :, 0]
        reach = np.linalg.norm(points[point] - centre, axis=1)
        distance = np.where(np.isfinite(reach) & (reach > 0), reach, 1.0)
    return points


def triangulate_views(
    bearings: Floats, rotations: Floats, translations: Floats, weights: Floats
) -> tuple[Floats, dict[int, str]]:
    """Triangulate points that several cameras see, and state why some cannot be triangulated.

    Args:
        bearings: (C, N, 3) unit rays in their camera's frame; NaN where a camera does not see the point.
        rotations: (C, 3, 3) world to camera.
        translations: (C, 3) world to camera; the points have the same unit.
        weights: (C,) weight of each camera, 1 over the variance of a ray's angle.

    Returns:
        (N, 3) points in the world, and by row the reason for every point that is NaN.
    """
    seen = np.isfinite(bearings).all(axis=2)
    camera, point = np.nonzero(seen)
    rays, n_points = bearings[camera, point], bearings.shape[1]
    points = triangulate(camera, point, rays, rotations, translations, n_points, weights=np.asarray(weights)[camera])
    behind = depths(move_to_camera_frames(points, camera, point, rotations, translations), rays) <= 0
    views, behind_any = seen.sum(axis=0), np.bincount(point[behind], minlength=n_points) > 0
    faults = {}
    for row in np.flatnonzero(~np.isfinite(points).all(axis=1) | behind_any):
        if views[row] < 2:
            faults[int(row)] = f"{views[row]} camera{'' if views[row] == 1 else 's'} of the two or more that are needed see it"
        else:
            faults[int(row)] = "its rays meet behind a camera" if behind_any[row] else "its rays are parallel"
    points[list(faults)] = np.nan
    return points, faults


def triangulate_two_views(rays_a: Floats, rays_b: Floats, R_ba: Floats, t_ba: Floats) -> Floats:
    """Triangulate points seen by two cameras with `x_b = R_ba x_a + t_ba`: the points of `triangulate`, in closed form.

    Args:
        rays_a: (N, 3) unit rays in camera a's frame.
        rays_b: (N, 3) unit rays in camera b's frame.
        R_ba: (3, 3) rotation from a to b.
        t_ba: (3,) translation from a to b.

    Returns:
        (N, 3) points in camera a's frame, in the unit of `t_ba`; NaN where the rays are parallel.
    """
    to_a = np.asarray(R_ba, dtype=np.float64).T
    d, e = np.asarray(rays_a, dtype=np.float64), np.asarray(rays_b, dtype=np.float64) @ to_a.T
    centre = -to_a @ np.asarray(t_ba, dtype=np.float64)
    # For any weights, the least-squares point of two rays lies on the shortest segment between them.
    normal = np.cross(d, e)
    sine2 = np.einsum("ni,ni->n", normal, normal)
    along = np.where(sine2 > 0, sine2, 1.0)
    on_a = d * (np.einsum("ni,ni->n", np.cross(centre, e), normal) / along)[:, None]
    on_b = centre + e * (np.einsum("ni,ni->n", np.cross(centre, d), normal) / along)[:, None]
    weight_a = weight_b = np.ones(len(d))
    points = np.full((len(d), 3), np.nan)
    for _ in range(TWO_VIEW_ROUNDS):
        total = weight_a + weight_b
        product = weight_a * weight_b * sine2
        # The smallest of the eigenvalues that `triangulate` compares, computed without cancellation; the largest is the sum of
        # the weights.
        least = 2 * product / (total + np.sqrt(np.maximum(total**2 - 4 * product, 0.0)))
        sound = least > PARALLEL**2 * total
        points = (weight_a[:, None] * on_a + weight_b[:, None] * on_b) / total[:, None]
        points[~sound] = np.nan
        weight_a, weight_b = (_inverse_squares(points - from_) for from_ in (np.zeros(3), centre))
    return points


def _inverse_squares(reach: Floats) -> Floats:
    """Return 1 over the squared lengths (N,) of vectors (N, 3); 1 where the length is 0 or not finite."""
    square = np.einsum("ni,ni->n", reach, reach)
    return np.asarray(1.0 / np.where(np.isfinite(square) & (square > 0), square, 1.0))


def parallax_angles(rays_a: Floats, rays_b: Floats, R_ba: Floats) -> Floats:
    """Return the angles (N,) in radians between rays (N, 3) of two cameras with `x_b = R_ba x_a + t_ba`."""
    return direction_angle(np.asarray(rays_a, dtype=np.float64) @ np.asarray(R_ba, dtype=np.float64).T, rays_b)


def move_to_camera_frames(points: Floats, camera: Ints, point: Ints, rotations: Floats, translations: Floats) -> Floats:
    """Return points (M, 3) in their cameras' frames: row m is point `point[m]` in the frame of camera `camera[m]`."""
    R, t = np.asarray(rotations)[camera], np.asarray(translations)[camera]
    return np.asarray(np.einsum("mij,mj->mi", R, np.asarray(points)[point]) + t)


def depths(points_c: Floats, bearing: Floats) -> Floats:
    """Return the signed depths (M,) of points (M, 3) in the camera's frame along their unit rays (M, 3): above 0 is in front.

    The depth is along the ray, not along the optical axis, so that it also holds for a fisheye's rays beyond 90 degrees.
    """
    return np.asarray((points_c * bearing).sum(axis=-1))


def angular_residuals(points_c: Floats, bearing: Floats) -> Floats:
    """Return the angles (M,) in radians between points (M, 3) in the camera's frame and their viewing rays (M, 3)."""
    return direction_angle(points_c, bearing)


def reprojection_residuals(points_c: Floats, bearing: Floats, tangent: Floats) -> Floats:
    """Compute reprojection residuals of points in the camera's frame, linearised at their viewing rays.

    Args:
        points_c: (M, 3) points in the camera's frame, any unit.
        bearing: (M, 3) unit viewing rays.
        tangent: (M, 2, 3) maps from the camera's frame to pixels at these rays (`Lens.tangents`).

    Returns:
        (M, 2) pixels, projection minus measurement; NaN for a point that is not in front of its ray.
    """
    along = depths(points_c, bearing)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = points_c / np.where(along > 0, along, np.nan)[:, None]
    return np.asarray(np.einsum("mij,mj->mi", tangent, scaled))


@dataclass(frozen=True, eq=False)
class PointObservations(Columns):
    """M sightings of points by cameras."""

    camera: Ints
    """(M,) camera index."""
    point: Ints
    """(M,) point index."""
    bearing: Floats
    """(M, 3) unit viewing rays, camera frame."""
    tangent: Floats
    """(M, 2, 3) pixels, from `Lens.tangents`."""
    sigma_px: Floats
    """(M,) standard deviation of the sighting, pixels."""
    velocity: Floats | None = None
    """(M, 2) velocity of the point in the image, pixels a second; None where time offsets are not estimated."""
    pixels: Floats | None = None
    """(M, 2) observed pixels; this and the next two fields are None where lenses are not refined."""
    lens_at: Floats | None = None
    """(M, L) lens parameters with which the ray was computed, as additions to the stated ones."""
    by_lens: Floats | None = None
    """(M, 2, L) derivative of the pixel by the lens parameters."""


def hold_depth(depth: Floats, square: Floats) -> Floats:
    """Return the depths (M,) by which residuals are divided, from depths along the rays and squared distances (M,).

    A point behind its ray has no residual. The depth is kept above a lower bound, so that the cost is large but finite.
    """
    return np.maximum(depth, MIN_COSINE * np.sqrt(square) + 1e-9)


def project_near(bearing: Floats, tangent: Floats, d: Floats) -> tuple[Floats, Floats]:
    """Compute the pixel residuals of camera-frame points near their rays, and the derivative.

    Args:
        bearing: (M, 3) observed unit rays.
        tangent: (M, 2, 3) from `Lens.tangents`.
        d: (M, 3) points in the camera frame.

    Returns:
        residual (M, 2) in pixels and its derivative by `d` (M, 2, 3).
    """
    inverse = 1.0 / hold_depth(np.einsum("mi,mi->m", bearing, d), np.einsum("mi,mi->m", d, d))
    residual = (tangent[:, :, 0] * d[:, :1] + tangent[:, :, 1] * d[:, 1:2] + tangent[:, :, 2] * d[:, 2:]) * inverse[:, None]
    by_d = (tangent - residual[:, :, None] * bearing[:, None, :]) * inverse[:, None, None]
    return residual, by_d


def pose_jacobian(by_d: Floats, d: Floats, R: Floats) -> tuple[Floats, Floats]:
    """Compute derivatives by a camera's rotation vector and centre (M, k, 6), and by the world point (M, k, 3).

    Args:
        by_d: (M, k, 3) derivative by the camera-frame point.
        d: (M, 3) camera-frame points.
        R: (M, 3, 3) world-to-camera rotations, one a row.
    """
    by_point = by_d @ R
    by_rotation = -by_d @ skew(d)
    return np.concatenate([by_rotation, -by_point], axis=2), by_point


def retract_poses(R: Floats, centre: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Move poses (C, 3, 3), (C, 3) by steps (C, 6): rotation vectors in the cameras' frames, then centres."""
    from scipy.spatial.transform import Rotation  # imports in a quarter of a second; reading a scene does not need it

    return Rotation.from_rotvec(step[:, :3]).as_matrix() @ R, centre + step[:, 3:6]
