"""Distances of one camera's people from the positions that the other cameras give, in the picture and on the ground.

Each person is located by all cameras but one (`PeopleRays`). In the picture of the camera that was left out, the residual is
the distance of the person's middle from the projection of that position. This camera has no influence on the position. On the
ground, the ray of the middle is intersected with the height of the position. The horizontal distance is the camera's own error.
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
"""Least sine of a ray's angle with the horizontal. On a flatter ray, one pixel moves the intersection with a height by a
hundredth of its squared range or more."""


@dataclass(frozen=True, eq=False)
class CameraDisagreements(Columns):
    """M people that one camera saw at the same time step as another camera."""

    step: Ints
    """(M,) time steps."""
    pixels: Floats
    """(M,) distance from the projection of their position by the others; infinite behind the camera."""
    extent_px: Floats
    """(M,) size of the people in the picture, pixels."""
    metres: Floats
    """(M,) distance on the ground; infinite where the ray does not reach the height of the position."""

    def __len__(self) -> int:
        return len(self.step)


def disagreements(rig: Rig, instants: Observations, person_height_m: float) -> dict[str, CameraDisagreements]:
    """Compute, for each camera with a pose, the distances of its people from the positions that the others give.

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
        # Only people that this camera sees: for each camera, all others would cost as much as all cameras together.
        same = rays.seen_by(index)[rays.person] & (rays.camera != index)
        found[camera.name] = _of_camera(camera, own, rays.triangulated(person_height_m, same))
    return found


def _of_camera(camera: Camera, own: Sightings, people: TriangulatedPeople) -> CameraDisagreements:
    """Compute the distances of one camera's people from their positions by the others."""
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
    """Find the rows (M,) of one camera's people that another camera saw too, and their positions (M, 3) by the others."""
    ids = max(int(identity.max(initial=0)) for identity in (own.identity, people.identity)) + 1
    mine, theirs = own.step * ids + own.identity, people.instant * ids + people.identity
    # People are in the order of these keys.
    at = np.minimum(np.searchsorted(theirs, mine), len(theirs) - 1)
    rows = np.flatnonzero(theirs[at] == mine) if len(theirs) else np.zeros(0, np.int64)
    return rows, people.place[at[rows]]
