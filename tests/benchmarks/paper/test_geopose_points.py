"""GeoPose on points of any origin: exact without noise, robust to wrong ones, plain about what is lacking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from paper.geopose_points import solve_correspondences
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.scale_cues import KnownLength
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.simulation import SimulationOptions, simulate
from passerby.solver.geopose.correspondences import ImagePoints, numbered_points
from passerby.solver.geopose.pairs import GeoPoseOptions

TRUTH = simulate(SimulationOptions(preset="terrace", seed=0, seconds=0.2)).rig
LINE = np.array([[-1.8, 0.0, 0.0], [1.8, 0.0, 0.0]])


def line(names: tuple[str, ...] = TRUTH.names, metres: float = 3.6) -> KnownLength:
    return KnownLength(metres, 0.01, {name: TRUTH[name].project(LINE) for name in names})


def sightings(n: int, noise_px: float = 0.0, wrong: float = 0.0) -> ImagePoints:
    rng = np.random.default_rng(1)
    places = rng.uniform((-2, -3, 0), (2, 3, 2), (n, 3))
    seen = {}
    for camera in TRUTH:
        pixel = camera.project(places) + noise_px * rng.standard_normal((n, 2))
        lost = rng.uniform(size=n) < wrong
        pixel[lost] = rng.uniform((0, 0), camera.lens.size, (lost.sum(), 2))
        seen[camera.name] = (np.arange(n), pixel)
    return numbered_points(TRUTH, seen)


def solve(points: ImagePoints, cue: KnownLength | None = None, **options: object) -> Solution:
    rig = Rig(tuple(replace(camera, pose=None) for camera in TRUTH))
    chosen = GeoPoseOptions("C1", **options)  # type: ignore[arg-type]
    return solve_correspondences(rig, points, [cue or line()], chosen, rng=np.random.default_rng(0))


def test_exact_without_noise() -> None:
    solution = solve(sightings(60))
    found = compare(solution.rig, TRUTH, "C1")
    assert solution.verdict == "accepted"
    assert found.missing == ()
    assert max(found.metric.position_mm.values()) < 0.01
    assert max(found.metric.orientation_deg.values()) < 1e-4


def test_the_world_is_the_reference_cameras_frame() -> None:
    pose = solve(sightings(60)).rig["C1"].pose
    assert pose is not None
    np.testing.assert_array_equal(pose.R_cw, np.eye(3))
    np.testing.assert_array_equal(pose.t_cw, np.zeros(3))


def test_one_sighting_in_five_wrong_is_left_to_ransac() -> None:
    found = compare(solve(sightings(150, noise_px=0.5, wrong=0.2)).rig, TRUTH, "C1")
    assert found.missing == ()
    assert found.similarity.mean_position_mm is not None
    assert found.similarity.mean_position_mm < 30
    assert found.similarity.mean_orientation_deg is not None
    assert found.similarity.mean_orientation_deg < 0.2


def test_the_scale_is_that_of_the_known_length() -> None:
    points = sightings(60)
    assert compare(solve(points, line(metres=7.2)).rig, TRUTH, "C1").scale_ratio == pytest.approx(2, rel=1e-4)


def test_a_camera_that_does_not_see_the_length_has_no_pose_and_a_reason() -> None:
    solution = solve(sightings(60), line(("C1", "C2", "C4")))
    assert solution.rig["C3"].pose is None
    assert solution.verdict == "doubtful"
    assert any("camera C3" in reason and "known length" in reason for reason in solution.reasons)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(EvidenceError, match="12 common points, 20 are needed"):
        solve(sightings(12))


def test_points_that_agree_on_nothing_place_no_camera() -> None:
    with pytest.raises(EvidenceError, match="are needed"):
        solve(sightings(60, wrong=1.0), min_correspondences=40)


def test_a_point_seen_twice_by_one_camera_is_told() -> None:
    with pytest.raises(InputError, match="C2 sees point 7 twice"):
        numbered_points(TRUTH, {"C2": (np.array([7, 7]), np.zeros((2, 2)))})
    with pytest.raises(InputError, match="camera C9"):
        numbered_points(TRUTH, {"C9": (np.array([7]), np.zeros((1, 2)))})


def test_an_unknown_reference_is_told() -> None:
    with pytest.raises(InputError, match="reference camera C7"):
        solve_correspondences(TRUTH, sightings(30), [line()], GeoPoseOptions("C7"), rng=np.random.default_rng(0))
