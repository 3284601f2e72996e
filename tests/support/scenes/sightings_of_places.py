"""One camera's sightings of people whose places are known, as what holds a camera against the others takes them."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Pose
from passerby.geometry.rotations import exp_rotation
from passerby.hypotheses.correspondences import Correspondences, match_people
from passerby.people.body_centres import TriangulatedPeople
from passerby.people.sightings import Sightings
from support.scenes.people_and_rigs import looking_at

LENS = Lens((1280, 720), np.array([[800.0, 0, 640], [0, 800.0, 360], [0, 0, 1]]), np.zeros(0))
POSE = looking_at((8.0, 0.5, 3.0), (0.0, 0.0, 0.9))
MOVED = Pose.from_centre(exp_rotation(np.array([0.02, 0.06, 0.01])) @ POSE.R_cw, POSE.centre + (0.3, -0.2, 0.1))
BODY_M = 1.72
SIGMA_PX = 6.0
PEOPLE = 4


def seen(
    pose: Pose, zoom: float | Floats = 1.0, *, count: int = 200, noise: float = 1.0, seed: int = 0,
    tracklet: dict[int, int] | None = None,
) -> Correspondences:  # fmt: skip
    """People, four at each instant, by a camera whose focal length is `zoom` times that of the lens.

    Args:
        pose: of the camera.
        zoom: see above; of all sightings, or (count,) of each.
        count: sightings.
        noise: what pixels are off by, in their sigmas.
        seed: of places and noise.
        tracklet: by person, the number of the camera's own tracklet, -1 for those who are not in it; None: who is who is known.
    """
    rng = np.random.default_rng(seed)
    place = np.column_stack([rng.uniform(-3.0, 3.0, (count, 2)), rng.normal(0.9, 0.2, count)])
    instant, identity = np.arange(count) // PEOPLE, np.arange(count) % PEOPLE
    people = TriangulatedPeople(instant, identity, place, np.tile(1e-8 * np.eye(3), (count, 1, 1)))
    at = (place - pose.centre) @ pose.R_cw.T
    lengthened = np.column_stack([np.broadcast_to(zoom, count)] * 2 + [np.ones(count)])
    ray = LENS.bearings(LENS.project_rays(at * lengthened) + noise * SIGMA_PX * rng.normal(size=(count, 2)))
    extent = zoom * LENS.focal * BODY_M / np.linalg.norm(at, axis=1)
    own = identity if tracklet is None else np.array([tracklet.get(one, -1) for one in identity.tolist()])
    centres = Sightings(
        np.zeros(count, np.int64), instant, own, middle=ray, middle_tangent=LENS.tangents(ray),
        middle_sd_px=np.full(count, SIGMA_PX), extent_px=extent,
    )  # fmt: skip
    return match_people(centres, people, BODY_M, given=tracklet is None)
