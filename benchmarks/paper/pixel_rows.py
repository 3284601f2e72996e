"""The rows of Tables 1 and 2 on one scene: each makes correspondences of its own, and ends in a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from baselines import MATCHERS, Matches, Unavailable, open_matcher
from baselines.matching import pooled_points
from paper.conditions import FAILED, Outcome, with_pose_errors
from paper.match_picture import right
from paper.pixel_stage import ANNOTATED, JOINT_NOISE_PX, ORACLE_NOISE_PX, Stage, marked_points
from passerby.calibration.calibrate import calibrate
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Rig
from passerby.core.figures import StarScale
from passerby.core.observations import Observations
from passerby.core.scale_cues import KnownLength
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.evaluation.reprojection import reprojection_error
from passerby.geometry.rotations import Similarity
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.solver.geopose.correspondences import ImagePoints, box_points, match_pair, numbered_points
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


MATCH_SIGMA_PX = 1.0  # of a matched keypoint. RANSAC's threshold is 2.5 times that.
MIN_ANNOTATED = 8  # points by hand are few and right: what the essential matrix needs
NOT_RUN = "not run"


@dataclass(frozen=True)
class Row:
    """One line of the tables."""

    name: str
    label: str
    scale: str  # where its scale comes from: a known length, the height of people, or both


ROWS = (
    *(Row(name, label, "length") for name, label in MATCHERS.items()),
    Row("oracle", f"oracle: {ANNOTATED} points by hand, {ORACLE_NOISE_PX:g} px", "length"),
    Row("boxes-by-hand", "boxes, people named by hand, GeoPose", "height"),
    Row("boxes-re-id", "boxes, people by re-identification, GeoPose", "height"),
    Row("trajectories", "**ours**, trajectories alone", "height"),
    Row("people", "**ours**, the default", "height"),
    Row("people-prior", "**ours**, the default, with the paper's prior knowledge", "height, length"),
    Row("people-by-hand", "**ours**, people named by hand", "height"),
    Row("keypoints", f"**ours**, joints, {JOINT_NOISE_PX:g} px", "height"),
)
"""In the paper's order; what the paper does not have stands beside it."""


@dataclass(frozen=True)
class PixelOutcome(Outcome):
    """What became of a row. All errors are infinite where not every camera was registered."""

    rpe_px: float = FAILED
    err_percent: float = FAILED
    matches: int | None = None  # of all pairs with the reference and all moments; None for a row without matches
    right: int | None = None  # those near their true epipolar lines
    appearance: str = ""  # what told people apart by their looks; empty where nothing did


def run_row(row: Row, stage: Stage) -> PixelOutcome:
    """What a row makes of a scene. A want of weights or of evidence is an outcome too."""
    try:
        return RUNS[row.name](stage)
    except Unavailable as error:
        return PixelOutcome(NOT_RUN, str(error), 0, len(stage.rig))


def _matcher(name: str) -> Callable[[Stage], PixelOutcome]:
    def run(stage: Stage) -> PixelOutcome:
        match = open_matcher(name)
        others = stage.rig.names[1:]
        found = [{name: match(views[stage.reference], views[name]) for name in others} for views in stage.pictures]
        stage.found_matches[name] = found
        points = pooled_points(stage.rig, stage.reference, found, MATCH_SIGMA_PX)
        outcome = judged(solved(stage.rig, points, [stage.length]), stage.truth.rig, stage.judged)
        total, good = counted(stage.truth.rig, found)
        return replace(outcome, matches=total, right=good)

    return run


def counted(truth: Rig, found: Sequence[Mapping[str, Matches]]) -> tuple[int, int]:
    """How many matches there are with the reference, the first camera, and how many are right."""
    pairs = [(name, matches) for moment in found for name, matches in moment.items()]
    good = sum(int(right(truth.cameras[0], truth[name], matches).sum()) for name, matches in pairs)
    return sum(len(matches) for _, matches in pairs), good


def _oracle(stage: Stage) -> PixelOutcome:
    marks = marked_points(stage.truth, ANNOTATED, ORACLE_NOISE_PX, stage.generator(2))
    there = {name: np.isfinite(pixels).all(axis=1) for name, pixels in marks.items()}
    sightings = {name: (np.flatnonzero(there[name]), pixels[there[name]]) for name, pixels in marks.items()}
    points = numbered_points(stage.rig, sightings, ORACLE_NOISE_PX)
    return judged(solved(stage.rig, points, [stage.length], MIN_ANNOTATED), stage.truth.rig, stage.judged)


def _boxes_by_hand(method: str) -> Callable[[Stage], PixelOutcome]:
    def run(stage: Stage) -> PixelOutcome:
        sightings = {}
        for name, boxes in stage.by_hand.items():
            path = stage.scratch / f"by-hand-{name}.txt"
            write_boxes(path, boxes)
            sightings[name] = {"tracks": str(path)}
        tables = {"association": {"mode": "given"}, "solver": _solver(method, stage)}
        return _calibrated(stage, stage.scene(f"by-hand-{method}", tables, sightings))

    return run


def _solver(method: str, stage: Stage) -> dict[str, str]:
    """The table of the scene file; GeoPose needs a reference camera."""
    return {"method": method} | ({"reference": stage.reference} if method == "geopose" else {})


def _from_videos(mode: str, method: str, name: str | None = None) -> Callable[[Stage], PixelOutcome]:
    def run(stage: Stage) -> PixelOutcome:
        tables = {"association": {"mode": mode}, "solver": _solver(method, stage)}
        return _calibrated(stage, stage.scene(f"{mode}-{method}", tables), name)

    return run


def _with_prior(stage: Stage) -> PixelOutcome:
    tables = {
        "association": {"mode": "combined"}, "solver": {"method": "people"}, "scale": stage.prior_knowledge,
    }  # fmt: skip
    return _calibrated(stage, stage.scene("prior", tables))


def _keypoints(stage: Stage) -> PixelOutcome:
    sightings = {}
    for name in stage.rig.names:
        path = stage.scratch / f"joints-{name}.json"
        write_keypoints(path, stage.truth.observations[name].keypoints)
        sightings[name] = {"keypoints": str(path)}
    tables = {"association": {"mode": "combined"}, "solver": {"method": "people"}}
    return _calibrated(stage, stage.scene("joints", tables, sightings))


RUNS: Mapping[str, Callable[[Stage], PixelOutcome]] = {
    **{name: _matcher(name) for name in MATCHERS}, "oracle": _oracle, "boxes-by-hand": _boxes_by_hand("geopose"),
    "boxes-re-id": _from_videos("appearance", "geopose"), "trajectories": _from_videos("trajectory", "people"),
    "people": _from_videos("combined", "people", "people"), "people-prior": _with_prior,
    "people-by-hand": _boxes_by_hand("people"), "keypoints": _keypoints,
}  # fmt: skip
"""By the names of `ROWS`."""


def people_matches(rig: Rig, seen: Observations) -> dict[str, Matches]:
    """Box centres of the same people in the first camera and each other one, at all instants: the paper's correspondences."""
    points = box_points(rig, seen)
    label, _ = points.labels()
    found = {}
    for index, name in enumerate(rig.names[1:], start=1):
        rows_a, rows_b = match_pair(points, label, 0, index)
        found[name] = Matches(points.pixel[rows_a], points.pixel[rows_b], np.ones(len(rows_a)))
    return found


@dataclass(frozen=True)
class Solved:
    """A rig and how far to trust it."""

    rig: Rig
    verdict: str
    reason: str


def solved(rig: Rig, points: ImagePoints, lengths: Sequence[KnownLength], least: int | None = None) -> Solved:
    """GeoPose on points of any origin, the first camera as the reference; no poses where there is too little evidence."""
    options = GeoPoseOptions(rig.names[0]) if least is None else GeoPoseOptions(rig.names[0], min_correspondences=least)
    try:
        solution = solve_correspondences(rig, points, lengths, options, rng=np.random.default_rng(0))
    except EvidenceError as error:
        return Solved(rig, "refused", next(iter(error.reasons), str(error)))
    return Solved(solution.rig, solution.verdict, next(iter(solution.reasons), ""))


def _calibrated(stage: Stage, scene: Path, name: str | None = None) -> PixelOutcome:
    """As `passerby calibrate` does it; with a name the people whom it matched are kept for the page's pictures."""
    result = calibrate(scene, keep=stage.seen)
    if name is not None:
        stage.found_matches[name] = [people_matches(stage.rig, result.observations)]
    appearance = result.perception.get("embedder", "")
    outcome = judged(Solved(result.rig, result.verdict, next(iter(result.reasons), "")), stage.truth.rig, stage.judged)
    return replace(outcome, appearance=appearance["network"] if isinstance(appearance, dict) else appearance)


def judged(result: Solved, truth: Rig, marks: Mapping[str, Floats] | None = None) -> PixelOutcome:
    """The figures of a rig against the truth, the first camera as the reference."""
    registered = sum(camera.pose is not None for camera in result.rig)
    outcome = PixelOutcome(result.verdict, result.reason, registered, len(truth))
    if outcome.failed:
        return outcome
    against = compare(result.rig, truth)
    reprojection = None if marks is None else reprojection_error(result.rig, marks)
    return replace(
        with_pose_errors(outcome, against),
        rpe_px=FAILED if reprojection is None else reprojection.rpe_px,
        err_percent=FAILED if reprojection is None else 100 * reprojection.err,
    )
