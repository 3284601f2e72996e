"""Steps of GeoPose for one camera and the reference: essential matrix, decomposition, triangulation, local adjustment.

Xu, Li, Weng, Kitani, CVPR 2021, section 3.3. The pair's frame is the reference camera's, and its baseline has length 1 until
it is scaled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Lens, Pose, Rig
from passerby.findings.finding import Finding, refusal
from passerby.findings.ranking import RefusalError
from passerby.geometry.triangulation import parallax_angles, triangulate_two_views
from passerby.geometry.two_view import (
    MIN_POINTS,
    NoRelativePoseError,
    choose_by_cheirality,
    decompose_essential,
    estimate_relative_pose,
)
from passerby.solver.geopose.bundle import adjust_points
from passerby.solver.geopose.correspondences import ImagePoints, match_pair, point_observations

IDENTITY = Pose(np.eye(3), np.zeros(3))

# RANSAC's threshold in sigmas of a correspondence: it contains 95 % of two-dimensional errors of correct correspondences.
THRESHOLD_SIGMAS = 2.5
# After an adjustment, points with a residual of more sigmas than this in one of their sightings are removed.
OUTLIER_SIGMAS = 4.0


@dataclass(frozen=True)
class GeoPoseOptions:
    """Options of `solve_geopose`."""

    reference: str
    """Name of the reference camera, the paper's camera 0: the one that shares people with all others."""
    person_height_m: float = 1.75
    """The prior on scale: mean height of people."""
    points: Literal["auto", "boxes", "joints"] = "auto"
    """Which points are correspondences: box centres (the paper), all keypoints, or keypoints if as many cameras have them."""
    ransac_threshold_px: float | None = None
    """Largest epipolar error of an inlier; None: 2.5 sigmas of the pair's median correspondence, 2 % of a box's height each."""
    min_correspondences: int = 20
    """A camera that shares fewer with the reference gets no pose; the paper finds 30 to suffice in its scenes."""
    max_correspondences: int = 2000
    """Most correspondences of a pair; more of the same people add time, little accuracy."""
    local_iterations: int = 30
    """Limit of a pair's bundle adjustment; the global one does the rest."""
    max_iterations: int = 200
    """Limit of the global bundle adjustment."""

    def __post_init__(self) -> None:
        threshold = 1.0 if self.ransac_threshold_px is None else self.ransac_threshold_px
        for name, value, least in (
            ("person_height_m", self.person_height_m, 0.1), ("ransac_threshold_px", threshold, 0.01),
            ("min_correspondences", self.min_correspondences, MIN_POINTS),
            ("max_correspondences", self.max_correspondences, self.min_correspondences),
            ("local_iterations", self.local_iterations, 1), ("max_iterations", self.max_iterations, 1),
        ):  # fmt: skip
            if not (np.isfinite(value) and value >= least):
                raise InputError(f"{name} = {value} is out of range: at least {least:g} is needed")


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """One camera and the reference: the pair's frame is the reference camera's."""

    camera: int
    """Index of the camera in the rig."""
    pose: Pose
    """Pose of the camera; the world is the reference camera's frame. Unit baseline, or metres when scaled."""
    points: Floats
    """(N, 3) points in the reference camera's frame."""
    label: Ints
    """(N,) numbers of the points, the same in all pairs."""
    rows: Ints
    """(N, 2) rows of the sightings by the reference and by the camera."""
    correspondences: int
    """Number of correspondences passed to RANSAC."""
    rms_px: float
    parallax_deg: float
    """Median angle between the two rays of a point."""

    def scaled(self, factor: float) -> PairGeometry:
        """Return the pair with all lengths multiplied by `factor`."""
        return replace(self, pose=Pose(self.pose.R_cw, self.pose.t_cw * factor), points=self.points * factor)


def solve_pair(
    rig: Rig, points: ImagePoints, label: Ints, priority: Ints, reference: int, camera: int, options: GeoPoseOptions,
    rng: np.random.Generator,
) -> PairGeometry:  # fmt: skip
    """Register one camera with the reference, up to scale, by the paper's pairwise steps in their order.

    Raises:
        RefusalError: too few correspondences, or too few that agree.
    """
    rows = np.column_stack(match_pair(points, label, reference, camera))
    if len(rows) < options.min_correspondences:
        raise RefusalError(refusal("few_common_points", common=len(rows), needed=options.min_correspondences))
    rows = rows[np.sort(np.argsort(priority[label[rows[:, 0]]])[: options.max_correspondences])]
    rays = points.bearing[rows[:, 0]], points.bearing[rows[:, 1]]
    lenses = rig.cameras[reference].lens, rig.cameras[camera].lens
    essential, inliers = pair_essential(*rays, lenses, points.sigma_px[rows], options, rng)
    pose, front = decompose(essential, rays[0][inliers], rays[1][inliers])
    kept = rows[np.flatnonzero(inliers)[front]]
    if len(kept) < options.min_correspondences:
        counts = {"agreeing": len(kept), "common": len(rows), "needed": options.min_correspondences}
        raise RefusalError(refusal("few_agreeing_points", **counts))
    triangulated = triangulate_pair(pose, points.bearing[kept[:, 0]], points.bearing[kept[:, 1]])
    pose, triangulated, fits, rms = local_bundle_adjustment(
        rig, points.take(kept.T.ravel()), camera, pose, triangulated, options
    )
    kept, triangulated = kept[fits], triangulated[fits]
    angles = parallax_angles(points.bearing[kept[:, 0]], points.bearing[kept[:, 1]], pose.R_cw)
    parallax = float(np.degrees(np.median(angles))) if len(kept) else 0.0
    return PairGeometry(camera, pose, triangulated, label[kept[:, 0]], kept, len(rows), rms, parallax)


def pair_essential(
    rays_reference: Floats, rays_camera: Floats, lenses: tuple[Lens, Lens], sigma_px: Floats, options: GeoPoseOptions,
    rng: np.random.Generator,
) -> tuple[Floats, Bools]:  # fmt: skip
    """Estimate the essential matrix (3, 3) from the reference to the camera by RANSAC, and its inliers (N,).

    Args:
        rays_reference: (N, 3) unit rays in the reference camera's frame.
        rays_camera: (N, 3) unit rays in the camera's frame.
        lenses: lenses of the reference and the camera.
        sigma_px: (N, 2) standard deviations of the sightings.
        options: give the threshold and the largest number of correspondences.
        rng: drives RANSAC.

    Raises:
        RefusalError: no relative pose agrees with enough of the rays.
    """
    focal = np.array([lens.focal for lens in lenses])
    if options.ransac_threshold_px is None:
        threshold = THRESHOLD_SIGMAS * float(np.median(np.sqrt(np.mean((sigma_px / focal) ** 2, axis=1))))
    else:
        threshold = options.ransac_threshold_px / float(np.sqrt(focal.prod()))
    try:
        view = estimate_relative_pose(
            rays_reference, rays_camera, threshold=threshold, rng=rng, max_points=options.max_correspondences
        )
    except NoRelativePoseError as error:
        raise RefusalError(_without_pose(error)) from None
    return view.essential, view.inliers


def _without_pose(error: NoRelativePoseError) -> Finding:
    """Return the finding with the reason why two cameras have no relative pose."""
    if error.usable < MIN_POINTS:
        return refusal("few_usable_points", usable=error.usable, needed=MIN_POINTS)
    if error.agreeing is None:
        return refusal("no_relative_pose", common=error.common)
    return refusal("relative_pose_weak", agreeing=error.agreeing, common=error.common, needed=MIN_POINTS)


def decompose(essential: Floats, rays_reference: Floats, rays_camera: Floats) -> tuple[Pose, Bools]:
    """Return the camera's pose in the reference's frame, unit baseline, and whether points (N,) lie in front of both."""
    R, t, front = choose_by_cheirality(decompose_essential(essential), rays_reference, rays_camera)
    return Pose(R, t), front


def triangulate_pair(pose: Pose, rays_reference: Floats, rays_camera: Floats) -> Floats:
    """Triangulate points (N, 3) in the reference camera's frame, in the unit of the baseline."""
    return triangulate_two_views(rays_reference, rays_camera, pose.R_cw, pose.t_cw)


def local_bundle_adjustment(
    rig: Rig, sightings: ImagePoints, camera: int, pose: Pose, points: Floats, options: GeoPoseOptions
) -> tuple[Pose, Floats, Bools, float]:
    """Refine the pair's pose and points on reprojection error, the reference held.

    Args:
        rig: the lenses.
        sightings: 2 N sightings, first those of the reference, then those of the camera, in the order of the points.
        camera: index of the camera in the rig.
        pose: pose of the camera, in the reference's frame.
        points: (N, 3) points in the reference's frame.
        options: give the iteration limit.

    Returns:
        pose, points, whether each point fits both sightings (N,), root mean square residual in pixels.
    """
    index = np.tile(np.arange(len(points), dtype=np.int64), 2)
    seen = point_observations(rig, sightings, index)
    seen = replace(seen, camera=(sightings.camera == camera).astype(np.int64))
    adjusted = adjust_points([IDENTITY, pose], points, seen, max_iterations=options.local_iterations)
    miss = np.linalg.norm(adjusted.residuals_px, axis=1) / sightings.sigma_px
    fits = (miss.reshape(2, -1) <= OUTLIER_SIGMAS).all(axis=0)
    return adjusted.poses[1], adjusted.points, fits, adjusted.rms_px
