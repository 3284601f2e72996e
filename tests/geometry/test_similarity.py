"""Similarities: exact where the points are exact, least squares where they are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import EvidenceError
from passerby.geometry.rotations import angle_between, chordal_mean_rotation, exp_rotation, fit_plane_similarity, fit_similarity

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.floats(0.1, 10), st.booleans())
def test_space_similarity_recovers_the_motion(seed: int, scale: float, with_scale: bool) -> None:
    rng = np.random.default_rng(seed)
    scale = scale if with_scale else 1.0
    R, t, source = exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.normal(size=3) * 5, rng.normal(size=(6, 3))
    target = scale * source @ R.T + t
    found = fit_similarity(source, target, rng.uniform(0.1, 2, 6), with_scale=with_scale)
    np.testing.assert_allclose(found.scale, scale, rtol=1e-9)
    np.testing.assert_allclose(found.rotation, R, atol=1e-7)
    np.testing.assert_allclose(found.apply(source), target, atol=1e-7)
    np.testing.assert_allclose(found.inverse().apply(target), source, atol=1e-6)


@given(seeds, st.floats(0.1, 10), st.floats(-3.1, 3.1))
def test_plane_similarity_recovers_the_motion_from_two_points(seed: int, scale: float, yaw: float) -> None:
    rng = np.random.default_rng(seed)
    source, t = rng.normal(size=(2, 2)), rng.normal(size=2)
    source[1] = source[0] + (0.5, 0.3)
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    target = scale * source @ R.T + t
    found = fit_plane_similarity(source, target)
    np.testing.assert_allclose((found.scale, found.yaw), (scale, yaw), atol=1e-8)
    np.testing.assert_allclose(found.apply(source), target, atol=1e-8)
    np.testing.assert_allclose(found.inverse().apply(target), source, atol=1e-8)


@given(seeds)
def test_no_small_change_of_the_fit_is_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target, w = rng.normal(size=(8, 3)), rng.normal(size=(8, 3)), rng.uniform(0.1, 1, 8)
    best = fit_similarity(source, target, w)

    def cost(scale: float, R: np.ndarray, t: np.ndarray) -> float:
        return float((w * ((scale * source @ R.T + t - target) ** 2).sum(axis=1)).sum())

    least = cost(best.scale, best.rotation, best.translation)
    for _ in range(20):
        moved = exp_rotation(1e-3 * rng.normal(size=3)) @ best.rotation
        other = cost(best.scale + 1e-3 * rng.normal(), moved, best.translation + 1e-3 * rng.normal(size=3))
        assert other >= least - 1e-12


def test_reflected_points_still_give_a_rotation(rng: np.random.Generator) -> None:
    source = rng.normal(size=(10, 3))
    found = fit_similarity(source, source * (1, 1, -1))
    np.testing.assert_allclose(np.linalg.det(found.rotation), 1.0)


def test_weightless_outlier_has_no_pull(rng: np.random.Generator) -> None:
    source = rng.normal(size=(5, 2))
    target = source + np.array([1.0, 2.0])
    target[0] += 100
    found = fit_plane_similarity(source, target, np.array([0.0, 1, 1, 1, 1]))
    np.testing.assert_allclose((found.scale, found.yaw, *found.translation), (1, 0, 1, 2), atol=1e-12)


@pytest.mark.parametrize("source", [np.zeros((4, 3)), np.zeros((1, 3))])
def test_points_without_extent_are_too_little_evidence(source: np.ndarray) -> None:
    with pytest.raises(EvidenceError, match=r"one place|at least 2"):
        fit_similarity(source, np.ones_like(source))


@given(seeds)
def test_chordal_mean_lies_amid_symmetric_turns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, turn = exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-0.5, 0.5, 3)
    pair = np.stack([exp_rotation(turn) @ R, exp_rotation(-turn) @ R])
    assert angle_between(chordal_mean_rotation(pair), R) < 1e-7
    heavy = chordal_mean_rotation(pair, np.array([3.0, 1.0]))
    assert angle_between(heavy, pair[0]) <= angle_between(heavy, pair[1]) + 1e-9


def test_chordal_mean_of_nothing() -> None:
    with pytest.raises(EvidenceError, match="at least one"):
        chordal_mean_rotation(np.zeros((0, 3, 3)))
