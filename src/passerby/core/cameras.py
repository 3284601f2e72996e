"""Cameras as values: a lens, a pose, and the rig that holds them.

Frames: world to camera is `x_c = R_cw X_w + t_cw` with OpenCV's camera axes (x right, y down, z forward), metres; pixels as
OpenCV counts them. Lens models are OpenCV's pinhole with radial-tangential distortion and OpenCV's fisheye.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from passerby.common.arrays import Floats
from passerby.common.display import html_of
from passerby.common.errors import InputError
from passerby.core.data_sheet import DATA_SHEET_SD, check_field, focal_of_field, sd_of_field
from passerby.core.projection import project_fisheye, unproject_fisheye, unproject_pinhole
from passerby.geometry.triangulation import triangulate_views

__all__ = ["FISHEYE_DISTORTION_LENGTHS", "PINHOLE_DISTORTION_LENGTHS", "Camera", "Lens", "Pose", "PoseSigma", "Rig"]
PINHOLE_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
FISHEYE_DISTORTION_LENGTHS = (0, 4)

# A pixel whose undistorted ray does not come back to within this many pixels lies outside what the lens model can express.
INVERSION_TOLERANCE_PX = 0.05

LARGEST_FOCAL_SD = 0.5
"""Of a focal length known no better than this the calibration, which follows it to first order, says nothing."""

NAMED = 8
"""Cameras beyond are not named on one line."""


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
    """One standard deviation of both focal lengths, as a share of them, where they are a guess. None: they are taken to be
    right."""
    uncalibrated: bool = False
    """Whether only the image size is known, and perhaps the focal length as `focal_sd` says: the principal point is taken to be
    the image centre and the distortion to be 0 until people tell more."""
    group: str | None = None
    """Cameras of one model: uncalibrated lenses with the same group share one focal length and distortion. None: no other
    lens is like it."""

    def __post_init__(self) -> None:
        if self.focal_sd is not None and not 0 < self.focal_sd <= LARGEST_FOCAL_SD:
            raise InputError(
                f"focal_sd {self.focal_sd:g} is out of range: give a share above 0, up to {LARGEST_FOCAL_SD:g}; leave it out "
                "for a focal length that was calibrated"
            )
        matrix = _frozen(self.matrix)
        distortions = _frozen(np.atleast_1d(self.distortions))
        if distortions.ndim == 2 and 1 in distortions.shape:  # OpenCV's functions return a row or a column
            distortions = distortions.reshape(-1)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortions", distortions)
        object.__setattr__(self, "size", (int(self.size[0]), int(self.size[1])))
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
        """A lens that was never calibrated, to be estimated together with the rig.

        Args:
            size: (width, height) in pixels.
            hfov_deg: field of view over the image's width, where a data sheet states it.
            focal_sd: standard deviation of the stated focal length, as a share. None: `DATA_SHEET_SD`, and more where a wide
                field of view is stated, see `sd_of_field`.
            focal_px: focal length in pixels, where that is known rather than a field of view.
            fisheye: whether the lens is an equidistant fisheye, rather than a pinhole with radial distortion.
            group: see `Lens.group`.

        Raises:
            InputError: a size, field of view, focal length or sigma that no lens has; a field of view and a focal length; a
                sigma without either.
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
        """The lens with both focal lengths times `factor`, known to `sd`, one standard deviation as a share."""
        matrix = np.array(self.matrix)
        matrix[:2, :2] *= factor
        return replace(self, matrix=matrix, focal_sd=sd)

    @property
    def focal(self) -> float:
        """Geometric mean of the two focal lengths, pixels."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))

    def project_rays(self, points: Floats) -> Floats:
        """Project points given in the camera's frame.

        Args:
            points: (N, 3), camera frame, any unit.

        Returns:
            (N, 2) pixels; NaN for a point that a pinhole lens has behind it.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if len(points) == 0:
            return np.zeros((0, 2))
        zero = np.zeros(3)
        if self.fisheye:
            return project_fisheye(points, self.matrix, self.distortions)
        safe = np.where(points[:, 2:] > 0, points, np.array([0.0, 0.0, 1.0]))
        if self.distortions.any():
            straight = cv2.projectPoints(safe[:, None], zero, zero, self.matrix, self.distortions)[0][:, 0]
            pixels = self._skewed(np.asarray(straight, dtype=np.float64))
        else:  # five times quicker than OpenCV
            pixels = (safe[:, :2] / safe[:, 2:]) @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        return np.asarray(np.where(points[:, 2:] > 0, pixels, np.nan), dtype=np.float64)

    def bearings(self, pixels: Floats) -> Floats:
        """Viewing rays of pixels.

        Args:
            pixels: (N, 2), distorted pixels as the picture has them.

        Returns:
            (N, 3) unit vectors in the camera frame; NaN where the lens model cannot be inverted.
        """
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if len(pixels) == 0:
            return np.zeros((0, 3))
        if self.fisheye:
            rays = unproject_fisheye(pixels, self.matrix, self.distortions)
        else:
            rays = unproject_pinhole(self._skewed(pixels, -1.0), self.matrix, self.distortions)
        rays = np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float64)
        with np.errstate(invalid="ignore"):
            back = np.linalg.norm(self.project_rays(np.nan_to_num(rays, nan=0.5)) - pixels, axis=1)
            rays[~(back < INVERSION_TOLERANCE_PX)] = np.nan
        return rays

    def _skewed(self, pixels: Floats, sign: float = 1.0) -> Floats:
        """Pinhole pixels with the matrix's skew put in (or taken out), which OpenCV's own functions leave alone."""
        skew = sign * self.matrix[0, 1] / self.matrix[1, 1]
        if skew == 0:
            return pixels
        return np.column_stack([pixels[:, 0] + skew * (pixels[:, 1] - self.matrix[1, 2]), pixels[:, 1]])

    def tangents(self, bearings: Floats) -> Floats:
        """Linear maps from the camera frame to pixels, around given viewing rays.

        A point `d` of the camera frame that projects near the ray `b` misses its pixel by `tangent @ d / (b . d)`, to first
        order: a reprojection residual that is exact in the angle, holds for every lens and needs no distortion inside a solver.

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


def _image_size(size: tuple[int, int]) -> tuple[int, int]:
    """(width, height) as whole numbers. Raises `InputError` for what is no image size."""
    numbers = np.asarray(size)
    whole = numbers.shape == (2,) and numbers.dtype.kind in "iuf" and bool((np.isfinite(numbers) & (numbers >= 1)).all())
    if not whole or (numbers != np.floor(numbers)).any():
        raise InputError(f"size {size!r} is not an image size: give [width, height] in pixels")
    return int(numbers[0]), int(numbers[1])


def _seen_rays(lens: Lens, pixels: Floats) -> Floats:
    """(N, 3) viewing rays of (N, 2) pixels; NaN where a pixel is not finite, or has no ray."""
    rays = np.full((len(pixels), 3), np.nan)
    known = np.isfinite(pixels).all(axis=1)
    rays[known] = lens.bearings(pixels[known])
    return rays


def _frozen(values: Floats) -> Floats:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Pose:
    """World to camera: `x_c = R_cw X_w + t_cw`."""

    R_cw: Floats
    """(3, 3) rotation."""
    t_cw: Floats
    """(3,) translation, metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "R_cw", _frozen(self.R_cw).reshape(3, 3))
        object.__setattr__(self, "t_cw", _frozen(self.t_cw).reshape(3))

    def __repr__(self) -> str:
        return f"Pose({_pose_in_words(self)})"

    @classmethod
    def from_centre(cls, R_cw: Floats, centre: Floats) -> Pose:
        """Pose of a camera with its centre at `centre` (3,), world frame, metres."""
        return cls(R_cw, -np.asarray(R_cw) @ np.asarray(centre))

    @cached_property
    def centre(self) -> Floats:
        """(3,) camera centre in the world, metres."""
        return _frozen(-self.R_cw.T @ self.t_cw)

    @property
    def heading_deg(self) -> float | None:
        """Where the camera looks over the ground: degrees from the world's x axis towards y, in (-180, 180].

        None for one that looks straight up or down.
        """
        x, y, _ = self.R_cw[2]
        return None if np.hypot(x, y) < 1e-9 else float(np.degrees(np.arctan2(y, x)))

    @property
    def tilt_deg(self) -> float:
        """How far the optical axis points below the horizon, degrees in [-90, 90]."""
        return float(np.degrees(np.arctan2(-self.R_cw[2, 2], np.hypot(self.R_cw[2, 0], self.R_cw[2, 1]))))

    @property
    def roll_deg(self) -> float | None:
        """How far the camera is turned about its optical axis, clockwise as seen from behind it: degrees in (-180, 180].

        0: the picture's rows are level. None for a camera that looks straight up or down.
        """
        level = np.cross(self.R_cw[2], (0.0, 0.0, 1.0))
        if np.linalg.norm(level) < 1e-9:
            return None
        return float(np.degrees(np.arctan2(self.R_cw[0] @ np.cross(self.R_cw[2], level), self.R_cw[0] @ level)))

    def moved(self, rotation: Floats, translation: Floats, scale: float = 1.0) -> Pose:
        """The pose after the world is moved by `X -> scale rotation X + translation`."""
        R_cw = self.R_cw @ np.asarray(rotation).T
        centre = scale * np.asarray(rotation) @ self.centre + np.asarray(translation)
        return Pose.from_centre(R_cw, centre)


def _pose_in_words(pose: Pose) -> str:
    """Where a camera is and where it looks."""
    x, y, z = (round(float(value), 3) + 0.0 for value in pose.centre)
    heading = "straight up or down" if pose.heading_deg is None else f"heading {pose.heading_deg:.1f} deg"
    return f"at ({x:.3f}, {y:.3f}, {z:.3f}) m, {heading}, tilt {pose.tilt_deg:.1f} deg"


@dataclass(frozen=True, eq=False)
class PoseSigma:
    """One-sigma uncertainty of a camera's pose, after the best rigid placement of the rig as a whole.

    Infinite where no evidence constrains it; files leave it out.
    """

    position_m: float
    """Root of the trace of the position's covariance, metres (the expected distance from the true centre)."""
    orientation_deg: float
    """Root of the trace of the rotation vector's covariance, degrees."""
    covariance: Floats | None = None
    """(6, 6): centre (metres, world), then rotation vector (radians, camera frame); None where any of it is infinite."""

    @classmethod
    def from_covariance(cls, covariance: Floats) -> PoseSigma:
        """The sigma of a covariance (6, 6) as `covariance` has it; rounding may leave its traces just below 0."""
        position, turn = max(np.trace(covariance[:3, :3]), 0.0), max(np.trace(covariance[3:, 3:]), 0.0)
        known = bool(np.isfinite(position + turn))
        return cls(float(np.sqrt(position)), float(np.degrees(np.sqrt(turn))), covariance if known else None)

    def __repr__(self) -> str:
        position = f"{1000 * self.position_m:.0f} mm" if np.isfinite(self.position_m) else "position unknown"
        orientation = f"{self.orientation_deg:.2f} deg" if np.isfinite(self.orientation_deg) else "orientation unknown"
        return f"PoseSigma({position}, {orientation})"

    def moved(self, rotation: Floats, scale: float = 1.0) -> PoseSigma:
        """The uncertainty after the world is moved by `X -> scale rotation X + translation`, as if that motion were exact.

        The centre's part turns and grows with the world; the rotation vector is the camera's own and stays.
        """
        covariance = None
        if self.covariance is not None:
            block = np.eye(6)
            block[:3, :3] = scale * np.asarray(rotation)
            covariance = block @ self.covariance @ block.T
        return PoseSigma(scale * self.position_m, self.orientation_deg, covariance)


@dataclass(frozen=True, eq=False)
class Camera:
    """One static camera; `pose` is None as long as it is not calibrated."""

    name: str
    lens: Lens
    pose: Pose | None = None
    sigma: PoseSigma | None = None

    def __repr__(self) -> str:
        pose = "without a pose" if self.pose is None else _pose_in_words(self.pose)
        sure = ""
        if self.sigma is not None:
            known = np.isfinite(self.sigma.position_m)
            sure = f", sigma {1000 * self.sigma.position_m:.0f} mm" if known else ", sigma unknown"
        return f"Camera({self.name!r}, {self.lens.size[0]} x {self.lens.size[1]}, {pose}{sure})"

    @property
    def centre(self) -> Floats:
        """(3,) camera centre in the world, metres. Raises `InputError` for a camera without a pose."""
        return self._posed().centre

    @property
    def K(self) -> Floats:
        """(3, 3) camera matrix in pixels, without the distortion: that of the lens."""
        return self.lens.matrix

    @property
    def P(self) -> Floats:
        """(3, 4) projection matrix K [R | t], from world metres to pixels of the undistorted picture.

        `cv2.undistortPoints(..., P=K)`, or `cv2.fisheye.undistortPoints` for a fisheye, maps the picture's pixels there.
        Raises `InputError` for a camera without a pose.
        """
        pose = self._posed()
        return _frozen(self.K @ np.column_stack([pose.R_cw, pose.t_cw]))

    def project(self, points: Floats) -> Floats:
        """Project world points through the whole lens, distortion included.

        Args:
            points: (N, 3) or (3,), world, metres.

        Returns:
            (N, 2) pixels of the picture as filmed; NaN behind a pinhole camera.

        Raises:
            InputError: the camera has no pose.
        """
        pose = self._posed()
        return self.lens.project_rays(np.asarray(points, dtype=np.float64).reshape(-1, 3) @ pose.R_cw.T + pose.t_cw)

    def _posed(self) -> Pose:
        if self.pose is None:
            raise InputError(f"camera {self.name} has no pose: it was not calibrated")
        return self.pose


@dataclass(frozen=True, eq=False)
class Rig:
    """The cameras in one world: z up, the people's ground plane at z = 0, metres."""

    cameras: tuple[Camera, ...]
    verdict: str | None = None
    metadata: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        twice = sorted(name for name, count in Counter(self.names).items() if count > 1)
        if twice:
            raise InputError(f"camera {twice[0]} occurs twice in one rig: camera names must differ")

    def __repr__(self) -> str:
        lost = len(self) - len(self.posed())
        named = ", ".join(self.names[:NAMED]) + (", ..." if len(self) > NAMED else "")
        without = f"; {lost} without a pose" if lost else ""
        verdict = f"; {self.verdict}" if self.verdict else ""
        return f"Rig({len(self)} camera{'s' if len(self) != 1 else ''}: {named}{without}{verdict})"

    def _repr_html_(self) -> str | None:
        """In a notebook: a table of the cameras and the rig from above."""
        return html_of(self)

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras' names, in the rig's order."""
        return tuple(camera.name for camera in self.cameras)

    def __getitem__(self, name: str) -> Camera:
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise KeyError(f"no camera {name} in this rig; it has {', '.join(self.names)}")

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def triangulate(self, points: Mapping[str, Floats]) -> Floats:
        """The world points that cameras see at given pixels; row n of every camera is the same point.

            rig.triangulate({"C1": [[412.0, 233.5]], "C2": [[128.2, 301.0]]})

        The squared angles to the viewing rays are minimised, in pixels by each camera's focal length.

        Args:
            points: by camera, (N, 2) pixels of the picture as filmed; NaN where that camera does not see the point.

        Returns:
            (N, 3) points, world, metres; always finite.

        Raises:
            InputError: an unknown camera or one without a pose, fewer than two cameras, arrays of other shapes, a point that
                fewer than two cameras see, rays that are parallel, or that meet behind a camera.
        """
        unknown = [name for name in points if name not in self.names]
        if unknown:
            raise InputError(f"no camera {unknown[0]} in this rig; it has {', '.join(self.names)}")
        if len(points) < 2:
            raise InputError(f"triangulation needs pixels of two cameras or more, not of {len(points)}")
        pixels = {name: np.asarray(values, dtype=np.float64) for name, values in points.items()}
        count = len(next(iter(pixels.values())))
        for name, values in pixels.items():
            if values.shape != (count, 2):
                raise InputError(f"pixels of camera {name} have the shape {values.shape}: give ({count}, 2), a row per point")
        cameras = [self[name] for name in pixels]
        poses = [camera._posed() for camera in cameras]
        found, faults = triangulate_views(
            np.stack([_seen_rays(camera.lens, values) for camera, values in zip(cameras, pixels.values(), strict=True)]),
            np.stack([pose.R_cw for pose in poses]),
            np.stack([pose.t_cw for pose in poses]),
            np.array([camera.lens.focal**2 for camera in cameras]),
        )
        if faults:
            row, why = next(iter(faults.items()))
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            raise InputError(f"point {row}{more} cannot be triangulated: {why}: leave it out, or check its pixels")
        return found

    def posed(self) -> Rig:
        """The rig of those cameras that have a pose."""
        return replace(self, cameras=tuple(camera for camera in self.cameras if camera.pose is not None))

    def moved(self, rotation: Floats, translation: Floats, scale: float = 1.0) -> Rig:
        """The rig after the world is moved by `X -> scale rotation X + translation`, sigmas too."""
        cameras = tuple(
            replace(
                camera,
                pose=camera.pose.moved(rotation, translation, scale),
                sigma=None if camera.sigma is None else camera.sigma.moved(rotation, scale),
            )
            if camera.pose is not None
            else camera
            for camera in self.cameras
        )
        return replace(self, cameras=cameras)
