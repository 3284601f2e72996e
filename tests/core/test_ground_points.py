"""Pixels to the ground and back, and how uncertain that is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.geometry.rotations import exp_rotation, fit_plane_similarity
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.lenses import looking_at
from support.tiers import thinned

MATRIX = np.array([[900.0, 0, 650], [0, 880, 340], [0, 0, 1]])
BENT = Lens((1280, 720), MATRIX, np.array([-0.25, 0.08, 0.001, -0.002]))
FISHEYE = Lens(
    (1280, 720), np.array([[420.0, 0, 640], [0, 420, 360], [0, 0, 1]]), np.array([0.02, -0.01, 0.0, 0.0]), fisheye=True
)
SIGMA = PoseSigma.from_covariance(
    np.diag(np.square([0.03, 0.04, 0.05, 0.003, 0.004, 0.002]))
    + 1e-5 * np.outer([1, -1, 2, 0.1, 0.1, 0], [1, -1, 2, 0.1, 0.1, 0])
)


def camera(lens: Lens = BENT, height: float = 4.0, name: str = "C1", at: tuple[float, float] = (0.5, -6.0)) -> Camera:
    centre = np.array([*at, height])
    return Camera(name, lens, Pose.from_centre(looking_at(centre, np.array([0.0, 2.0, 2.0]), 0.05), centre), SIGMA)


def on_ground(count: int = 40, seed: int = 1) -> np.ndarray:
    return np.column_stack([np.random.default_rng(seed).uniform((-3, -2), (3, 8), (count, 2)), np.zeros(count)])


@pytest.mark.parametrize("lens", [BENT, FISHEYE])
def test_ground_and_projection_are_inverse_and_undistorted_pixels_are_those_of_the_projection_matrix(lens: Lens) -> None:
    one, points = camera(lens), on_ground()
    pixels = one.project(points)
    assert one.sees_ground(pixels).all()
    np.testing.assert_allclose(one.ground(pixels).xyz, points, atol=1e-6)
    np.testing.assert_allclose(one.ground(pixels[0]).xy, points[:1, :2], atol=1e-6)
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ one.P.T
    np.testing.assert_allclose(one.undistort(pixels), homogeneous[:, :2] / homogeneous[:, 2:], atol=1e-4)


def test_pixels_above_the_horizon_and_others_without_a_place_are_errors() -> None:
    one = camera()
    pixels = np.array([[640.0, 700.0], [640.0, 2.0], [640.0, 1.0]])
    assert one.sees_ground(pixels).tolist() == [True, False, False]
    assert np.isfinite(one.ground(pixels[:1], pixel_sd_px=1.0).sigma_m).all()
    wide = camera(replace(FISHEYE, matrix=np.array([[250.0, 0, 640], [0, 250, 360], [0, 0, 1]])))
    for call, message in (
        (lambda: one.ground(pixels), r"pixel 1 \(and 1 more\), \(640\.0, 2\.0\), does not show the ground"),
        (lambda: camera(height=-1.0).ground(pixels[:1]), "not above the ground"),
        (lambda: one.ground([[np.nan, 3.0]]), "not finite"),
        (lambda: one.ground([[1.0, 2.0, 3.0]]), r"give \(N, 2\)"),
        (lambda: replace(one, pose=None).ground(pixels), "has no pose"),
        (lambda: wide.undistort([[640.0, 360.0], [5.0, 360.0]]), r"pixel 1, \(5\.0, 360\.0\)"),
    ):
        with pytest.raises(InputError, match=message):
            call()
    unknown = replace(one, sigma=None).ground([[640.0, 600.0], [600.0, 700.0]])
    assert (unknown.sigma_m, unknown.covariance, unknown.distance(0, 1)[1]) == (None, None, None)
    assert one.ground(np.zeros((0, 2)), pixel_sd_px=1.0).xyz.shape == (0, 3)


@pytest.mark.parametrize("lens", [BENT, FISHEYE])
def test_the_covariance_is_that_of_moved_cameras_and_pixels(lens: Lens) -> None:
    one, rng = camera(lens), np.random.default_rng(3)
    pixels = one.project(np.array([[0.0, 0.0, 0.0], [1.5, 3.0, 0.0]]))
    found = one.ground(pixels, pixel_sd_px=2.0)
    drawn = []
    for error in rng.multivariate_normal(np.zeros(6), SIGMA.covariance, 2000):
        pose = Pose.from_centre(exp_rotation(error[3:]) @ one.pose.R_cw, one.pose.centre + error[:3])
        drawn.append(replace(one, pose=pose).ground(pixels + 2.0 * rng.standard_normal(pixels.shape)).xy)
    moved = np.array(drawn)
    for row in range(2):
        measured = np.cov(moved[:, row].T)
        np.testing.assert_allclose(measured, found.covariance[row], rtol=0.12, atol=0.05 * np.trace(measured))
    metres, sigma = found.distance(0, 1)
    distances = np.linalg.norm(moved[:, 0] - moved[:, 1], axis=1)
    assert metres == pytest.approx(np.hypot(1.5, 3.0), abs=1e-6)
    assert sigma == pytest.approx(distances.std(), rel=0.08)
    assert sigma < np.hypot(*found.sigma_m)  # what both have in common has cancelled


def test_a_rig_projects_into_the_images_that_show_a_point() -> None:
    """Not one that a strong distortion folds into the image."""
    rig = Rig((camera(), camera(FISHEYE, name="C2", at=(5.0, 3.0)), replace(camera(name="C3"), pose=None)))
    points = np.array([[0.0, 2.0, 0.0], [0.5, 1.0, 1.7], [0.5, -30.0, 0.0]])
    seen = rig.project(points)
    assert list(seen) == ["C1", "C2"]
    assert np.isfinite(seen["C1"]).all(axis=1).tolist() == [True, True, False]  # the last one is behind
    np.testing.assert_allclose(seen["C1"][:2], rig["C1"].project(points[:2]))
    np.testing.assert_allclose(rig.triangulate({name: pixels[:2] for name, pixels in seen.items()}), points[:2], atol=1e-5)
    strong = Lens((1280, 720), np.array([[600.0, 0, 640], [0, 600, 360], [0, 0, 1]]), np.array([-0.4, 0.0, 0.0, 0.0]))
    one = camera(strong)
    world = (5 * np.array([np.tan(np.radians(55)), 0.0, 1.0]) - one.pose.t_cw) @ one.pose.R_cw
    assert 0 < one.project(world)[0, 0] < 1280
    assert np.isnan(Rig((one,)).project(world)["C1"]).all()


@pytest.mark.system
@thinned("seed", range(540, 544), quick=1)
def test_true_points_lie_within_the_stated_sigma(seed: int) -> None:
    """The mean height is drawn as the prior says, so that the scale is as wrong as it is said to be."""
    height = 1.72 * (1 + 0.045 * np.random.default_rng((77, seed)).standard_normal())
    made = simulate(SimulationOptions(seed=seed, seconds=30.0, box_noise=0.02, person_height_mean_m=height))
    boxes = {name: made.observations[name].boxes for name in made.rig.names}
    lenses = {one.name: one.lens for one in made.rig}
    found = passerby.calibrate_observations(lenses, boxes, fps=5.0, association={"mode": "given"})
    assert {name: len(seen) for name, seen in found.tracks.items()} == {name: len(seen) for name, seen in boxes.items()}
    fit = fit_plane_similarity(*(np.array([one.centre[:2] for one in rig]) for rig in (found.rig, made.rig)), with_scale=False)
    placed = found.rig.moved(exp_rotation(np.array([0.0, 0.0, fit.yaw])), np.array([*fit.translation, 0.0]))
    places = made.ground_positions[::10].reshape(-1, 2)
    points = np.column_stack([places, np.zeros(len(places))])[np.isfinite(places).all(axis=1)]
    squares = []
    for one, pixels in zip(placed, made.rig.project(points).values(), strict=True):
        shown = np.isfinite(pixels).all(axis=1)
        on_ground = one.ground(pixels[shown])
        error = on_ground.xy - points[shown, :2]
        assert on_ground.covariance is not None
        squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(on_ground.covariance), error))
    # 99.9 % of a chi-square distribution of two degrees: all points err with the same few cameras.
    assert np.median(np.concatenate(squares)) < 13.8
