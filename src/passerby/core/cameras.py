"""Cameras as values: a lens, a pose, and the rig that holds them.

Frames: world to camera is `x_c = R_cw X_w + t_cw` with OpenCV's camera axes (x right, y down, z forward), metres; pixels as
OpenCV counts them. Lens models are OpenCV's pinhole with radial-tangential distortion and OpenCV's fisheye.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, frozen
from passerby.common.errors import InputError
from passerby.common.text import html_of
from passerby.core.ground_points import GroundPoints, ground_points, sees_ground
from passerby.core.lens import FISHEYE_DISTORTION_LENGTHS, PINHOLE_DISTORTION_LENGTHS, Lens
from passerby.core.pose import Pose, PoseSigma, pose_in_words
from passerby.geometry.triangulation import triangulate_views

__all__ = ["FISHEYE_DISTORTION_LENGTHS", "PINHOLE_DISTORTION_LENGTHS", "Camera", "Lens", "Pose", "PoseSigma", "Rig"]

NAMED = 8
"""Largest number of cameras that are named on one line."""
FOLDED_RAD = 0.01
"""If the ray of a pixel is farther than this from the point's ray, the pixel shows another point: a distortion folds back
beyond its last angle."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One static camera; `pose` is None as long as it is not calibrated."""

    name: str
    lens: Lens
    pose: Pose | None = None
    sigma: PoseSigma | None = None

    def __repr__(self) -> str:
        pose = "without a pose" if self.pose is None else pose_in_words(self.pose)
        sure = ""
        if self.sigma is not None:
            known = np.isfinite(self.sigma.position_m)
            sure = f", sigma {1000 * self.sigma.position_m:.0f} mm" if known else ", sigma unknown"
        return f"Camera({self.name!r}, {self.lens.size[0]} x {self.lens.size[1]}, {pose}{sure})"

    @property
    def centre(self) -> Floats:
        """(3,) camera centre in the world, metres. Raises `InputError` for a camera without a pose."""
        return self._require_pose().centre

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
        pose = self._require_pose()
        return frozen(self.K @ np.column_stack([pose.R_cw, pose.t_cw]))

    def project(self, points: Floats) -> Floats:
        """Project world points through the whole lens, distortion included.

        Args:
            points: (N, 3) or (3,), world, metres.

        Returns:
            (N, 2) pixels of the picture as filmed; NaN behind a pinhole camera.

        Raises:
            InputError: the camera has no pose.
        """
        pose = self._require_pose()
        return self.lens.project_rays(np.asarray(points, dtype=np.float64).reshape(-1, 3) @ pose.R_cw.T + pose.t_cw)

    def ground(self, pixels: Floats, *, pixel_sd_px: float = 0.0) -> GroundPoints:
        """Compute the points on the ground z = 0 that pixels show, with their uncertainty from pose and intrinsics.

            found = camera.ground([[640.0, 500.0]])
            found.xy, found.sigma_m

        The sigma, as that of the pose, is valid after the best placement of the rig as a whole. It includes the intrinsics.
        Near the horizon a small error of the pose moves a point far, and the sigma, which is linear, is too small.

        Args:
            pixels: (N, 2) or (2,), pixels of the picture as filmed.
            pixel_sd_px: standard deviation of each coordinate of the pixels, added to the uncertainty.

        Returns:
            N points (x, y), world, metres; always finite.

        Raises:
            InputError: the camera has no pose, or a pixel shows no ground: it is above the horizon or nearer to it than 0.01
                rad, or the lens has no ray for it. `sees_ground` finds the pixels that do.
        """
        return ground_points(self.lens, self._require_pose(), self.sigma, _pixels(pixels, self.name), pixel_sd_px)

    def sees_ground(self, pixels: Floats) -> Bools:
        """Return whether pixels show the ground, 0.01 rad or more below the horizon.

        Args:
            pixels: (N, 2) or (2,), pixels of the picture as filmed.

        Returns:
            (N,) True where `ground` has a point.

        Raises:
            InputError: the camera has no pose.
        """
        return sees_ground(self.lens, self._require_pose(), _pixels(pixels, self.name))

    def undistort(self, points: Floats) -> Floats:
        """Convert pixels of the picture as filmed to those of the undistorted picture, which has the camera matrix `K`.

        Args:
            points: (N, 2) or (2,), pixels of the picture as filmed.

        Returns:
            (N, 2) pixels; always finite. `P` projects to them.

        Raises:
            InputError: a pixel without a ray in front of the camera, such as one beyond 90 degrees of a fisheye.
        """
        pixels = _pixels(points, self.name)
        rays = self.lens.bearings(pixels)
        lost = np.flatnonzero(~(np.nan_to_num(rays[:, 2], nan=0.0) > 0))
        if len(lost):
            u, v = pixels[lost[0]]
            raise InputError(
                f"camera {self.name}: pixel {lost[0]}, ({u:.1f}, {v:.1f}), has no place in an undistorted image: it is "
                "outside the lens, or 90 degrees or more off the optical axis: leave it out"
            )
        return np.asarray((rays / rays[:, 2:]) @ self.K[:2].T)

    def _require_pose(self) -> Pose:
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
        """Return a table of the cameras and the rig from above as HTML, for notebooks."""
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

    def project(self, points: Floats) -> dict[str, Floats]:
        """Project world points into all cameras with a pose: the inverse of `triangulate`.

            rig.project([[0.0, 5.0, 1.2]])["C1"]

        Args:
            points: (N, 3) or (3,), world, metres.

        Returns:
            By camera, (N, 2) pixels of the picture as filmed; NaN where its image does not show the point: behind the camera,
            or outside the image.
        """
        world = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        return {camera.name: _project_into_picture(camera, world) for camera in self.posed()}

    def triangulate(self, points: Mapping[str, Floats]) -> Floats:
        """Triangulate world points from the pixels at which cameras see them; row n of every camera is the same point.

            rig.triangulate({"C1": [[412.0, 233.5]], "C2": [[128.2, 301.0]]})

        The squared angles to the viewing rays are minimised, each converted to pixels with the camera's focal length.

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
        poses = [camera._require_pose() for camera in cameras]
        found, faults = triangulate_views(
            np.stack([_find_seen_rays(camera.lens, values) for camera, values in zip(cameras, pixels.values(), strict=True)]),
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
        """Return the rig of those cameras that have a pose."""
        return replace(self, cameras=tuple(camera for camera in self.cameras if camera.pose is not None))

    def moved(self, rotation: Floats, translation: Floats, scale: float = 1.0) -> Rig:
        """Return the rig after the world is moved by `X -> scale rotation X + translation`, with its sigmas."""
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


def _pixels(values: Floats, camera: str) -> Floats:
    """Return the pixels as (N, 2), finite. Raises `InputError`."""
    pixels = np.asarray(values, dtype=np.float64)
    if pixels.shape[-1:] != (2,) or pixels.ndim > 2:
        raise InputError(f"camera {camera}: pixels have the shape {pixels.shape}: give (N, 2)")
    pixels = pixels.reshape(-1, 2)
    lost = np.flatnonzero(~np.isfinite(pixels).all(axis=1))
    if len(lost):
        raise InputError(f"camera {camera}: pixel {lost[0]} is not finite: leave it out")
    return pixels


def _project_into_picture(camera: Camera, world: Floats) -> Floats:
    """Project world points (N, 3) to pixels (N, 2); NaN outside the picture, and where a lens model folds back into it."""
    pose, pixels = camera._require_pose(), camera.project(world)
    with np.errstate(invalid="ignore"):
        shown: Bools = np.asarray(((pixels >= 0) & (pixels <= np.array(camera.lens.size))).all(axis=1))
    rays = world @ pose.R_cw.T + pose.t_cw
    seen = _find_seen_rays(camera.lens, np.where(shown[:, None], pixels, np.nan))
    with np.errstate(invalid="ignore"):
        shown &= np.einsum("ni,ni->n", seen, rays) > np.cos(FOLDED_RAD) * np.linalg.norm(rays, axis=1)
    return np.where(shown[:, None], pixels, np.nan)


def _find_seen_rays(lens: Lens, pixels: Floats) -> Floats:
    """Compute the viewing rays (N, 3) of pixels (N, 2); NaN where a pixel is not finite, or has no ray."""
    rays = np.full((len(pixels), 3), np.nan)
    known = np.isfinite(pixels).all(axis=1)
    rays[known] = lens.bearings(pixels[known])
    return rays
