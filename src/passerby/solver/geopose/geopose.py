"""GeoPose, the solver of the paper: Xu, Li, Weng, Kitani, CVPR 2021, section 3.3.

The steps for each camera and the reference camera are: the essential matrix of the pair's correspondences by RANSAC, its
decomposition, triangulation, a local bundle adjustment, and the scale from the height of people. Then points seen in several
pairs are merged, and a global bundle adjustment refines all cameras and points. All other methods are compared with this one.
Its known weakness is that one bad pair loses its camera.

The paper does not specify all steps. Chosen here are PoseLib's RANSAC, the robust loss of the adjustments, the statistic of
the scale (`body_extent.standing_length`), and the placement of the world by people's verticals and feet.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.figures import StarScale
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.solution import Solution
from passerby.findings.finding import refusal
from passerby.findings.ranking import RefusalError
from passerby.solver.geopose.body_extent import (
    BodyEndpoints,
    BodySegments3D,
    box_extents,
    joint_extents,
    place_world,
    standing_length,
    triangulate_segments,
    vertical,
)
from passerby.solver.geopose.correspondences import box_points, joint_points
from passerby.solver.geopose.pairs import (
    GeoPoseOptions,
    PairGeometry,
    decompose,
    local_bundle_adjustment,
    pair_essential,
    solve_pair,
    triangulate_pair,
)
from passerby.solver.geopose.star import (
    MIN_PARALLAX_DEG,
    find_weaknesses,
    global_bundle_adjustment,
    merge_points,
    posed_cameras,
    reference_of,
    scale_from_lengths,
    solve_star_graph,
    star_solution,
)

__all__ = [
    "GeoPoseOptions", "PairGeometry", "check_people_stand", "decompose", "global_bundle_adjustment", "local_bundle_adjustment",
    "measure_people", "merge_points", "pair_essential", "scale_from_prior", "solve_geopose", "solve_pair", "triangulate_pair",
]  # fmt: skip

# Factor on the adjustment's formal sigmas, which assume independent sightings. The centre of a box is a different point of the
# body from every side, and stays the same point as long as a person walks in one direction. Joints are the same points from all
# sides. With 3.5, over 12 simulated scenes a preset, one sigma contains 58 to 69 % of the position errors, but 25 to 100 % of
# the orientation errors (fewest in construction); the factor for joints was chosen with less data and not checked separately.
SIGMA_FACTOR = {"boxes": 3.5, "joints": 1.25}
# Relative sigma of the measured length of standing people: running people are 1.5 % too short, boxes around swinging feet 1 %
# too long.
STANDING_SD = 0.01
MIN_STANDING_SHARE = 1 / 3


def solve_geopose(
    rig: Rig, observations: Observations, cues: ScaleCues, options: GeoPoseOptions, *, rng: np.random.Generator
) -> Solution:
    """Calibrate a rig as the paper does.

    Args:
        rig: names and lenses; poses in it are not read.
        observations: boxes or keypoints whose identities hold across cameras.
        cues: only `lengths` are used (in pairs and rigs whose cameras see them); the height of people is taken from `options`.
        options: see `GeoPoseOptions`.
        rng: drives RANSAC and the choice among too many correspondences.

    Returns:
        The rig in a world with z up and the ground at z = 0, the reference camera above the origin. Sigmas are relative to the
        reference camera, whose own are 0. A camera that shares too little with the reference has no pose.

    Raises:
        InputError: the reference is not a camera of the rig.
        RefusalError: no camera could be registered with the reference, or scale and vertical cannot be determined.
    """
    reference = reference_of(rig, options)
    kind = _kind_of_points(rig, observations, options)
    points = joint_points(rig, observations) if kind == "joints" else box_points(rig, observations)
    extents = joint_extents(rig, observations) if kind == "joints" else box_extents(rig, observations)

    def measured(pairs: list[PairGeometry]) -> BodySegments3D:
        return measure_people(rig, extents, reference, pairs)

    def metres(people: BodySegments3D, pairs: list[PairGeometry]) -> StarScale:
        return scale_from_prior(rig, people, extents.span, cues, options, reference, pairs)

    def scale_of_pair(pair: PairGeometry) -> float:
        people = measured([pair])
        if pair.parallax_deg >= MIN_PARALLAX_DEG:
            check_people_stand(extents, reference, pair.camera, len(people))
        return metres(people, [pair]).factor

    odd = [extents.finding] if extents.finding else []
    star = solve_star_graph(rig, points, options, scale_of_pair, rng, odd)
    people = measured(star.pairs)
    scale = metres(people, star.pairs)
    people = people.scaled(scale.factor)
    world = place_world(people, vertical(people), np.zeros(3), extents.shares[1] * options.person_height_m)
    findings = [*star.findings, *find_weaknesses(rig, star, "people", "the method 'people'")]
    return star_solution("geopose", rig, star, scale, world, SIGMA_FACTOR[kind], findings, kind)


def measure_people(rig: Rig, extents: BodyEndpoints, reference: int, pairs: list[PairGeometry]) -> BodySegments3D:
    """Triangulate people seen whole by two or more cameras of the star, from feet to head, in the frame and unit of pairs."""
    return triangulate_segments(rig, extents, *posed_cameras(reference, pairs))


def scale_from_prior(
    rig: Rig, people: BodySegments3D, span: float, cues: ScaleCues, options: GeoPoseOptions, reference: int,
    pairs: list[PairGeometry],
) -> StarScale:  # fmt: skip
    """Return the factor that makes all lengths metres, and its source.

    Known lengths that the cameras see are used first, each weighted by its standard deviation. Without them, the length of a
    standing person is set to that of the prior, times the measured share `span`. The function is used for each pair, and for
    all cameras after the global adjustment, in which the scale is not observable.
    """
    known = scale_from_lengths(rig, cues.lengths, reference, pairs)
    if known is not None:
        return known
    factor = options.person_height_m * span / standing_length(people, vertical(people))
    count = len(np.unique(people.identity))
    sd = float(np.hypot(cues.population.sd_m / options.person_height_m / np.sqrt(count), STANDING_SD))
    return StarScale(
        from_="person height", height_m=options.person_height_m, sightings=len(people), people=count, factor=factor,
        relative_sd=sd,
    )  # fmt: skip


def check_people_stand(extents: BodyEndpoints, reference: int, camera: int, n_segments: int) -> None:
    """Refuse a pair in whose pose almost no person has a head and feet.

    Box centres lie in a thin horizontal layer. For cameras that face each other, its mirror image fits as well. The centres do
    not show that this pose is wrong, but in it the rays to the tops and bottoms of the boxes do not meet.

    Raises:
        RefusalError: fewer than a third of the people seen whole by both cameras have a head and feet in the pair.
    """
    shared = extents.shared(reference, camera)
    if n_segments < MIN_STANDING_SHARE * shared:
        raise RefusalError(refusal("people_do_not_stand", standing=n_segments, shared=int(shared)))


def _kind_of_points(rig: Rig, observations: Observations, options: GeoPoseOptions) -> Literal["boxes", "joints"]:
    if options.points != "auto":
        return options.points
    seen = [observations[name] for name in rig.names if name in observations.cameras]
    with_joints = sum(bool((camera.keypoints.identity >= 0).any()) for camera in seen)
    with_boxes = sum(bool((camera.boxes.identity >= 0).any()) for camera in seen)
    return "joints" if with_joints and with_joints >= with_boxes else "boxes"
