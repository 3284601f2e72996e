"""GeoPose around one reference camera, independent of the origin of the points and of the scale.

Xu, Li, Weng, Kitani, CVPR 2021, section 3.3: every other camera is registered with the reference, each pair gets its scale,
points seen in several pairs are merged, and a global bundle adjustment refines all cameras and points. `geopose` supplies
points of people and their height; the benchmark `geopose_points` supplies points of any origin and known lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, PoseSigma, Rig
from passerby.core.figures import StarFigures, StarPair, StarScale
from passerby.core.scale_cues import KnownLength
from passerby.core.solution import Solution, decide_verdict
from passerby.core.usability import add_missing_camera_doubts, doubts_of_uncertainty
from passerby.findings.finding import Finding, notice
from passerby.findings.ranking import RefusalError, findings_of
from passerby.findings.texts import texts_of
from passerby.geometry.groups import group_sums
from passerby.geometry.rotations import Similarity
from passerby.solver.geopose.bundle import PointAdjustment, adjust_points
from passerby.solver.geopose.correspondences import ImagePoints, point_observations
from passerby.solver.geopose.known_lengths import measured_lengths
from passerby.solver.geopose.pairs import IDENTITY, GeoPoseOptions, PairGeometry, solve_pair

# Pairs contradict each other if their places of the same point differ by more than this share of its distance.
MAX_DISAGREEMENT = 0.15
MIN_INLIER_SHARE = 0.5
MIN_PARALLAX_DEG = 3.0


@dataclass(frozen=True, eq=False)
class StarReconstruction:
    """The reference and the cameras that could be registered with it, after the global adjustment."""

    reference: int
    """Index of the reference in the rig."""
    pairs: list[PairGeometry]
    """Pairs with adjusted poses; the scale is a compromise of the pairs' own scales."""
    adjusted: PointAdjustment
    """Adjustment of the reference and the pairs' cameras, in their order."""
    merged: int
    """Number of points in at least one pair."""
    disagreement: float
    """See `merge_points`."""
    findings: tuple[Finding, ...]
    """Findings about the input, and reasons why other cameras could not be registered."""


def solve_star_graph(
    rig: Rig,
    points: ImagePoints,
    options: GeoPoseOptions,
    scale_of_pair: Callable[[PairGeometry], float],
    rng: np.random.Generator,
    odd: Sequence[Finding] = (),
) -> StarReconstruction:
    """Register every camera with the reference, merge the points, and adjust all together.

    Args:
        rig: names and lenses; poses in it are not read.
        points: sightings of all cameras; sightings with the same identity, frame and part are of the same point.
        options: see `GeoPoseOptions`.
        scale_of_pair: returns the factor that makes a pair's lengths metres; `RefusalError` if there is none or the pair is
            wrong.
        rng: drives RANSAC and the choice among too many correspondences.
        odd: findings from earlier steps.

    Raises:
        InputError: the reference is not a camera of the rig.
        RefusalError: no camera could be registered with the reference.
    """
    reference = reference_of(rig, options)
    label, key = points.labels()
    # One draw for all pairs: if there are too many points, all pairs keep the same ones, which can then be merged.
    priority = rng.permutation(len(key))
    pairs: list[PairGeometry] = []
    findings = list(odd)
    for camera in range(len(rig)):
        if camera == reference:
            continue
        try:
            pair = solve_pair(rig, points, label, priority, reference, camera, options, rng)
            pairs.append(pair.scaled(scale_of_pair(pair)))
        except EvidenceError as error:
            cause = findings_of(error)[0].as_value()
            findings.append(notice("pair_failed", rig.names[camera], options.reference, cause=cause))
    if not pairs:
        reasons = "; ".join(texts_of(findings))
        message = f"no camera could be registered with the reference {options.reference}: {reasons}"
        raise RefusalError(findings, message)
    merged, disagreement = merge_points(pairs, len(key))
    adjusted = global_bundle_adjustment(rig, points, label, pairs, merged, reference, options)
    final = [replace(pair, pose=pose) for pair, pose in zip(pairs, adjusted.poses[1:], strict=True)]
    count = int(np.isfinite(merged).all(axis=1).sum())
    return StarReconstruction(reference, final, adjusted, count, disagreement, tuple(findings))


def reference_of(rig: Rig, options: GeoPoseOptions) -> int:
    """Return the index of the reference camera. Raises `InputError` where the rig has no such camera."""
    if options.reference not in rig.names:
        raise InputError(f"the reference camera {options.reference} is not in the rig: choose one of {', '.join(rig.names)}")
    return rig.names.index(options.reference)


def scale_from_lengths(
    rig: Rig, lengths: Sequence[KnownLength], reference: int, pairs: Sequence[PairGeometry]
) -> StarScale | None:
    """Return the scale from known lengths, each weighted by its standard deviation; None if no two cameras see any of them."""
    seen = measured_lengths(rig, lengths, *posed_cameras(reference, pairs))
    if not seen:
        return None
    weight = np.array([(cue.metres / cue.sd_m) ** 2 for cue, _ in seen])
    ratio = np.array([np.log(cue.metres / measured) for cue, measured in seen])
    factor = float(np.exp(weight @ ratio / weight.sum()))
    sd = float(1 / np.sqrt(weight.sum()))
    return StarScale(from_="known lengths", lengths=len(seen), factor=factor, relative_sd=sd)


def star_solution(
    method: str,
    rig: Rig,
    star: StarReconstruction,
    scale: StarScale,
    world: Similarity,
    sigma_factor: float,
    findings: Sequence[Finding],
    points: str,
) -> Solution:
    """Return the solution: the star in metres, in its world, with sigmas, verdict and figures.

    Args:
        method: name of the solver.
        rig: names and lenses.
        star: result of `solve_star_graph`.
        scale: scale of all cameras together.
        world: motion from the reference camera's frame, metres, to the world's.
        sigma_factor: factor on the adjustment's formal sigmas, which are too small.
        findings: doubts, and notices about causes of uncertainty.
        points: kind of the points, for the figures.
    """
    final = [pair.scaled(scale.factor) for pair in star.pairs]
    covariance = _covariances(final, star.adjusted, scale.factor, sigma_factor, scale.relative_sd)
    solved = _placed_rig(rig, star.reference, final, covariance, world)
    figures = StarFigures(
        points=points, reference=rig.names[star.reference], scale=scale,
        pairs=tuple(_pair_figures(rig, pair) for pair in final),
        merged_points=star.merged,
        pair_disagreement=star.disagreement, rms_px=star.adjusted.rms_px, iterations=star.adjusted.iterations,
        converged=star.adjusted.converged,
    )  # fmt: skip
    findings = add_missing_camera_doubts(solved, findings)
    findings = [*findings, *doubts_of_uncertainty(solved, figures, findings)]
    verdict = decide_verdict(solved, findings)
    return Solution(method, replace(solved, verdict=verdict), verdict, tuple(findings), figures)


def find_weaknesses(rig: Rig, star: StarReconstruction, what: str, other: str) -> list[Finding]:
    """Return notices about causes of uncertainty of the result.

    Args:
        rig: the cameras' names.
        star: the result.
        what: name of the kind of points.
        other: alternative that is suggested to the user.
    """
    found = []
    for pair in star.pairs:
        name, share = rig.names[pair.camera], len(pair.rows) / pair.correspondences
        if share < MIN_INLIER_SHARE:
            found.append(notice("few_inliers", name, share=share))
        if pair.parallax_deg < MIN_PARALLAX_DEG:
            found.append(notice("near_reference", name, parallax_deg=pair.parallax_deg))
    if star.disagreement > MAX_DISAGREEMENT:
        found.append(notice("pairs_disagree", what=what, share=star.disagreement, other=other))
    if not star.adjusted.converged:
        found.append(notice("adjustment_not_converged"))
    return found


def merge_points(pairs: list[PairGeometry], count: int) -> tuple[Floats, float]:
    """Merge a point seen in several pairs to the mean of its coordinates in the reference camera's frame.

    Returns:
        (count, 3) points, NaN for points in no pair; and the disagreement of the pairs: the median distance of a point in one
        pair from its mean, as a share of its distance from the reference camera (0 where no point is in two pairs).
    """
    label = np.concatenate([pair.label for pair in pairs])
    points = np.concatenate([pair.points for pair in pairs])
    times = np.bincount(label, minlength=count)
    with np.errstate(invalid="ignore"):
        merged = group_sums(label, points, count) / times[:, None]
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

    The adjustment's cameras are the reference, then the pairs' cameras in their order. It uses the inliers of the pairs.
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


def posed_cameras(reference: int, pairs: Sequence[PairGeometry]) -> tuple[Ints, Floats, Floats]:
    """Return indices (C,), rotations (C, 3, 3) and translations (C, 3) of the reference and the pairs' cameras."""
    return (
        np.array([reference, *(pair.camera for pair in pairs)]),
        np.stack([np.eye(3), *(pair.pose.R_cw for pair in pairs)]),
        np.stack([np.zeros(3), *(pair.pose.t_cw for pair in pairs)]),
    )


def _covariances(
    pairs: list[PairGeometry], adjusted: PointAdjustment, factor: float, sigma_factor: float, scale_sd: float
) -> Floats:
    """Return the covariances (1 + pairs, 6, 6) of the reference and the pairs' cameras in its frame, metres and radians.

    They are those of the adjustment, whose scale is held, plus the effect of the scale's error on the distance from the
    reference.
    """
    unit = np.diag([factor] * 3 + [1.0] * 3) * sigma_factor
    covariance = unit @ adjusted.pose_covariance @ unit
    for index, pair in enumerate(pairs, start=1):
        covariance[index, :3, :3] += scale_sd**2 * np.outer(pair.pose.centre, pair.pose.centre)
    return np.asarray(covariance)


def _placed_rig(rig: Rig, reference: int, pairs: list[PairGeometry], covariances: Floats, world: Similarity) -> Rig:
    """Return the rig in the world, with sigmas; cameras without a pair have no pose."""
    turn = np.eye(6)
    turn[:3, :3] = world.rotation
    solved: dict[int, Camera] = {}
    for index, (camera, pose) in enumerate([(reference, IDENTITY), *((pair.camera, pair.pose) for pair in pairs)]):
        solved[camera] = replace(
            rig.cameras[camera],
            pose=pose.moved(world.rotation, world.translation),
            sigma=PoseSigma.from_covariance(turn @ covariances[index] @ turn.T),
        )
    return Rig(tuple(solved.get(i, replace(camera, pose=None, sigma=None)) for i, camera in enumerate(rig)))


def _pair_figures(rig: Rig, pair: PairGeometry) -> StarPair:
    return StarPair(
        camera=rig.names[pair.camera], correspondences=pair.correspondences, inliers=len(pair.rows), rms_px=pair.rms_px,
        parallax_deg=pair.parallax_deg,
    )  # fmt: skip
