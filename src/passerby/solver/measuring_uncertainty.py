"""Uncertainty of measurements with a rig: points that several cameras see, and places on the ground that one camera sees.

A wrong principal point and an opposite rotation of the camera nearly cancel for every point that it measures. The sigmas of
poses and of intrinsics, each alone, are therefore no measure of the rig's accuracy in use. Here the covariance of the complete
cameras, with all correlations, is propagated to the places where people walked:

- *points*: up to 1.8 m above these places, triangulated by all cameras that see them;
- *ground*: the places themselves, where one camera's ray meets z = 0;
- *across*: the distance at which a camera's rays pass beside the points.

To first order, the estimated camera with parameter errors `d` sees a point X at X', with `J_X (X' - X) + J d = 0`. As in
`core.measuring`, one similarity of the whole rig is subtracted, the least-squares one of the points; for a rig joined from
groups, one of each group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.measuring import HEIGHTS_M, CameraMeasuring, MeasuringFigures, MeasuringSigma, points_above
from passerby.solver.gauge import Free
from passerby.solver.systematic import LOWER_EDGE
from passerby.solver.uncertainty import COMPLETE

MOST_PLACES, NEAR_M = 200, 2.0
"""Largest number of places of each group of cameras, and largest distance of a place from where a camera saw people, metres."""
LEAST_CROSSING = 1e-9
"""Smallest ratio of the information along a point's rays to that across them: rays that cross at a hundredth of a degree."""


@dataclass(frozen=True, eq=False)
class _Views:
    """The view of N points by one camera, in the world of the adjustment."""

    seen: Bools
    """(N,) whether the camera sees the point."""
    by_point: Floats
    """(N, 2, 3) derivative of the pixel by the point, pixels a metre; 0 where it is not seen."""
    by_camera: Floats
    """(N, 2, 10) derivative of the pixel by the parameters of the complete camera; 0 where the point is not seen."""

    @classmethod
    def of(cls, camera: Camera, points: Floats, near: Bools) -> _Views:
        """Compute the view of a camera with a pose; of points (N, 3), it sees only those `near` (N,) places with people."""
        pose = camera.pose
        assert pose is not None
        seen = near & np.isfinite(camera.project(points)).all(axis=1)
        pixels = np.nan_to_num(camera.project(points), nan=-1.0)
        seen &= ((pixels >= 0) & (pixels <= np.array(camera.lens.size) - 1.0)).all(axis=1)
        d = points @ pose.R_cw.T + pose.t_cw
        distance = np.linalg.norm(d, axis=1)
        ray = d / np.maximum(distance, 1e-9)[:, None]
        by_ray = np.zeros((len(points), 2, 3))
        by_ray[seen] = camera.lens.tangents(ray[seen])
        by_d = by_ray / np.maximum(distance, 1e-9)[:, None, None]
        by_camera = np.zeros((len(points), 2, COMPLETE))
        by_camera[:, :, :3] = -by_d @ pose.R_cw
        # A rotation vector w moves the point in the camera's frame by w x d.
        by_camera[:, :, 3:6] = np.cross(d[:, None], by_d)
        by_camera[seen, :, 6:] = camera.lens.by_intrinsics(ray[seen])
        return cls(np.asarray(seen), by_d @ pose.R_cw, np.nan_to_num(by_camera))


def measuring_uncertainty(
    rig: Rig, complete: Floats, people: Floats, seen: Bools, person_height_m: float, free: Free,
    groups: Sequence[Sequence[int]] = (),
) -> MeasuringFigures | None:  # fmt: skip
    """Compute the uncertainty of measurements with a rig where people walked.

    A camera is used only near the places where it saw people: by geometry alone, places behind the walls of a hall are in its
    image too. Groups of cameras that were separate rigs measure separately; the uncertainty of their relative pose is in the
    poses' sigmas.

    Args:
        rig: C cameras with poses; world of the adjustment, z up, the ground at z = 0, metres.
        complete: (10 C, 10 C) covariance of the complete cameras (`RigCovariance.complete`).
        people: (N, 2) places of people on the ground, metres.
        seen: (C, N) whether each camera saw people there.
        person_height_m: typical height of these people, metres.
        free: parts of the solution that no evidence constrains.
        groups: numbers in the rig of the cameras of each separate rig; empty: all cameras are one rig.

    Returns:
        The figures; None where cameras are unconstrained, or fewer than two see the places.
    """
    if free.cameras or not len(people):
        return None
    root, sees_ground = _root(complete, len(rig)), not (free.vertical or free.ground)
    found, count = list[_Measured](), 0
    for group in [list(one) for one in groups] or [list(range(len(rig)))]:
        rows = np.flatnonzero(seen[group].any(axis=0))
        if not len(rows):
            continue
        rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_PLACES)).round().astype(np.int64)]
        near = np.array([_near(people[rows], people[seen[c]]) for c in group])
        one = _measured([rig.cameras[c] for c in group], root[group], people[rows], near, sees_ground=sees_ground)
        found += [] if one is None else [one]
        count += len(rows)
    if not found:
        return None
    grounds = [ground for one in found for ground in one.grounds]
    return MeasuringFigures(
        places=count, points=MeasuringSigma.of(np.concatenate([one.points for one in found])),
        ground=MeasuringSigma.of(np.concatenate(grounds)) if grounds else None,
        ground_height_mm=1000 * LOWER_EDGE * person_height_m if sees_ground else None,
        cameras={name: measuring for one in found for name, measuring in one.cameras.items()},
    )  # fmt: skip


def _near(places: Floats, seen: Floats) -> Bools:
    """Return whether a camera that saw people at `seen` (K, 2) saw some near each of the places (P, 2)."""
    if not len(seen):
        return np.zeros(len(places), dtype=bool)
    return np.isfinite(KDTree(seen).query(places, distance_upper_bound=NEAR_M)[0])


@dataclass(frozen=True, eq=False)
class _Measured:
    """One sigma of measurements by a group of cameras, metres."""

    points: Floats
    """(N,) one sigma of points that two or more of them see."""
    grounds: list[Floats]
    """One sigma (M,) of the places that each camera sees."""
    cameras: dict[str, CameraMeasuring]


def _measured(group: Sequence[Camera], root: Floats, places: Floats, near: Bools, *, sees_ground: bool) -> _Measured | None:
    """Compute the sigmas at places (P, 2), where each camera saw people `near` (C, P); None if no two cameras see them."""
    points = points_above(places)
    views = [_Views.of(camera, points, np.tile(own, len(HEIGHTS_M))) for camera, own in zip(group, near, strict=True)]
    known = (np.sum([view.seen for view in views], axis=0) > 1) & _determined(views)
    if np.count_nonzero(known) < len(HEIGHTS_M):
        return None
    moved = _triangulated(views, known, root)
    basis = _similarities(points)
    fit = np.linalg.lstsq(basis[known].reshape(-1, 7), moved[known].reshape(-1, root.shape[2]), rcond=None)[0]
    of_points = np.zeros(len(points))
    of_points[known] = _sigmas(moved[known] - basis[known] @ fit)
    cameras, grounds = {}, []
    for camera, view, own in zip(group, views, root, strict=True):
        both, on = view.seen & known, np.flatnonzero(view.seen[: len(places)])
        if not both.any():
            continue
        ground = reach = None
        if len(on) and sees_ground:
            reach = float(np.median(np.linalg.norm(places[on] - camera.centre[:2], axis=1)) / abs(camera.centre[2]))
            grounds.append(_sigmas(_on_ground(view, own, on) - (basis[on] @ fit)[:, :2]))
            ground = MeasuringSigma.of(grounds[-1])
        across = MeasuringSigma.of(_sigmas(_beside(view, own, basis @ fit, both)))
        cameras[camera.name] = CameraMeasuring(
            points=MeasuringSigma.of(of_points[both]), across=across, ground=ground, reach=reach
        )  # fmt: skip
    return _Measured(of_points[known], grounds, cameras)


def _root(complete: Floats, n_cameras: int) -> Floats:
    """Return a root (C, 10, 10 C) of the cameras' covariance."""
    value, vector = np.linalg.eigh(0.5 * (complete + complete.T))
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))).reshape(n_cameras, COMPLETE, -1))


def _determined(views: list[_Views]) -> Bools:
    """Return whether the rays of each point (N,) cross; they do not if all its cameras are at one place."""
    value = np.linalg.eigvalsh(np.sum([np.swapaxes(view.by_point, 1, 2) @ view.by_point for view in views], axis=0))
    return np.asarray(value[:, 0] > LEAST_CROSSING * value[:, 2])


def _triangulated(views: list[_Views], known: Bools, root: Floats) -> Floats:
    """Return the displacements (N, 3, K) of points by the K independent errors of the cameras; 0 for points not `known`."""
    J = np.stack([view.by_point for view in views])
    normal = np.einsum("cnki,cnkj->nij", J, J)
    normal[~known] = np.eye(3)
    right = np.zeros((len(known), 3, root.shape[2]))
    for view, own in zip(views, root, strict=True):
        right += np.swapaxes(view.by_point, 1, 2) @ (view.by_camera @ own)
    right[~known] = 0.0
    return np.asarray(-np.linalg.solve(normal, right))


def _similarities(points: Floats) -> Floats:
    """Return the displacements (N, 3, 7) of points (N, 3) by the freedoms of a similarity."""
    about = points - points.mean(axis=0)
    out = np.zeros((len(points), 3, 7))
    out[:, :, :3] = np.eye(3)
    for axis in range(3):
        out[:, :, 3 + axis] = np.cross(np.eye(3)[axis], about)
    out[:, :, 6] = about
    return out


def _on_ground(view: _Views, own: Floats, on: Ints) -> Floats:
    """Return the displacements (M, 2, K), on the ground z = 0, of the places (M rows) that a camera sees."""
    return np.asarray(-np.linalg.pinv(view.by_point[on][:, :, :2]) @ (view.by_camera[on] @ own))


def _beside(view: _Views, own: Floats, fitted: Floats, both: Bools) -> Floats:
    """Return the displacements (M, 3, K) of a camera's rays beside the points: the smallest ones that explain its pixels."""
    pixels = view.by_camera[both] @ own + view.by_point[both] @ fitted[both]
    return np.asarray(np.linalg.pinv(view.by_point[both]) @ pixels)


def _sigmas(moved: Floats) -> Floats:
    """Return the root mean square lengths (M,) of displacements (M, d, K), metres."""
    return np.asarray(np.sqrt((moved**2).sum(axis=(1, 2))))
