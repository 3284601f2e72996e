"""A camera's pose, and its uncertainty.

World to camera is `x_c = R_cw X_w + t_cw` with OpenCV's camera axes (x right, y down, z forward), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from passerby.common.arrays import Floats, frozen


@dataclass(frozen=True, eq=False)
class Pose:
    """World to camera: `x_c = R_cw X_w + t_cw`."""

    R_cw: Floats
    """(3, 3) rotation."""
    t_cw: Floats
    """(3,) translation, metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "R_cw", frozen(self.R_cw).reshape(3, 3))
        object.__setattr__(self, "t_cw", frozen(self.t_cw).reshape(3))

    def __repr__(self) -> str:
        return f"Pose({pose_in_words(self)})"

    @classmethod
    def from_centre(cls, R_cw: Floats, centre: Floats) -> Pose:
        """Return the pose of a camera with its centre at `centre` (3,), world frame, metres."""
        return cls(R_cw, -np.asarray(R_cw) @ np.asarray(centre))

    @cached_property
    def centre(self) -> Floats:
        """(3,) camera centre in the world, metres."""
        return frozen(-self.R_cw.T @ self.t_cw)

    @property
    def heading_deg(self) -> float | None:
        """Horizontal direction of the optical axis: degrees from the world's x axis towards y, in (-180, 180].

        None for a camera that looks straight up or down.
        """
        x, y, _ = self.R_cw[2]
        return None if np.hypot(x, y) < 1e-9 else float(np.degrees(np.arctan2(y, x)))

    @property
    def tilt_deg(self) -> float:
        """Angle of the optical axis below the horizon, degrees in [-90, 90]."""
        return float(np.degrees(np.arctan2(-self.R_cw[2, 2], np.hypot(self.R_cw[2, 0], self.R_cw[2, 1]))))

    @property
    def roll_deg(self) -> float | None:
        """Rotation of the camera about its optical axis, clockwise as seen from behind it: degrees in (-180, 180].

        At 0 the picture's rows are level. None for a camera that looks straight up or down.
        """
        level = np.cross(self.R_cw[2], (0.0, 0.0, 1.0))
        if np.linalg.norm(level) < 1e-9:
            return None
        return float(np.degrees(np.arctan2(self.R_cw[0] @ np.cross(self.R_cw[2], level), self.R_cw[0] @ level)))

    def moved(self, rotation: Floats, translation: Floats, scale: float = 1.0) -> Pose:
        """Return the pose after the world is moved by `X -> scale rotation X + translation`."""
        R_cw = self.R_cw @ np.asarray(rotation).T
        centre = scale * np.asarray(rotation) @ self.centre + np.asarray(translation)
        return Pose.from_centre(R_cw, centre)


def pose_in_words(pose: Pose) -> str:
    """Describe the position of a camera and its viewing direction."""
    x, y, z = (round(float(value), 3) + 0.0 for value in pose.centre)
    heading = "straight up or down" if pose.heading_deg is None else f"heading {pose.heading_deg:.1f} deg"
    return f"at ({x:.3f}, {y:.3f}, {z:.3f}) m, {heading}, tilt {pose.tilt_deg:.1f} deg"


@dataclass(frozen=True, eq=False)
class PoseSigma:
    """One-sigma uncertainty of a camera's pose, after the best rigid placement of the rig as a whole.

    Infinite where no evidence constrains the pose; files leave it out then.
    """

    position_m: float
    """Root of the trace of the position's covariance, metres (the expected distance from the true centre)."""
    orientation_deg: float
    """Root of the trace of the rotation vector's covariance, degrees."""
    covariance: Floats | None = None
    """(6, 6) of centre (metres, world), then rotation vector (radians, camera frame); None where a part of it is infinite."""
    complete: Floats | None = None
    """(10, 10) of pose and intrinsics: the same six, then the logarithm of the focal length, the principal point (pixels) and
    the first distortion coefficient. Errors of intrinsics and rotation can compensate each other. None where it is unknown."""
    points_m: float | None = None
    """Median of the expected distances of points that this camera and others see where people walked, metres."""
    ground_m: float | None = None
    """The same for positions on the ground by this camera alone. Both are valid after one similarity of the whole rig."""

    @classmethod
    def from_covariance(cls, covariance: Floats, complete: Floats | None = None) -> PoseSigma:
        """Return the sigma of a covariance (6, 6) as in the field `covariance`; rounding may leave its traces just below 0.
        `complete` (10, 10) is stored unchanged.
        """
        position, turn = max(np.trace(covariance[:3, :3]), 0.0), max(np.trace(covariance[3:, 3:]), 0.0)
        known = bool(np.isfinite(position + turn))
        own = (covariance, complete) if known else (None, None)
        return cls(float(np.sqrt(position)), float(np.degrees(np.sqrt(turn))), *own)

    @property
    def with_lens_known(self) -> Floats | None:
        """(6, 6) covariance of the pose for exactly this lens; `covariance` where the uncertainty of the lens is unknown.

        It is used where a rig is compared with itself: the error of the intrinsics is then the same on both sides.
        """
        if self.complete is None:
            return self.covariance
        pose, lens, both = self.complete[:6, :6], self.complete[6:, 6:], self.complete[:6, 6:]
        unit = 1.0 / np.sqrt(np.maximum(np.diag(lens), 1e-30))
        return np.asarray(pose - both * unit @ np.linalg.pinv(lens * unit[:, None] * unit, hermitian=True) @ (both * unit).T)

    def __repr__(self) -> str:
        position = f"{1000 * self.position_m:.0f} mm" if np.isfinite(self.position_m) else "position unknown"
        orientation = f"{self.orientation_deg:.2f} deg" if np.isfinite(self.orientation_deg) else "orientation unknown"
        return f"PoseSigma({position}, {orientation})"

    def moved(self, rotation: Floats, scale: float = 1.0) -> PoseSigma:
        """Return the uncertainty after the world is moved by `X -> scale rotation X + translation`, with that motion exact.

        The centre's covariance turns and scales with the world; the rotation vector is in the camera's frame and stays.
        """

        def carried(covariance: Floats | None) -> Floats | None:
            if covariance is None:
                return None
            block = np.eye(len(covariance))
            block[:3, :3] = scale * np.asarray(rotation)
            return np.asarray(block @ covariance @ block.T)

        return PoseSigma(
            scale * self.position_m, self.orientation_deg, carried(self.covariance), carried(self.complete),
            None if self.points_m is None else scale * self.points_m, None if self.ground_m is None else scale * self.ground_m,
        )  # fmt: skip
