"""Rotations against their definitions; similarities exact where points are exact, least squares where they are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from passerby.common.errors import EvidenceError
from passerby.geometry import rotations

component = st.floats(-1.7, 1.7)
vectors = st.tuples(component, component, component).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3)
seeds = st.integers(0, 2**32 - 1)


@given(vectors)
def test_exponential_is_that_of_the_cross_product_and_the_logarithm_undoes_it(v: np.ndarray) -> None:
    np.testing.assert_allclose(rotations.exp_rotation(v), expm(rotations.skew(v)), atol=1e-12)
    np.testing.assert_allclose(rotations.log_rotation(rotations.exp_rotation(v)), v, atol=1e-9)


@given(vectors, directions, directions, st.floats(0, np.pi))
def test_angles_are_those_put_in_and_the_smallest_turn_reaches_its_target(
    base: np.ndarray, a: np.ndarray, b: np.ndarray, angle: float
) -> None:
    R = rotations.exp_rotation(base)
    turned = rotations.exp_rotation(angle * a / np.linalg.norm(a)) @ R
    np.testing.assert_allclose(rotations.angle_between(turned, R), angle, atol=1e-7)
    R = rotations.rotation_between(a, b)
    np.testing.assert_allclose(R @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-9)
    np.testing.assert_allclose(rotations.angle_between(R, np.eye(3)), rotations.direction_angle(a, b), atol=1e-7)
    opposite = rotations.rotation_between(a, -a)
    np.testing.assert_allclose(opposite @ a, -a, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(opposite), 1.0)


def test_any_number_of_rotations_at_once() -> None:
    v = np.random.default_rng(20).normal(size=(2, 5, 3)) * 0.8
    R = rotations.exp_rotation(v)
    assert R.shape == (2, 5, 3, 3)
    np.testing.assert_allclose(rotations.log_rotation(R)[1, 3], rotations.log_rotation(R[1, 3]), atol=1e-12)
    np.testing.assert_allclose(rotations.skew(v)[1, 2] @ v[0, 0], np.cross(v[1, 2], v[0, 0]))
    assert rotations.exp_rotation(np.zeros((0, 3))).shape == (0, 3, 3)
    assert rotations.log_rotation(np.zeros((0, 3, 3))).shape == (0, 3)


@given(directions, st.sampled_from([1e-12, 1e-7, 0.5, 2.99, 3.01, np.pi - 1e-6]))
def test_one_rotation_is_as_one_of_several(axis: np.ndarray, angle: float) -> None:
    """One alone is computed by itself, several by a library."""
    vector = angle * axis / np.linalg.norm(axis)
    single, several = rotations.exp_rotation(vector), rotations.exp_rotation(np.stack([vector, vector]))
    np.testing.assert_allclose(single, several[0], atol=1e-14)
    np.testing.assert_allclose(rotations.log_rotation(single), rotations.log_rotation(several)[0], atol=1e-9)


@given(seeds, st.floats(0.1, 10), st.booleans())
def test_space_similarity_recovers_the_motion(seed: int, scale: float, with_scale: bool) -> None:
    rng = np.random.default_rng(seed)
    scale = scale if with_scale else 1.0
    R, t, source = rotations.exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.normal(size=3) * 5, rng.normal(size=(6, 3))
    target = scale * source @ R.T + t
    found = rotations.fit_similarity(source, target, rng.uniform(0.1, 2, 6), with_scale=with_scale)
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
    found = rotations.fit_plane_similarity(source, target)
    np.testing.assert_allclose((found.scale, found.yaw), (scale, yaw), atol=1e-8)
    np.testing.assert_allclose(found.apply(source), target, atol=1e-8)
    np.testing.assert_allclose(found.inverse().apply(target), source, atol=1e-8)


@given(seeds)
def test_no_small_change_of_the_fit_is_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target, w = rng.normal(size=(8, 3)), rng.normal(size=(8, 3)), rng.uniform(0.1, 1, 8)
    best = rotations.fit_similarity(source, target, w)

    def cost(scale: float, R: np.ndarray, t: np.ndarray) -> float:
        return float((w * ((scale * source @ R.T + t - target) ** 2).sum(axis=1)).sum())

    least = cost(best.scale, best.rotation, best.translation)
    for _ in range(20):
        moved = rotations.exp_rotation(1e-3 * rng.normal(size=3)) @ best.rotation
        other = cost(best.scale + 1e-3 * rng.normal(), moved, best.translation + 1e-3 * rng.normal(size=3))
        assert other >= least - 1e-12


def test_reflected_points_still_give_a_rotation_and_a_weightless_outlier_has_no_pull() -> None:
    rng = np.random.default_rng(20)
    source = rng.normal(size=(10, 3))
    np.testing.assert_allclose(np.linalg.det(rotations.fit_similarity(source, source * (1, 1, -1)).rotation), 1.0)
    source = rng.normal(size=(5, 2))
    target = source + np.array([1.0, 2.0])
    target[0] += 100
    found = rotations.fit_plane_similarity(source, target, np.array([0.0, 1, 1, 1, 1]))
    np.testing.assert_allclose((found.scale, found.yaw, *found.translation), (1, 0, 1, 2), atol=1e-12)


@given(seeds)
def test_chordal_mean_lies_amid_symmetric_turns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, turn = rotations.exp_rotation(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-0.5, 0.5, 3)
    pair = np.stack([rotations.exp_rotation(turn) @ R, rotations.exp_rotation(-turn) @ R])
    assert rotations.angle_between(rotations.chordal_mean_rotation(pair), R) < 1e-7
    heavy = rotations.chordal_mean_rotation(pair, np.array([3.0, 1.0]))
    assert rotations.angle_between(heavy, pair[0]) <= rotations.angle_between(heavy, pair[1]) + 1e-9


def test_points_on_one_spot_and_no_rotations_are_too_little_evidence() -> None:
    for source in (np.zeros((4, 3)), np.zeros((1, 3))):
        with pytest.raises(EvidenceError, match=r"one place|at least 2"):
            rotations.fit_similarity(source, np.ones_like(source))
    with pytest.raises(EvidenceError, match="at least one"):
        rotations.chordal_mean_rotation(np.zeros((0, 3, 3)))
