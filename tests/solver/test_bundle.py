"""Bundle adjustment of points: derivatives, recovery of the truth, held cameras, honest sigmas."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Lens, Pose, Rig
from passerby.geometry.rotations import angle_between, exp_rotation, log_rotation
from passerby.geometry.triangulation import PointObservations, pose_jacobian, project_near, retract_poses
from passerby.solver.geopose import bundle
from passerby.solver.geopose.bundle import adjust_points
from support.scenes.people_and_rigs import LENS, ring

FISHEYE = Lens((1280, 720), np.array([[350.0, 0, 640], [0, 350.0, 360], [0, 0, 1]]), np.array([-0.02, 0.003, 0, 0]), True)


def poses_of(rig: Rig) -> list[Pose]:
    return [camera.pose for camera in rig if camera.pose is not None]


def sightings(rig: Rig, points: np.ndarray, rng: np.random.Generator, noise_px: float) -> PointObservations:
    """Every camera sees every point, in a shuffled order."""
    camera, point = (grid.ravel() for grid in np.meshgrid(np.arange(len(rig)), np.arange(len(points)), indexing="ij"))
    shuffle = rng.permutation(len(camera))
    camera, point = camera[shuffle], point[shuffle]
    bearing, tangent = np.zeros((len(camera), 3)), np.zeros((len(camera), 2, 3))
    for c, item in enumerate(rig):
        own = camera == c
        pixels = item.project(points[point[own]])
        bearing[own] = item.lens.bearings(pixels + noise_px * rng.normal(size=pixels.shape))
        tangent[own] = item.lens.tangents(bearing[own])
    return PointObservations(camera, point, bearing, tangent, np.full(len(camera), max(noise_px, 0.1)))


def disturbed(poses: Sequence[Pose], rng: np.random.Generator) -> list[Pose]:
    """All but the first."""
    return [poses[0]] + [
        Pose.from_centre(exp_rotation(0.05 * rng.normal(size=3)) @ pose.R_cw, pose.centre + 0.3 * rng.normal(size=3))
        for pose in poses[1:]
    ]


def cloud(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform((-2.5, -2.5, 0), (2.5, 2.5, 2), (count, 3))


@pytest.mark.parametrize("lens", [LENS, FISHEYE])
def test_residual_is_the_reprojection_error_and_its_derivative_holds(lens: Lens) -> None:
    """A point behind its ray costs much, but not infinitely."""
    rng = np.random.default_rng(0)
    d = rng.uniform((-2, -1, 4), (2, 1, 9), (30, 3))
    seen = lens.project_rays(d) + rng.normal(0, 3, (30, 2))
    bearing = lens.bearings(seen)
    tangent = lens.tangents(bearing)
    residual, by_d = project_near(bearing, tangent, d)
    np.testing.assert_allclose(residual, lens.project_rays(d) - seen, atol=0.15)
    for axis, h in enumerate(1e-5 * np.eye(3)):
        numerical = (project_near(bearing, tangent, d + h)[0] - project_near(bearing, tangent, d - h)[0]) / 2e-5
        np.testing.assert_allclose(by_d[:, :, axis], numerical, rtol=1e-5, atol=1e-4)
    ahead = np.array([[0.0, 0.0, 1.0]])
    behind, by_d = project_near(ahead, LENS.tangents(ahead), np.array([[0.5, 0.0, -3.0]]))
    assert np.isfinite(by_d).all()
    assert 100 < np.abs(behind).max() < 1e6


def test_pose_jacobian_matches_central_differences() -> None:
    rng = np.random.default_rng(1)
    R, centre = exp_rotation(rng.normal(size=(20, 3))), rng.normal(size=(20, 3))
    point, by_d = rng.normal(size=(20, 3)) * 5, rng.normal(size=(20, 2, 3))

    def value(step: np.ndarray) -> np.ndarray:
        turned, moved = retract_poses(R, centre, np.tile(step[:6], (20, 1)))
        return np.einsum("mki,mij,mj->mk", by_d, turned, point + step[6:] - moved)

    found = np.concatenate(pose_jacobian(by_d, np.einsum("mij,mj->mi", R, point - centre), R), axis=2)
    numerical = np.stack([(value(h) - value(-h)) / 2e-6 for h in 1e-6 * np.eye(9)], axis=2)
    np.testing.assert_allclose(found, numerical, rtol=1e-6, atol=1e-6)


def test_exact_sightings_give_back_the_truth() -> None:
    rng = np.random.default_rng(2)
    rig = ring(4)
    points = cloud(rng, 40)
    seen = sightings(rig, points, rng, 0.0)
    start = disturbed(poses_of(rig), rng)
    found = adjust_points(start, points + 0.2 * rng.normal(size=points.shape), seen)
    assert found.converged
    assert found.rms_px < 1e-6
    # The first camera and the distance to the farthest one of the start fix the gauge.
    first = start[0].centre
    spread = [np.linalg.norm(pose.centre - first) for pose in start]
    far = int(np.argmax(spread))
    assert np.linalg.norm(found.poses[far].centre - first) == pytest.approx(spread[far], rel=1e-9)
    scale = spread[far] / np.linalg.norm(poses_of(rig)[far].centre - first)
    for pose, truth in zip(found.poses, poses_of(rig), strict=True):
        assert angle_between(pose.R_cw, truth.R_cw) < 1e-6
        np.testing.assert_allclose(pose.centre, first + scale * (truth.centre - first), atol=1e-5)
    np.testing.assert_allclose(found.points, first + scale * (points - first), atol=1e-5)


def test_the_unit_of_lengths_does_not_matter() -> None:
    rng, rig, unit = np.random.default_rng(9), ring(4), 1e-5
    points = cloud(rng, 40)
    seen = sightings(rig, points, rng, 0.0)
    start = [Pose.from_centre(pose.R_cw, unit * pose.centre) for pose in disturbed(poses_of(rig), rng)]
    found = adjust_points(start, unit * points, seen)
    away, held, truly = (
        np.linalg.norm([pose.centre - poses[0].centre for pose in poses], axis=1)
        for poses in (found.poses, start, poses_of(rig))
    )
    far = int(np.argmax(held))
    assert away[far] == pytest.approx(held[far], rel=1e-9)
    np.testing.assert_allclose(away / away[far], truly / truly[far], rtol=1e-4)


@pytest.mark.parametrize("fixed", [(0,), (2,), (3, 1)])
def test_held_cameras_stay_to_the_last_digit_and_the_others_move(fixed: tuple[int, ...]) -> None:
    """Also where one of two is not the farthest: two that are held fix the scale themselves."""
    rng, rig = np.random.default_rng(8), ring(4)
    points = cloud(rng, 40)
    start = disturbed(poses_of(rig), rng)
    found = adjust_points(start, points, sightings(rig, points, rng, 0.5), fixed_cameras=fixed)
    for c, (before, after) in enumerate(zip(start, found.poses, strict=True)):
        if c in fixed:
            np.testing.assert_array_equal(after.R_cw, before.R_cw)
            np.testing.assert_allclose(after.centre, before.centre, rtol=1e-12)
        else:
            assert np.abs(before.R_cw - after.R_cw).max() + np.abs(before.centre - after.centre).max() > 1e-12


def test_one_sighting_in_eight_far_off_is_let_go_and_residuals_are_those_of_each_sighting() -> None:
    rng = np.random.default_rng(3)
    rig = ring(4)
    points = cloud(rng, 60)
    seen = sightings(rig, points, rng, 0.5)
    wrong = rng.choice(len(seen.camera), len(seen.camera) // 8, replace=False)
    bearing = seen.bearing.copy()
    bearing[wrong] += 0.15 * rng.normal(size=(len(wrong), 3))
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    spoilt = replace(seen, bearing=bearing, tangent=LENS.tangents(bearing))
    found = adjust_points(poses_of(rig), points, spoilt)
    angles = [float(np.degrees(angle_between(a.R_cw, b.R_cw))) for a, b in zip(found.poses, poses_of(rig), strict=True)]
    assert max(angles) < 0.2
    length = np.linalg.norm(found.residuals_px, axis=1)
    right = np.setdiff1d(np.arange(len(length)), wrong)
    assert np.median(length[right]) < 1.0
    assert np.median(length[wrong]) > 20
    assert found.rms_px < 2.0
    R, centre = (np.array([getattr(pose, name) for pose in found.poses]) for name in ("R_cw", "centre"))
    d = np.einsum("mij,mj->mi", R[seen.camera], found.points[seen.point] - centre[seen.camera])
    np.testing.assert_allclose(found.residuals_px, project_near(bearing, spoilt.tangent, d)[0], atol=1e-9)


def test_sigmas_hold_over_forty_draws_of_the_noise() -> None:
    """Two cameras held (so the gauge is), the third free: errors in units of the stated covariance.

    Each of the 40 x 6 errors lies within one sigma with probability 0.683. The six of a draw depend on each other, so the
    tolerance is that of 80 independent ones: three binomial sigmas, 0.156. The mean of the squared Mahalanobis lengths is 6,
    its sigma 0.55.
    """
    rig = ring(3)
    truth = poses_of(rig)
    points = cloud(np.random.default_rng(6), 30)
    normalised, squared = [], []
    for draw in range(40):
        rng = np.random.default_rng(100 + draw)
        seen = sightings(rig, points, rng, 1.0)
        found = adjust_points(truth, points, seen, fixed_cameras=(0, 1), loss_scale_px=50.0)
        error = np.concatenate([found.poses[2].centre - truth[2].centre, log_rotation(found.poses[2].R_cw @ truth[2].R_cw.T)])
        covariance = found.pose_covariance[2]
        normalised.append(error / np.sqrt(np.diag(covariance)))
        squared.append(error @ np.linalg.solve(covariance, error))
        assert np.abs(found.pose_covariance[:2]).max() == 0
    assert np.mean(np.abs(normalised) < 1) == pytest.approx(0.683, abs=0.156)
    assert np.mean(squared) == pytest.approx(6.0, abs=2.0)


@pytest.mark.parametrize("unknowns", [0, 79])
def test_without_outliers_the_variance_is_that_of_the_residuals_that_the_unknowns_leave(unknowns: int) -> None:
    """Forty sightings have eighty residuals, and each unknown takes one of them."""
    squared = np.random.default_rng(8).chisquare(2, 40)
    found = bundle._robust_variance(squared, np.ones(40), 1e6, unknowns)
    assert found == pytest.approx(squared.sum() / (80 - unknowns), rel=1e-6)
