"""Points and polygons in an image."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from passerby.common.arrays import Bools, Floats


def inside_any(points: Floats, polygons: Iterable[Floats]) -> Bools:
    """Which points lie in one polygon or more.

    Args:
        points: (N, 2); a point with NaN lies in none.
        polygons: (K, 2) corners each, in either direction; a polygon that crosses itself has holes (the even-odd rule).

    Returns:
        (N,)
    """
    found = np.zeros(len(points), dtype=np.bool_)
    for corners in polygons:
        found |= _inside(points, corners)
    return found


def _inside(points: Floats, corners: Floats) -> Bools:
    """By the even-odd rule: a ray to the right crosses the sides an odd number of times."""
    x, y = points[:, :1], points[:, 1:]
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    crosses = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.asarray((crosses & (x < at)).sum(axis=1) % 2 == 1)
