"""Many small systems of equations at once, laid out by component: every operation works on all of them."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats


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
