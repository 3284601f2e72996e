"""GeoPose, the paper's solver, faithful: Xu, Li, Weng, Kitani, CVPR 2021, section 3.3.

Around one reference camera, for every other camera: the essential matrix of the pair's correspondences in RANSAC, its
decomposition, triangulation, a local bundle adjustment, and the scale from the height of people. Then points seen in several
pairs are merged, and a global bundle adjustment refines all cameras and points. This is the mode that every other is compared
with; its known weakness is that one bad pair loses its camera.

What the paper leaves open is chosen here: PoseLib's RANSAC, the robust loss of the adjustments, the statistic of the scale
(`body_extent.standing_length`), and the placement of the world by people's verticals and feet.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera, PoseSigma, Rig
from passerby.errors import EvidenceError, InputError
from passerby.geometry.similarity import Similarity
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
from passerby.solver.correspondences import ImagePoints, box_points, joint_points, point_observations
from passerby.solver.geopose_pairs import (
    IDENTITY,
    GeoPoseOptions,
    PairGeometry,
    decompose,
    local_bundle_adjustment,
    pair_essential,
    solve_pair,
    triangulate_pair,
)
from passerby.solver.known_lengths import measured_lengths
from passerby.solver.scale import ScaleCues
from passerby.solver.solution import Solution, Verdict

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

__all__ = [
    "GeoPoseOptions", "PairGeometry", "check_people_stand", "decompose", "global_bundle_adjustment", "local_bundle_adjustment",
    "measure_people", "merge_points", "pair_essential", "scale_from_prior", "solve_geopose", "solve_pair", "triangulate_pair",
]  # fmt: skip

# Pairs that see the same person's point at places that differ by more than this share of its distance contradict each other.
MAX_DISAGREEMENT = 0.15
# The adjustment's formal sigma takes sightings as independent, but the centre of a box is another point of the body from every
# side, and stays so for as long as a person walks the same way. Joints are the same points from all sides. With 3.5, over 12
# simulated scenes a preset, one sigma holds 58 to 69 % of the position errors, but 25 to 100 % of the orientation errors
# (construction fewest); the factor for joints was chosen with less data and not checked on its own.
SIGMA_FACTOR = {"boxes": 3.5, "joints": 1.25}
# Of the measured length of standing people, as a share: running people are 1.5 % short, boxes around swinging feet 1 % long.
STANDING_SD = 0.01
MIN_INLIER_SHARE = 0.5
MIN_STANDING_SHARE = 1 / 3
MIN_PARALLAX_DEG = 3.0


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
            people = measure_people(rig, extents, reference, [pair])
            if pair.parallax_deg >= MIN_PARALLAX_DEG:
                check_people_stand(extents, reference, camera, len(people))
            factor, _ = scale_from_prior(rig, people, extents.span, cues, options, reference, [pair])
            pairs.append(pair.scaled(factor))
        except EvidenceError as error:
            reasons.append(f"camera {rig.names[camera]} could not be registered with {options.reference}: {error}")
    if not pairs:
        raise EvidenceError(
            f"no camera could be registered with the reference {options.reference}: " + "; ".join(reasons), tuple(reasons)
        )
    merged, disagreement = merge_points(pairs, len(key))
    adjusted = global_bundle_adjustment(rig, points, label, pairs, merged, reference, options)
    final = [replace(pair, pose=pose) for pair, pose in zip(pairs, adjusted.poses[1:], strict=True)]
    people = measure_people(rig, extents, reference, final)
    factor, prior = scale_from_prior(rig, people, extents.span, cues, options, reference, final)
    final = [pair.scaled(factor) for pair in final]
    people = people.scaled(factor)
    world = place_world(people, vertical(people), np.zeros(3), extents.shares[1] * options.person_height_m)
    covariance = _covariances(final, adjusted, factor, SIGMA_FACTOR[kind], prior["relative_sd"])
    solved = _placed_rig(rig, reference, final, covariance, world)
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


def measure_people(rig: Rig, extents: Extents, reference: int, pairs: list[PairGeometry]) -> Segments:
    """The people that the reference and the pairs' cameras see whole, from feet to head, in the frame and unit of the pairs."""
    return triangulate_segments(rig, extents, *_star(reference, pairs))


def scale_from_prior(
    rig: Rig, people: Segments, span: float, cues: ScaleCues, options: GeoPoseOptions, reference: int, pairs: list[PairGeometry]
) -> tuple[float, dict[str, Any]]:
    """What to multiply all lengths by to get metres, and what it rests on.

    Known lengths that the cameras see come first, each weighted by its standard deviation; else the length of a standing person
    is set to the prior's, times the `span` of it that was measured. Used for each pair, and once more for all cameras together
    after the global adjustment, which cannot see the scale.
    """
    lengths = measured_lengths(rig, cues.lengths, *_star(reference, pairs))
    if lengths:
        weight = np.array([(cue.metres / cue.sd_m) ** 2 for cue, _ in lengths])
        ratio = np.array([np.log(cue.metres / measured) for cue, measured in lengths])
        factor = float(np.exp(weight @ ratio / weight.sum()))
        sd = float(1 / np.sqrt(weight.sum()))
        return factor, {"from": "known lengths", "lengths": len(lengths), "factor": factor, "relative_sd": sd}
    factor = options.person_height_m * span / standing_length(people, vertical(people))
    count = len(np.unique(people.identity))
    sd = float(np.hypot(cues.population.sd_m / options.person_height_m / np.sqrt(count), STANDING_SD))
    return factor, {"from": "person height", "height_m": options.person_height_m, "sightings": len(people), "people": count,
                    "factor": factor, "relative_sd": sd}  # fmt: skip


def check_people_stand(extents: Extents, reference: int, camera: int, n_segments: int) -> None:
    """Refuse a pair whose pose lets hardly anybody have head and feet.

    Box centres lie in a thin level slab, and with cameras that face each other its mirror image fits as well. Nothing in the
    centres shows that pose to be wrong, but the tops and the bottoms of the boxes do not meet in it.

    Raises:
        EvidenceError: fewer than a third of the people seen whole by both cameras have a head and feet in the pair.
    """
    shared = extents.shared(reference, camera)
    if n_segments < MIN_STANDING_SHARE * shared:
        raise EvidenceError(
            f"heads and feet of only {n_segments} of {shared} people seen by both meet in its pose, so it is wrong (points on "
            "one level cannot tell apart two poses of cameras that face each other): choose another reference camera"
        )


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


def _star(reference: int, pairs: list[PairGeometry]) -> tuple[Ints, Floats, Floats]:
    """Indices (C,), rotations (C, 3, 3) and translations (C, 3) of the reference and the pairs' cameras."""
    return (
        np.array([reference, *(pair.camera for pair in pairs)]),
        np.stack([np.eye(3), *(pair.pose.R_cw for pair in pairs)]),
        np.stack([np.zeros(3), *(pair.pose.t_cw for pair in pairs)]),
    )


def _kind_of_points(rig: Rig, observations: Observations, options: GeoPoseOptions) -> Literal["boxes", "joints"]:
    if options.points != "auto":
        return options.points
    seen = [observations[name] for name in rig.names if name in observations.cameras]
    with_joints = sum(bool((camera.keypoints.identity >= 0).any()) for camera in seen)
    with_boxes = sum(bool((camera.boxes.identity >= 0).any()) for camera in seen)
    return "joints" if with_joints and with_joints >= with_boxes else "boxes"


def _covariances(
    pairs: list[PairGeometry], adjusted: PointAdjustment, factor: float, sigma_factor: float, scale_sd: float
) -> Floats:
    """(1 + pairs, 6, 6) covariances of the reference and the pairs' cameras in the reference's frame, metres and radians.

    Those of the adjustment, whose scale is held, and what a wrong scale would do to the distance from the reference.
    """
    unit = np.diag([factor] * 3 + [1.0] * 3) * sigma_factor
    covariance = unit @ adjusted.pose_covariance @ unit
    for index, pair in enumerate(pairs, start=1):
        covariance[index, :3, :3] += scale_sd**2 * np.outer(pair.pose.centre, pair.pose.centre)
    return np.asarray(covariance)


def _placed_rig(rig: Rig, reference: int, pairs: list[PairGeometry], covariances: Floats, world: Similarity) -> Rig:
    """The rig in the world, with sigmas; cameras without a pair have no pose."""
    turn = np.eye(6)
    turn[:3, :3] = world.rotation
    solved: dict[int, Camera] = {}
    for index, (camera, pose) in enumerate([(reference, IDENTITY), *((pair.camera, pair.pose) for pair in pairs)]):
        covariance = turn @ covariances[index] @ turn.T
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
