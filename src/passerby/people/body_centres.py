"""Where people are by all cameras but one: what that one's own sightings can be held against, with no part in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.columns import Columns
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.geometry.groups import group_sums
from passerby.people.segments import upright_segments

SHARE, FLOOR_PX = 0.03, 1.0
"""What the middle of a person is off by: a share of the extent in the picture, and pixels. The centre of a box is another point
of the body from every side, so that it is more than the noise which a rig leaves over."""
MIDDLE_SD_M = 0.25
"""How much the height of people's middles differs, where some crouch or sit: with 0.12 two cameras above a building site seemed
to move while several people worked near the ground."""
ROUNDS, LOSS = 4, 3.0
"""Rounds of reweighting, and the scale of the Cauchy loss in sigmas."""


@dataclass(frozen=True, eq=False)
class BodyCentres(Columns):
    """M sightings of the middles of people in one camera, at instants that all cameras share."""

    instant: Ints
    """(M,)"""
    identity: Ints
    """(M,) the person, a tracklet of this camera's own, or -1."""
    ray: Floats
    """(M, 3) unit rays, camera frame."""
    tangent: Floats
    """(M, 2, 3) from `Lens.tangents`."""
    sigma_px: Floats
    """(M,)"""
    extent_px: Floats
    """(M,)"""
    fraction: Floats
    """(M,) where on the body the middle is, as a share of its height."""

    def __len__(self) -> int:
        return len(self.instant)


@dataclass(frozen=True, eq=False)
class TriangulatedPeople:
    """N places of people's middles, in the order of their instants."""

    instant: Ints
    identity: Ints
    place: Floats
    """(N, 3) world, metres."""
    covariance: Floats
    """(N, 3, 3)"""

    def __len__(self) -> int:
        return len(self.instant)


def body_centres(seen: CameraObservations, camera: Camera) -> BodyCentres:
    """The people whose top and bottom are in the picture, with or without identity."""
    ends = upright_segments(seen, camera.lens)
    extent = np.linalg.norm(ends.bottom - ends.top, axis=1)
    ray = camera.lens.bearings(0.5 * (ends.top + ends.bottom))
    found = BodyCentres(
        ends.frame, ends.identity, ray, camera.lens.tangents(ray), np.hypot(FLOOR_PX, SHARE * extent), extent,
        0.5 * (ends.top_fraction + ends.bottom_fraction),
    )  # fmt: skip
    sound = np.flatnonzero(np.isfinite(ray).all(axis=1) & np.isfinite(found.tangent).all(axis=(1, 2)))
    return found.take(sound[np.argsort(found.instant[sound], kind="stable")])


def identified_body_centres(rig: Rig, instants: Observations) -> list[BodyCentres | None]:
    """Of each camera with a pose the people with an identity; None for one without."""
    out: list[BodyCentres | None] = []
    for camera in rig:
        found = body_centres(instants[camera.name], camera) if camera.pose is not None else None
        out.append(None if found is None else found.take(found.identity >= 0))
    return out


def triangulate_people(
    rig: Rig, centres: list[BodyCentres | None], person_height_m: float, *, excluding: int = -1
) -> TriangulatedPeople:
    """Where everybody is by the cameras but one: the point nearest to all rays, at the height where people's middles are.

    Least squares on angles with a Cauchy loss; one other camera does, the height then tells how far away the person is.

    Args:
        rig: with poses.
        centres: of each camera, from `identified_body_centres`; None where there is no pose.
        person_height_m: typical standing height, metres.
        excluding: index of the camera that has no part in it; -1 for none.
    """
    poses = [camera.pose for camera in rig]
    used = [(c, m) for c, m in enumerate(centres) if m is not None and c != excluding and len(m)]
    if not used:
        return TriangulatedPeople(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    key = np.concatenate([np.column_stack([m.instant, m.identity]) for _, m in used])
    who, point = np.unique(key, axis=0, return_inverse=True)
    point = point.ravel()
    direction, centre, angle = [], [], []
    for c, m in used:
        pose = poses[c]
        assert pose is not None
        direction.append(m.ray @ pose.R_cw)
        centre.append(np.broadcast_to(pose.centre, (len(m), 3)))
        angle.append(m.sigma_px / np.linalg.norm(m.tangent, axis=(1, 2)) * np.sqrt(2.0))
    d, C, sigma = np.concatenate(direction), np.concatenate(centre), np.concatenate(angle)
    n = len(who)
    fraction = np.bincount(point, np.concatenate([m.fraction for _, m in used]), n) / np.bincount(point, minlength=n)
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    toward = np.einsum("mij,mj->mi", across, C)
    # A first distance, where the ray meets the height of the middles or goes ten metres.
    weight = 1.0 / (sigma * 10.0) ** 2
    for _ in range(ROUNDS):
        A, b = group_sums(point, weight[:, None, None] * across, n), group_sums(point, weight[:, None] * toward, n)
        A[:, 2, 2] += 1 / MIDDLE_SD_M**2
        b[:, 2] += fraction * person_height_m / MIDDLE_SD_M**2
        A += 1e-6 * np.eye(3)
        place = np.linalg.solve(A, b[:, :, None])[:, :, 0]
        reach = place[point] - C
        distance = np.maximum(np.linalg.norm(reach, axis=1), 0.3)
        miss = np.linalg.norm(np.einsum("mij,mj->mi", across, reach), axis=1) / distance / sigma
        weight = 1.0 / (sigma * distance) ** 2 / (1 + (miss / LOSS) ** 2)
    return TriangulatedPeople(who[:, 0], who[:, 1], np.asarray(place), np.asarray(np.linalg.inv(A)))
