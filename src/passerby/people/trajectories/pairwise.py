"""Tracking as in Xu, Li, Weng, Kitani, CVPR 2021: the mean of the pairwise triangulations of the box centres."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.geometry.triangulation import depths, triangulate_two_views


def pairwise_points(cameras: Sequence[Camera], ltwh: Floats) -> tuple[Floats, Floats]:
    """Triangulate the body middles of one person.

    Args:
        cameras: C cameras with poses.
        ltwh: (T, C, 4) the person's boxes, pixels; NaN where a camera does not see the person.

    Returns:
        (T, 3) mean over the pairs of cameras, world, metres, NaN with fewer than two cameras; (T,) root mean square distance
        of the pairs' points from it on the ground plane, NaN with a single pair.
    """
    middle = ltwh[:, :, :2] + ltwh[:, :, 2:] / 2
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(middle).all(axis=2))
    rays = np.full((*seen.shape, 3), np.nan)
    for c, camera in enumerate(cameras):
        rays[seen[:, c], c] = camera.lens.bearings(middle[seen[:, c], c])
    total, square, count = np.zeros((len(seen), 3)), np.zeros(len(seen)), np.zeros(len(seen))
    for a, b in combinations(range(len(cameras)), 2):
        rows = np.flatnonzero(np.isfinite(rays[:, [a, b]]).all(axis=(1, 2)))
        if not len(rows):
            continue
        pose_a, pose_b = cameras[a].pose, cameras[b].pose
        assert pose_a is not None
        assert pose_b is not None
        R_ba = pose_b.R_cw @ pose_a.R_cw.T
        t_ba = pose_b.t_cw - R_ba @ pose_a.t_cw
        point_a = triangulate_two_views(rays[rows, a], rays[rows, b], R_ba, t_ba)
        with np.errstate(invalid="ignore"):
            in_front = (depths(point_a, rays[rows, a]) > 0) & (depths(point_a @ R_ba.T + t_ba, rays[rows, b]) > 0)
        rows = rows[in_front]
        point = (point_a[in_front] - pose_a.t_cw) @ pose_a.R_cw
        total[rows] += point
        square[rows] += (point[:, :2] ** 2).sum(axis=1)
        count[rows] += 1
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count[:, None]
        spread = np.sqrt(np.maximum(square / count - (mean[:, :2] ** 2).sum(axis=1), 0.0))
    return mean, np.where(count > 1, spread, np.nan)
