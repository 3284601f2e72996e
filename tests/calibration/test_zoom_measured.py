"""The focal length of a stretch of time and its sigma, by people whose places are known; moves beside it."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.calibration.diagnostics.correspondences import Correspondences, match_people
from passerby.calibration.diagnostics.zoom import zoom_of
from passerby.core.cameras import Lens, Pose
from passerby.geometry.rotations import exp_rotation
from passerby.people.body_centres import BodyCentres, TriangulatedPeople
from support.scenes.people_and_rigs import looking_at

LENS = Lens((1280, 720), np.array([[800.0, 0, 640], [0, 800.0, 360], [0, 0, 1]]), np.zeros(0))
POSE = looking_at((8.0, 0.5, 3.0), (0.0, 0.0, 0.9))
MOVED = Pose.from_centre(exp_rotation(np.array([0.02, 0.06, 0.01])) @ POSE.R_cw, POSE.centre + (0.3, -0.2, 0.1))
BODY_M = 1.72
SIGMA_PX = 6.0


def seen(pose: Pose, zoom: float = 1.0, *, count: int = 200, noise: float = 1.0, seed: int = 0) -> Correspondences:
    """People with a camera whose focal length is `zoom` times that of the lens: pixels are off by `noise` sigmas."""
    rng = np.random.default_rng(seed)
    place = np.column_stack([rng.uniform(-3.0, 3.0, (count, 2)), rng.normal(0.9, 0.2, count)])
    instant, identity = np.arange(count) // 4, np.arange(count) % 4
    people = TriangulatedPeople(instant, identity, place, np.tile(1e-8 * np.eye(3), (count, 1, 1)))
    at = (place - pose.centre) @ pose.R_cw.T
    ray = LENS.bearings(LENS.project_rays(at * (zoom, zoom, 1.0)) + noise * SIGMA_PX * rng.normal(size=(count, 2)))
    extent = zoom * LENS.focal * BODY_M / np.linalg.norm(at, axis=1)
    own = BodyCentres(instant, identity, ray, LENS.tangents(ray), np.full(count, SIGMA_PX), extent, np.full(count, 0.5))
    return match_people(own, people, BODY_M, given=True)


@pytest.mark.parametrize("zoom", [0.7, 1.4])
def test_the_focal_length_scatters_by_its_sigma(zoom: float) -> None:
    """Of a camera that stays where it is, over samples of the pixels' noise."""
    errors, sigmas = [], []
    for seed in range(12):
        found = zoom_of(seen(POSE, zoom, seed=seed), POSE, POSE, 5.0)
        assert found is not None
        errors.append(np.log(found.factor / zoom))
        sigmas.append(abs(np.log(found.factor)) / found.sigmas)
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) / np.mean(sigmas) < 1.6


@pytest.mark.parametrize("zoom", [0.8, 1.3])
def test_a_camera_that_was_moved_and_zoomed_is_told_with_both(zoom: float) -> None:
    found = zoom_of(seen(MOVED, zoom, noise=0.2), POSE, MOVED, 5.0)
    assert found is not None
    assert found.factor == pytest.approx(zoom, rel=0.03)
    np.testing.assert_allclose(found.pose.centre, MOVED.centre, atol=0.15)


@pytest.mark.parametrize("zoom", [0.97, 1.0, 1.03])
def test_a_camera_that_was_moved_and_hardly_zoomed_does_not_zoom(zoom: float) -> None:
    assert zoom_of(seen(MOVED, zoom, noise=0.05), POSE, MOVED, 5.0) is None
