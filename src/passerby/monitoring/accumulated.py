"""Where cameras are by all the footage at once: the scores of boxes, or the windows that were adjusted, added up.

Both are a sum of squares that is quadratic in small changes of the poses. Its minimum is an estimate of the rig, which
`comparison.compare` compares with what was known before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.geometry.rotations import exp_rotation
from passerby.monitoring.comparison import FEWEST_STRETCHES, Estimate
from passerby.monitoring.evidence import model_covariance
from passerby.people.resection import FEWEST_CLUSTERS, cluster_robust_covariance
from passerby.people.scores import Scores

RIDGE = 1e-6
"""Share of the diagonal that is added to it: position, heading and scale of the whole rig are free."""


@dataclass(frozen=True, eq=False)
class Part:
    """What a window shows that was adjusted: C cameras, relative to the rig's poses."""

    from_s: float
    until_s: float
    shift: Floats
    """(6 C,)"""
    information: Floats
    """(6 C, 6 C) nothing along similarities."""
    stretches: Floats
    """(C,) of people."""


def estimate_by_scores(R: Floats, centre: Floats, scores: Scores) -> Estimate | None:
    """By boxes. Each stretch of a person counts once, and their scatter is in the covariance.

    Args:
        R: (C, 3, 3) the poses about which the scores are: world to camera,
        centre: (C, 3) and centres, metres.
        scores: of the footage.

    Returns:
        The estimate; None where fewer than two cameras have enough stretches.
    """
    stretches = np.count_nonzero(scores.counts, axis=0)
    cameras = np.flatnonzero(stretches >= FEWEST_CLUSTERS)
    if len(cameras) < 2:
        return None
    normal = _with_ridge(scores.information.sum(axis=0), cameras)
    own = _rows(cameras)
    gradient = scores.gradient[:, own]
    shift = np.linalg.solve(normal, gradient.sum(axis=0))
    residual = gradient - scores.information[:, own][:, :, own] @ shift
    inverse = np.linalg.inv(normal)
    covariance = inverse @ cluster_robust_covariance(residual, normal)[0] @ inverse
    return _estimate(R, centre, cameras, shift, covariance, stretches)


def estimate_by_parts(R: Floats, centre: Floats, parts: Sequence[Part]) -> Estimate | None:
    """By windows that were adjusted. Where they differ by more than they state, that is in the covariance.

    Args:
        R: (C, 3, 3) the poses relative to which the windows' shifts are: world to camera,
        centre: (C, 3) and centres, metres.
        parts: windows without overlap.

    Returns:
        The estimate; None where fewer than two cameras have enough stretches.
    """
    stretches = np.floor(np.sum([one.stretches for one in parts], axis=0) + 1e-9).astype(np.int64)
    cameras = np.flatnonzero(stretches >= FEWEST_STRETCHES)
    if len(cameras) < 2:
        return None
    own = _rows(cameras)
    information = [one.information[np.ix_(own, own)] for one in parts]
    normal = _with_ridge(np.sum([one.information for one in parts], axis=0), cameras)
    shift = np.linalg.solve(
        normal, np.sum([known @ one.shift[own] for known, one in zip(information, parts, strict=True)], axis=0)
    )
    inverse = np.linalg.inv(normal)
    misfit = sum(
        float((one.shift[own] - shift) @ known @ (one.shift[own] - shift))
        for known, one in zip(information, parts, strict=True)
    )
    left = sum(np.linalg.matrix_rank(known, hermitian=True, tol=RIDGE * np.trace(known)) for known in information)
    left -= int(np.linalg.matrix_rank(np.sum(information, axis=0), hermitian=True, tol=RIDGE * np.trace(normal)))
    return _estimate(R, centre, cameras, shift, max(1.0, misfit / max(left, 1)) * inverse, stretches)


def _rows(cameras: Ints) -> Ints:
    """(6 K,) unknowns of cameras (K,)."""
    return np.asarray((6 * cameras[:, None] + np.arange(6)).ravel())


def _with_ridge(information: Floats, cameras: Ints) -> Floats:
    """(6 K, 6 K) of some cameras (K,), invertible."""
    own = _rows(cameras)
    known = information[np.ix_(own, own)]
    return np.asarray(known + RIDGE * np.diag(np.diag(known)))


def _estimate(
    R: Floats, centre: Floats, cameras: Ints, shift: Floats, covariance: Floats, stretches: Ints
) -> Estimate:  # fmt: skip
    """The poses after small changes (6 K,) of the cameras (K,)."""
    n, change = len(cameras), shift.reshape(-1, 6)
    turned = np.array([exp_rotation(own[3:]) @ old for own, old in zip(change, R[cameras], strict=True)])
    placed = centre[cameras] + change[:, :3]
    # In all the footage as in each window, people seem to move a camera by so much.
    return Estimate(cameras, turned, placed, covariance + np.kron(np.eye(n), model_covariance()), stretches[cameras])
