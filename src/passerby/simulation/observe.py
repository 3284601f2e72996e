"""What a camera sees of the bodies: tight boxes, joints, and what is hidden or outside the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.observations import BODY_17
from passerby.simulation.body import body_spheres
from passerby.simulation.lenses import before_fold

Mask = NDArray[np.bool_]

NEAREST_M = 0.3
"""A person any part of whom is nearer to the image plane than this (or behind it) is not seen at all."""
PAIRS_AT_ONCE = 1024


@dataclass(frozen=True, eq=False)
class View:
    """What one camera sees, free of any detector's faults. T instants, P people."""

    box: Floats
    """(T, P, 4) left, top, right, bottom of the whole body, clipped at the picture's border, pixels."""
    visible_box: Floats
    """(T, P, 4) the same of the parts that no person hides; meaningless where everything is hidden."""
    clipped: Mask
    """(T, P, 4) edges that the picture's border cut."""
    inside: Floats
    """(T, P) share of the body inside the picture, 0 to 1; 0 for a person behind the camera."""
    hidden: Floats
    """(T, P) share of that part which is hidden by people nearer to the camera, 0 to 1."""
    joints: Floats
    """(T, P, 17, 2) COCO's joints, pixels."""
    joint_visible: Mask
    """(T, P, 17) inside the picture and not hidden by another person."""


def observe_camera(camera: Camera, joints: Floats, heights: Floats, present: Mask, occlusion: bool = True) -> View:
    """Project all bodies into one camera.

    Args:
        camera: with a pose.
        joints: (T, P, J, 3) world, metres, from `body.pose_joints`.
        heights: (P,) metres.
        present: (T, P) who is there.
        occlusion: whether people hide each other.
    """
    n_times, n_people = present.shape
    centres, radii = body_spheres(joints, heights)
    seen = _camera_frame(camera, centres)
    in_front = whole_in_view(camera, seen) & present
    seen = np.where(in_front[..., None, None], seen, np.array([0.0, 0.0, 1e3]))
    extents = _extents(camera, seen, np.broadcast_to(radii, seen.shape[:-1]))
    discs = camera.lens.project_rays(seen.reshape(-1, 3)).reshape((*seen.shape[:-1], 2))
    disc_radii = camera.lens.focal * radii / seen[..., 2]
    body_17 = _camera_frame(camera, joints[:, :, : len(BODY_17)])
    body_17 = np.where(in_front[..., None, None], body_17, np.array([0.0, 0.0, 1e3]))
    joint_px = camera.lens.project_rays(body_17.reshape(-1, 3)).reshape(n_times, n_people, len(BODY_17), 2)

    picture = np.array(camera.lens.size, dtype=np.float64)
    limits = np.array([*picture, *picture])
    whole = _hull(extents, np.ones(extents.shape[:-1], dtype=np.bool_))
    points = np.concatenate([discs, joint_px], axis=2)
    depth = np.where(in_front, np.linalg.norm(seen, axis=-1).mean(axis=-1), np.inf)
    covered = _covered(points, discs, disc_radii, whole, depth if occlusion else np.full_like(depth, np.inf))
    disc_covered, joint_covered = covered[:, :, : discs.shape[2]], covered[:, :, discs.shape[2] :]
    disc_inside = ((discs > 0) & (discs < picture)).all(axis=-1) & in_front[..., None]
    weight = np.broadcast_to(radii**2, discs.shape[:-1])
    inside = (weight * disc_inside).sum(axis=-1) / weight.sum(axis=-1)
    hidden = (weight * (disc_inside & disc_covered)).sum(axis=-1) / np.maximum((weight * disc_inside).sum(axis=-1), 1e-12)
    box = np.clip(whole, 0.0, limits)
    return View(
        box=box,
        visible_box=np.clip(_hull(extents, ~disc_covered), 0.0, limits),
        clipped=box != whole,
        inside=inside,
        hidden=hidden,
        joints=joint_px,
        joint_visible=((joint_px > 0) & (joint_px < picture)).all(axis=-1) & ~joint_covered & in_front[..., None],
    )


def whole_in_view(camera: Camera, seen: Floats) -> Mask:
    """(...) which bodies (..., points, 3), camera frame, are in front, and nowhere so far aside that the lens folds.

    What is beyond the fold of a lens would appear inside the picture, which no real lens does.
    """
    return np.asarray((seen[..., 2].min(axis=-1) - 0.12 > NEAREST_M) & before_fold(camera.lens, seen).all(axis=-1))


def _camera_frame(camera: Camera, points: Floats) -> Floats:
    pose = camera.pose
    if pose is None:
        raise InputError(f"camera {camera.name} has no pose: only a camera with a pose can see people")
    return np.asarray(points @ pose.R_cw.T + pose.t_cw)


def _extents(camera: Camera, centres: Floats, radii: Floats) -> Floats:
    """(..., 4) left, top, right, bottom of spheres given in the camera frame.

    The extreme x / z of a sphere lies where a plane through the camera's y axis touches it; that point is projected through
    the distorted lens (likewise for y). Exact without distortion; under mild distortion off by a hundredth of a pixel.
    """
    extremes = []
    for axis, sign in ((0, -1.0), (1, -1.0), (0, 1.0), (1, 1.0)):
        across, depth = centres[..., axis], centres[..., 2]
        angle = np.arctan2(across, depth) + sign * np.arcsin(np.minimum(radii / np.hypot(across, depth), 1.0))
        touch = centres.copy()
        touch[..., axis] += sign * radii * np.cos(angle)
        touch[..., 2] -= sign * radii * np.sin(angle)
        pixels = camera.lens.project_rays(touch.reshape(-1, 3))[:, axis]
        extremes.append(pixels.reshape(radii.shape))
    return np.stack(extremes, axis=-1)


def _hull(extents: Floats, use: Mask) -> Floats:
    """(T, P, 4) box around the extents (T, P, S, 4) of the spheres in use (T, P, S)."""
    low = np.where(use[..., None], extents[..., :2], np.inf).min(axis=2)
    high = np.where(use[..., None], extents[..., 2:], -np.inf).max(axis=2)
    return np.concatenate([low, high], axis=-1)


def _covered(points: Floats, discs: Floats, disc_radii: Floats, boxes: Floats, depth: Floats) -> Mask:
    """(T, P, S) which of the points (T, P, S, 2) lie behind a disc (T, P, D) of a person nearer to the camera."""
    overlap = (boxes[:, :, None, :2] < boxes[:, None, :, 2:]).all(axis=-1) & (
        boxes[:, :, None, 2:] > boxes[:, None, :, :2]
    ).all(axis=-1)
    time, back, front = np.nonzero(overlap & (depth[:, None, :] < depth[:, :, None]) & np.isfinite(depth)[:, :, None])
    covered = np.zeros(points.shape[:-1], dtype=np.bool_)
    for start in range(0, len(time), PAIRS_AT_ONCE):
        t, b, f = (index[start : start + PAIRS_AT_ONCE] for index in (time, back, front))
        apart = points[t, b][:, :, None].astype(np.float32) - discs[t, f][:, None].astype(np.float32)
        distance2 = apart[..., 0] ** 2 + apart[..., 1] ** 2
        behind = (distance2 < (disc_radii[t, f] ** 2).astype(np.float32)[:, None]).any(axis=-1)
        np.logical_or.at(covered, (t, b), behind)
    return covered
