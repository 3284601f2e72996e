"""Reprojection near a measured ray, its derivatives, and steps of poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Columns, Floats, Ints
from passerby.geometry.rotations import skew

POSE_SIZE = 6

# A point that comes closer than this share of its distance to the plane of its own ray has left the camera's view.
_MIN_COSINE = 0.05


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
    """(M, 2) how fast the point moves through the picture, pixels a second; None where time is no question."""
    pixels: Floats | None = None
    """(M, 2) where it was seen; this and the next two None where lenses are not refined."""
    lens_at: Floats | None = None
    """(M, L) the camera's lens that the ray was made with, as what is added to the stated one."""
    by_lens: Floats | None = None
    """(M, 2, L) how the pixel moves with it."""
    distortion_slope: Floats | None = None
    """(M, 2, 2) how that by the distortion changes with the pixel; None where the distortion is not refined."""


def held_depth(depth: Floats, square: Floats) -> Floats:
    """(M,) depths of points along their rays by which residuals are divided, from the depths and squared distances (M,).

    A point behind its ray has no residual: the depth is held above a floor so that the cost is large but finite.
    """
    return np.maximum(depth, _MIN_COSINE * np.sqrt(square) + 1e-9)


def project_near(bearing: Floats, tangent: Floats, d: Floats) -> tuple[Floats, Floats]:
    """Pixel residuals of camera-frame points near their rays, and the derivative.

    Args:
        bearing: (M, 3) observed unit rays.
        tangent: (M, 2, 3) from `Lens.tangents`.
        d: (M, 3) points in the camera frame.

    Returns:
        residual (M, 2) in pixels and its derivative by d (M, 2, 3).
    """
    inverse = 1.0 / held_depth(np.einsum("mi,mi->m", bearing, d), np.einsum("mi,mi->m", d, d))
    residual = (tangent[:, :, 0] * d[:, :1] + tangent[:, :, 1] * d[:, 1:2] + tangent[:, :, 2] * d[:, 2:]) * inverse[:, None]
    by_d = (tangent - residual[:, :, None] * bearing[:, None, :]) * inverse[:, None, None]
    return residual, by_d


def pose_jacobian(by_d: Floats, d: Floats, R: Floats) -> tuple[Floats, Floats]:
    """Derivatives by a camera's rotation vector and centre (M, k, 6), and by the world point (M, k, 3).

    Args:
        by_d: (M, k, 3) derivative by the camera-frame point.
        d: (M, 3) camera-frame points.
        R: (M, 3, 3) world-to-camera rotations, one a row.
    """
    by_point = by_d @ R
    by_rotation = -by_d @ skew(d)
    return np.concatenate([by_rotation, -by_point], axis=2), by_point


def retract_poses(R: Floats, centre: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Move poses (C, 3, 3), (C, 3) by (C, 6): rotation vectors in the cameras' frames, then centres."""
    return Rotation.from_rotvec(step[:, :3]).as_matrix() @ R, centre + step[:, 3:6]
