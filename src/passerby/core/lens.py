"""A camera's lens: OpenCV's pinhole with radial-tangential distortion, or OpenCV's fisheye.

Pixels as OpenCV counts them; rays in OpenCV's camera axes (x right, y down, z forward).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from passerby.common.arrays import Floats, frozen
from passerby.common.errors import InputError
from passerby.core.data_sheet import DATA_SHEET_SD, check_field, focal_of_field, sd_of_field

PINHOLE_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
FISHEYE_DISTORTION_LENGTHS = (0, 4)
BROWN = 5
"""Number of coefficients of Brown's model: k1, k2, p1, p2 and k3 (D. C. Brown, *Decentering distortion of lenses*, 1966)."""
# A pixel is outside the lens model if its undistorted ray projects to more than this many pixels away from it.
INVERSION_TOLERANCE_PX = 0.05
INTRINSICS = 4
"""Number of lens parameters that `Lens.by_intrinsics` has derivatives by."""
QUARTER_TURNS = (0, 90, 180, 270)
LARGEST_FOCAL_SD = 0.5
"""Largest relative standard deviation of a focal length, used for unknown ones; first-order estimates fail beyond it."""


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics of one camera: picture size, OpenCV matrix and distortion.

    Raises `InputError` when the values cannot be a lens (size, shape, finiteness, focal length, number of coefficients).
    """

    size: tuple[int, int]
    """(width, height) in pixels."""
    matrix: Floats
    """(3, 3) camera matrix in pixels."""
    distortions: Floats
    """Pinhole: 0, 4, 5, 8, 12 or 14 coefficients in OpenCV's order; fisheye: 0 or 4. Given as (N,), (1, N) or (N, 1)."""
    fisheye: bool = False
    focal_sd: float | None = None
    """Standard deviation of both focal lengths, as a share, where they are a guess. None: they are assumed to be correct."""
    uncalibrated: bool = False
    """Whether only the image size is known, and perhaps the focal length with `focal_sd`. Until people are used, the principal
    point is assumed at the image centre, and the distortion to be 0."""
    group: str | None = None
    """Cameras of one model: uncalibrated lenses with the same group share one focal length and distortion. None: the lens
    shares them with no other."""
    rotate: int = 0
    """Degrees clockwise, 0, 90, 180 or 270, by which the images have to be turned so that people in them stand upright, for a
    camera that is mounted on its side. The other values refer to the images as filmed."""
    start_sd: float | None = None
    """`focal_sd` of a focal length that a search among people found. It narrows the next search. It is not used in addition to
    `focal_sd`, because it comes from the same people as the adjustment. None: there was no search."""
    principal_point_sd: float | None = None
    """Standard deviation of the principal point, as a share of the image's width. None: that of stated intrinsics."""
    distortion_sd: float | None = None
    """Standard deviation of the first distortion coefficient. None: that of stated intrinsics."""

    def __post_init__(self) -> None:
        if self.focal_sd is not None and not 0 < self.focal_sd <= LARGEST_FOCAL_SD:
            raise InputError(
                f"focal_sd {self.focal_sd:g} is out of range: give a share above 0, up to {LARGEST_FOCAL_SD:g}; leave it out "
                "for a focal length that was calibrated"
            )
        matrix = frozen(self.matrix)
        distortions = frozen(np.atleast_1d(self.distortions))
        if distortions.ndim == 2 and 1 in distortions.shape:  # OpenCV's functions return a row or a column
            distortions = distortions.reshape(-1)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortions", distortions)
        object.__setattr__(self, "size", (int(self.size[0]), int(self.size[1])))
        if self.rotate not in QUARTER_TURNS:
            raise InputError(f"rotate is {self.rotate}: give 90, 180 or 270 degrees clockwise, or 0")
        if min(self.size) < 1:
            raise InputError(f"size {list(self.size)} is not an image size: give [width, height] in pixels")
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise InputError(f"matrix must be 3 x 3 finite numbers, not {matrix.tolist()}")
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0) or not np.allclose(matrix[2], (0, 0, 1)):
            raise InputError(
                f"matrix {matrix.tolist()} is not a camera matrix: focal lengths above 0 and a last row of 0, 0, 1 are needed"
            )
        lengths = FISHEYE_DISTORTION_LENGTHS if self.fisheye else PINHOLE_DISTORTION_LENGTHS
        if distortions.ndim != 1:
            raise InputError(f"distortions has the shape {distortions.shape}: give one list of coefficients")
        if distortions.size not in lengths or not np.isfinite(distortions).all():
            kind = "fisheye" if self.fisheye else "pinhole"
            raise InputError(
                f"distortions has {distortions.size} values; a {kind} lens takes {', '.join(map(str, lengths))} finite ones"
            )

    def __repr__(self) -> str:
        kind = "fisheye" if self.fisheye else "pinhole"
        bent = f"{self.distortions.size} distortions" if self.distortions.any() else "no distortion"
        return f"Lens({kind}, {self.size[0]} x {self.size[1]}, focal {self.focal:.1f} px, {bent})"

    @classmethod
    def unknown(
        cls, size: tuple[int, int], hfov_deg: float | None = None, focal_sd: float | None = None, *,
        focal_px: float | None = None, fisheye: bool = False, group: str | None = None,
    ) -> Lens:  # fmt: skip
        """Return a lens that was never calibrated, to be estimated together with the rig.

        Args:
            size: (width, height) in pixels.
            hfov_deg: field of view over the image's width, where a data sheet states it.
            focal_sd: standard deviation of the stated focal length, as a share. None: `DATA_SHEET_SD`, and more for a wide
                field of view, see `sd_of_field`.
            focal_px: focal length in pixels, if it is stated instead of a field of view.
            fisheye: whether the lens is an equidistant fisheye, and not a pinhole with radial distortion.
            group: see `Lens.group`.

        Raises:
            InputError: a size, field of view, focal length or sigma that no lens has; both a field of view and a focal length;
                a sigma without either.
        """
        width, height = _image_size(size)
        if hfov_deg is not None and focal_px is not None:
            raise InputError("hfov_deg and focal_px state the focal length twice: give one of them")
        if focal_sd is not None and hfov_deg is None and focal_px is None:
            raise InputError(
                f"focal_sd {focal_sd:g} is the sigma of a focal length that is not stated: add it, or delete focal_sd"
            )
        focal, sd = float(max(width, height)), LARGEST_FOCAL_SD
        if fisheye:  # 180 degrees over the longer side
            focal /= np.pi
        if hfov_deg is not None:
            focal, sd = focal_of_field(hfov_deg, width, fisheye=fisheye), sd_of_field(hfov_deg, fisheye=fisheye)
        elif focal_px is not None:
            focal, sd = focal_px, DATA_SHEET_SD
        if hfov_deg is not None or focal_px is not None:
            check_field(focal, (width, height), fisheye=fisheye)
            sd = sd if focal_sd is None else focal_sd
        matrix = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        return cls((width, height), matrix, np.zeros(0), fisheye, focal_sd=sd, uncalibrated=True, group=group)

    def with_focal(self, factor: float, sd: float) -> Lens:
        """Return the lens with both focal lengths times `factor`, and their standard deviation `sd` as a share."""
        matrix = np.array(self.matrix)
        matrix[:2, :2] *= factor
        return replace(self, matrix=matrix, focal_sd=sd)

    def started(self, factor: float, sd: float) -> Lens:
        """Return the lens with both focal lengths times `factor`, as found by a search with the standard deviation `sd`."""
        return replace(self.with_focal(factor, sd), focal_sd=self.focal_sd, start_sd=sd)

    @property
    def search_sd(self) -> float | None:
        """Standard deviation, as a share, of the range of focal lengths in which the true one is searched for."""
        return self.focal_sd if self.start_sd is None else self.start_sd

    @property
    def focal(self) -> float:
        """Geometric mean of the two focal lengths, pixels."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))

    def project_rays(self, points: Floats) -> Floats:
        """Project points given in the camera's frame.

        Args:
            points: (N, 3), camera frame, any unit.

        Returns:
            (N, 2) pixels; NaN for a point behind a pinhole lens.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if len(points) == 0:
            return np.zeros((0, 2))
        if self.fisheye:
            return project_fisheye(points, self.matrix, self.distortions)
        safe = np.where(points[:, 2:] > 0, points, np.array([0.0, 0.0, 1.0]))
        plane = distort_plane(safe[:, :2] / safe[:, 2:], self.distortions)
        pixels = plane @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        return np.asarray(np.where(points[:, 2:] > 0, pixels, np.nan), dtype=np.float64)

    def bearings(self, pixels: Floats) -> Floats:
        """Compute the viewing rays of pixels.

        Args:
            pixels: (N, 2), distorted pixels as in the picture.

        Returns:
            (N, 3) unit vectors in the camera frame; NaN where the lens model cannot be inverted.
        """
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if len(pixels) == 0:
            return np.zeros((0, 3))
        if self.fisheye:
            rays = unproject_fisheye(pixels, self.matrix, self.distortions)
        else:
            rays = unproject_pinhole(self._skew_pixels(pixels, -1.0), self.matrix, self.distortions)
        rays = np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float64)
        with np.errstate(invalid="ignore"):
            back = np.linalg.norm(self.project_rays(np.nan_to_num(rays, nan=0.5)) - pixels, axis=1)
            rays[~(back < INVERSION_TOLERANCE_PX)] = np.nan
        return rays

    def _skew_pixels(self, pixels: Floats, sign: float = 1.0) -> Floats:
        """Add the matrix's skew to pinhole pixels, or remove it (`sign` -1); OpenCV's own functions ignore it."""
        skew = sign * self.matrix[0, 1] / self.matrix[1, 1]
        if skew == 0:
            return pixels
        return np.column_stack([pixels[:, 0] + skew * (pixels[:, 1] - self.matrix[1, 2]), pixels[:, 1]])

    def tangents(self, bearings: Floats) -> Floats:
        """Compute linear maps from the camera frame to pixels, around given viewing rays.

        The projection of a point `d` of the camera frame near the ray `b` misses its pixel by `tangent @ d / (b . d)`, to first
        order. This reprojection residual is exact in the angle, is valid for every lens and needs no distortion inside a
        solver.

        Args:
            bearings: (N, 3) unit vectors in the camera frame.

        Returns:
            (N, 2, 3) pixels per unit of `d / (b . d)`; each row is orthogonal to its bearing.
        """
        b = np.asarray(bearings, dtype=np.float64).reshape(-1, 3)
        helper = np.where(np.abs(b[:, :1]) < 0.6, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
        e1 = np.cross(b, helper)
        e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
        e2 = np.cross(b, e1)
        step = 1e-6
        d1 = (self.project_rays(b + step * e1) - self.project_rays(b - step * e1)) / (2 * step)
        d2 = (self.project_rays(b + step * e2) - self.project_rays(b - step * e2)) / (2 * step)
        return np.asarray(d1[:, :, None] * e1[:, None, :] + d2[:, :, None] * e2[:, None, :])

    def derivatives(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Compute the pixels of points in front of the camera, and their derivatives by the points and by the lens.

        Args:
            points: (N, 3) in the camera frame, any unit.

        Returns:
            (N, 2) pixels, (N, 2, 3) derivatives by the points, and (N, 2, 4) derivatives as in `by_intrinsics`.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if not len(points) or self.fisheye or self.matrix[0, 1] != 0:
            away = np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
            rays = points / away
            return self.project_rays(points), self.tangents(rays) / away[:, :, None], self.by_intrinsics(rays)
        zero, few = np.zeros(3), np.zeros(max(len(self.distortions), 4))
        few[: len(self.distortions)] = self.distortions
        found = cv2.projectPoints(points[:, None], zero, zero, self.matrix, few)
        pixels, by = (np.asarray(part, dtype=np.float64).reshape(len(points), 2, -1) for part in found)
        # Derivatives by rotation, translation, both focal lengths, principal point, and distortion coefficients, in this order.
        focal = by[:, :, 6:8] @ np.diag(self.matrix)[:2, None]
        return pixels[:, :, 0], by[:, :, 3:6], np.concatenate([focal, by[:, :, 8:11]], axis=2)

    def by_intrinsics(self, rays: Floats) -> Floats:
        """Compute the derivatives of the pixels of rays by the intrinsics.

        Args:
            rays: (N, 3) in the camera frame.

        Returns:
            (N, 2, 4) by the logarithm of both focal lengths (distortions are shares of them, and grow with them), the two
            coordinates of the principal point (pixels), and the first distortion coefficient, which is radial in all models.
        """
        out = np.zeros((len(rays), 2, INTRINSICS))
        out[:, :, 0] = self.project_rays(rays) - self.matrix[:2, 2]
        out[:, :, 1:3] = np.eye(2)
        few = np.zeros(max(len(self.distortions), 4))
        few[: len(self.distortions)] = self.distortions
        step = np.zeros_like(few)
        step[0] = 1e-4
        ends = [replace(self, distortions=few + sign * step).project_rays(rays) for sign in (1, -1)]
        out[:, :, 3] = (ends[0] - ends[1]) / 2e-4
        return out


def _image_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return (width, height) as whole numbers. Raises `InputError` for values that are not an image size."""
    numbers = np.asarray(size)
    whole = numbers.shape == (2,) and numbers.dtype.kind in "iuf" and bool((np.isfinite(numbers) & (numbers >= 1)).all())
    if not whole or (numbers != np.floor(numbers)).any():
        raise InputError(f"size {size!r} is not an image size: give [width, height] in pixels")
    return int(numbers[0]), int(numbers[1])


def distort_plane(plane: Floats, distortions: Floats) -> Floats:
    """Distort points (N, 2) of the plane z = 1 by OpenCV's model.

    With five coefficients at most, it is computed here: OpenCV computes all derivatives too, which takes three times as long.
    """
    if not distortions.any():
        return plane
    if len(distortions) > BROWN:
        rays, zero = np.column_stack([plane, np.ones(len(plane))]), np.zeros(3)
        return np.asarray(cv2.projectPoints(rays[:, None], zero, zero, np.eye(3), distortions)[0][:, 0], dtype=np.float64)
    k1, k2, p1, p2, k3 = (*distortions, 0.0)[:BROWN]
    x, y = plane.T
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    bent = np.array([x * radial, y * radial])
    if p1 or p2:
        both = 2.0 * x * y
        bent += p1 * both + p2 * (square + 2.0 * x * x), p1 * (square + 2.0 * y * y) + p2 * both
    return np.asarray(bent.T)


def unproject_pinhole(pixels: Floats, matrix: Floats, distortions: Floats) -> Floats:
    """Convert pixels (N, 2) to rays (N, 3) with z = 1: OpenCV's fixed-point iteration, then Newton steps.

    OpenCV's own iteration stops after five rounds. At the border of a strong lens it is then off by half a pixel.
    """
    step = 1e-6

    def distort(plane: Floats) -> Floats:
        return distort_plane(plane, distortions) * np.diag(matrix)[:2] + matrix[:2, 2]

    plane = np.asarray(cv2.undistortPoints(pixels[:, None], matrix, distortions)[:, 0], dtype=np.float64)
    if distortions.size == 0 or not distortions.any():
        return np.column_stack([plane, np.ones(len(plane))])
    for _ in range(8):
        at = distort(plane)
        miss = pixels - at
        if np.nanmax(np.abs(miss)) < 1e-9:
            break
        by_x = (distort(plane + (step, 0.0)) - at) / step
        by_y = (distort(plane + (0.0, step)) - at) / step
        determinant = by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0]
        with np.errstate(all="ignore"):
            dx = (miss[:, 0] * by_y[:, 1] - miss[:, 1] * by_y[:, 0]) / determinant
            dy = (by_x[:, 0] * miss[:, 1] - by_x[:, 1] * miss[:, 0]) / determinant
            plane = plane + np.clip(np.column_stack([dx, dy]), -0.2, 0.2)
    return np.column_stack([plane, np.ones(len(plane))])


def _fisheye_polynomial(theta: Floats, k: Floats) -> tuple[Floats, Floats]:
    """Compute the distorted angle and its derivative, OpenCV's fisheye: theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8)."""
    t2 = theta * theta
    k1, k2, k3, k4 = (*k, 0.0, 0.0, 0.0, 0.0)[:4]
    value = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
    return value, slope


def project_fisheye(points: Floats, matrix: Floats, distortions: Floats) -> Floats:
    """Project points with OpenCV's fisheye model, valid beyond 90 degrees (cv2.fisheye.projectPoints is not)."""
    radius = np.hypot(points[:, 0], points[:, 1])
    theta = np.arctan2(radius, points[:, 2])
    distorted, _ = _fisheye_polynomial(theta, distortions)
    scale = np.where(radius > 1e-12, distorted / np.maximum(radius, 1e-12), 1.0 / np.maximum(np.abs(points[:, 2]), 1e-12))
    plane = points[:, :2] * scale[:, None]
    x = matrix[0, 0] * plane[:, 0] + matrix[0, 1] * plane[:, 1] + matrix[0, 2]
    y = matrix[1, 1] * plane[:, 1] + matrix[1, 2]
    return np.column_stack([x, y])


def unproject_fisheye(pixels: Floats, matrix: Floats, distortions: Floats) -> Floats:
    """Invert the fisheye polynomial by Newton's method; NaN where it does not converge."""
    y = (pixels[:, 1] - matrix[1, 2]) / matrix[1, 1]
    x = (pixels[:, 0] - matrix[0, 2] - matrix[0, 1] * y) / matrix[0, 0]
    target = np.hypot(x, y)
    theta = np.minimum(target, np.pi * 0.9)
    for _ in range(30):
        value, slope = _fisheye_polynomial(theta, distortions)
        theta = np.clip(theta - (value - target) / np.where(np.abs(slope) > 1e-6, slope, 1e-6), 0, np.pi)
    ratio = np.where(target > 1e-12, np.sin(theta) / np.maximum(target, 1e-12), 1.0)
    return np.column_stack([x * ratio, y * ratio, np.cos(theta)])
