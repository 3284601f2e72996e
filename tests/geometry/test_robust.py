"""Weights of robust losses: what least squares with them minimises is the loss."""

import numpy as np
import pytest

from passerby.geometry.groups import (
    cauchy_weights,
    compute_cut_cauchy_cost,
    compute_cut_cauchy_weights,
    huber_weights,
    residual_scale,
)

AT = np.array([0.01, 0.5, 1.0, 2.4, 4.0, 7.0])


def slope(cost, at, step=1e-6):
    return (cost(at + step) - cost(at - step)) / (2 * step)


def test_cauchy_is_the_slope_of_its_cost_over_the_residual():
    np.testing.assert_allclose(cauchy_weights((AT / 3) ** 2), slope(lambda r: 4.5 * np.log1p((r / 3) ** 2), AT) / AT, rtol=1e-6)


def test_the_cut_cost_no_longer_grows():
    half = lambda r: 0.5 * compute_cut_cauchy_cost(r**2, 3.0, 25.0)  # noqa: E731
    np.testing.assert_allclose(compute_cut_cauchy_weights(AT**2, 3.0, 25.0), slope(half, AT) / AT, rtol=1e-6)
    assert (compute_cut_cauchy_weights(AT**2, 3.0, 25.0) > 0).tolist() == (AT < 5).tolist()


def test_huber():
    weights = huber_weights(AT, 2.5)
    assert weights[AT < 2.5].tolist() == [1.0] * 4
    np.testing.assert_allclose((weights * AT)[AT > 2.5], 2.5)


def test_a_third_of_outliers_does_not_move_the_scale():
    rng = np.random.default_rng(0)
    residuals = np.concatenate([2.0 * rng.standard_normal(6000), np.full(2000, 1e3)])
    assert residual_scale(residuals[:6000], 0.1) == pytest.approx(2.0, rel=0.05)
    assert 2.0 < residual_scale(residuals, 0.1) < 3.5
    assert residual_scale(np.zeros(5), 0.1) == 0.1
