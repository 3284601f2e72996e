"""The relative pose of two simulated cameras."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import EvidenceError
from passerby.geometry.rotations import angle_between, direction_angle, exp_rotation
from passerby.geometry.two_view import (
    choose_by_cheirality,
    decompose_essential,
    epipolar_errors,
    essential_matrix,
    estimate_relative_pose,
    find_in_front_of_both,
)

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


@given(seeds)
def test_essential_matrix_annuls_true_pairs_and_its_parts_come_back(seed: int) -> None:
    R, t, a, b = scene(np.random.default_rng(seed), 20)
    E = essential_matrix(R, t)
    assert np.abs(np.einsum("ni,ij,nj->n", b, E, a)).max() < 1e-12
    candidates = decompose_essential(-3.0 * E)
    assert len(candidates) == 4
    found_R, found_t, front = choose_by_cheirality(candidates, a, b)
    assert angle_between(found_R, R) < 1e-7
    assert direction_angle(found_t, t) < 1e-7
    assert front.all()
    for other_R, other_t in candidates:
        np.testing.assert_allclose(np.linalg.det(other_R), 1.0)
        E_other = essential_matrix(other_R, other_t)
        np.testing.assert_allclose(E_other * np.sign((E_other * E).sum()), E, atol=1e-9)


@given(seeds, st.floats(1e-5, 3e-3))
def test_epipolar_error_is_the_turn_that_makes_the_rays_meet(seed: int, error: float) -> None:
    """A ray tilted off its epipolar plane: both rays share the turn back, each at least a part."""
    rng = np.random.default_rng(seed)
    R, t, a, b = scene(rng, 10)
    normal = unit(a @ essential_matrix(R, t).T)
    tilted = unit(b + np.tan(error) * normal)
    found = epipolar_errors(essential_matrix(R, t), a, tilted)
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
    view = estimate_relative_pose(a, b, threshold=2e-3, rng=rng)
    assert angle_between(view.R_ba, R) < np.deg2rad(0.5)
    assert direction_angle(view.t_ba, t) < np.deg2rad(0.7)
    np.testing.assert_allclose(np.linalg.norm(view.t_ba), 1.0)
    honest = np.setdiff1d(np.arange(300), swapped)
    assert view.inliers[honest].mean() > 0.97
    assert view.inliers[swapped].mean() < 0.2
    assert 0 < view.score <= view.inliers.sum()


def test_a_subset_is_enough() -> None:
    R, _, a, b = scene(np.random.default_rng(1), 5000, noise=1e-3)
    view = estimate_relative_pose(a, b, threshold=4e-3, rng=np.random.default_rng(9), max_points=500)
    assert angle_between(view.R_ba, R) < np.deg2rad(0.5)
    assert len(view.inliers) == 5000
    assert view.inliers.mean() > 0.97


def test_rays_beyond_the_search_angle_are_judged_all_the_same() -> None:
    """A fisheye's rays at 90 degrees and beyond cannot enter the search, but count as inliers when they fit."""
    rng = np.random.default_rng(4)
    R, t, a, b = scene(rng, 200, noise=2e-4)
    wide = unit(rng.uniform((-4, -1, -0.6), (-3, 1, -0.1), (20, 3)))
    at = 5 * wide
    wide_b = unit(at @ R.T + 6 * t)
    view = estimate_relative_pose(np.vstack([a, wide]), np.vstack([b, wide_b]), threshold=2e-3, rng=rng)
    assert angle_between(view.R_ba, R) < np.deg2rad(0.3)
    assert view.inliers[200:].mean() > 0.8


def test_too_few_points_and_unrelated_rays_have_no_pose_that_most_agree_with() -> None:
    rng = np.random.default_rng(0)
    _, _, a, b = scene(rng, 7)
    with pytest.raises(EvidenceError, match="7 common points"):
        estimate_relative_pose(a, b, threshold=2e-3, rng=rng)
    (*_, a, _), (*_, b) = scene(rng, 100), scene(rng, 100)
    try:
        view = estimate_relative_pose(a, b, threshold=1e-4, rng=rng)
    except EvidenceError:
        return
    assert view.inliers.mean() < 0.3


def test_cheirality_is_along_the_ray() -> None:
    R, t = np.eye(3), np.array([1.0, 0.0, 0.0])
    a, b = unit(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])), unit(np.array([[1.0, 0.0, 3.0], [-1.0, 0.0, 3.0]]))
    assert find_in_front_of_both(R, t, a, b).tolist() == [True, False]
