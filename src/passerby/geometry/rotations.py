"""Rotations: rotation vectors, angles between rotations and directions, the smallest turn between two directions."""

from __future__ import annotations

import math

import numpy as np

from passerby.common.arrays import Floats

MOST_BY_SINE = 3.0
"""Radians up to which a turn's axis is taken from the difference of the matrix and its inverse."""


def skew(vectors: Floats) -> Floats:
    """Cross-product matrices: (..., 3) to (..., 3, 3) with `skew(v) @ w = v x w`."""
    v = np.asarray(vectors, dtype=np.float64)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def exp_rotation(vectors: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues)."""
    v = np.asarray(vectors, dtype=np.float64)
    if v.size == 0:
        return np.zeros((*v.shape, 3))
    if v.ndim == 1:
        return _exp_single(v)
    from scipy.spatial.transform import Rotation  # a quarter of a second, which reading a scene does without

    matrices = Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()
    return np.asarray(matrices, dtype=np.float64).reshape(*v.shape, 3)


def log_rotation(rotations: Floats) -> Floats:
    """Rotation vectors (..., 3) in radians, at most pi long, of rotation matrices (..., 3, 3)."""
    R = np.asarray(rotations, dtype=np.float64)
    if R.size == 0:
        return np.zeros(R.shape[:-1])
    if R.ndim == 2 and (vector := _log_single(R)) is not None:
        return vector
    from scipy.spatial.transform import Rotation

    vectors = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(vectors, dtype=np.float64).reshape(R.shape[:-1])


def _exp_single(vector: Floats) -> Floats:
    """`exp_rotation` of one vector, in a tenth of the time that the library takes for it."""
    angle = math.sqrt(float(vector @ vector))
    half = 0.5 * angle
    # sin(a) / a, and (1 - cos(a)) / a^2 without the difference.
    first, second = (math.sin(angle) / angle, 0.5 * (math.sin(half) / half) ** 2) if angle > 1e-9 else (1.0, 0.5)
    x, y, z = vector.tolist()
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    xx, yy, zz = second * x * x, second * y * y, second * z * z
    x, y, z = first * x, first * y, first * z
    return np.array([[1 - yy - zz, xy - z, xz + y], [xy + z, 1 - xx - zz, yz - x], [xz - y, yz + x, 1 - xx - yy]])


def _log_single(rotation: Floats) -> Floats | None:
    """`log_rotation` of one matrix, in the same way; None near a turn by half, where the sine gives no axis."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    axis = np.array([h - f, c - g, d - b])
    sine, cosine = 0.5 * math.sqrt(float(axis @ axis)), 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if angle > MOST_BY_SINE:
        return None
    return np.asarray(axis * (0.5 * angle / sine if sine > 1e-9 else 0.5))


def angle_between(R_a: Floats, R_b: Floats) -> Floats:
    """Angles (...) in radians, 0 to pi, of the rotations `R_a R_b^T`, both (..., 3, 3) and broadcast."""
    difference = np.asarray(R_a, dtype=np.float64) @ np.swapaxes(np.asarray(R_b, dtype=np.float64), -1, -2)
    # From the sine and the cosine: exact at both ends, and without a library call for a single matrix.
    axis = np.stack([difference[..., i, j] - difference[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)
    sine, cosine = np.sqrt((axis * axis).sum(axis=-1)), np.trace(difference, axis1=-2, axis2=-1) - 1
    return np.asarray(np.arctan2(sine, cosine))


def direction_angle(a: Floats, b: Floats) -> Floats:
    """Angles (...) in radians, 0 to pi, between directions (..., 3) of any length; exact for small angles too."""
    a, b = np.broadcast_arrays(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64))
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def rotation_between(a: Floats, b: Floats) -> Floats:
    """The smallest rotation (3, 3) that turns direction `a` (3,) into direction `b` (3,).

    Of opposite directions the axis is free; one orthogonal to `a` is taken.
    """
    a = np.asarray(a, dtype=np.float64) / np.linalg.norm(a)
    b = np.asarray(b, dtype=np.float64) / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-12:
        if cosine > 0:
            return np.eye(3)
        helper = np.eye(3)[int(np.argmin(np.abs(a)))]
        axis = np.cross(a, helper)
        return exp_rotation(np.pi * axis / np.linalg.norm(axis))
    return exp_rotation(np.arctan2(sine, cosine) * axis / sine)
