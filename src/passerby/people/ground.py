"""The ground that people walk on, estimated with a calibrated rig. It is not always z = 0 (`passerby align --tilt`, geodetic
heights).
"""

from __future__ import annotations

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import Clock, Observations
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.groups import cauchy_weights, residual_scale
from passerby.people.held_cameras import GROUND_SD, GroundPlane, fit_people
from passerby.people.sightings import Sightings, poses_of, upright_sightings
from passerby.people.upright_body import reach_by_size

LOOSE_M = 1.0
FEWEST = 60
"""Number of blocks (one person at one time step) seen by two cameras or more, below which no slope is estimated."""
MOST = 3000
FAR_SLOPE = 0.3
"""Largest slope. A steeper ground is an error: people are taken to be upright along z."""
MAX_SD = 0.4


def rough_height(rig: Rig, observations: Observations) -> float:
    """Estimate the height of people's feet, metres, from the sizes of people in the pictures; identities are not needed."""
    heights = []
    for camera in rig.posed():
        if camera.pose is None or camera.name not in observations.cameras:
            continue
        seen = upright_sightings(observations[camera.name], camera.lens, Clock(1.0))
        if len(seen) > MOST:
            seen = seen.take(np.linspace(0, len(seen) - 1, MOST).astype(np.int64))
        top, bottom = seen.top @ camera.pose.R_cw, seen.bottom @ camera.pose.R_cw
        size, length = np.linalg.norm(top - bottom, axis=1), PERSON_HEIGHT_M * (seen.top_fraction - seen.bottom_fraction)
        middle, reach = reach_by_size(top, bottom, size, length)
        heights.append(camera.pose.centre[2] + reach * middle[:, 2] - PERSON_HEIGHT_M / 2)
    joined = np.concatenate([np.zeros(0), *heights])
    return float(np.median(joined)) if len(joined) else 0.0


def fit_ground(rig: Rig, seen: Sightings, height_m: float) -> GroundPlane:
    """Fit a plane to the feet of people that two cameras or more see.

    Args:
        rig: poses.
        seen: sightings with identities over all cameras.
        height_m: approximate height of the ground.
    """
    several = np.flatnonzero(np.bincount(seen.block, minlength=seen.n_blocks) > 1)
    if len(several) < FEWEST:
        return GroundPlane(height_m, sd=max(GROUND_SD, 0.2))
    wanted = np.zeros(seen.n_blocks, dtype=bool)
    wanted[several[np.linspace(0, len(several) - 1, min(MOST, len(several))).astype(np.int64)]] = True
    rotation, centre = poses_of(rig, seen.names)
    body = fit_people(seen.of_blocks(wanted), rotation, centre, ground=GroundPlane(height_m, sd=LOOSE_M)).body
    middle = np.median(body[:, :2], axis=0)
    design = np.column_stack([np.ones(len(body)), body[:, :2] - middle])
    plane, scale = np.array([np.median(body[:, 2]), 0.0, 0.0]), 0.3
    for _ in range(20):
        miss = body[:, 2] - design @ plane
        scale = residual_scale(miss, 0.02)
        weight = cauchy_weights((miss / (2 * scale)) ** 2)
        # A weak prior of no slope, for people who stay in one place.
        normal = design.T @ (weight[:, None] * design) + np.diag([0.0, 10.0, 10.0])
        plane = np.linalg.solve(normal, design.T @ (weight * body[:, 2]))
    slope = np.clip(plane[1:], -FAR_SLOPE, FAR_SLOPE)
    height = float(plane[0] - slope @ middle)
    return GroundPlane(height, (float(slope[0]), float(slope[1])), float(np.clip(scale, GROUND_SD, MAX_SD)))
