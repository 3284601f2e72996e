"""Robust losses as weights of iterated least squares, and the scale of residuals that a minority cannot move."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats

NORMAL_BY_MAD = 1.4826
"""Standard deviation of a normal variable by the median of its absolute value."""


def cauchy_weights(squares: Floats) -> Floats:
    """(N,) weights of residuals by their squares (N,) in units of the loss's scale: 1 / (1 + square)."""
    return np.asarray(1.0 / (1.0 + squares))


def huber_weights(lengths: Floats, scale: float) -> Floats:
    """(N,) weights of residuals by their lengths (N,): 1 up to `scale`, and beyond it a pull that no longer grows."""
    return np.minimum(1.0, scale / np.maximum(lengths, 1e-9))


def cut_cauchy_cost(squares: Floats, scale: float, beyond: float) -> Floats:
    """(N,) Cauchy's cost of squares in sigmas, constant beyond `beyond`: what is farther off is another person."""
    return np.asarray(scale**2 * np.log1p(np.minimum(squares, beyond) / scale**2))


def cut_cauchy_weights(squares: Floats, scale: float, beyond: float) -> Floats:
    """(N,) the weights of `cut_cauchy_cost`: 0 beyond `beyond`."""
    return np.where(squares > beyond, 0.0, cauchy_weights(squares / scale**2))


def residual_scale(residuals: Floats, least: float) -> float:
    """The standard deviation of residuals (N,) around 0 by their median, `least` or more."""
    return max(NORMAL_BY_MAD * float(np.median(np.abs(residuals))), least)
