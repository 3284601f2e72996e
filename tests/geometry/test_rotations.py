"""Rotations against their definitions."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from passerby.geometry.rotations import angle_between, direction_angle, exp_rotation, log_rotation, rotation_between, skew

component = st.floats(-1.7, 1.7)
vectors = st.tuples(component, component, component).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3)


@given(vectors)
def test_exponential_is_the_matrix_exponential_of_the_cross_product(v: np.ndarray) -> None:
    np.testing.assert_allclose(exp_rotation(v), expm(skew(v)), atol=1e-12)


@given(vectors)
def test_logarithm_undoes_the_exponential(v: np.ndarray) -> None:
    np.testing.assert_allclose(log_rotation(exp_rotation(v)), v, atol=1e-9)


@given(vectors, directions, st.floats(0, np.pi))
def test_angle_between_is_the_angle_that_was_put_in(base: np.ndarray, axis: np.ndarray, angle: float) -> None:
    R = exp_rotation(base)
    turned = exp_rotation(angle * axis / np.linalg.norm(axis)) @ R
    np.testing.assert_allclose(angle_between(turned, R), angle, atol=1e-7)


@given(directions, directions)
def test_smallest_turn_reaches_the_target_and_no_farther(a: np.ndarray, b: np.ndarray) -> None:
    R = rotation_between(a, b)
    np.testing.assert_allclose(R @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-9)
    np.testing.assert_allclose(angle_between(R, np.eye(3)), direction_angle(a, b), atol=1e-7)


def test_turn_between_opposite_directions() -> None:
    a = np.array([0.0, 0.0, 2.0])
    R = rotation_between(a, -a)
    np.testing.assert_allclose(R @ a, -a, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)


def test_vectorised_over_leading_axes(rng: np.random.Generator) -> None:
    v = rng.normal(size=(2, 5, 3)) * 0.8
    R = exp_rotation(v)
    assert R.shape == (2, 5, 3, 3)
    np.testing.assert_allclose(log_rotation(R)[1, 3], log_rotation(R[1, 3]), atol=1e-12)
    np.testing.assert_allclose(skew(v)[1, 2] @ v[0, 0], np.cross(v[1, 2], v[0, 0]))
    assert exp_rotation(np.zeros((0, 3))).shape == (0, 3, 3)
    assert log_rotation(np.zeros((0, 3, 3))).shape == (0, 3)


@given(directions, st.sampled_from([1e-12, 1e-7, 0.5, 2.99, 3.01, np.pi - 1e-6]))
def test_one_rotation_is_as_one_of_several(axis: np.ndarray, angle: float) -> None:
    """One alone is computed by itself, several by a library."""
    vector = angle * axis / np.linalg.norm(axis)
    single, several = exp_rotation(vector), exp_rotation(np.stack([vector, vector]))
    np.testing.assert_allclose(single, several[0], atol=1e-14)
    np.testing.assert_allclose(log_rotation(single), log_rotation(several)[0], atol=1e-9)
