"""Errors of an estimated rig against the true one: poses (CPE), scale, vertical, ground, intrinsics, stated sigmas.

A wrong scale and a wrong shape are different errors, so the estimate is aligned with the truth in two ways:

- *metric*: moved rigidly so that the reference camera coincides with the truth in position and orientation; means over the
  other cameras. This is the CPE of Xu, Li, Weng, Kitani, "Wide-Baseline Multi-Camera Calibration using Person
  Re-Identification", CVPR 2021.
- *similarity*: turned by the chordal mean over the cameras of `R_true^T R_est`, then scaled and shifted by least squares over
  the camera centres; means over all cameras.

A position error is `|C_est - C_true|`, an orientation error the angle of `R_est R_true^T` (R is world to camera).

No measurement determines the rotation of a rig's world about the vertical and its translation along the ground. For the stated
sigmas, the estimate is therefore placed on the truth by the best such motion, by least squares over the camera centres. The
sigmas of a rig file are stated for this placement. The remaining errors, and the sigmas, include those of scale, vertical and
ground.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.measuring import MeasuringErrors, measuring_errors
from passerby.core.observations import Boxes
from passerby.geometry.rotations import (
    Similarity,
    angle_between,
    chordal_mean_rotation,
    direction_angle,
    exp_rotation,
    fit_plane_similarity,
)

GRID = (17, 13)
"""Numbers of points along x and y of the picture at which rays are compared."""
SAME_PX = 1e-3
"""Lenses whose rays differ by less are the same."""


@dataclass(frozen=True)
class Placement:
    """The errors that remain after one placement of the estimate on the truth; None if undefined."""

    position_mm: dict[str, float]
    """Position error by camera; empty if the placement is undefined."""
    orientation_deg: dict[str, float]
    """Orientation error by camera."""
    mean_position_mm: float | None
    mean_orientation_deg: float | None
    median_position_mm: float | None
    median_orientation_deg: float | None


@dataclass(frozen=True)
class LensError:
    """Errors of one camera's intrinsics against the true ones, which are for the same image size."""

    focal_percent: float
    """Estimated over true focal length, minus 1, per cent; a focal length is the geometric mean of those along x and y."""
    principal_point_px: float
    """Distance between the principal points."""
    ray_px: float | None
    """Mean distance, over the picture, between a pixel and the projection of its true ray by the estimated lens; None if it
    projects no ray. A small rotation of the camera compensates for much of it.
    """

    @property
    def differs(self) -> bool:
        """Whether the two lenses are different."""
        return self.ray_px is None or self.ray_px > SAME_PX

    def to_dict(self) -> dict[str, float | None]:
        """Return the errors as plain values for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Stated:
    """Errors after the best placement along the ground, and the stated sigmas, by camera."""

    position_mm: dict[str, float]
    orientation_deg: dict[str, float]
    position_sigma_mm: dict[str, float]
    """Stated sigmas of the positions; only of cameras that state one."""
    orientation_sigma_deg: dict[str, float]

    def __repr__(self) -> str:
        return f"Stated({len(self.position_mm)} cameras, {len(self.position_sigma_mm)} with sigmas)"

    @property
    def position_sigmas(self) -> dict[str, float]:
        """Position errors divided by their sigmas."""
        return {name: self.position_mm[name] / sigma for name, sigma in self.position_sigma_mm.items() if sigma > 0}

    @property
    def orientation_sigmas(self) -> dict[str, float]:
        """Orientation errors divided by their sigmas."""
        return {name: self.orientation_deg[name] / sigma for name, sigma in self.orientation_sigma_deg.items() if sigma > 0}

    def to_dict(self) -> dict[str, Any]:
        """Return errors and sigmas as plain values for JSON."""
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
            "position_within_1_sigma": _measure_coverage(position, 1),
            "position_within_2_sigmas": _measure_coverage(position, 2),
            "orientation_within_1_sigma": _measure_coverage(orientation, 1),
            "orientation_within_2_sigmas": _measure_coverage(orientation, 2),
        }


@dataclass(frozen=True)
class Comparison:
    """Errors of an estimated rig against the true one."""

    names: tuple[str, ...]
    """The cameras compared: those of the truth that have a pose in the estimate."""
    missing: tuple[str, ...]
    """Cameras of the truth without a pose in the estimate."""
    reference: str
    metric: Placement
    similarity: Placement
    scale_ratio: float | None
    """Estimated length / true length."""
    gravity_error_deg: float | None
    """Angle between the estimate's and the true vertical, after the similarity's rotation."""
    ground_error_mm: float | None
    """Height of the estimated ground over the true one, below the cameras' centroid, after the similarity."""
    stated: Stated | None = None
    """Errors for the comparison with the stated sigmas; None if undefined."""
    lenses: Mapping[str, LensError] = field(default_factory=dict)
    """Errors of the intrinsics, of cameras whose image size is the same in both rigs."""
    measured: MeasuringErrors | None = None
    """Errors of points and of places on the ground that the rig measures; None if not requested, or undefined."""

    def __repr__(self) -> str:
        mean, turn = self.similarity.mean_position_mm, self.similarity.mean_orientation_deg
        errors = "" if mean is None or turn is None else f", mean {mean:.1f} mm and {turn:.2f} deg after the best similarity"
        scale = "" if self.scale_ratio is None else f", scale {self.scale_ratio:.4f}"
        return f"Comparison({len(self.names)} cameras, {len(self.missing)} missing{errors}{scale})"

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain values for JSON: no NaN, None if undefined."""
        cameras = [
            {
                "name": name,
                "position_error_mm": self.metric.position_mm.get(name),
                "orientation_error_deg": self.metric.orientation_deg.get(name),
                "similarity_position_error_mm": self.similarity.position_mm.get(name),
                "similarity_orientation_error_deg": self.similarity.orientation_deg.get(name),
            }
            for name in (*self.names, *self.missing)
        ]
        return {
            "cameras": cameras,
            "metric": self._summary(self.metric),
            "similarity": self._summary(self.similarity),
            "scale_ratio": self.scale_ratio,
            "gravity_error_deg": self.gravity_error_deg,
            "ground_error_mm": self.ground_error_mm,
            "reference": self.reference,
            "registered": len(self.names),
            "missing": list(self.missing),
            "stated": None if self.stated is None else self.stated.to_dict(),
            "lenses": {name: error.to_dict() for name, error in self.lenses.items()},
            "points": None if self.measured is None else self.measured.points.to_dict(),
            "ground": None if self.measured is None else self._ground(self.measured),
        }

    def _ground(self, measured: MeasuringErrors) -> dict[str, Any] | None:
        if measured.ground is None:
            return None
        cameras = {name: one.to_dict() for name, one in measured.cameras.items()}
        return {**measured.ground.to_dict(), "cameras": cameras}

    def _summary(self, placement: Placement) -> dict[str, float | None]:
        return {
            "mean_position_mm": placement.mean_position_mm,
            "mean_orientation_deg": placement.mean_orientation_deg,
            "median_position_mm": placement.median_position_mm,
            "median_orientation_deg": placement.median_orientation_deg,
            "scale_ratio": self.scale_ratio,
        }


def compare(estimate: Rig, truth: Rig, reference: str | None = None) -> Comparison:
    """Compare an estimated rig with the true one.

    Args:
        estimate: estimated rig; cameras without a pose in it count as missing; cameras that the truth lacks are left out.
        truth: true rig; cameras without a pose are left out.
        reference: camera that coincides in the metric placement; None: the truth's first camera with an estimated pose.

    Raises:
        InputError: no camera has a pose in both, or the reference has none.
    """
    true_poses = _poses(truth)
    estimated = _poses(estimate)
    names = tuple(name for name in true_poses if name in estimated)
    missing = tuple(name for name in true_poses if name not in estimated)
    if not names:
        raise InputError(
            f"no camera has a pose in both rigs: the estimate has {', '.join(estimated) or 'none'}, "
            f"the truth {', '.join(true_poses) or 'none'}; the names must be the same"
        )
    if reference is not None and reference not in names:
        raise InputError(f"reference camera {reference} has no pose in both rigs: choose one of {', '.join(names)}")
    reference = reference or names[0]
    e, t = [estimated[name] for name in names], [true_poses[name] for name in names]

    anchor = names.index(reference)
    turn = t[anchor].R_cw.T @ e[anchor].R_cw
    metric = [pose.moved(turn, t[anchor].centre - turn @ e[anchor].centre) for pose in e]
    others = [index for index in range(len(names)) if index != anchor]

    similarity = place(e, t)
    gravity, ground, placed = None, None, None
    if similarity is not None:
        up = similarity.rotation[:, 2]
        placed = [pose.moved(similarity.rotation, similarity.translation, similarity.scale) for pose in e]
        gravity = float(np.degrees(direction_angle(up, np.array([0.0, 0.0, 1.0]))))
        ground = _ground_error_mm(up, similarity.translation, np.mean([pose.centre for pose in t], axis=0))
    return Comparison(
        names=names,
        missing=missing,
        reference=reference,
        metric=_placement(names, metric, t, others),
        similarity=_placement(names, placed, t, range(len(names))),
        scale_ratio=None if similarity is None else 1 / similarity.scale,
        gravity_error_deg=gravity,
        ground_error_mm=ground,
        stated=compare_stated_sigmas([estimate[name] for name in names], t),
        lenses={name: error for name in names if (error := lens_error(estimate[name].lens, truth[name].lens)) is not None},
    )


def compare_measuring(
    estimate: Rig, truth: Rig, reference: str | None = None, people: Mapping[str, Boxes] | None = None
) -> Comparison:
    """Compare an estimated rig with the true one, including the errors of points and places that it measures.

    `people` as in `measuring_errors`; the other arguments as in `compare`.
    """
    return replace(compare(estimate, truth, reference), measured=measuring_errors(estimate, truth, people))


def place(estimate: Sequence[Pose], truth: Sequence[Pose]) -> Similarity | None:
    """Compute the similarity of the world that moves the estimated cameras to the true ones.

    The rotation is the chordal mean of `R_true^T R_est`; scale and translation are found by least squares over the centres.

    Returns:
        The similarity, metres to metres; None if undefined: fewer than two cameras, cameras at one place, or an estimate so
        wrong that no positive scale fits.
    """
    if len(estimate) < 2:
        return None
    rotation = chordal_mean_rotation(np.array([t.R_cw.T @ e.R_cw for e, t in zip(estimate, truth, strict=True)]))
    moved = np.array([rotation @ pose.centre for pose in estimate])
    target = np.array([pose.centre for pose in truth])
    spread = moved - moved.mean(axis=0)
    length, overlap = float((spread**2).sum()), float((spread * target).sum())
    if not length > 1e-18 * float((moved**2).sum()) or not overlap > 0:
        return None
    scale = overlap / length
    return Similarity(scale, rotation, target.mean(axis=0) - scale * moved.mean(axis=0))


def _poses(rig: Rig) -> dict[str, Pose]:
    def pose_of(camera: Camera) -> list[tuple[str, Pose]]:
        return [] if camera.pose is None else [(camera.name, camera.pose)]

    return dict(item for camera in rig for item in pose_of(camera))


def _placement(names: Sequence[str], placed: Sequence[Pose] | None, truth: Sequence[Pose], counted: Sequence[int]) -> Placement:
    """Compute the errors of all cameras, with mean and median over the cameras in `counted`."""
    if placed is None:
        return Placement({}, {}, None, None, None, None)
    position = [float(1000 * np.linalg.norm(p.centre - t.centre)) for p, t in zip(placed, truth, strict=True)]
    orientation = [float(np.degrees(angle_between(p.R_cw, t.R_cw))) for p, t in zip(placed, truth, strict=True)]
    some_position, some_orientation = [position[index] for index in counted], [orientation[index] for index in counted]
    return Placement(
        dict(zip(names, position, strict=True)),
        dict(zip(names, orientation, strict=True)),
        float(np.mean(some_position)) if some_position else None,
        float(np.mean(some_orientation)) if some_orientation else None,
        float(np.median(some_position)) if some_position else None,
        float(np.median(some_orientation)) if some_orientation else None,
    )


def _ground_error_mm(up: Floats, origin: Floats, centroid: Floats) -> float | None:
    """Compute the absolute height, mm, of the plane through `origin` with normal `up` below `centroid`; None if vertical."""
    if abs(up[2]) < 1e-6:
        return None
    height = origin[2] - (up[0] * (centroid[0] - origin[0]) + up[1] * (centroid[1] - origin[1])) / up[2]
    return float(1000 * abs(height))


def lens_error(estimate: Lens, truth: Lens) -> LensError | None:
    """Compute the error of a lens; None if the two lenses are for different image sizes."""
    if estimate.size != truth.size:
        return None
    width, height = truth.size
    across, down = np.meshgrid(*(np.linspace(0, size - 1, count) for size, count in zip((width, height), GRID, strict=True)))
    pixels = np.column_stack([across.ravel(), down.ravel()])
    rays = truth.bearings(pixels)
    seen = np.isfinite(rays).all(axis=1)
    miss = np.linalg.norm(estimate.project_rays(rays[seen]) - pixels[seen], axis=1)
    miss = miss[np.isfinite(miss)]
    return LensError(
        float(100 * (estimate.focal / truth.focal - 1)),
        float(np.linalg.norm(estimate.matrix[:2, 2] - truth.matrix[:2, 2])),
        float(miss.mean()) if len(miss) else None,
    )


def _measure_coverage(errors: dict[str, float], sigmas: float) -> float | None:
    """Compute the share of the errors, in sigmas, up to a number of sigmas; None if no sigma is stated."""
    return float(np.mean([error <= sigmas for error in errors.values()])) if errors else None


def compare_stated_sigmas(estimate: Sequence[Camera], truth: Sequence[Pose]) -> Stated | None:
    """Compute the errors and sigmas of cameras with poses; the true poses have the same order, and z is up in both worlds.

    None if the placement is undefined: fewer than two cameras, or all above one place.
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
