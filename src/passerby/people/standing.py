"""Instants at which people stand, so that their highest point is at standing height.

People crouch, bend and sit; they do not grow. So the standing height is not the mean of the observed heights but their
highest frequent value, even for a person who crouches most of the time.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats, Ints

KERNEL = 0.025
"""Width of the kernel on heights, as a share: box noise over two or more views."""
SIGNIFICANT = 0.35
"""A mode counts as frequent when its density is at least this share of the highest mode's."""
NEAR = 0.06
"""Largest difference from the mode for standing, as a share: below it people are bent, above it they jump or raise an arm."""
MIN_INSTANTS = 8


def standing_share(ratio: Floats) -> float:
    """Return the highest frequent value of a person's heights; `ratio` (N,) are shares of the height assumed so far."""
    grid = np.arange(0.4, 1.41, 0.005)
    centred = (grid[:, None] - ratio[None, :]) / KERNEL
    density = np.exp(-0.5 * centred**2).sum(axis=1)
    inner = density[1:-1]
    peak = np.flatnonzero((inner >= density[:-2]) & (inner > density[2:])) + 1
    if len(peak) == 0:
        return float(np.median(ratio))
    frequent = peak[density[peak] >= SIGNIFICANT * density[peak].max()]
    return float(grid[frequent.max()])


def standing_instants(extent: Floats, height: Floats, person: Ints) -> Floats:
    """Return (N,) 1 where a person may be standing, 0 where bent, crouching, sitting or reaching up.

    Args:
        extent: (N,) distance from the lowest to the highest point, metres.
        height: (N,) the person's standing height as assumed so far, metres.
        person: (N,) person of each instant.
    """
    ratio = extent / height
    out = np.ones(len(ratio))
    everyone = standing_share(ratio) if len(ratio) >= MIN_INSTANTS else 1.0
    for index in np.unique(person):
        own = person == index
        share = standing_share(ratio[own]) if np.count_nonzero(own) >= MIN_INSTANTS else everyone
        out[own] = np.abs(ratio[own] - share) < NEAR
    return out
