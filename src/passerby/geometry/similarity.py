"""Least-squares placement of one point set on another: rigid or with scale, in space and in the plane, and mean rotations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError


@dataclass(frozen=True, eq=False)
class Similarity:
    """`X -> scale rotation X + translation` in space."""

    scale: float
    rotation: Floats
    """(3, 3) rotation."""
    translation: Floats
    """(3,), in the target's unit."""

    def apply(self, points: Floats) -> Floats:
        """Move points (..., 3)."""
        return np.asarray(self.scale * np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation)

    def inverse(self) -> Similarity:
        """The map from the target back to the source."""
        rotation = self.rotation.T
        return Similarity(1.0 / self.scale, rotation, -rotation @ self.translation / self.scale)


@dataclass(frozen=True, eq=False)
class PlaneSimilarity:
    """`x -> scale rotation(yaw) x + translation` in the plane."""

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
        """Move points (..., 2)."""
        return np.asarray(self.scale * np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation)

    def inverse(self) -> PlaneSimilarity:
        """The map from the target back to the source."""
        back = PlaneSimilarity(1.0 / self.scale, -self.yaw, np.zeros(2))
        return PlaneSimilarity(back.scale, back.yaw, -back.apply(self.translation))


def fit_similarity(source: Floats, target: Floats, weights: Floats | None = None, *, with_scale: bool = True) -> Similarity:
    """The similarity that moves `source` onto `target` with the smallest weighted squared distance.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991, with weights. Points
    on one line leave the turn about that line free; any minimiser is returned then.

    Args:
        source: (N, 3) points.
        target: (N, 3) their partners.
        weights: (N,) at least 0; equal when None.
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
    """The plane similarity that moves `source` (N, 2) onto `target` (N, 2) with the smallest weighted squared distance.

    Two points fix it. Arguments and errors as of `fit_similarity`.
    """
    source, target, w, source_mean, target_mean = _centre_points(source, target, weights)
    along = float((w * (source * target).sum(axis=1)).sum())
    across = float((w * (source[:, 0] * target[:, 1] - source[:, 1] * target[:, 0])).sum())
    scale = float(np.hypot(along, across) / _spread(source, w)) if with_scale else 1.0
    turn = PlaneSimilarity(scale, float(np.arctan2(across, along)), np.zeros(2))
    return PlaneSimilarity(scale, turn.yaw, target_mean - turn.apply(source_mean))


def chordal_mean_rotation(rotations: Floats, weights: Floats | None = None) -> Floats:
    """The rotation (3, 3) with the smallest weighted squared Frobenius distance to `rotations` (N, 3, 3).

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
    """Both sets about their weighted means, the weights with sum 1, and the two means."""
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
