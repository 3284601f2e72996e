"""Pixels and the points of the ground z = 0 that they show, through a camera's own lens."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera


def ground_points(camera: Camera, pixels: Floats) -> Floats:
    """Where the rays of pixels meet the ground.

    Args:
        camera: with a pose; world z up, ground at z = 0, metres.
        pixels: (N, 2), as the picture has them, distortion and all.

    Returns:
        (N, 2) world x and y, metres; NaN for a ray that does not meet the ground ahead of the camera.
    """
    assert camera.pose is not None
    rays = camera.lens.bearings(pixels) @ camera.pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -camera.centre[2] / rays[:, 2]
        points = camera.centre[:2] + far[:, None] * rays[:, :2]
    return np.asarray(np.where((far > 0)[:, None] & np.isfinite(points), points, np.nan), dtype=np.float64)
