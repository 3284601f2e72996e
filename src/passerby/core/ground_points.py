"""Points on the ground that one camera sees, with their uncertainty.

A pixel's ray meets the ground z = 0 at `X = C - C_z d / d_z`, with the camera's centre C and the ray's direction d. To first
order the errors of the pose (centre, rotation vector), of the intrinsics and of the pixel move X linearly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats
from passerby.common.errors import InputError
from passerby.core.lens import INTRINSICS, Lens
from passerby.core.pose import Pose, PoseSigma
from passerby.geometry.single_view import HORIZON


@dataclass(frozen=True, eq=False)
class GroundPoints:
    """N points on the ground that one camera sees; all values are finite. World of the rig: ground z = 0, metres."""

    xy: Floats
    """(N, 2) positions on the ground, metres."""
    covariance: Floats | None
    """(N, 2, 2) covariance of each position from camera and pixel, square metres; None where the pose's is unknown."""
    by_camera: Floats
    """(N, 2, 10) derivatives of the position by pose and intrinsics, in the order of `PoseSigma.complete`."""
    camera_covariance: Floats | None
    """(10, 10) covariance of pose and intrinsics; intrinsics count as exact where theirs is unknown. None if unknown."""

    def __repr__(self) -> str:
        sigma = self.sigma_m
        known = "sigma unknown" if sigma is None else f"sigma {np.median(sigma):.3f} m (median)" if len(self) else "no points"
        return f"GroundPoints({len(self)} points, {known})"

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def xyz(self) -> Floats:
        """(N, 3) the same points in space, metres: z is 0."""
        return np.column_stack([self.xy, np.zeros(len(self))])

    @property
    def sigma_m(self) -> Floats | None:
        """(N,) root of the trace of each covariance, metres (the expected distance from the true point); None if unknown."""
        return None if self.covariance is None else np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    def distance(self, first: int, second: int) -> tuple[float, float | None]:
        """Return the distance between two of the points, and its 1-sigma.

        Both points move together with the camera: their common error cancels. Errors of the two pixels are independent.

        Args:
            first: row of one point.
            second: row of another one.

        Returns:
            Distance in metres; one sigma in metres, None where the pose's covariance is unknown.
        """
        apart = self.xy[first] - self.xy[second]
        metres = float(np.linalg.norm(apart))
        if self.covariance is None or self.camera_covariance is None:
            return metres, None
        both = self.by_camera[[first, second]]
        by_pixel = (self.covariance[[first, second]] - both @ self.camera_covariance @ np.swapaxes(both, 1, 2)).sum(axis=0)
        change = both[0] - both[1]
        covariance = change @ self.camera_covariance @ change.T + by_pixel
        along = apart / metres if metres > 0 else np.array([1.0, 0.0])
        return metres, float(np.sqrt(max(along @ covariance @ along, 0.0)))


def sees_ground(lens: Lens, pose: Pose, pixels: Floats) -> Bools:
    """Return whether each pixel (N, 2) shows the ground, (N,): it is below the horizon by 0.01 rad or more, and has a ray."""
    return _hits_ground(pose, lens.bearings(pixels))


def ground_points(lens: Lens, pose: Pose, sigma: PoseSigma | None, pixels: Floats, pixel_sd_px: float) -> GroundPoints:
    """Intersect the rays of pixels with the ground; see `Camera.ground`.

    Args:
        lens: lens of the camera.
        pose: pose of the camera, world to camera.
        sigma: uncertainty of the pose and the intrinsics; None if unknown.
        pixels: (N, 2) of the picture as filmed.
        pixel_sd_px: standard deviation of each coordinate of the pixels.

    Raises:
        InputError: a pixel that does not show the ground, with its row.
    """
    rays = lens.bearings(pixels)
    missing = np.flatnonzero(~_hits_ground(pose, rays))
    if len(missing):
        row = int(missing[0])
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        why = (
            "the camera is not above the ground"
            if pose.centre[2] <= 0
            else "it is at the horizon, above it, or outside the lens"
        )
        raise InputError(
            f"pixel {row}{more}, ({pixels[row, 0]:.1f}, {pixels[row, 1]:.1f}), does not show the ground: {why}: leave out the "
            "pixels for which camera.sees_ground(pixels) is False"
        )
    directions = rays @ pose.R_cw
    along = directions[:, :2] / directions[:, 2:]
    xy = pose.centre[:2] - pose.centre[2] * along
    # Derivative by the direction: -C_z / d_z [I | -along]. A rotation vector w turns the direction by R^T (b x w).
    by_point = np.concatenate([np.broadcast_to(np.eye(2), (len(rays), 2, 2)), -along[:, :, None]], axis=2)
    by_direction = (-pose.centre[2] / directions[:, 2])[:, None, None] * by_point
    by_ray = by_direction @ pose.R_cw.T
    by_pixel = by_ray @ np.linalg.pinv(lens.tangents(rays)) if len(rays) else np.zeros((0, 2, 2))
    # If a change of the lens moves the pixels of all rays, the ray of a fixed pixel moves in the opposite direction.
    by_camera = np.concatenate([by_point, by_ray @ _cross(rays), -by_pixel @ lens.by_intrinsics(rays)], axis=2)
    known, covariance = None if sigma is None else _complete_covariance(sigma), None
    if known is not None:
        by_both = by_pixel @ np.swapaxes(by_pixel, 1, 2)
        covariance = by_camera @ known @ np.swapaxes(by_camera, 1, 2) + pixel_sd_px**2 * by_both
    return GroundPoints(xy, covariance, by_camera, known)


def _complete_covariance(sigma: PoseSigma) -> Floats | None:
    """Return the covariance (10, 10) of pose and intrinsics; unknown intrinsics count as exact. None without the pose's."""
    if sigma.complete is not None or sigma.covariance is None:
        return sigma.complete
    out = np.zeros((6 + INTRINSICS, 6 + INTRINSICS))
    out[:6, :6] = sigma.covariance
    return out


def _hits_ground(pose: Pose, rays: Floats) -> Bools:
    """Return whether each ray (N, 3), camera frame, hits the ground, (N,)."""
    down = -np.nan_to_num(rays, nan=0.0) @ pose.R_cw[:, 2]
    return np.asarray(np.isfinite(rays).all(axis=1) & (down > HORIZON) & (pose.centre[2] > 0))


def _cross(rays: Floats) -> Floats:
    """Return the matrices (N, 3, 3) that form the cross product of each ray with a vector."""
    x, y, z = rays.T
    zero = np.zeros(len(rays))
    return np.stack([np.stack([zero, -z, y], 1), np.stack([z, zero, -x], 1), np.stack([-y, x, zero], 1)], axis=1)
