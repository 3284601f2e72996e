"""What cameras see of people who stand upright, without any error: sightings as the person model has them."""

from __future__ import annotations

import numpy as np

from passerby.core.cameras import Rig
from passerby.people.sightings import Sightings


def poses_of(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3, 3) world to camera, and (C, 3) centres."""
    poses = [camera.pose for camera in rig if camera.pose is not None]
    return np.array([pose.R_cw for pose in poses]), np.array([pose.centre for pose in poses])


def standing(rig: Rig, ground: np.ndarray, heights: np.ndarray) -> Sightings:
    """Head and foot of each of N people at `ground` (N, 2) in each camera, camera by camera; all count as boxes."""
    feet, heads = (np.column_stack([ground, z]) for z in (np.zeros(len(heights)), heights))
    parts = []
    for camera in rig:
        top, bottom = camera.project(heads), camera.project(feet)
        rays = [camera.lens.bearings(pixels) for pixels in (top, bottom)]
        parts.append((*rays, *map(camera.lens.tangents, rays), np.linalg.norm(top - bottom, axis=1)))
    top, bottom, top_tangent, bottom_tangent, extent = (np.concatenate(column) for column in zip(*parts, strict=True))
    n, people = len(extent), len(heights)
    who = np.tile(np.arange(people), len(rig))
    return Sightings(
        np.repeat(np.arange(len(rig)), people), np.zeros(n, np.int64), who, block=who, top=top, bottom=bottom,
        top_tangent=top_tangent, bottom_tangent=bottom_tangent, extent_px=extent, top_fraction=np.ones(n),
        bottom_fraction=np.zeros(n), has_foot=np.ones(n),
    )  # fmt: skip
