"""GeoPose, the paper's solver, faithful: Xu, Li, Weng, Kitani, CVPR 2021, section 3.3.

Around one reference camera, for every other camera: the essential matrix of the pair's correspondences in RANSAC, its
decomposition, triangulation, a local bundle adjustment, and the scale from the height of people. Then points seen in several
pairs are merged, and a global bundle adjustment refines all cameras and points. This is the mode that every other is compared
with; its known weakness is that one bad pair loses its camera.

What the paper leaves open is chosen here: PoseLib's RANSAC, the robust loss of the adjustments, the statistic of the scale
(`body_extent.standing_length`), and the placement of the world by people's verticals and feet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.errors import EvidenceError, InputError
from passerby.geometry.similarity import Similarity
from passerby.geometry.triangulation import parallax_angles, triangulate_two_views
from passerby.geometry.two_view import choose_by_cheirality, decompose_essential, relative_pose
from passerby.observations import Observations
from passerby.solver.body_extent import (
    Extents,
    Segments,
    box_extents,
    joint_extents,
    place_world,
    standing_length,
    triangulate_segments,
    vertical,
)
from passerby.solver.bundle import PointAdjustment, adjust_points
from passerby.solver.correspondences import ImagePoints, box_points, joint_points, match_pair, point_observations
from passerby.solver.known_lengths import measured_lengths
from passerby.solver.scale import ScaleCues
from passerby.solver.solution import Solution, Verdict

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

IDENTITY = Pose(np.eye(3), np.zeros(3))

# RANSAC's threshold in sigmas of a correspondence: 95 % of the honest ones of a two-dimensional error lie within it.
THRESHOLD_SIGMAS = 2.5
# After an adjustment points that miss one of their sightings by more sigmas than this are taken out.
OUTLIER_SIGMAS = 4.0
# Pairs that see the same person's point at places that differ by more than this share of its distance contradict each other.
MAX_DISAGREEMENT = 0.15
MIN_INLIER_SHARE = 0.5
MIN_PARALLAX_DEG = 3.0


@dataclass(frozen=True)
class GeoPoseOptions:
    """Options of `solve_geopose`."""

    reference: str
    """Name of the reference camera, the paper's camera 0: the one that shares people with all others."""
    person_height_m: float = 1.75
    """The prior on scale: how tall people are on average."""
    points: Literal["auto", "boxes", "joints"] = "auto"
    """What makes correspondences: box centres (the paper), all joints, or joints wherever as many cameras have them."""
    ransac_threshold_px: float | None = None
    """Largest epipolar error of an inlier; None: 2.5 sigmas of the pair's median correspondence, 2 % of a box's height each."""
    min_correspondences: int = 20
    """A camera that shares fewer with the reference gets no pose; the paper finds 30 to suffice in its scenes."""
    max_correspondences: int = 2000
    """Most correspondences of a pair; more of the same people add time, little accuracy."""
    max_iterations: int = 100
    """Limit of each bundle adjustment."""


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """One camera and the reference: the pair's frame is the reference camera's."""

    camera: int
    """Index in the rig."""
    pose: Pose
    """Of the camera; the world is the reference camera's frame. Unit baseline, or metres once scaled."""
    points: Floats
    """(N, 3) in the reference camera's frame."""
    label: Ints
    """(N,) the points' numbers, alike in all pairs."""
    rows: Ints
    """(N, 2) rows of the sightings by the reference and by the camera."""
    correspondences: int
    """How many went into RANSAC."""
    rms_px: float
    parallax_deg: float
    """Median angle between the two rays of a point."""

    def scaled(self, factor: float) -> PairGeometry:
        """The pair with all lengths times `factor`."""
        return replace(self, pose=Pose(self.pose.R_cw, self.pose.t_cw * factor), points=self.points * factor)


def solve_geopose(
    rig: Rig, observations: Observations, cues: ScaleCues, options: GeoPoseOptions, *, rng: np.random.Generator
) -> Solution:
    """Calibrate a rig as the paper does.

    Args:
        rig: names and lenses; poses in it are not read.
        observations: boxes or keypoints whose identities hold across cameras.
        cues: only `lengths` are used (in pairs and rigs whose cameras see them); the height of people is the options'.
        options: see `GeoPoseOptions`.
        rng: drives RANSAC and the choice among too many correspondences.

    Returns:
        The rig in a world with z up and the ground at z = 0, the reference camera above the origin. Sigmas are relative to the
        reference camera, whose own are 0. A camera that shares too little with the reference has no pose, and a reason.

    Raises:
        InputError: the reference is not a camera of the rig.
        EvidenceError: no camera could be registered with the reference, or nothing fixes scale and vertical.
    """
    if options.reference not in rig.names:
        raise InputError(f"the reference camera {options.reference} is not in the rig: choose one of {', '.join(rig.names)}")
    kind = _kind_of_points(rig, observations, options)
    points = joint_points(rig, observations) if kind == "joints" else box_points(rig, observations)
    extents = joint_extents(rig, observations) if kind == "joints" else box_extents(rig, observations)
    reference = rig.names.index(options.reference)
    label, key = points.labels()
    # One draw for all pairs: where points are too many, all pairs keep the same ones, which can then be merged.
    priority = rng.permutation(len(key))

    pairs: list[PairGeometry] = []
    reasons: list[str] = [extents.note] if extents.note else []
    for camera in range(len(rig)):
        if camera == reference:
            continue
        try:
            pair = solve_pair(rig, points, label, priority, reference, camera, options, rng)
            pairs.append(pair.scaled(scale_from_prior(rig, extents, cues, options, reference, [pair])[0]))
        except EvidenceError as error:
            reasons.append(f"camera {rig.names[camera]} could not be registered with {options.reference}: {error}")
    if not pairs:
        raise EvidenceError(
            f"no camera could be registered with the reference {options.reference}: " + "; ".join(reasons), tuple(reasons)
        )
    merged, disagreement = merge_points(pairs, len(key))
    adjusted = global_bundle_adjustment(rig, points, label, pairs, merged, reference, options)
    final = [replace(pair, pose=pose) for pair, pose in zip(pairs, adjusted.poses[1:], strict=True)]
    factor, prior, segments = scale_from_prior(rig, extents, cues, options, reference, final)
    final = [pair.scaled(factor) for pair in final]
    segments = Segments(segments.identity, segments.top * factor, segments.bottom * factor)
    world = place_world(segments, vertical(segments), np.zeros(3))
    solved = _placed_rig(rig, reference, final, adjusted, factor, world)
    reasons += _doubts(rig, pairs, disagreement, adjusted)
    verdict: Verdict = "doubtful" if reasons else "accepted"
    figures = {
        "points": kind, "reference": options.reference, "scale": prior,
        "pairs": [_pair_figures(rig, pair) for pair in pairs],
        "merged_points": int(np.isfinite(merged).all(axis=1).sum()),
        "pair_disagreement": disagreement, "rms_px": adjusted.rms_px, "iterations": adjusted.iterations,
        "converged": adjusted.converged,
    }  # fmt: skip
    return Solution("geopose", replace(solved, verdict=verdict), verdict, tuple(reasons), figures)


def solve_pair(
    rig: Rig, points: ImagePoints, label: Ints, priority: Ints, reference: int, camera: int, options: GeoPoseOptions,
    rng: np.random.Generator,
) -> PairGeometry:  # fmt: skip
    """One camera with the reference, up to scale: the paper's pairwise steps in their order.

    Raises:
        EvidenceError: too few correspondences, or too few that agree.
    """
    rows = np.column_stack(match_pair(points, label, reference, camera))
    if len(rows) < options.min_correspondences:
        raise EvidenceError(f"{len(rows)} common points, {options.min_correspondences} are needed")
    rows = rows[np.sort(np.argsort(priority[label[rows[:, 0]]])[: options.max_correspondences])]
    rays = points.bearing[rows[:, 0]], points.bearing[rows[:, 1]]
    lenses = rig.cameras[reference].lens, rig.cameras[camera].lens
    essential, inliers = pair_essential(*rays, lenses, points.sigma_px[rows], options, rng)
    pose, front = decompose(essential, rays[0][inliers], rays[1][inliers])
    kept = rows[np.flatnonzero(inliers)[front]]
    if len(kept) < options.min_correspondences:
        raise EvidenceError(
            f"{len(kept)} of {len(rows)} common points agree on one relative pose, {options.min_correspondences} are needed"
        )
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
    """The essential matrix (3, 3) from the reference to the camera, in RANSAC, and its inliers (N,).

    Args:
        rays_reference: (N, 3) unit rays in the reference camera's frame.
        rays_camera: (N, 3) unit rays in the camera's frame.
        lenses: of the reference and the camera.
        sigma_px: (N, 2) standard deviations of the sightings.
        options: for the threshold.
        rng: drives RANSAC.
    """
    focal = np.array([lens.focal for lens in lenses])
    if options.ransac_threshold_px is None:
        threshold = THRESHOLD_SIGMAS * float(np.median(np.sqrt(np.mean((sigma_px / focal) ** 2, axis=1))))
    else:
        threshold = options.ransac_threshold_px / float(np.sqrt(focal.prod()))
    view = relative_pose(rays_reference, rays_camera, threshold=threshold, rng=rng, max_points=options.max_correspondences)
    return view.essential, view.inliers


def decompose(essential: Floats, rays_reference: Floats, rays_camera: Floats) -> tuple[Pose, Bools]:
    """The pose of the camera in the reference's frame, unit baseline, and which points (N,) lie in front of both."""
    R, t, front = choose_by_cheirality(decompose_essential(essential), rays_reference, rays_camera)
    return Pose(R, t), front


def triangulate_pair(pose: Pose, rays_reference: Floats, rays_camera: Floats) -> Floats:
    """(N, 3) points in the reference camera's frame, unit of the baseline."""
    return triangulate_two_views(rays_reference, rays_camera, pose.R_cw, pose.t_cw)


def local_bundle_adjustment(
    rig: Rig, sightings: ImagePoints, camera: int, pose: Pose, points: Floats, options: GeoPoseOptions
) -> tuple[Pose, Floats, Bools, float]:
    """Refine the pair's pose and points on reprojection error, the reference held.

    Args:
        rig: the lenses.
        sightings: 2 N sightings, first those of the reference, then those of the camera, in the order of the points.
        camera: index of the camera in the rig.
        pose: of the camera, in the reference's frame.
        points: (N, 3) in the reference's frame.
        options: for the iteration limit.

    Returns:
        pose, points, which of the points fit both sightings (N,), root mean square residual in pixels.
    """
    index = np.tile(np.arange(len(points), dtype=np.int64), 2)
    seen = point_observations(rig, sightings, index)
    seen = replace(seen, camera=(sightings.camera == camera).astype(np.int64))
    adjusted = adjust_points([IDENTITY, pose], points, seen, max_iterations=options.max_iterations)
    miss = np.linalg.norm(adjusted.residuals_px, axis=1) / sightings.sigma_px
    fits = (miss.reshape(2, -1) <= OUTLIER_SIGMAS).all(axis=0)
    return adjusted.poses[1], adjusted.points, fits, adjusted.rms_px


def scale_from_prior(
    rig: Rig, extents: Extents, cues: ScaleCues, options: GeoPoseOptions, reference: int, pairs: list[PairGeometry]
) -> tuple[float, dict[str, Any], Segments]:
    """What to multiply all lengths by to get metres.

    Known lengths that the cameras see come first, each weighted by its standard deviation; else the length of a standing person
    is set to the prior's. Used for each pair, and once more for all cameras together after the global adjustment, which cannot
    see the scale.

    Returns:
        The factor; what it rests on, for the report; the people measured, in the frame and unit of the pairs.
    """
    cameras = np.array([reference, *(pair.camera for pair in pairs)])
    R = np.stack([np.eye(3), *(pair.pose.R_cw for pair in pairs)])
    t = np.stack([np.zeros(3), *(pair.pose.t_cw for pair in pairs)])
    segments = triangulate_segments(rig, extents, cameras, R, t)
    lengths = measured_lengths(rig, cues.lengths, cameras, R, t)
    if lengths:
        weight = np.array([(cue.metres / cue.sd_m) ** 2 for cue, _ in lengths])
        ratio = np.array([np.log(cue.metres / measured) for cue, measured in lengths])
        factor = float(np.exp(weight @ ratio / weight.sum()))
        return factor, {"from": "known lengths", "lengths": len(lengths), "factor": factor}, segments
    standing = standing_length(segments, vertical(segments))
    factor = options.person_height_m * extents.span / standing
    return factor, {"from": "person height", "height_m": options.person_height_m, "segments": len(segments),
                    "people": len(np.unique(segments.identity)), "factor": factor}, segments  # fmt: skip


def merge_points(pairs: list[PairGeometry], count: int) -> tuple[Floats, float]:
    """A point seen in several pairs becomes the mean of its coordinates in the reference camera's frame.

    Returns:
        (count, 3) points, NaN for those that no pair has; and by how much the pairs disagree: the median distance of a point
        in one pair from its mean, as a share of its distance from the reference camera (0 where no point is in two pairs).
    """
    label = np.concatenate([pair.label for pair in pairs])
    points = np.concatenate([pair.points for pair in pairs])
    times = np.bincount(label, minlength=count)
    with np.errstate(invalid="ignore"):
        merged = np.stack([np.bincount(label, points[:, k], count) for k in range(3)], axis=1) / times[:, None]
    several = times[label] > 1
    if not several.any():
        return merged, 0.0
    mean = merged[label[several]]
    distance = np.linalg.norm(points[several] - mean, axis=1) / np.linalg.norm(mean, axis=1)
    return merged, float(np.median(distance))


def global_bundle_adjustment(
    rig: Rig,
    points: ImagePoints,
    label: Ints,
    pairs: list[PairGeometry],
    merged: Floats,
    reference: int,
    options: GeoPoseOptions,
) -> PointAdjustment:
    """Refine the poses of all pairs' cameras and the merged points on reprojection error, the reference held.

    The adjustment's cameras are the reference and then the pairs' in their order; a pair's inliers take part.
    """
    rows = np.unique(np.concatenate([pair.rows.ravel() for pair in pairs]))
    number = np.full(len(merged), -1)
    used = np.unique(label[rows])
    number[used] = np.arange(len(used))
    position = np.zeros(len(rig), dtype=np.int64)
    position[[reference, *(pair.camera for pair in pairs)]] = np.arange(1 + len(pairs))
    sightings = points.take(rows)
    seen = point_observations(rig, sightings, number[label[rows]])
    seen = replace(seen, camera=position[sightings.camera])
    poses = [IDENTITY, *(pair.pose for pair in pairs)]
    return adjust_points(poses, merged[used], seen, max_iterations=options.max_iterations)


def _kind_of_points(rig: Rig, observations: Observations, options: GeoPoseOptions) -> Literal["boxes", "joints"]:
    if options.points != "auto":
        return options.points
    seen = [observations[name] for name in rig.names if name in observations.cameras]
    with_joints = sum(bool((camera.keypoints.identity >= 0).any()) for camera in seen)
    with_boxes = sum(bool((camera.boxes.identity >= 0).any()) for camera in seen)
    return "joints" if with_joints and with_joints >= with_boxes else "boxes"


def _placed_rig(
    rig: Rig, reference: int, pairs: list[PairGeometry], adjusted: PointAdjustment, factor: float, world: Similarity
) -> Rig:
    """The rig in the world, with sigmas; cameras without a pair have no pose."""
    turn = np.eye(6)
    turn[:3, :3] = factor * world.rotation
    solved: dict[int, Camera] = {}
    for index, (camera, pose) in enumerate([(reference, IDENTITY), *((pair.camera, pair.pose) for pair in pairs)]):
        covariance = turn @ adjusted.pose_covariance[index] @ turn.T
        position = float(np.sqrt(np.trace(covariance[:3, :3])))
        orientation = float(np.degrees(np.sqrt(np.trace(covariance[3:, 3:]))))
        solved[camera] = replace(
            rig.cameras[camera],
            pose=pose.moved(world.rotation, world.translation),
            sigma=PoseSigma(position, orientation, covariance),
        )
    return Rig(tuple(solved.get(i, replace(camera, pose=None, sigma=None)) for i, camera in enumerate(rig)))


def _doubts(rig: Rig, pairs: list[PairGeometry], disagreement: float, adjusted: PointAdjustment) -> list[str]:
    """What speaks against the result, one sentence each."""
    doubts = []
    for pair in pairs:
        name, share = rig.names[pair.camera], len(pair.rows) / pair.correspondences
        if share < MIN_INLIER_SHARE:
            doubts.append(f"only {share:.0%} of the points that camera {name} shares with the reference agree with its pose")
        if pair.parallax_deg < MIN_PARALLAX_DEG:
            doubts.append(
                f"camera {name} looks from almost where the reference stands (rays meet at {pair.parallax_deg:.1f} degrees): "
                "its distance is not known; choose another reference"
            )
    if disagreement > MAX_DISAGREEMENT:
        doubts.append(
            f"the pairs place the same people {disagreement:.0%} of their distance apart: at least one pair is wrong; "
            "try another reference camera or the method 'people'"
        )
    if not adjusted.converged:
        doubts.append(f"the global adjustment did not converge in {adjusted.iterations} iterations")
    return doubts


def _pair_figures(rig: Rig, pair: PairGeometry) -> dict[str, Any]:
    return {
        "camera": rig.names[pair.camera], "correspondences": pair.correspondences, "inliers": len(pair.rows),
        "rms_px": pair.rms_px, "parallax_deg": pair.parallax_deg,
    }  # fmt: skip
