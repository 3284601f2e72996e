"""Linear systems: inverses of symmetric matrices with null directions, and many small systems at once.

Up to `FULL_UP_TO` rows all eigenvalues are computed. For larger matrices this takes ten times as long as an inverse by the
Cholesky factor. So only the smallest eigenvalues are computed there, by shifted inverse iteration (Lanczos).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from passerby.common.arrays import Floats

FULL_UP_TO = 800
_SMALLEST = 8
"""Number of the smallest eigenvalues that are computed; if all of them are zero, all eigenvalues are computed."""


def pseudo_inverse(matrix: Floats, null_share: float) -> Floats:
    """Compute the inverse (n, n) of a matrix; it is 0 along the null vectors.

    Args:
        matrix: (n, n) symmetric, with no eigenvalues below 0 except by rounding.
        null_share: eigenvalues below this share of the largest one count as zero.
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
    """Compute the inverse (n, n) of a normal matrix whose unknowns differ in units; 0 along the free directions (the datum)."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-12))
    return pseudo_inverse(H * scale[:, None] * scale, 1e-12) * scale[:, None] * scale


def null_vectors(matrix: Floats, null_share: float) -> Floats:
    """Compute the orthonormal eigenvectors (n, k) whose eigenvalues are zero in the sense of `pseudo_inverse`."""
    if len(matrix) > FULL_UP_TO:
        value, vector, largest = _find_smallest(matrix, null_share)
        null = value < null_share * largest
        if not null.all():
            return np.asarray(vector[:, null])
    value, vector = np.linalg.eigh(matrix)
    return np.asarray(vector[:, value < null_share * value[-1]])


def _find_smallest(matrix: Floats, null_share: float) -> tuple[Floats, Floats, float]:
    """Compute the smallest eigenvalues (k,), their eigenvectors (n, k), and the largest eigenvalue."""
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
    """Solve N symmetric positive definite systems of three unknowns, by square-root-free Cholesky factors.

    `np.linalg.solve` takes several times as long for thousands of systems.

    Args:
        matrix: (6, N) entries 00, 01, 02, 11, 12, 22.
        right: (3, N) right-hand sides.

    Returns:
        Solutions (3, N).
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
