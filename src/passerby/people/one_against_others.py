"""How far one camera's people are from where the other cameras put them: in the picture and on the ground.

Each person is located by all cameras but one (`PeopleRays`). In the picture of the one that was left out, the distance
of the person's middle from the projection of that place is a residual with no part of its own in it. On the ground, the ray of
the middle meets the height of that place somewhere: the horizontal distance is the error of the camera by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Columns, Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Observations
from passerby.people.body_centres import PeopleRays, TriangulatedPeople, identified_body_centres
from passerby.people.sightings import Sightings

LEAST_DESCENT = 0.02
"""Sine of a ray's angle with the horizontal: a flatter ray meets no height that a pixel would not move by a hundredth of its
range squared."""


@dataclass(frozen=True, eq=False)
class CameraDisagreements(Columns):
    """M people of one camera whom another one saw at the same time step."""

    step: Ints
    """(M,) time steps."""
    pixels: Floats
    """(M,) distance from the projection of their place by the others; infinite behind the camera."""
    extent_px: Floats
    """(M,) their size in the picture."""
    metres: Floats
    """(M,) distance on the ground; infinite where the ray does not come down to the height of the place."""

    def __len__(self) -> int:
        return len(self.step)


def disagreements(rig: Rig, instants: Observations, person_height_m: float) -> dict[str, CameraDisagreements]:
    """By camera with a pose, how far its people are from where the others put them.

    Args:
        rig: world z up, the ground at z = 0; cameras without a pose are left out.
        instants: people at common time steps, with identities that hold over the cameras.
        person_height_m: typical standing height.
    """
    centres = identified_body_centres(rig, instants)
    rays = PeopleRays.of(rig, centres)
    found = {}
    for index, (camera, own) in enumerate(zip(rig, centres, strict=True)):
        if own is None:
            continue
        # Everybody else's people cost as much as all cameras together, for each camera.
        same = rays.seen_by(index)[rays.person] & (rays.camera != index)
        found[camera.name] = _of_camera(camera, own, rays.triangulated(person_height_m, same))
    return found


def _of_camera(camera: Camera, own: Sightings, people: TriangulatedPeople) -> CameraDisagreements:
    """The distances of one camera's people from their places by the others."""
    rows, places = _shared(own, people)
    own = own.take(rows)
    pose = camera.pose
    assert pose is not None
    seen = camera.lens.project_rays(own.middle)
    predicted = camera.project(places)
    pixels = np.linalg.norm(predicted - seen, axis=1)
    ahead = (places - pose.centre) @ pose.R_cw[2] > 0
    ray = own.middle @ pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (places[:, 2] - pose.centre[2]) / ray[:, 2]
    down = (np.abs(ray[:, 2]) > LEAST_DESCENT) & (reach > 0)
    hit = pose.centre[:2] + np.where(down, reach, np.nan)[:, None] * ray[:, :2]
    metres = np.where(down, np.linalg.norm(hit - places[:, :2], axis=1), np.inf)
    return CameraDisagreements(own.step, np.where(ahead, pixels, np.inf), own.extent_px, metres)


def _shared(own: Sightings, people: TriangulatedPeople) -> tuple[Ints, Floats]:
    """Rows of one camera's people whom another camera saw, and (M, 3) where that puts them."""
    ids = max(int(identity.max(initial=0)) for identity in (own.identity, people.identity)) + 1
    mine, theirs = own.step * ids + own.identity, people.instant * ids + people.identity
    # People are in the order of these keys.
    at = np.minimum(np.searchsorted(theirs, mine), len(theirs) - 1)
    rows = np.flatnonzero(theirs[at] == mine) if len(theirs) else np.zeros(0, np.int64)
    return rows, people.place[at[rows]]
