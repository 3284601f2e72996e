"""Linear systems: inverses of symmetric matrices with null directions, and many small systems at once.

Up to `FULL_UP_TO` rows all eigenvalues are worked out; beyond, that takes ten times as long as an inverse by Cholesky's
factor, and only the smallest ones are looked at, by shifted inverse iteration (Lanczos).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from passerby.common.arrays import Floats

FULL_UP_TO = 800
_SMALLEST = 8
"""So many of the smallest eigenvalues are looked at; where all of them are null, all eigenvalues are."""


def pseudo_inverse(matrix: Floats, null_share: float) -> Floats:
    """(n, n) the inverse; 0 along the null vectors.

    Args:
        matrix: (n, n) symmetric, without eigenvalues below 0 but for rounding.
        null_share: eigenvalues below this share of the largest one are zero.
    """
    if len(matrix) <= FULL_UP_TO:
        return np.asarray(np.linalg.pinv(matrix, rcond=null_share, hermitian=True))
    null = null_vectors(matrix, null_share)
    level = np.trace(matrix) / len(matrix)
    try:
        root = np.linalg.cholesky(matrix + null @ (level * np.eye(null.shape[1]) - null.T @ matrix @ null) @ null.T)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, rcond=null_share, hermitian=True))
    inverse, failed = scipy.linalg.lapack.dpotri(root, lower=1)
    assert not failed
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    return np.asarray(inverse - null @ null.T / level)


def inverse_of(H: Floats) -> Floats:
    """The inverse of a normal matrix whose unknowns have different units; 0 along what is free (the datum)."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-12))
    return pseudo_inverse(H * scale[:, None] * scale, 1e-12) * scale[:, None] * scale


def null_vectors(matrix: Floats, null_share: float) -> Floats:
    """(n, k) orthonormal eigenvectors whose eigenvalues are zero, as of `pseudo_inverse`."""
    if len(matrix) > FULL_UP_TO:
        value, vector, largest = _find_smallest(matrix, null_share)
        null = value < null_share * largest
        if not null.all():
            return np.asarray(vector[:, null])
    value, vector = np.linalg.eigh(matrix)
    return np.asarray(vector[:, value < null_share * value[-1]])


def _find_smallest(matrix: Floats, null_share: float) -> tuple[Floats, Floats, float]:
    """The smallest eigenvalues (k,), their vectors (n, k), and the largest eigenvalue."""
    n = len(matrix)
    start = np.random.default_rng(0).standard_normal(n)
    largest = float(scipy.sparse.linalg.eigsh(matrix, k=1, which="LA", v0=start, tol=1e-6, return_eigenvectors=False)[0])
    shift = null_share * largest
    try:
        factor = scipy.linalg.cho_factor(matrix + shift * np.eye(n), lower=True, check_finite=False)
    except np.linalg.LinAlgError:  # negative by more than rounding
        return np.zeros(1), np.zeros((n, 1)), largest
    solve = scipy.sparse.linalg.LinearOperator(
        (n, n), matvec=lambda x: scipy.linalg.cho_solve(factor, x, check_finite=False), dtype=np.float64
    )
    value, vector = scipy.sparse.linalg.eigsh(matrix, k=_SMALLEST, sigma=-shift, OPinv=solve, v0=start)
    return value, vector, largest


def solve_symmetric(matrix: Floats, right: Floats) -> Floats:
    """Solutions of symmetric positive definite systems of three unknowns, by square-root-free Cholesky factors.

    `np.linalg.solve` takes several times as long for thousands of them.

    Args:
        matrix: (6, N) entries 00, 01, 02, 11, 12, 22.
        right: (3, N) right sides.

    Returns:
        (3, N)
    """
    a, b, c, d, e, f = matrix
    l10, l20 = b / a, c / a
    second = d - l10 * b
    l21 = (e - l20 * b) / second
    third = f - l20 * c - l21 * (e - l20 * b)
    y1 = right[1] - l10 * right[0]
    y2 = right[2] - l20 * right[0] - l21 * y1
    z = y2 / third
    y = y1 / second - l21 * z
    return np.array([right[0] / a - l10 * y - l20 * z, y, z])
