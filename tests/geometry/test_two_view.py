"""The relative pose of two simulated cameras; triangulation against points that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import EvidenceError
from passerby.core.cameras import Lens
from passerby.geometry import triangulation, two_view
from passerby.geometry.rotations import angle_between, direction_angle, exp_rotation
from support.scenes.people_and_rigs import ring

seeds = st.integers(0, 2**32 - 1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def scene(rng: np.random.Generator, count: int, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A wide baseline: R_ba, unit t_ba, and the noisy rays of points in front of both cameras."""
    R = exp_rotation(np.array([0.1, rng.uniform(0.5, 1.2), -0.05]))
    middle = np.array([0.0, 0.0, 7.0])
    t = np.array([0.2, 0.3, 7.0]) - R @ middle
    points = middle + rng.uniform(-2.5, 2.5, (count, 3))
    rays = [unit(seen) for seen in (points, points @ R.T + t)]
    return R, t / np.linalg.norm(t), *(unit(ray + noise * rng.normal(size=ray.shape)) for ray in rays)  # type: ignore[return-value]


def cameras_around(count: int) -> tuple[np.ndarray, np.ndarray]:
    """World-to-camera rotations and translations."""
    poses = [camera.pose for camera in ring(count)]
    return np.stack([pose.R_cw for pose in poses]), np.stack([pose.t_cw for pose in poses])


def rays_of(points: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    return unit(points @ R.T + t)


@given(seeds, st.floats(1e-5, 3e-3))
def test_essential_matrix_annuls_true_pairs_and_its_parts_come_back(seed: int, error: float) -> None:
    """The error of a ray tilted off its epipolar plane is the turn that makes the rays meet: both share it."""
    R, t, a, b = scene(np.random.default_rng(seed), 20)
    E = two_view.essential_matrix(R, t)
    assert np.abs(np.einsum("ni,ij,nj->n", b, E, a)).max() < 1e-12
    candidates = two_view.decompose_essential(-3.0 * E)
    assert len(candidates) == 4
    found_R, found_t, front = two_view.choose_by_cheirality(candidates, a, b)
    assert angle_between(found_R, R) < 1e-7
    assert direction_angle(found_t, t) < 1e-7
    assert front.all()
    for other_R, other_t in candidates:
        np.testing.assert_allclose(np.linalg.det(other_R), 1.0)
        E_other = two_view.essential_matrix(other_R, other_t)
        np.testing.assert_allclose(E_other * np.sign((E_other * E).sum()), E, atol=1e-9)
    found = two_view.epipolar_errors(E, a, unit(b + np.tan(error) * unit(a @ E.T)))
    assert (found <= error * 1.001).all()
    assert (found > 0).all()
    # Of two rays at equal distance the half is either's share, and the shares add as squares.
    assert np.median(found) > error / np.sqrt(2) * 0.6


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_relative_pose_under_noise_and_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, t, a, b = scene(rng, 300, noise=5e-4)
    swapped = rng.choice(300, 90, replace=False)
    b[swapped] = np.roll(b[swapped], 1, axis=0)
    view = two_view.estimate_relative_pose(a, b, threshold=2e-3, rng=rng)
    assert angle_between(view.R_ba, R) < np.deg2rad(0.5)
    assert direction_angle(view.t_ba, t) < np.deg2rad(0.7)
    np.testing.assert_allclose(np.linalg.norm(view.t_ba), 1.0)
    honest = np.setdiff1d(np.arange(300), swapped)
    assert view.inliers[honest].mean() > 0.97
    assert view.inliers[swapped].mean() < 0.2
    assert 0 < view.score <= view.inliers.sum()


def test_a_subset_is_enough_and_rays_beyond_the_search_angle_count_all_the_same() -> None:
    """A fisheye's rays at 90 degrees and beyond cannot enter the search, but are inliers when they fit."""
    R, _, a, b = scene(np.random.default_rng(1), 5000, noise=1e-3)
    view = two_view.estimate_relative_pose(a, b, threshold=4e-3, rng=np.random.default_rng(9), max_points=500)
    assert angle_between(view.R_ba, R) < np.deg2rad(0.5)
    assert len(view.inliers) == 5000
    assert view.inliers.mean() > 0.97
    rng = np.random.default_rng(4)
    R, t, a, b = scene(rng, 200, noise=2e-4)
    wide = unit(rng.uniform((-4, -1, -0.6), (-3, 1, -0.1), (20, 3)))
    wide_b = unit(5 * wide @ R.T + 6 * t)
    view = two_view.estimate_relative_pose(np.vstack([a, wide]), np.vstack([b, wide_b]), threshold=2e-3, rng=rng)
    assert angle_between(view.R_ba, R) < np.deg2rad(0.3)
    assert view.inliers[200:].mean() > 0.8


def test_cheirality_is_along_the_ray_and_unrelated_rays_have_no_pose_that_most_agree_with() -> None:
    R, t = np.eye(3), np.array([1.0, 0.0, 0.0])
    a, b = unit(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])), unit(np.array([[1.0, 0.0, 3.0], [-1.0, 0.0, 3.0]]))
    assert two_view.find_in_front_of_both(R, t, a, b).tolist() == [True, False]
    rng = np.random.default_rng(0)
    _, _, a, b = scene(rng, 7)
    with pytest.raises(EvidenceError, match="7 common points"):
        two_view.estimate_relative_pose(a, b, threshold=2e-3, rng=rng)
    (*_, a, _), (*_, b) = scene(rng, 100), scene(rng, 100)
    try:
        view = two_view.estimate_relative_pose(a, b, threshold=1e-4, rng=rng)
    except EvidenceError:
        return
    assert view.inliers.mean() < 0.3


@given(seeds)
def test_exact_rays_give_the_exact_points_however_few_cameras_see_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, t = cameras_around(5)
    points = rng.uniform(-2, 2, (12, 3))
    seen = rng.random((5, 12)) < 0.6
    camera, point = np.nonzero(seen)
    bearing = np.concatenate([rays_of(points, R[c], t[c])[seen[c]] for c in range(5)])
    found = triangulation.triangulate(camera, point, bearing, R, t, 12)
    enough = seen.sum(axis=0) >= 2
    np.testing.assert_allclose(found[enough], points[enough], atol=1e-6)
    assert np.isnan(found[~enough]).all()


def test_angles_count_not_distances_to_the_rays() -> None:
    """A point 2 m from one camera and 20 m from the other, both rays equally noisy: the far ray must not pull as hard."""
    t = np.array([0.0, 0.0, 18.0])
    R = exp_rotation(np.array([0.0, 0.9, 0.0]))
    points = np.tile([[0.3, 0.2, 2.0]], (400, 1))
    noise = 0.01 * np.random.default_rng(20).normal(size=(2, 400, 3))
    rays_a, rays_b = unit(rays_of(points, np.eye(3), np.zeros(3)) + noise[0]), unit(rays_of(points, R, t) + noise[1])
    by_angle = triangulation.triangulate_two_views(rays_a, rays_b, R, t)
    camera, point = np.repeat([0, 1], 400), np.tile(np.arange(400), 2)
    pose = np.stack([np.eye(3), R]), np.stack([np.zeros(3), t])
    midpoint = triangulation.triangulate(camera, point, np.concatenate([rays_a, rays_b]), *pose, 400, iterations=1)
    error = [np.median(np.linalg.norm((found - points)[:, :2], axis=1)) for found in (by_angle, midpoint)]
    assert error[0] < 0.6 * error[1]


def test_a_heavy_ray_pulls_the_point_and_no_rays_are_no_points() -> None:
    R, t = cameras_around(3)
    point = np.array([[0.5, -0.2, 0.9]])
    bearing = np.concatenate([rays_of(point, R[c], t[c]) for c in range(3)])
    bearing[2:] = unit(bearing[2:] + 0.02)
    arguments = np.arange(3), np.zeros(3, dtype=int), bearing, R, t, 1
    plain = triangulation.triangulate(*arguments)
    trusting = triangulation.triangulate(*arguments, weights=np.array([1.0, 1.0, 1e-6]))
    assert np.linalg.norm(trusting - point) < 1e-3 < np.linalg.norm(plain - point)
    nothing = np.zeros(0, dtype=int)
    found = triangulation.triangulate(nothing, nothing, np.zeros((0, 3)), np.eye(3)[None], np.zeros((1, 3)), 2)
    np.testing.assert_array_equal(found, np.full((2, 3), np.nan))


@given(seeds)
def test_parallax_is_the_angle_at_the_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, t = exp_rotation(rng.uniform(-0.5, 0.5, 3)), rng.normal(size=3)
    points = rng.uniform((-2, -2, 4), (2, 2, 9), (10, 3))
    to_a, to_b = -points, -R.T @ t - points
    cosine = (to_a * to_b).sum(axis=1) / np.linalg.norm(to_a, axis=1) / np.linalg.norm(to_b, axis=1)
    found = triangulation.parallax_angles(rays_of(points, np.eye(3), np.zeros(3)), rays_of(points, R, t), R)
    np.testing.assert_allclose(found, np.arccos(np.clip(cosine, -1, 1)), atol=1e-6)


def test_residuals_are_pixels_of_the_lens() -> None:
    rng = np.random.default_rng(20)
    lens = Lens((800, 600), np.array([[500.0, 0, 400], [0, 510, 300], [0, 0, 1]]), np.array([-0.1, 0.02, 0, 0]))
    R, t = cameras_around(1)
    points = rng.uniform(-1.5, 1.5, (20, 3))
    seen = triangulation.move_to_camera_frames(points, np.zeros(20, dtype=int), np.arange(20), R, t)
    measured = lens.project_rays(seen) + rng.normal(size=(20, 2))
    bearing = lens.bearings(measured)
    residual = triangulation.reprojection_residuals(seen, bearing, lens.tangents(bearing))
    np.testing.assert_allclose(residual, lens.project_rays(seen) - measured, atol=0.02)
    np.testing.assert_allclose(
        triangulation.angular_residuals(seen, bearing) * lens.focal, np.linalg.norm(residual, axis=1), rtol=0.6
    )
    assert (triangulation.depths(seen, bearing) > 0).all()
    assert np.isnan(triangulation.reprojection_residuals(-seen, bearing, lens.tangents(bearing))).all()


@given(seeds)
def test_points_of_two_views_are_those_of_the_general_solution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (R_a, R_b), (t_a, t_b) = cameras_around(2)
    R_ba = R_b @ R_a.T
    t_ba = t_b - R_ba @ t_a
    points = rng.uniform(-2, 2, (40, 3)) + [0.0, 0.0, 8.0]
    rays_a, rays_b = unit(points), unit(points @ R_ba.T + t_ba)
    rays_b = unit(rays_b + rng.normal(0, 0.01, rays_b.shape))  # they miss each other
    rays_b[:3] = rays_a[:3] @ R_ba.T  # parallel
    camera, point = np.repeat([0, 1], 40), np.tile(np.arange(40), 2)
    rotations, translations = np.stack([np.eye(3), R_ba]), np.stack([np.zeros(3), t_ba])
    expected = triangulation.triangulate(camera, point, np.concatenate([rays_a, rays_b]), rotations, translations, 40)
    found = triangulation.triangulate_two_views(rays_a, rays_b, R_ba, t_ba)
    assert np.isnan(found[:3]).all()
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
