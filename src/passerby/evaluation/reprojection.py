"""Reprojection errors on annotated correspondences: RPE and ERR of Xu et al., CVPR 2021, section 5 (their Table 2).

A correspondence is one point of the world that an annotator marked in two or more pictures. Its place in the world is unknown,
so the measure needs no true cameras. Each point is triangulated from its marks with the estimated cameras (least squares over
the angles of all its rays), projected into each picture in which it is marked, and compared with the mark there. RPE is the
mean distance in pixels over all marks, ERR is RPE / min(height, width) of the pictures. An error that all cameras share (scale,
place) does not change them: they measure only the shape of the rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Observations
from passerby.geometry.triangulation import triangulate


@dataclass(frozen=True)
class Reprojection:
    """Errors of the cameras on annotated correspondences."""

    rpe_px: float
    """Mean distance between a mark and its point's projection. A distance is at most the picture's diagonal, which is also its
    value if there is no projection because the point lies behind the camera or the rays do not meet. Without this limit, a
    point near a camera's plane, whose projection can be arbitrarily far away, would dominate the mean."""
    err: float
    """RPE over the shortest side of any of the pictures; a fraction."""
    correspondences: int
    """Number of correspondences that are marked in two or more cameras with a pose."""
    lost: int
    """Number of other correspondences with two or more marks, where fewer than two of the cameras have a pose."""


def reprojection_error(rig: Rig, marks: Mapping[str, Floats]) -> Reprojection | None:
    """Compute RPE and ERR of an estimated rig; None if no two cameras with a pose have a correspondence in common.

    Args:
        rig: rig with poses; cameras without one are left out.
        marks: camera -> (N, 2) pixels of the correspondences in the distorted picture; NaN if not marked.

    Raises:
        InputError: cameras with different numbers of correspondences, or a camera that the rig lacks.
    """
    unknown = sorted(set(marks) - set(rig.names))
    if unknown:
        raise InputError(f"correspondences are marked in camera {unknown[0]}: the rig has {', '.join(rig.names)}")
    if len({len(pixels) for pixels in marks.values()}) > 1:
        raise InputError(
            "the cameras have different numbers of marks: give NaN for a correspondence that a camera does not see"
        )
    cameras = [camera for camera in rig if camera.name in marks and camera.pose is not None]
    if not cameras:
        return None
    pixels = np.stack([marks[camera.name] for camera in cameras])
    marked = np.asarray(np.isfinite(pixels).all(axis=2))
    judged = np.asarray(marked.sum(axis=0) >= 2)
    total = np.asarray(np.sum([np.isfinite(seen).all(axis=1) for seen in marks.values()], axis=0) >= 2)
    if not judged.any():
        return None
    index, point = np.nonzero(marked & judged)
    ray = np.concatenate([camera.lens.bearings(pixels[k][marked[k] & judged]) for k, camera in enumerate(cameras)])
    sound = np.isfinite(ray).all(axis=1)
    poses = [camera.pose for camera in cameras if camera.pose is not None]
    R, t = np.stack([pose.R_cw for pose in poses]), np.stack([pose.t_cw for pose in poses])
    places = triangulate(index[sound], point[sound], ray[sound], R, t, pixels.shape[1])
    errors = []
    for k, camera in enumerate(cameras):
        seen = marked[k] & judged
        distance = np.linalg.norm(camera.project(places[seen]) - pixels[k][seen], axis=1)
        errors.append(np.fmin(distance, np.hypot(*camera.lens.size)))
    rpe = float(np.concatenate(errors).mean())
    shortest = min(min(camera.lens.size) for camera in cameras)
    return Reprojection(rpe, rpe / shortest, int(judged.sum()), int((total & ~judged).sum()))


def median_residuals(rig: Rig, observations: Observations) -> dict[str, float]:
    """Compute the median reprojection error of each camera, pixels.

    Joints are used if two cameras share any, otherwise centres of boxes. Each is triangulated from all cameras that saw it.

    Args:
        rig: cameras without a pose are left out.
        observations: observations at common instants, with identities over all cameras.

    Returns:
        Camera -> median error, of each camera that shares a joint or a box with another one.
    """
    posed = [camera for camera in rig if camera.pose is not None and camera.name in observations.cameras]
    poses = [camera.pose for camera in posed if camera.pose is not None]
    for marks in (_joints, _centres):
        seen = [marks(observations[camera.name]) for camera in posed]
        if not any(len(pixels) for _, pixels in seen):
            continue
        index = np.repeat(np.arange(len(posed)), [len(pixels) for _, pixels in seen])
        keys, pixels = np.concatenate([key for key, _ in seen]), np.concatenate([pixels for _, pixels in seen])
        rays = np.concatenate([camera.lens.bearings(own[1]) for camera, own in zip(posed, seen, strict=True)])
        _, point, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        sound = np.isfinite(rays).all(axis=1) & (count[point] > 1)
        if not sound.any():
            continue
        index, point, pixels, rays = index[sound], point[sound], pixels[sound], rays[sound]
        R, t = np.stack([pose.R_cw for pose in poses]), np.stack([pose.t_cw for pose in poses])
        places = triangulate(index, point, rays, R, t, len(count))[point]
        medians = {}
        for k, camera in enumerate(posed):
            own = index == k
            miss = np.linalg.norm(camera.project(places[own]) - pixels[own], axis=1)
            if np.isfinite(miss).any():
                medians[camera.name] = float(np.nanmedian(miss))
        return medians
    return {}


def _centres(seen: CameraObservations) -> tuple[Ints, Floats]:
    """Return keys (N, 3) frame, identity, 0, and pixels (N, 2) of the centres of boxes."""
    boxes = seen.boxes.take(seen.boxes.identity > UNKNOWN)
    return np.column_stack([boxes.frame, boxes.identity, np.zeros_like(boxes.frame)]), boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2


def _joints(seen: CameraObservations) -> tuple[Ints, Floats]:
    """Return keys (N, 3) frame, identity, number of the joint, and pixels (N, 2) of the detected joints."""
    joints = seen.keypoints.take(seen.keypoints.identity > UNKNOWN)
    body, joint = np.nonzero(joints.score > 0)
    return np.column_stack([joints.frame[body], joints.identity[body], joint]), joints.xy[body, joint]
