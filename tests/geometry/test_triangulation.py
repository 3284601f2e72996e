"""Triangulation against points that are known."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from passerby.core.cameras import Lens
from passerby.geometry.rotations import exp_rotation
from passerby.geometry.triangulation import (
    angular_residuals,
    depths,
    move_to_camera_frames,
    parallax_angles,
    reprojection_residuals,
    triangulate,
    triangulate_two_views,
)
from support.scenes.people_and_rigs import ring

seeds = st.integers(0, 2**32 - 1)


def cameras_around(count: int) -> tuple[np.ndarray, np.ndarray]:
    """World-to-camera rotations and translations."""
    poses = [camera.pose for camera in ring(count)]
    return np.stack([pose.R_cw for pose in poses]), np.stack([pose.t_cw for pose in poses])


def rays_of(points: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    seen = points @ R.T + t
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)


@given(seeds)
def test_exact_rays_give_the_exact_points_however_few_cameras_see_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, t = cameras_around(5)
    points = rng.uniform(-2, 2, (12, 3))
    seen = rng.random((5, 12)) < 0.6
    camera, point = np.nonzero(seen)
    bearing = np.concatenate([rays_of(points, R[c], t[c])[seen[c]] for c in range(5)])
    found = triangulate(camera, point, bearing, R, t, 12)
    enough = seen.sum(axis=0) >= 2
    np.testing.assert_allclose(found[enough], points[enough], atol=1e-6)
    assert np.isnan(found[~enough]).all()


def test_angles_count_not_distances_to_the_rays(rng: np.random.Generator) -> None:
    """A point 2 m from one camera and 20 m from the other, both rays equally noisy: the far ray must not pull as hard."""
    t = np.array([0.0, 0.0, 18.0])
    R = exp_rotation(np.array([0.0, 0.9, 0.0]))
    points = np.tile([[0.3, 0.2, 2.0]], (400, 1))
    noise = 0.01 * rng.normal(size=(2, 400, 3))
    rays_a = rays_of(points, np.eye(3), np.zeros(3)) + noise[0]
    rays_b = rays_of(points, R, t) + noise[1]
    rays_a /= np.linalg.norm(rays_a, axis=1, keepdims=True)
    rays_b /= np.linalg.norm(rays_b, axis=1, keepdims=True)
    by_angle = triangulate_two_views(rays_a, rays_b, R, t)
    camera, point = np.repeat([0, 1], 400), np.tile(np.arange(400), 2)
    pose = np.stack([np.eye(3), R]), np.stack([np.zeros(3), t])
    midpoint = triangulate(camera, point, np.concatenate([rays_a, rays_b]), *pose, 400, iterations=1)
    error = [np.median(np.linalg.norm((found - points)[:, :2], axis=1)) for found in (by_angle, midpoint)]
    assert error[0] < 0.6 * error[1]


def test_a_heavy_ray_pulls_the_point(rng: np.random.Generator) -> None:
    R, t = cameras_around(3)
    point = np.array([[0.5, -0.2, 0.9]])
    bearing = np.concatenate([rays_of(point, R[c], t[c]) for c in range(3)])
    bearing[2] += 0.02
    bearing[2] /= np.linalg.norm(bearing[2])
    arguments = np.arange(3), np.zeros(3, dtype=int), bearing, R, t, 1
    plain = triangulate(*arguments)
    trusting = triangulate(*arguments, weights=np.array([1.0, 1.0, 1e-6]))
    assert np.linalg.norm(trusting - point) < 1e-3 < np.linalg.norm(plain - point)


def test_no_rays_no_points() -> None:
    nothing = np.zeros(0, dtype=int)
    found = triangulate(nothing, nothing, np.zeros((0, 3)), np.eye(3)[None], np.zeros((1, 3)), 2)
    np.testing.assert_array_equal(found, np.full((2, 3), np.nan))


@given(seeds)
def test_parallax_is_the_angle_at_the_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, t = exp_rotation(rng.uniform(-0.5, 0.5, 3)), rng.normal(size=3)
    points = rng.uniform((-2, -2, 4), (2, 2, 9), (10, 3))
    to_a, to_b = -points, -R.T @ t - points
    cosine = (to_a * to_b).sum(axis=1) / np.linalg.norm(to_a, axis=1) / np.linalg.norm(to_b, axis=1)
    found = parallax_angles(rays_of(points, np.eye(3), np.zeros(3)), rays_of(points, R, t), R)
    np.testing.assert_allclose(found, np.arccos(np.clip(cosine, -1, 1)), atol=1e-6)


def test_residuals_are_pixels_of_the_lens(rng: np.random.Generator) -> None:
    lens = Lens((800, 600), np.array([[500.0, 0, 400], [0, 510, 300], [0, 0, 1]]), np.array([-0.1, 0.02, 0, 0]))
    R, t = cameras_around(1)
    points = rng.uniform(-1.5, 1.5, (20, 3))
    seen = move_to_camera_frames(points, np.zeros(20, dtype=int), np.arange(20), R, t)
    measured = lens.project_rays(seen) + rng.normal(size=(20, 2))
    bearing = lens.bearings(measured)
    residual = reprojection_residuals(seen, bearing, lens.tangents(bearing))
    np.testing.assert_allclose(residual, lens.project_rays(seen) - measured, atol=0.02)
    np.testing.assert_allclose(angular_residuals(seen, bearing) * lens.focal, np.linalg.norm(residual, axis=1), rtol=0.6)
    assert (depths(seen, bearing) > 0).all()
    assert np.isnan(reprojection_residuals(-seen, bearing, lens.tangents(bearing))).all()


@given(seeds)
def test_points_of_two_views_are_those_of_the_general_solution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (R_a, R_b), (t_a, t_b) = cameras_around(2)
    R_ba = R_b @ R_a.T
    t_ba = t_b - R_ba @ t_a
    points = rng.uniform(-2, 2, (40, 3)) + [0.0, 0.0, 8.0]
    rays_a, rays_b = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (points, points @ R_ba.T + t_ba))
    rays_b = rays_b + rng.normal(0, 0.01, rays_b.shape)  # they miss each other
    rays_b /= np.linalg.norm(rays_b, axis=1, keepdims=True)
    rays_b[:3] = rays_a[:3] @ R_ba.T  # parallel
    camera, point = np.repeat([0, 1], 40), np.tile(np.arange(40), 2)
    rotations, translations = np.stack([np.eye(3), R_ba]), np.stack([np.zeros(3), t_ba])
    expected = triangulate(camera, point, np.concatenate([rays_a, rays_b]), rotations, translations, 40)
    found = triangulate_two_views(rays_a, rays_b, R_ba, t_ba)
    assert np.isnan(found[:3]).all()
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
