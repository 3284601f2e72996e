"""The border of a camera's picture as rays: what drawings of a rig show of what a camera sees."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens

SIDE_SAMPLES = 8
"""Of each side of a picture: lenses bend its border."""
FLATTEST = 0.5
"""Cosine from the axis up to which a frustum ends in a plane, and beyond which (60 degrees) at one distance: the plane of a
fisheye lens lies at infinity."""


def border_rays(lens: Lens, samples: int = SIDE_SAMPLES) -> Floats:
    """(4 K, 3) unit rays of the picture's border, camera frame, clockwise from the first pixel's corner, K to a side.

    Where the lens model cannot be inverted, as in the black corners of a fisheye's picture, the ray of the point nearest to the
    border that can; NaN where there is none.
    """
    width, height = lens.size
    share = np.arange(samples) / samples
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    on_border = np.concatenate(
        [a + share[:, None] * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    middle = np.clip((lens.matrix[:2, 2] + 0.5) / (width, height), 0.05, 0.95)
    rays = np.full((len(on_border), 3), np.nan)
    for inward in np.linspace(1.0, 0.05, 39):
        rows = np.flatnonzero(np.isnan(rays[:, 0]))
        if not len(rows):
            break
        # The picture reaches half a pixel beyond the centres of its outermost pixels.
        rays[rows] = lens.bearings((middle + inward * (on_border[rows] - middle)) * (width, height) - 0.5)
    return rays


def frustum_rim(lens: Lens, depth: float, samples: int = SIDE_SAMPLES) -> Floats:
    """(4 K, 3) the border of the picture held before the camera, camera frame, metres: flat, `depth` in front; wider lenses'
    bent back. Rows as of `border_rays`.
    """
    rays = border_rays(lens, samples)
    return np.asarray(depth * rays / np.maximum(rays[:, 2:], FLATTEST))
