"""The upright body: positions of its two ends, and the equations of its sightings, linearised about a guess.

World: z up. A body stands at (x, y), and reaches from its lowest to its highest point. Its lowest visible point is nearer to
the camera than its axis. Two rays, of its highest and of its lowest point, give three equations that are linear once the
distances along the rays are known: two of the *centre* between both, across and up the picture, with a small sigma, and one of
the *size*, with a large sigma, since a detector's slack moves both edges apart and does not move the centre.

The fits with held cameras use these equations: `held_cameras` (monitoring, resection), `upright_bodies` (report) and
`trajectories` (tracking). The solver's person model shares only the ends (`body_ends`): its residuals are in pixels, and the
cameras' lenses, clocks and slack are among its unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.people.model import Priors
from passerby.people.sightings import Sightings

LOW, HIGH = 2, 3
"""Columns of a body after its position (x, y): its lowest and its highest point above the ground, metres."""
HORIZON = 0.02
"""Sine of the angle below the horizontal under which rays are not intersected with the ground."""
NEAREST_M = 0.3
"""Least distance of a person from a camera: it keeps the equations finite where a guess is far off."""
ROUNDS = 4
"""Iterations of a body's position; the first distance is from the box's size. The fourth moves no person by a millimetre."""
SHORTEST_SHARE, LONGEST_SHARE = 0.3, 1.3
"""Limits of a body's highest point during these iterations, as shares of the usual height."""
STANCE_SD = Priors().high
"""Standard deviation of the highest point, as a share of the standing height: gait, a bent neck, shoes."""


def body_ends(
    centre: Floats, body: Floats, moved: Floats, top_fraction: Floats | float = 1.0, bottom_fraction: Floats | float = 0.0
) -> tuple[Floats, Floats, Floats, Floats]:
    """Compute the highest and the lowest point of upright bodies that cameras see.

    Args:
        centre: (M, 3) of the cameras, metres.
        body: (M, 4) x, y, height of the lowest and of the highest point, metres.
        moved: (M, 1) distance by which the lowest visible point is nearer to the camera than the body's axis, metres.
        top_fraction: (M,) height of the highest point on the body, as a share of the body's height.
        bottom_fraction: (M,) the same of the lowest point.

    Returns:
        (M, 3) highest points; (M, 3) lowest points; (M, 2) unit vectors over the ground to the cameras; (M,) distances there.
    """
    length = body[:, HIGH] - body[:, LOW]
    top = np.column_stack([body[:, :2], body[:, LOW] + top_fraction * length])
    toward = centre[:, :2] - body[:, :2]
    distance = np.maximum(np.linalg.norm(toward, axis=1), 0.1)
    toward = toward / distance[:, None]
    bottom = np.column_stack([body[:, :2] + moved * toward, body[:, LOW] + bottom_fraction * length])
    return top, bottom, toward, distance


def by_low_and_high(by_point: Floats, fraction: Floats) -> Floats:
    """Chain (M, k, 3) derivatives by a point on the body's axis to (M, k, 4) by x, y, low and high.

    Args:
        by_point: derivatives by the point, metres.
        fraction: (M,) height of the point on the body, as a share of the body's height.
    """
    by_z = by_point[:, :, 2:]
    return np.concatenate([by_point[:, :, :2], by_z * (1 - fraction)[:, None, None], by_z * fraction[:, None, None]], axis=2)


@dataclass(frozen=True, eq=False)
class BodyEquations:
    """Three whitened equations of each of N sightings: across, up, and size.

    After changes of the body and of the camera the residual is `residual - by_body d(body) - by_camera d(camera)`.
    """

    by_body: Floats
    """(N, 3, 4) derivatives by x, y, height of the ground, height of the body, metres."""
    residual: Floats
    """(N, 3) in sigmas."""
    by_top: Floats
    """(N, 3, 3) derivatives by the highest point, metres, world."""
    by_bottom: Floats
    """(N, 3, 3) derivatives by the lowest point, metres, world."""
    top: Floats
    """(N, 3) vector from the camera to the highest point, metres, world."""
    bottom: Floats
    """(N, 3) the same to the lowest point."""
    distance: Floats
    """(N,) metres along the rays to the body's middle."""

    def by_camera(self, rotation: Floats) -> Floats:
        """Return derivatives (N, 3, 6) by the camera: centre (metres, world), rotation vector w (radians, camera frame).

        The rotation R becomes exp(w) R.

        Args:
            rotation: (N, 3, 3) world to camera, of the camera of each sighting.
        """
        turning = np.cross(self.top[:, None], self.by_top) + np.cross(self.bottom[:, None], self.by_bottom)
        return np.concatenate([-self.by_body[:, :, :3], turning @ rotation.transpose(0, 2, 1)], axis=2)


def linearise_bodies(seen: Sightings, body: Floats, moved: Floats) -> BodyEquations:
    """Linearise the equations of sightings, rays in the world's frame, about bodies.

    The rows are linearised about the observed rays. The observed size is the angle between them, so that it adds no constant.

    Args:
        seen: N sightings.
        body: (N, 4) the body of each: x, y, height of the ground, height of the body, metres.
        moved: (N, 1), or one for all: distance by which the lowest visible point is nearer to the camera than the axis, metres.
    """
    low_and_high = np.column_stack([body[:, :3], body[:, 2] + body[:, 3]])
    ends = body_ends(seen.origin, low_and_high, moved, seen.top_fraction, seen.bottom_fraction)[:2]
    axes, reach, along = [], (ends[0] - seen.origin, ends[1] - seen.origin), []
    for ray, end in zip((seen.top, seen.bottom), reach, strict=True):
        across = np.column_stack([-ray[:, 1], ray[:, 0], np.zeros(len(ray))])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        along.append(np.maximum((end * ray).sum(axis=1), NEAREST_M))
        axes.append(np.stack([across, np.cross(ray, across)], axis=1) / along[-1][:, None, None])
    tight, loose = (0.5 / seen.centre_sd)[:, None, None], (1 / seen.size_sd)[:, None, None]
    by_top, by_bottom = (
        np.concatenate([one * tight, sign * one[:, 1:] * loose], axis=1) for one, sign in zip(axes, (1, -1), strict=True)
    )
    residual = -((by_top @ reach[0][:, :, None]) + (by_bottom @ reach[1][:, :, None]))[:, :, 0]
    by_height = seen.top_fraction[:, None] * by_top[:, :, 2] + seen.bottom_fraction[:, None] * by_bottom[:, :, 2]
    by_body = np.concatenate([by_top + by_bottom, by_height[:, :, None]], axis=2)
    return BodyEquations(by_body, residual, by_top, by_bottom, *reach, 0.5 * (along[0] + along[1]))


@dataclass(frozen=True, eq=False)
class GroundEquations:
    """The equations of N sightings on flat ground, where a body is (x, y, top): `by_body @ (x, y, top) = value`, whitened."""

    by_body: Floats
    """(N, 3, 3) coefficients of the rows across, up, size."""
    value: Floats
    """(N, 3) right-hand sides."""
    distance: Floats
    """(N,) metres along the rays to the body's middle."""

    @property
    def information(self) -> Floats:
        """(N, 3, 3) normal matrix of each sighting."""
        return np.asarray(self.by_body.transpose(0, 2, 1) @ self.by_body)

    @property
    def pull(self) -> Floats:
        """(N, 3) right-hand side of the normal equations of each sighting."""
        return np.asarray((self.by_body.transpose(0, 2, 1) @ self.value[:, :, None])[:, :, 0])

    def residual(self, body: Floats) -> Floats:
        """Return the residuals (N, 3) at bodies (N, 3), in sigmas."""
        return np.asarray((self.by_body @ body[:, :, None])[:, :, 0] - self.value)


def linearise_on_ground(seen: Sightings, body: Floats, foot_shift: float | Floats) -> GroundEquations:
    """Linearise the equations of boxes, rays in the world's frame, about bodies (N, 3) on the ground z = 0: x, y, top.

    Args:
        seen: the boxes.
        body: approximate body of each box; only distances are taken from it.
        foot_shift: distance by which the lowest visible point is nearer to the camera than the body's axis, metres; (N, 1)
            where bodies differ in it.
    """
    standing = np.column_stack([body[:, :2], np.zeros(len(body)), body[:, 2]])
    found = linearise_bodies(seen, standing, np.asarray(foot_shift))
    by_body = np.concatenate([found.by_body[:, :, :2], found.by_body[:, :, 3:]], axis=2)
    return GroundEquations(by_body, found.residual + (by_body @ body[:, :, None])[:, :, 0], found.distance)


def solve_bodies(information: Floats, pull: Floats, height: Floats, height_sd: Floats) -> tuple[Floats, Floats]:
    """Solve bodies from summed normal equations and a prior on their height.

    Args:
        information: (N, 3, 3) normal matrices of (x, y, top).
        pull: (N, 3) right-hand sides.
        height: (N,) expected highest point, metres.
        height_sd: (N,) its sigma, metres.

    Returns:
        (N, 3) x, y, top; (N, 3, 3) covariance.
    """
    weight = 1 / np.asarray(height_sd) ** 2
    normal, right = np.array(information), np.array(pull)
    normal[:, 2, 2] += weight
    right[:, 2] += weight * height
    covariance = np.linalg.inv(normal + 1e-9 * np.eye(3))
    return (covariance @ right[:, :, None])[:, :, 0], np.asarray(covariance, dtype=np.float64)


def single_view_bodies(seen: Sightings, height_m: float, foot_shift: float) -> tuple[Floats, Floats]:
    """Compute the body of about the given height from each box alone, with rays in the world's frame.

    Returns:
        (N, 3) x, y, top; (N, 3, 3) covariance. NaN where the lens gives no rays.
    """
    middle, reach = reach_by_size(seen.top, seen.bottom, seen.size, height_m)
    body = np.column_stack([seen.origin[:, :2] + reach[:, None] * middle[:, :2], np.full(len(reach), height_m)])
    known = np.full(len(reach), height_m)
    for _ in range(ROUNDS):
        found = linearise_on_ground(seen, body, foot_shift)
        body, covariance = solve_bodies(found.information, found.pull, known, STANCE_SD * known)
        body[:, 2] = np.clip(body[:, 2], SHORTEST_SHARE * height_m, LONGEST_SHARE * height_m)
    return body, covariance


def reach_by_size(
    top: Floats, bottom: Floats, size: Floats, length_m: Floats | float, least_level: float = 0.0
) -> tuple[Floats, Floats]:
    """Compute the distances of upright bodies from their size in the picture.

    Args:
        top: (N, 3) unit rays of the highest points, world.
        bottom: (N, 3) the same of the lowest.
        size: (N,) the angle between both, radians.
        length_m: (N,) distance between both points on the body, metres.
        least_level: least factor by which a body seen from above looks shorter.

    Returns:
        (N, 3) unit rays of the middles, (N,) metres along them.
    """
    middle = top + bottom
    middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    level = np.maximum(np.hypot(middle[:, 0], middle[:, 1]), least_level)
    return middle, np.asarray(length_m * level / np.maximum(size, 1e-4))


def ground_under(camera: Camera, pixels: Floats) -> Floats:
    """Intersect the rays of pixels (N, 2) with the ground z = 0: (N, 2), metres; NaN near the horizon and above it."""
    assert camera.pose is not None
    ray = camera.lens.bearings(pixels) @ camera.pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(ray[:, 2] < -HORIZON, camera.pose.centre[2] / -ray[:, 2], np.nan)
    return np.asarray(camera.pose.centre[:2] + reach[:, None] * ray[:, :2])


def height_over(camera: Camera, place: Floats, pixels: Floats) -> Floats:
    """Return the heights (N,) at which the rays of pixels (N, 2) pass over positions (N, 2) on the ground, metres."""
    assert camera.pose is not None
    ray = camera.lens.bearings(pixels) @ camera.pose.R_cw
    away = np.linalg.norm(place - camera.pose.centre[:2], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(camera.pose.centre[2] + away * ray[:, 2] / np.linalg.norm(ray[:, :2], axis=1))


def pixels_over(camera: Camera, place: Floats, height_m: float) -> Floats:
    """Project points at a height over positions (N, 2) on the ground to pixels (N, 2); NaN where the camera cannot see them."""
    return camera.project(np.column_stack([place, np.full(len(place), height_m)]))
