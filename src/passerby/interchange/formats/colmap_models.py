"""COLMAP's camera models, and their conversion to OpenCV's lenses.

Parameters are in the order of COLMAP 4.2's `sensor/models.h`. COLMAP counts pixels from the corner of the first one, OpenCV
from its centre: principal points differ by half a pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.interchange.formats.lens_models import (
    FISHEYE,
    PINHOLE,
    PRISM_12,
    RADTAN_4,
    RATIONAL_8,
    LensModel,
    Rays,
    find_nearest_lens,
    how_far,
)

HALF_PIXEL = 0.5


@dataclass(frozen=True)
class ColmapModel:
    """One of COLMAP's camera models."""

    name: str
    number: int
    """Number of the model in binary files."""
    focals: int
    """Number of focal lengths: 1 (f) or 2 (fx and fy)."""
    others: tuple[str, ...] = ()
    """COLMAP's names of the parameters after focal lengths and principal point."""
    fisheye: bool = False

    @property
    def length(self) -> int:
        """Number of parameters."""
        return self.focals + 2 + len(self.others)


_K = ("k1", "k2", "k3", "k4", "k5", "k6")
MODELS: Mapping[str, ColmapModel] = {
    model.name: model
    for model in (
        ColmapModel("SIMPLE_PINHOLE", 0, 1),
        ColmapModel("PINHOLE", 1, 2),
        ColmapModel("SIMPLE_RADIAL", 2, 1, _K[:1]),
        ColmapModel("RADIAL", 3, 1, _K[:2]),
        ColmapModel("OPENCV", 4, 2, ("k1", "k2", "p1", "p2")),
        ColmapModel("OPENCV_FISHEYE", 5, 2, _K[:4], fisheye=True),
        ColmapModel("FULL_OPENCV", 6, 2, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
        ColmapModel("FOV", 7, 2, ("omega",)),
        ColmapModel("SIMPLE_RADIAL_FISHEYE", 8, 1, _K[:1], fisheye=True),
        ColmapModel("RADIAL_FISHEYE", 9, 1, _K[:2], fisheye=True),
        ColmapModel("THIN_PRISM_FISHEYE", 10, 2, ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"), fisheye=True),
        ColmapModel("RAD_TAN_THIN_PRISM_FISHEYE", 11, 2, (*_K, "p1", "p2", "s1", "s2", "s3", "s4"), fisheye=True),
        ColmapModel("SIMPLE_DIVISION", 12, 1, ("k",)),
        ColmapModel("DIVISION", 13, 2, ("k",)),
        ColmapModel("SIMPLE_FISHEYE", 14, 1, fisheye=True),
        ColmapModel("FISHEYE", 15, 2, fisheye=True),
        ColmapModel("EUCM", 16, 2, ("alpha", "beta")),
    )
}
"""COLMAP's models by name. EQUIRECTANGULAR (17) is missing: it has no focal length and is no lens here."""

WRITTEN: Mapping[LensModel, str] = {
    PINHOLE: "PINHOLE",
    RADTAN_4: "OPENCV",
    RATIONAL_8: "FULL_OPENCV",
    FISHEYE: "OPENCV_FISHEYE",
}
"""Lens model -> COLMAP's model that is written for it, simplest first."""

_OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def parameters_of(lens: Lens, model: LensModel) -> list[float]:
    """Return COLMAP's parameters of a lens that a model of `WRITTEN` holds."""
    matrix = lens.matrix
    coefficients = np.concatenate([lens.distortions, np.zeros(8)])[: len(model.coefficients)]
    centre = (matrix[0, 2] + HALF_PIXEL, matrix[1, 2] + HALF_PIXEL)
    return [float(number) for number in (matrix[0, 0], matrix[1, 1], *centre, *coefficients)]


def lens_of(model: ColmapModel, numbers: Sequence[float], size: tuple[int, int]) -> Lens | None:
    """Convert COLMAP's parameters to a lens; None if no model of OpenCV holds them. Raises `InputError` for an invalid lens."""
    matrix, other = _split_parameters(model, numbers)
    if model.name in _PROJECTIONS:
        bending = ("p1", "p2", "k5", "k6", "sx1", "sy1", "s1", "s2", "s3", "s4") if model.fisheye else tuple(other)
        if model.name in ("FOV", "EUCM") or any(other.get(name) for name in bending):
            return None
    if model.fisheye:
        return Lens(size, matrix, np.array([other.get(name, 0.0) for name in _K[:4]]), True)
    return Lens(size, matrix, np.array([other.get(name, 0.0) for name in _OPENCV_ORDER]))


def express_in_opencv(model: ColmapModel, numbers: Sequence[float], size: tuple[int, int], place: str) -> tuple[Lens, str]:
    """Fit OpenCV's models to COLMAP's parameters. Return the lens with the least error, and a text that states the error.

    Raises `InputError`, which begins with `place`, where no model can be fitted.
    """
    matrix, other = _split_parameters(model, numbers)
    plane = _PROJECTIONS[model.name]

    def project(bearings: Floats) -> Floats:
        return plane(bearings, other) @ matrix[:2, :2].T + matrix[:2, 2]

    rays = Rays.of_projection(project, size)
    start = Lens(size, matrix, np.zeros(0), model.fisheye or model.name == "FOV")
    lens, _ = find_nearest_lens(rays, (FISHEYE, RATIONAL_8, PRISM_12), start, place)
    return lens, how_far(rays, lens)


def _split_parameters(model: ColmapModel, numbers: Sequence[float]) -> tuple[Floats, dict[str, float]]:
    """Split parameters into the camera matrix (3, 3) in OpenCV's pixels and the other parameters by name."""
    if len(numbers) != model.length:
        raise InputError(f"has {len(numbers)} parameters, but model {model.name} takes {model.length}")
    fx, fy = numbers[0], numbers[model.focals - 1]
    cx, cy = numbers[model.focals : model.focals + 2]
    matrix = np.array([[fx, 0.0, cx - HALF_PIXEL], [0.0, fy, cy - HALF_PIXEL], [0.0, 0.0, 1.0]])
    return matrix, dict(zip(model.others, numbers[model.focals + 2 :], strict=True))


def _divide_by_depth(bearings: Floats) -> Floats:
    """Compute x / z and y / z (N, 2); NaN behind the camera."""
    z = np.where(bearings[:, 2:] > 1e-9, bearings[:, 2:], np.nan)
    return np.asarray(bearings[:, :2] / z, dtype=np.float64)


def _equidistant(bearings: Floats) -> Floats:
    """Project directions (N, 3) to points (N, 2) whose radius is the angle to the axis, radians."""
    radius = np.hypot(bearings[:, 0], bearings[:, 1])
    angle = np.arctan2(radius, bearings[:, 2])
    return np.asarray(bearings[:, :2] * (angle / np.maximum(radius, 1e-12))[:, None], dtype=np.float64)


def _fov(bearings: Floats, other: Mapping[str, float]) -> Floats:
    """Project by the FOV model of Devernay and Faugeras, "Straight lines have to be straight" (2001)."""
    plane, omega = _divide_by_depth(bearings), max(other["omega"], 1e-9)
    radius = np.maximum(np.hypot(*plane.T), 1e-12)
    return np.asarray(plane * (np.arctan(2 * radius * np.tan(omega / 2)) / (radius * omega))[:, None])


def _division(bearings: Floats, other: Mapping[str, float]) -> Floats:
    """Project by Fitzgibbon's division model (2001): undistorted = distorted / (1 + k r^2), solved for the distorted point."""
    plane = _divide_by_depth(bearings)
    return np.asarray(plane * (2 / (1 + np.sqrt(1 - 4 * other["k"] * (plane**2).sum(axis=1))))[:, None])


def _eucm(bearings: Floats, other: Mapping[str, float]) -> Floats:
    """Project by the model of Khomutenko et al., "An enhanced unified camera model" (2016)."""
    x, y, z = bearings.T
    distance = np.sqrt(other["beta"] * (x * x + y * y) + z * z)
    depth = other["alpha"] * distance + (1 - other["alpha"]) * z
    return np.asarray(bearings[:, :2] / np.where(depth > 1e-9, depth, np.nan)[:, None])


def _project_thin_prism(bearings: Floats, other: Mapping[str, float]) -> Floats:
    """Project by the model of Weng et al. (1992) on the equidistant projection, or by Project Aria's model.

    Project Aria's model has two more radial and prism terms.
    """
    plane = _equidistant(bearings)
    square = (plane**2).sum(axis=1)
    radial = np.zeros(len(plane))
    for power, name in enumerate(_K):
        radial += other.get(name, 0.0) * square ** (power + 1)
    after = plane if "sx1" in other else plane * (1 + radial)[:, None]
    (u, v), turned = after.T, (after**2).sum(axis=1)
    a, b = (other["p2"], other["p1"]) if "sx1" in other else (other["p1"], other["p2"])
    prism_u = other.get("sx1", other.get("s1", 0.0)) * turned + other.get("s2", 0.0) * turned**2
    prism_v = other.get("sy1", other.get("s3", 0.0)) * turned + other.get("s4", 0.0) * turned**2
    u_moved = 2 * b * u * v + a * (turned + 2 * u * u) + prism_u
    v_moved = 2 * a * u * v + b * (turned + 2 * v * v) + prism_v
    return np.asarray(plane * (1 + radial)[:, None] + np.column_stack([u_moved, v_moved]), dtype=np.float64)


_PROJECTIONS: Mapping[str, Callable[[Floats, Mapping[str, float]], Floats]] = {
    "FOV": _fov,
    "SIMPLE_DIVISION": _division,
    "DIVISION": _division,
    "EUCM": _eucm,
    "THIN_PRISM_FISHEYE": _project_thin_prism,
    "RAD_TAN_THIN_PRISM_FISHEYE": _project_thin_prism,
}
"""Projections of models that OpenCV does not have: directions (N, 3) to points (N, 2) on the plane of the camera matrix."""
