"""Rotations and similarities: rotation vectors, angles, and the least-squares fit of one point set to another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError

MOST_BY_SINE = 3.0
"""Largest rotation angle, radians, at which the axis is computed from the difference of the matrix and its inverse."""


def skew(vectors: Floats) -> Floats:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3): `skew(v) @ w = v x w`."""
    v = np.asarray(vectors, dtype=np.float64)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def exp_rotation(vectors: Floats) -> Floats:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues)."""
    v = np.asarray(vectors, dtype=np.float64)
    if v.size == 0:
        return np.zeros((*v.shape, 3))
    if v.ndim == 1:
        return _exp_single(v)
    from scipy.spatial.transform import Rotation  # imports in a quarter of a second; reading a scene does not need it

    matrices = Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()
    return np.asarray(matrices, dtype=np.float64).reshape(*v.shape, 3)


def log_rotation(rotations: Floats) -> Floats:
    """Return the rotation vectors (..., 3) in radians, at most pi long, of rotation matrices (..., 3, 3)."""
    R = np.asarray(rotations, dtype=np.float64)
    if R.size == 0:
        return np.zeros(R.shape[:-1])
    if R.ndim == 2 and (vector := _log_single(R)) is not None:
        return vector
    from scipy.spatial.transform import Rotation

    vectors = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(vectors, dtype=np.float64).reshape(R.shape[:-1])


def _exp_single(vector: Floats) -> Floats:
    """Compute `exp_rotation` of one vector (3,), in a tenth of the time that scipy takes."""
    angle = math.sqrt(float(vector @ vector))
    half = 0.5 * angle
    # sin(a) / a, and (1 - cos(a)) / a^2 computed from the half angle, without the cancellation of 1 - cos(a).
    first, second = (math.sin(angle) / angle, 0.5 * (math.sin(half) / half) ** 2) if angle > 1e-9 else (1.0, 0.5)
    x, y, z = vector.tolist()
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    xx, yy, zz = second * x * x, second * y * y, second * z * z
    x, y, z = first * x, first * y, first * z
    return np.array([[1 - yy - zz, xy - z, xz + y], [xy + z, 1 - xx - zz, yz - x], [xz - y, yz + x, 1 - xx - yy]])


def _log_single(rotation: Floats) -> Floats | None:
    """Compute `log_rotation` of one matrix (3, 3) without scipy; None near an angle of pi, where the sine gives no axis."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    axis = np.array([h - f, c - g, d - b])
    sine, cosine = 0.5 * math.sqrt(float(axis @ axis)), 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if angle > MOST_BY_SINE:
        return None
    return np.asarray(axis * (0.5 * angle / sine if sine > 1e-9 else 0.5))


def angle_between(R_a: Floats, R_b: Floats) -> Floats:
    """Return the angles (...) in radians, 0 to pi, of the rotations `R_a R_b^T`, both (..., 3, 3) and broadcast."""
    difference = np.asarray(R_a, dtype=np.float64) @ np.swapaxes(np.asarray(R_b, dtype=np.float64), -1, -2)
    # Sine and cosine together are exact near 0 and near pi, and need no library call for a single matrix.
    axis = np.stack([difference[..., i, j] - difference[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)
    sine, cosine = np.sqrt((axis * axis).sum(axis=-1)), np.trace(difference, axis1=-2, axis2=-1) - 1
    return np.asarray(np.arctan2(sine, cosine))


def direction_angle(a: Floats, b: Floats) -> Floats:
    """Return the angles (...) in radians, 0 to pi, between directions (..., 3) of any length; exact for small angles too."""
    a, b = np.broadcast_arrays(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64))
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def rotation_between(a: Floats, b: Floats) -> Floats:
    """Return the smallest rotation (3, 3) that turns direction `a` (3,) into direction `b` (3,).

    For opposite directions the axis is not determined; an axis orthogonal to `a` is taken.
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


@dataclass(frozen=True, eq=False)
class Similarity:
    """The similarity `X -> scale rotation X + translation` in space."""

    scale: float
    rotation: Floats
    """(3, 3) rotation."""
    translation: Floats
    """(3,), in the target's unit."""

    def apply(self, points: Floats) -> Floats:
        """Apply the similarity to points (..., 3)."""
        return np.asarray(self.scale * np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation)

    def inverse(self) -> Similarity:
        """Return the map from the target back to the source."""
        rotation = self.rotation.T
        return Similarity(1.0 / self.scale, rotation, -rotation @ self.translation / self.scale)


@dataclass(frozen=True, eq=False)
class PlaneSimilarity:
    """The similarity `x -> scale rotation(yaw) x + translation` in the plane."""

    scale: float
    yaw: float
    """Radians, counter-clockwise."""
    translation: Floats
    """(2,), in the target's unit."""

    @property
    def rotation(self) -> Floats:
        """(2, 2) rotation."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, -s], [s, c]])

    def apply(self, points: Floats) -> Floats:
        """Apply the similarity to points (..., 2)."""
        return np.asarray(self.scale * np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation)

    def inverse(self) -> PlaneSimilarity:
        """Return the map from the target back to the source."""
        back = PlaneSimilarity(1.0 / self.scale, -self.yaw, np.zeros(2))
        return PlaneSimilarity(back.scale, back.yaw, -back.apply(self.translation))


def fit_similarity(source: Floats, target: Floats, weights: Floats | None = None, *, with_scale: bool = True) -> Similarity:
    """Fit the similarity that moves `source` onto `target` with the smallest weighted squared distance.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991, with weights. Points
    on one line do not determine the rotation about that line; then any one of the minimisers is returned.

    Args:
        source: (N, 3) points.
        target: (N, 3) the corresponding points.
        weights: (N,) at least 0; equal weights when None.
        with_scale: False keeps the scale at 1 (a rigid motion).

    Raises:
        EvidenceError: fewer than two points of positive weight, or, with scale, all source points in one place.
    """
    source, target, w, source_mean, target_mean = _centre_points(source, target, weights)
    covariance = (w[:, None] * target).T @ source
    U, singular, Vt = np.linalg.svd(covariance)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    rotation = (U * sign) @ Vt
    scale = float((singular * sign).sum() / _spread(source, w)) if with_scale else 1.0
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def fit_plane_similarity(
    source: Floats, target: Floats, weights: Floats | None = None, *, with_scale: bool = True
) -> PlaneSimilarity:
    """Fit the plane similarity that moves `source` (N, 2) onto `target` (N, 2) with the smallest weighted squared distance.

    Two points determine it. The arguments and errors are those of `fit_similarity`.
    """
    source, target, w, source_mean, target_mean = _centre_points(source, target, weights)
    along = float((w * (source * target).sum(axis=1)).sum())
    across = float((w * (source[:, 0] * target[:, 1] - source[:, 1] * target[:, 0])).sum())
    scale = float(np.hypot(along, across) / _spread(source, w)) if with_scale else 1.0
    turn = PlaneSimilarity(scale, float(np.arctan2(across, along)), np.zeros(2))
    return PlaneSimilarity(scale, turn.yaw, target_mean - turn.apply(source_mean))


def chordal_mean_rotation(rotations: Floats, weights: Floats | None = None) -> Floats:
    """Compute the rotation (3, 3) with the smallest weighted squared Frobenius distance to `rotations` (N, 3, 3).

    Hartley, Trumpf, Dai, Li, "Rotation averaging", IJCV 2013, section 5.

    Raises:
        EvidenceError: no rotation of positive weight.
    """
    R = np.asarray(rotations, dtype=np.float64).reshape(-1, 3, 3)
    w = np.ones(len(R)) if weights is None else np.asarray(weights, dtype=np.float64)
    if not (w > 0).any():
        raise EvidenceError("a mean rotation needs at least one rotation of positive weight")
    U, _, Vt = np.linalg.svd(np.einsum("n,nij->ij", w, R))
    return np.asarray((U * np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])) @ Vt)


def _centre_points(source: Floats, target: Floats, weights: Floats | None) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return both point sets relative to their weighted means, the weights with sum 1, and the two means."""
    source, target = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    w = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    if np.count_nonzero(w > 0) < 2:
        raise EvidenceError(f"{np.count_nonzero(w > 0)} common points do not fix a similarity: at least 2 are needed")
    w = w / w.sum()
    source_mean, target_mean = w @ source, w @ target
    return source - source_mean, target - target_mean, w, source_mean, target_mean


def _spread(centred: Floats, weights: Floats) -> float:
    spread = float((weights * (centred**2).sum(axis=1)).sum())
    if spread <= 0.0:
        raise EvidenceError("all points are in one place: they fix no scale")
    return spread
