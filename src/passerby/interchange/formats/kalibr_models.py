"""Projections of Kalibr's camera models that OpenCV's pinhole and fisheye do not have.

From aslam_cameras of github.com/ethz-asl/kalibr: OmniProjection.hpp (C. Mei and P. Rives, Single View Point Omnidirectional
Camera Calibration from Planar Grids, ICRA 2007), DoubleSphereProjection.hpp (V. Usenko et al., The Double Sphere Camera Model,
3DV 2018), ExtendedUnifiedProjection.hpp (B. Khomutenko et al., An Enhanced Unified Camera Model, RA-L 2016) and
FovDistortion.hpp (F. Devernay and O. Faugeras, Straight lines have to be straight, MVA 2001).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError

INTRINSICS = {"pinhole": 4, "omni": 5, "ds": 6, "eucm": 6}
"""How many numbers each model has; the last four are fu, fv, pu, pv."""


def projection(place: str, model: str, intrinsics: Floats, distortion: str, coefficients: Floats) -> Callable[[Floats], Floats]:
    """The function from (N, 3) points in the camera's frame to (N, 2) pixels, NaN where the model has none.

    Raises `InputError`, beginning with `place`, for a combination that Kalibr does not have either.
    """
    own = intrinsics[:-4].tolist()
    fx, fy, cx, cy = intrinsics[-4:].tolist()
    models: dict[tuple[str, str], Callable[[Floats], Floats]] = {
        ("pinhole", "fov"): lambda points: _fov(points, float(coefficients[0])),
        ("omni", "none"): lambda points: _omni(points, *own),
        ("omni", "radtan"): lambda points: _radtan(_omni(points, *own), coefficients),
        ("ds", "none"): lambda points: _double_sphere(points, *own),
        ("eucm", "none"): lambda points: _unified(points, *own),
    }
    if (model, distortion) not in models:
        raise InputError(f"{place}: camera_model {model} with distortion_model {distortion} does not exist")
    plane = models[model, distortion]

    def project(points: Floats) -> Floats:
        with np.errstate(all="ignore"):
            return np.asarray(plane(np.asarray(points, dtype=np.float64)) * (fx, fy) + (cx, cy), dtype=np.float64)

    return project


def _over(points: Floats, depth: Floats, valid: NDArray[np.bool_]) -> Floats:
    """(N, 2) x and y over a depth; NaN where that is not valid."""
    return np.where((valid & (depth > 0))[:, None], points[:, :2] / depth[:, None], np.nan)


def _omni(points: Floats, xi: float) -> Floats:
    """On the unit sphere, seen from xi behind its middle."""
    length = np.linalg.norm(points, axis=1)
    limit = xi if xi <= 1 else 1 / xi
    return _over(points, points[:, 2] + xi * length, points[:, 2] > -limit * length)


def _double_sphere(points: Floats, xi: float, alpha: float) -> Floats:
    """Through two unit spheres, xi apart."""
    length = np.linalg.norm(points, axis=1)
    shifted = xi * length + points[:, 2]
    second = np.hypot(np.hypot(points[:, 0], points[:, 1]), shifted)
    w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2 * w1 * xi + xi * xi + 1)
    return _over(points, alpha * second + (1 - alpha) * shifted, points[:, 2] > -w2 * length)


def _unified(points: Floats, alpha: float, beta: float) -> Floats:
    """On an ellipsoid."""
    length = np.sqrt(beta * (points[:, 0] ** 2 + points[:, 1] ** 2) + points[:, 2] ** 2)
    limit = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    return _over(points, alpha * length + (1 - alpha) * points[:, 2], points[:, 2] > -limit * length)


def _fov(points: Floats, w: float) -> Floats:
    """A pinhole whose radius is an angle: r_d = atan(2 r tan(w / 2)) / w."""
    plane = _over(points, points[:, 2], points[:, 2] > 0)
    radius = np.linalg.norm(plane, axis=1)
    scale = np.where(radius > 1e-9, np.arctan(2 * radius * np.tan(w / 2)) / (w * radius), 2 * np.tan(w / 2) / w)
    return np.asarray(plane * scale[:, None])


def _radtan(plane: Floats, coefficients: Floats) -> Floats:
    """OpenCV's k1 k2 p1 p2 on a plane."""
    k1, k2, p1, p2 = coefficients.tolist()
    x, y = plane.T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    return np.column_stack([
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
    ])  # fmt: skip
