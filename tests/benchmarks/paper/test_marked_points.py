"""What stands in for an annotator, and GeoPose on such points: exact without noise, robust, plain about what is lacking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from paper.pixel_rows import solve_correspondences
from paper.pixel_stage import marked_length, marked_points, named_by_hand
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.core.scale_cues import KnownLength
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.evaluation.reprojection import reprojection_error
from passerby.simulation import SimulationOptions, simulate
from passerby.solver.geopose.correspondences import ImagePoints, numbered_points
from passerby.solver.geopose.pairs import GeoPoseOptions

SCENE = simulate(SimulationOptions(preset="terrace", seed=0, seconds=8.0))
TRUTH = SCENE.rig
LINE = np.array([[-1.8, 0.0, 0.0], [1.8, 0.0, 0.0]])


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_points_are_marked_where_they_are_and_miss_by_as_much_as_asked() -> None:
    marks = marked_points(SCENE, 15, 0.0, rng())
    seen = np.stack([np.isfinite(pixels).all(axis=1) for pixels in marks.values()])
    assert seen.shape == (4, 15)
    assert seen[0].all()
    assert (seen.sum(axis=0) >= 2).all()
    found = reprojection_error(TRUTH, marks)
    assert found is not None
    assert found.rpe_px < 1e-6
    exact, missed = (marked_points(SCENE, 60, noise, rng()) for noise in (0.0, 1.0))
    off = np.concatenate([(missed[name] - exact[name]).ravel() for name in exact])
    assert np.nanstd(off) == pytest.approx(1.0, abs=0.15)
    # Not all on one level: thirty of them fix the cameras, the paper's oracle.
    first = marked_points(SCENE, 30, 0.0, rng())["C1"]
    assert np.std(first[np.isfinite(first).all(axis=1), 1]) > 30


def test_a_known_length_is_as_long_as_it_says_and_seen_by_all() -> None:
    cue = marked_length(TRUTH, 3.6, 0.0, rng())
    assert set(cue.points) == set(TRUTH.names)
    for camera in TRUTH:
        ray = camera.lens.bearings(cue.points[camera.name]) @ camera.pose.R_cw
        ends = camera.centre - ray * (camera.centre[2] / ray[:, 2])[:, None]
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(3.6, abs=1e-3)
    with pytest.raises(InputError, match=r"no line of 3\.6 m"):
        marked_length(Rig(TRUTH.cameras[:1]), 3.6, 0.0, rng())


def test_boxes_are_named_by_the_person_that_they_show() -> None:
    places = np.array([[0, 0, 10, 20], [50, 0, 10, 20], [5, 0, 10, 20]])
    true = Boxes(np.array([1, 1, 2]), np.array([7, 8, 7]), places, np.ones(3))
    places = np.array([[51, 1, 10, 20], [1, 0, 10, 19], [90, 0, 10, 20]])
    found = Boxes(np.array([1, 1, 2]), np.array([1, 2, 3]), places, np.ones(3))
    assert named_by_hand({"a": found}, {"a": true})["a"].identity.tolist() == [8, 7, -1]


def line(names: tuple[str, ...] = TRUTH.names, metres: float = 3.6) -> KnownLength:
    return KnownLength(metres, 0.01, {name: TRUTH[name].project(LINE) for name in names})


def sightings(n: int, noise_px: float = 0.0, wrong: float = 0.0) -> ImagePoints:
    drawn = np.random.default_rng(1)
    places = drawn.uniform((-2, -3, 0), (2, 3, 2), (n, 3))
    seen = {}
    for camera in TRUTH:
        pixel = camera.project(places) + noise_px * drawn.standard_normal((n, 2))
        lost = drawn.uniform(size=n) < wrong
        pixel[lost] = drawn.uniform((0, 0), camera.lens.size, (lost.sum(), 2))
        seen[camera.name] = (np.arange(n), pixel)
    return numbered_points(TRUTH, seen)


def solve(points: ImagePoints, cue: KnownLength | None = None, **options: object) -> Solution:
    rig = Rig(tuple(replace(camera, pose=None) for camera in TRUTH))
    chosen = GeoPoseOptions("C1", **options)  # type: ignore[arg-type]
    return solve_correspondences(rig, points, [cue or line()], chosen, rng=rng())


def test_exact_without_noise_in_the_frame_of_the_reference_at_the_scale_of_the_length() -> None:
    solution = solve(sightings(60))
    found = compare(solution.rig, TRUTH, "C1")
    assert solution.verdict == "accepted"
    assert found.missing == ()
    assert max(found.metric.position_mm.values()) < 0.01
    assert max(found.metric.orientation_deg.values()) < 1e-4
    pose = solution.rig["C1"].pose
    assert pose is not None
    np.testing.assert_array_equal(pose.R_cw, np.eye(3))
    np.testing.assert_array_equal(pose.t_cw, np.zeros(3))
    assert compare(solve(sightings(60), line(metres=7.2)).rig, TRUTH, "C1").scale_ratio == pytest.approx(2, rel=1e-4)


def test_one_sighting_in_five_wrong_is_left_to_ransac() -> None:
    found = compare(solve(sightings(150, noise_px=0.5, wrong=0.2)).rig, TRUTH, "C1")
    assert found.missing == ()
    assert found.similarity.mean_position_mm < 30
    assert found.similarity.mean_orientation_deg < 0.2


def test_a_camera_that_does_not_see_the_length_has_no_pose_and_a_reason() -> None:
    solution = solve(sightings(60), line(("C1", "C2", "C4")))
    assert solution.rig["C3"].pose is None
    assert solution.verdict == "doubtful"
    assert any("camera C3" in reason and "known length" in reason for reason in solution.reasons)


def test_too_little_evidence_and_wrong_names_are_refused() -> None:
    with pytest.raises(EvidenceError, match="12 common points, 20 are needed"):
        solve(sightings(12))
    with pytest.raises(EvidenceError, match="are needed"):
        solve(sightings(60, wrong=1.0), min_correspondences=40)
    with pytest.raises(InputError, match="C2 sees point 7 twice"):
        numbered_points(TRUTH, {"C2": (np.array([7, 7]), np.zeros((2, 2)))})
    with pytest.raises(InputError, match="camera C9"):
        numbered_points(TRUTH, {"C9": (np.array([7]), np.zeros((1, 2)))})
    with pytest.raises(InputError, match="reference camera C7"):
        solve_correspondences(TRUTH, sightings(30), [line()], GeoPoseOptions("C7"), rng=rng())
