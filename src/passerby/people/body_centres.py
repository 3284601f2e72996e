"""Positions of people by all cameras but one, to be compared with the sightings of that camera: they do not depend on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.symmetric import solve_symmetric
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.geometry.triangulation import triangulate
from passerby.people.segments import upright_segments
from passerby.people.sightings import Sightings

SHARE, FLOOR_PX = 0.03, 1.0
"""Sigma of the middle of a person: a share of the extent in the picture, and pixels. The centre of a box is another point of
the body from every side, so that this is more than the residual noise of a rig."""
MIDDLE_SD_M = 0.25
"""Standard deviation of the height of people's middles, where some crouch or sit, metres. With 0.12 two cameras above a
building site seemed to move while several people worked near the ground."""
ROUNDS, LOSS = 4, 3.0
"""Rounds of reweighting, and the scale of the Cauchy loss in sigmas."""


@dataclass(frozen=True, eq=False)
class TriangulatedPeople:
    """N positions of people's middles, in the order of their instants."""

    instant: Ints
    identity: Ints
    place: Floats
    """(N, 3) world, metres."""
    covariance: Floats
    """(N, 3, 3) square metres."""

    def __len__(self) -> int:
        return len(self.instant)


def body_centres(seen: CameraObservations, camera: Camera) -> Sightings:
    """Return the middles of all people whose top and bottom are in the picture, in the order of their time steps.

    `middle` is the ray of the point halfway between the two in the picture, in the camera's frame.
    """
    ends = upright_segments(seen, camera.lens)
    extent = np.linalg.norm(ends.bottom - ends.top, axis=1)
    ray = camera.lens.bearings(0.5 * (ends.top + ends.bottom))
    found = Sightings(
        np.zeros(len(ray), np.int64), ends.frame, ends.identity, middle=ray, middle_tangent=camera.lens.tangents(ray),
        middle_sd_px=np.hypot(FLOOR_PX, SHARE * extent), extent_px=extent, top_fraction=ends.top_fraction,
        bottom_fraction=ends.bottom_fraction,
    )  # fmt: skip
    sound = np.flatnonzero(np.isfinite(ray).all(axis=1) & np.isfinite(found.middle_tangent).all(axis=(1, 2)))
    return found.take(sound[np.argsort(found.step[sound], kind="stable")])


def identified_body_centres(rig: Rig, instants: Observations) -> list[Sightings | None]:
    """Return, for each camera with a pose, the people with an identity; None for a camera without a pose."""
    out: list[Sightings | None] = []
    for camera in rig:
        found = body_centres(instants[camera.name], camera) if camera.pose is not None else None
        out.append(None if found is None else found.take(found.identity >= 0))
    return out


def locate_people(rig: Rig, observations: Observations) -> tuple[Floats, Floats]:
    """Return frame and identity (N, 2) of people that two cameras or more see, and their body centres (N, 3), world, metres.

    Positions are triangulated from rays alone and do not depend on the heights of people, unlike in `triangulate_people`.
    """
    rays = PeopleRays.of(rig, identified_body_centres(rig, observations))
    n = len(rays.instant)
    if not n:
        return np.zeros((0, 2)), np.zeros((0, 3))
    poses = [camera.pose or Pose(np.eye(3), np.zeros(3)) for camera in rig]
    R, t = np.array([pose.R_cw for pose in poses]), np.array([pose.t_cw for pose in poses])
    bearing = np.einsum("mij,jm->mi", R[rays.camera], rays.direction)
    points = triangulate(rays.camera, rays.person, bearing, R, t, n)
    placed = np.isfinite(points).all(axis=1)
    return np.column_stack([rays.instant, rays.identity]).astype(float)[placed], points[placed]


def triangulate_people(
    rig: Rig, centres: Sequence[Sightings | None], person_height_m: float, *, excluding: int = -1
) -> TriangulatedPeople:
    """Compute the positions of all people from all cameras but one (`PeopleRays.triangulated`).

    Args:
        rig: with poses.
        centres: of each camera, from `identified_body_centres`; None where there is no pose.
        person_height_m: typical standing height, metres.
        excluding: index of the camera that is not used; -1 for none.
    """
    rays = PeopleRays.of(rig, centres)
    return rays.triangulated(person_height_m, rays.camera != excluding)


@dataclass(frozen=True, eq=False)
class PeopleRays:
    """M rays of all cameras to the middles of N people, each at one instant."""

    instant: Ints
    """(N,) ascending."""
    identity: Ints
    """(N,) ascending within one instant."""
    camera: Ints
    """(M,) ascending."""
    person: Ints
    """(M,) the row in `instant` and `identity`."""
    direction: Floats
    """(3, M) unit rays, world."""
    centre: Floats
    """(3, M) camera centres, metres."""
    sigma: Floats
    """(M,) one sigma of the ray, radians."""
    fraction: Floats
    """(M,) height of the middle on the body, as a share of the body's height."""

    @classmethod
    def of(cls, rig: Rig, centres: Sequence[Sightings | None]) -> PeopleRays:
        """Collect the rays of each camera's `identified_body_centres`; None stands for a camera without a pose."""
        used = [(c, m) for c, m in enumerate(centres) if m is not None and len(m)]
        if not used:
            none, nothing = np.zeros(0, np.int64), np.zeros((3, 0))
            return cls(none, none, none, none, nothing, nothing, np.zeros(0), np.zeros(0))
        instant, identity = (np.concatenate(column) for column in zip(*((m.step, m.identity) for _, m in used), strict=True))
        ids = int(identity.max()) + 1
        key, person = np.unique(instant * ids + identity, return_inverse=True)
        direction, centre, sigma = [], [], []
        for c, m in used:
            pose = rig.cameras[c].pose
            assert pose is not None
            direction.append((m.middle @ pose.R_cw).T)
            centre.append(np.broadcast_to(pose.centre[:, None], (3, len(m))))
            sigma.append(m.middle_sd_px / np.linalg.norm(m.middle_tangent, axis=(1, 2)) * np.sqrt(2.0))
        return cls(
            key // ids, key % ids, np.repeat([c for c, _ in used], [len(m) for _, m in used]), person,
            np.concatenate(direction, axis=1), np.concatenate(centre, axis=1), np.concatenate(sigma),
            np.concatenate([m.middle_fraction for _, m in used]),
        )  # fmt: skip

    def seen_by(self, camera: int) -> Bools:
        """Return a mask (N,) of the people that a camera sees."""
        return np.bincount(self.person[self.camera == camera], minlength=len(self.instant)) > 0

    def triangulated(self, person_height_m: float, rows: Bools) -> TriangulatedPeople:
        """Triangulate people from some of the rays, with a prior on the height of people's middles.

        Least squares on angles with a Cauchy loss. One ray is enough: the height then gives the person's distance.

        Args:
            person_height_m: typical standing height, metres.
            rows: (M,) mask of the rays to use.
        """
        use = np.flatnonzero(rows)
        if not len(use):
            none = np.zeros(0, np.int64)
            return TriangulatedPeople(none, none, np.zeros((0, 3)), np.zeros((0, 3, 3)))
        there = np.bincount(self.person[use], minlength=len(self.instant))
        who = np.flatnonzero(there)
        n, person = len(who), (np.cumsum(there > 0) - 1)[self.person[use]]
        d, centre, sigma = self.direction[:, use], self.centre[:, use], self.sigma[use]
        height = np.bincount(person, self.fraction[use], n) / there[who] * person_height_m
        across = np.array([1 - d[0] ** 2, -d[0] * d[1], -d[0] * d[2], 1 - d[1] ** 2, -d[1] * d[2], 1 - d[2] ** 2])
        along = (d * centre).sum(axis=0)
        toward = centre - along * d
        # First weights: as if all people were ten metres away.
        weight = 1.0 / (sigma * 10.0) ** 2
        place, normal = np.zeros((3, n)), np.zeros((6, n))
        for _ in range(ROUNDS):
            normal, right = (
                np.array([np.bincount(person, weight * row, n) for row in rows_]).reshape(-1, n) for rows_ in (across, toward)
            )
            normal[5] += 1 / MIDDLE_SD_M**2
            right[2] += height / MIDDLE_SD_M**2
            normal[[0, 3, 5]] += 1e-6
            place = solve_symmetric(normal, right)
            reach = place[:, person] - centre
            square = (reach * reach).sum(axis=0)
            distance = np.maximum(np.sqrt(square), 0.3)
            aside = reach - (reach * d).sum(axis=0) * d
            miss = np.sqrt((aside * aside).sum(axis=0)) / (distance * sigma)
            weight = 1.0 / ((sigma * distance) ** 2 * (1 + (miss / LOSS) ** 2))
        covariance = np.asarray(np.linalg.inv(normal[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)))
        return TriangulatedPeople(self.instant[who], self.identity[who], np.ascontiguousarray(place.T), covariance)
