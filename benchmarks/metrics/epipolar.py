"""How far matches between two pictures lie from the epipolar lines of the true cameras."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.geometry.two_view import essential_matrix

RIGHT_PX = 5.0
"""A match this near its epipolar line counts as right. Along the line it may still be wrong: about one wrong match in fifty is
counted as right by chance in a picture of 500 rows."""


def epipolar_distances(a: Camera, b: Camera, xy_a: Floats, xy_b: Floats) -> Floats:
    """How far each match lies from the epipolar line of its first place in the second picture.

    The distance is the angle between the second ray and the epipolar plane, times the focal length: pixels, also under a
    distortion, which bends the line.

    Args:
        a: the first camera, with its true pose.
        b: the second.
        xy_a: (N, 2) pixels, distorted.
        xy_b: (N, 2) pixels, distorted.

    Returns:
        (N,) pixels; infinite where a lens has no ray.

    Raises:
        InputError: a camera without a pose.
    """
    for camera in (a, b):
        if camera.pose is None:
            raise InputError(f"camera {camera.name} has no pose, and so no epipolar lines: give the true rig")
    assert a.pose is not None
    assert b.pose is not None
    R_ba = b.pose.R_cw @ a.pose.R_cw.T
    normal = a.lens.bearings(xy_a) @ essential_matrix(R_ba, b.pose.t_cw - R_ba @ a.pose.t_cw).T
    length = np.linalg.norm(normal, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = (normal * b.lens.bearings(xy_b)).sum(axis=1) / length
    angle = np.arcsin(np.clip(np.abs(sine), 0, 1))
    return np.where(np.isfinite(angle), angle * b.lens.focal, np.inf)
