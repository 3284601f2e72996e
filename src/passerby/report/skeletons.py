"""Joints that two cameras or more saw, in space and as they project again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import MIN_JOINT_SCORE, MIN_JOINTS, Observations
from passerby.geometry.groups import group_numbers
from passerby.geometry.ray_consensus import vote_points

TOLERANCE_PX, TOLERANCE_SHARE = 2.0, 0.05
"""Joints that agree lie within so many pixels, and this share of the person's height in the picture, of where they project:
five times what joints are usually off by."""


@dataclass(frozen=True, eq=False)
class Joints:
    """K joints as cameras saw them, and J in space."""

    camera: Ints
    """(K,) in the sample's rig."""
    frame: Ints
    """(K,) of the sample's clock."""
    identity: Ints
    """(K,)"""
    kind: Ints
    """(K,) which joint of the body, by its number in the files."""
    seen: Floats
    """(K, 2) pixels."""
    model: Floats
    """(K, 2) where the joint in space projects, pixels; NaN where two cameras do not agree on one."""
    agrees: Bools
    """(K,) whether the joint in space uses it."""
    point: Ints
    """(K,) rows of `xyz`."""
    xyz: Floats
    """(J, 3) metres, world; NaN where two cameras do not agree."""

    def __len__(self) -> int:
        return len(self.camera)


def joints_of(rig: Rig, observations: Observations) -> Joints:
    """The joints of all people with identities, triangulated instant by instant.

    Args:
        rig: cameras with poses.
        observations: at instants that the cameras share.
    """
    parts = [_rows(index, observations, camera.name) for index, camera in enumerate(rig)]
    index = np.concatenate([rows for rows, _ in parts])
    values = np.concatenate([found for _, found in parts])
    camera, frame, identity, kind = index.T
    xy, size = values[:, :2], values[:, 2]
    point = group_numbers(identity, frame, kind)
    n_points = int(point.max(initial=-1)) + 1
    xyz, agrees = np.full((n_points, 3), np.nan), np.zeros(len(camera), bool)
    bearing, tangent = np.full((len(camera), 3), np.nan), np.zeros((len(camera), 2, 3))
    for number, one in enumerate(rig):
        rows = np.flatnonzero(camera == number)
        bearing[rows] = one.lens.bearings(xy[rows])
        tangent[rows] = one.lens.tangents(bearing[rows])
    known = np.flatnonzero(np.isfinite(bearing).all(axis=1))
    if len(known):
        R = np.array([one.pose.R_cw for one in rig if one.pose is not None])
        centre = np.array([one.centre for one in rig])
        found = vote_points(
            camera[known], point[known], bearing[known], tangent[known], TOLERANCE_PX + TOLERANCE_SHARE * size[known], n_points,
            R, centre,
        )  # fmt: skip
        xyz, agrees[known] = found.points, found.inlier
    model = np.full((len(camera), 2), np.nan)
    for number, one in enumerate(rig):
        rows = np.flatnonzero((camera == number) & np.isfinite(xyz[point, 0]))
        model[rows] = one.project(xyz[point[rows]])
    return Joints(camera, frame, identity, kind, xy, model, agrees, point, xyz)


def _rows(camera: int, observations: Observations, name: str) -> tuple[Ints, Floats]:
    """Of one camera's joints: (K, 4) camera, frame, identity, kind; (K, 3) x, y, the person's height in the picture, pixels."""
    keypoints = observations[name].keypoints
    found = keypoints.score > MIN_JOINT_SCORE
    found &= (found.sum(axis=1) >= MIN_JOINTS)[:, None]
    row, kind = np.nonzero(found)
    y = keypoints.xy[:, :, 1]
    low, high = np.where(found, y, np.inf).min(axis=1, initial=np.inf), np.where(found, y, -np.inf).max(axis=1, initial=-np.inf)
    index = np.column_stack([np.full(len(row), camera), keypoints.frame[row], keypoints.identity[row], kind])
    return index.astype(np.int64), np.column_stack([keypoints.xy[row, kind], (high - low)[row]])
