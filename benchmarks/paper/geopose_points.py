"""GeoPose on correspondences of any origin: matches between pictures, or points that somebody marked.

The steps are those of `solve_geopose`, by the same code. What people would bring with them is lacking: the scale comes from
known lengths (the prior knowledge of the paper: a free-throw line of 3.6 m, a pipe of 1.0 m), and nothing tells the vertical.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.common.errors import EvidenceError
from passerby.core.cameras import Rig
from passerby.core.figures import StarScale
from passerby.core.scale_cues import KnownLength
from passerby.core.solution import Solution
from passerby.geometry.rotations import Similarity
from passerby.solver.geopose.correspondences import ImagePoints
from passerby.solver.geopose.pairs import GeoPoseOptions, PairGeometry
from passerby.solver.geopose.star import find_weaknesses, reference_of, scale_from_lengths, solve_star_graph, star_solution

# Points of a picture that are the same from all sides: the adjustment's formal sigmas stand.
SIGMA_FACTOR = 1.0


def solve_correspondences(
    rig: Rig, points: ImagePoints, lengths: Sequence[KnownLength], options: GeoPoseOptions, *, rng: np.random.Generator
) -> Solution:
    """Calibrate a rig from points that several cameras see, by the steps of GeoPose.

    Args:
        rig: names and lenses; poses in it are not read.
        points: sightings, such as of `correspondences.numbered_points`; the identity is the number of the 3D point.
        lengths: known lengths, marked in the reference and in every camera that is to be registered.
        options: see `GeoPoseOptions`; `points` and `person_height_m` mean nothing here.
        rng: drives RANSAC and the choice among too many correspondences.

    Returns:
        The rig in the reference camera's frame (x right, y down, z forward), metres: without people there is no vertical.
        Sigmas are relative to the reference. A camera that shares too little with the reference, or sees no known length with
        it, has no pose, and a reason.

    Raises:
        InputError: the reference is not a camera of the rig, or a known length is marked where a lens has no ray.
        EvidenceError: no camera could be registered with the reference.
    """
    reference = reference_of(rig, options)

    def metres(pairs: Sequence[PairGeometry]) -> StarScale:
        scale = scale_from_lengths(rig, lengths, reference, pairs)
        if scale is None:
            raise EvidenceError(
                f"no known length is marked in it and in the reference {options.reference}, so its distance is unknown"
            )
        return scale

    star = solve_star_graph(rig, points, options, lambda pair: metres([pair]).factor, rng)
    here = Similarity(1.0, np.eye(3), np.zeros(3))
    findings = [*star.findings, *find_weaknesses(rig, star, "points", "other points")]
    return star_solution("geopose", rig, star, metres(star.pairs), here, SIGMA_FACTOR, findings, "given")
