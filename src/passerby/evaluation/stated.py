"""Are the stated sigmas as large as the errors?

A rig's world is free to be turned about the vertical and moved along the ground: no measurement tells of it. So the estimate
is placed upon the truth by the best such motion, least squares over the camera centres, which is the placement that the
sigmas of a rig file are stated for. What remains, and what the sigmas are of, holds the errors of scale, vertical and ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from passerby.core.cameras import Camera, Pose
from passerby.geometry.rotations import angle_between, exp_rotation
from passerby.geometry.similarity import fit_plane_similarity


@dataclass(frozen=True)
class Stated:
    """Errors after the best placement along the ground, beside the sigmas that were stated, by camera."""

    position_mm: dict[str, float]
    orientation_deg: dict[str, float]
    position_sigma_mm: dict[str, float]
    """Of the cameras that state one."""
    orientation_sigma_deg: dict[str, float]

    def __repr__(self) -> str:
        return f"Stated({len(self.position_mm)} cameras, {len(self.position_sigma_mm)} with sigmas)"

    @property
    def position_sigmas(self) -> dict[str, float]:
        """Errors of position as multiples of their sigmas."""
        return {name: self.position_mm[name] / sigma for name, sigma in self.position_sigma_mm.items() if sigma > 0}

    @property
    def orientation_sigmas(self) -> dict[str, float]:
        """Errors of orientation as multiples of their sigmas."""
        return {name: self.orientation_deg[name] / sigma for name, sigma in self.orientation_sigma_deg.items() if sigma > 0}

    def to_dict(self) -> dict[str, Any]:
        """As plain values for JSON."""
        position, orientation = self.position_sigmas, self.orientation_sigmas
        return {
            "cameras": [
                {
                    "name": name,
                    "position_error_mm": error,
                    "position_sigma_mm": self.position_sigma_mm.get(name),
                    "position_error_sigmas": position.get(name),
                    "orientation_error_deg": self.orientation_deg[name],
                    "orientation_sigma_deg": self.orientation_sigma_deg.get(name),
                    "orientation_error_sigmas": orientation.get(name),
                }
                for name, error in self.position_mm.items()
            ],
            "position_within_1_sigma": _within(position, 1),
            "position_within_2_sigmas": _within(position, 2),
            "orientation_within_1_sigma": _within(orientation, 1),
            "orientation_within_2_sigmas": _within(orientation, 2),
        }


def _within(errors: dict[str, float], sigmas: float) -> float | None:
    """The share of the errors within so many sigmas; None where no sigma is stated."""
    return float(np.mean([error <= sigmas for error in errors.values()])) if errors else None


def stated_errors(estimate: Sequence[Camera], truth: Sequence[Pose]) -> Stated | None:
    """Errors and sigmas of cameras with poses, the true poses in the same order, z up in both worlds.

    None where the placement is not defined: fewer than two cameras, or all above one place.
    """
    poses = [camera.pose for camera in estimate if camera.pose is not None]
    ours, true = (np.array([pose.centre for pose in of]).reshape(-1, 3) for of in (poses, truth))
    if len(ours) < 2 or float(np.ptp(ours[:, :2], axis=0).max()) < 1e-9:
        return None
    fit = fit_plane_similarity(ours[:, :2], true[:, :2], with_scale=False)
    turn, shift = exp_rotation(np.array([0.0, 0.0, fit.yaw])), np.array([*fit.translation, 0.0])
    placed = [pose.moved(turn, shift) for pose in poses]
    names = [camera.name for camera in estimate]
    sigmas = {camera.name: camera.sigma for camera in estimate if camera.sigma is not None}
    return Stated(
        {n: float(1000 * np.linalg.norm(p.centre - t.centre)) for n, p, t in zip(names, placed, truth, strict=True)},
        {n: float(np.degrees(angle_between(p.R_cw, t.R_cw))) for n, p, t in zip(names, placed, truth, strict=True)},
        {name: 1000 * sigma.position_m for name, sigma in sigmas.items() if np.isfinite(sigma.position_m)},
        {name: sigma.orientation_deg for name, sigma in sigmas.items() if np.isfinite(sigma.orientation_deg)},
    )
