"""Ground tracks of a simulated site's cameras from where people are, without boxes: what a thousand cameras can be tried with.

Boxes and tracking of a thousand cameras take an hour of processor time; the comparison of the cameras needs neither. Places
have the errors of feet in noisy boxes, and people are seen where they stand whole in the image.
"""

from __future__ import annotations

import numpy as np

from passerby.association.ground.ground_tracks import GroundTracks, Tolerance
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats
from passerby.geometry.single_view import Level
from passerby.simulation.sites import Site
from passerby.simulation.sites.plan import CELL_M

ALONG, ACROSS_M = 0.04, 0.15
"""Standard deviation of a place along the ray, as a share of its distance, and across it: boxes with 2 % noise from 3.5 m."""


def true_tracks(site: Site, missing: float) -> list[GroundTracks]:
    """Of every camera, by its own clock and in its own frame; `missing` is the share of samples that are left out."""
    reach = round(site.options.clock_offsets / STEP_S) + 1
    last = round(site.options.seconds / STEP_S)
    steps = np.arange(-reach, last + reach + 1)
    rng = site.options.rng(20)
    found = []
    people = np.arange(len(site.walkers))
    xy, floor = site.walkers.places(people, steps * STEP_S)
    for index, own in enumerate(rng.spawn(len(site.rig))):
        found.append(_tracks(site, index, steps, xy, floor, missing, own))
    return found


def _tracks(
    site: Site, index: int, steps: Floats, xy: Floats, floor: Floats, missing: float, rng: np.random.Generator
) -> GroundTracks:
    sight, camera = site.sights[index], site.rig.cameras[index]
    assert camera.pose is not None
    ground = np.array(site.plan.mounts[index].ground)
    rows = np.flatnonzero((floor == sight.floor).ravel())
    rows = rows[(np.abs(xy.reshape(-1, 2)[rows] - ground) < 30.0).all(axis=1)]
    place = xy.reshape(-1, 2)[rows]
    cell = np.clip(np.floor(place / CELL_M).astype(np.int64) - sight.corner, 0, np.array(sight.seen.shape) - 1)
    seen = sight.seen[cell[:, 0], cell[:, 1]] & (rng.uniform(size=len(rows)) >= missing)
    rows, place = rows[seen], place[seen]
    forward = camera.pose.R_cw[2, :2]
    turn = 1j * np.exp(-1j * np.angle(complex(*forward)))
    away = (place - ground) @ np.array([1.0, 1j])
    distance = np.abs(away)
    noise = ALONG * distance * rng.standard_normal(len(rows)) + 1j * ACROSS_M * rng.standard_normal(len(rows))
    local = (away + noise * away / np.maximum(distance, 1e-6)) * turn
    # The camera's clock shows less by its offset than the world's; grid times of its own are the nearest.
    own_step = steps[rows // xy.shape[1]] - round(float(site.clock_offsets_s[index]) / STEP_S)
    inside = (own_step >= 0) & (own_step <= round(site.options.seconds / STEP_S))
    level = Level(np.array([0.0, 1.0, 0.0]), site.options.camera_height_m, 0.0)
    return GroundTracks(
        level, Tolerance(), own_step[inside], (rows % xy.shape[1])[inside], local[inside], np.zeros(inside.sum(), dtype=complex)
    )
