"""Selection of an identity's boxes that show the same person, by votes of cameras and neighbouring instants."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints

FITS = 13.8
"""Largest squared distance in sigmas, in two dimensions, of boxes that agree: 999 of 1000 right boxes are nearer."""
SOFT = 6.0
"""Scale of the weight of a vote, in squared sigmas: the weight decreases exponentially with the squared distance."""
NEIGHBOURS_S = (0.2, 0.5, 1.0)
"""Approximate times before and after an instant, seconds, at which boxes vote too."""
NEIGHBOUR_VOTE = 0.25
"""Weight of a vote at one of these six times. All six together count a little more than one other camera at the instant itself:
two wrong cameras are rarer than one that is wrong for a moment."""
MOVES_M_S = 1.0
"""One sigma of a person's motion between the instants, metres per second."""
CELLS_AT_ONCE = 200_000
"""Pairs of boxes that are compared at once: memory is constant for a recording of any length."""


def vote(instant: Ints, camera: Ints, seconds: Floats, place: Floats, covariance: Floats) -> Bools:
    """Return a mask (M,) of boxes that agree with the box that has most votes at their instant; of two that disagree, one.

    Args:
        instant: (M,) rows of `seconds`.
        camera: (M,) camera of each box; one box of a camera at an instant.
        seconds: (T,) ascending.
        place: (M, 2) position of the person by each box alone, metres.
        covariance: (M, 2, 2)
    """
    cameras, column = np.unique(camera, return_inverse=True)
    shape = (len(seconds), len(cameras))
    where, spread = np.full((*shape, 2), np.nan), np.full((*shape, 2, 2), np.nan)
    where[instant, column], spread[instant, column] = place, covariance
    agrees = np.zeros(shape, dtype=np.bool_)
    at_once = max(1, CELLS_AT_ONCE // len(cameras) ** 2)
    shifts = _shifts(seconds)
    for first in range(0, len(seconds), at_once):
        rows = np.arange(first, min(first + at_once, len(seconds)))
        score = np.zeros((len(rows), len(cameras)))
        for shift in shifts:
            other = np.clip(rows + shift, 0, len(seconds) - 1)
            apart = np.abs(seconds[other] - seconds[rows])
            d2 = _apart2(where[rows], spread[rows], where[other], spread[other], MOVES_M_S * apart)
            use = np.isfinite(d2) & ((rows + shift == other) & (apart <= 1.5 * max(NEIGHBOURS_S)))[:, None, None]
            votes = np.where(use, np.exp(-np.where(use, d2, 0.0) / SOFT), 0.0)
            score += (1.0 if shift == 0 else NEIGHBOUR_VOTE) * votes.sum(axis=2)
        best = np.argmax(np.where(np.isfinite(where[rows, :, 0]), score, -1.0), axis=1)
        own = np.arange(len(rows))
        d2 = _apart2(where[rows], spread[rows], where[rows], spread[rows], np.zeros(len(rows)))[own, best]
        with np.errstate(invalid="ignore"):
            agrees[rows] = d2 < FITS
        agrees[rows, best] = True
    return np.asarray(agrees[instant, column])


def mahalanobis_squared(place: Floats, covariance: Floats) -> Floats:
    """Return the squared Mahalanobis lengths (N,) of differences (N, 2) with covariances (N, 2, 2)."""
    return _mahalanobis2(place, covariance)


def _shifts(seconds: Floats) -> list[int]:
    """Return the instants to compare with, as differences of rows: the same, and some before and after."""
    if len(seconds) < 2:
        return [0]
    step = float(np.median(np.diff(seconds)))
    reach = sorted({max(1, round(wanted / step)) for wanted in NEIGHBOURS_S})
    return [0, *(sign * shift for shift in reach for sign in (-1, 1))]


def _apart2(place: Floats, covariance: Floats, other: Floats, other_covariance: Floats, moved: Floats) -> Floats:
    """Return squared Mahalanobis distances (T, C, C) between the boxes (T, C) and the others; NaN where one is missing."""
    difference = place[:, :, None] - other[:, None]
    spread = covariance[:, :, None] + other_covariance[:, None] + (moved**2)[:, None, None, None, None] * np.eye(2)
    return _mahalanobis2(difference, spread)


def _mahalanobis2(d: Floats, S: Floats) -> Floats:
    """Return the squared Mahalanobis lengths (...,) of differences (..., 2) with covariances (..., 2, 2)."""
    a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    x, y = d[..., 0], d[..., 1]
    with np.errstate(invalid="ignore"):
        return np.asarray((c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b))
