"""Cameras around an area: where they stand, and where they look."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Pose, Rig
from passerby.simulation.lenses import TYPICAL, draw_lenses

AIM_HEIGHT_M = 0.8
"""Cameras look at this height over a point near the middle of the area: hips in the picture's middle, feet in view."""


def place_cameras(
    n_cameras: int,
    area_m: tuple[float, float],
    standoff_m: float,
    height_m: float,
    picture: tuple[int, int],
    rng: np.random.Generator,
    first: int = 1,
    lenses: str = TYPICAL,
) -> Rig:
    """Cameras named C1, C2, ... (from `first` on) around a rectangle centred on the origin, looking in.

    Four stand at the corners; any other number is spread evenly along the perimeter from the first corner. Position, aim,
    field of view and roll (2 degrees either way) are jittered by `rng`.

    Args:
        n_cameras: how many.
        area_m: extent along x and y, metres.
        standoff_m: distance of the cameras from the area along x and y, metres.
        height_m: height of the cameras over the ground z = 0, metres (jittered by up to 5 cm).
        picture: (width, height), pixels.
        rng: each camera uses its own child of it, so that the first cameras stay when more are asked for at the same places.
        first: number of the first camera's name.
        lenses: one of `lenses.LENSES`.
    """
    half = np.asarray(area_m) / 2 + standoff_m
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * half
    cameras = []
    children = rng.spawn(n_cameras)
    lens_of = draw_lenses(lenses, picture, rng)
    for index, child in enumerate(children):
        along = 4.0 * index / n_cameras
        side = int(along)
        ground = corners[side] + (along - side) * (corners[side + 1] - corners[side])
        ground = ground + child.uniform(-0.5, 0.5, 2) * min(1.0, standoff_m / 1.5)
        centre = np.array([*ground, height_m + child.uniform(-0.05, 0.05)])
        aim = np.array([*(child.uniform(-0.06, 0.06, 2) * area_m), AIM_HEIGHT_M])
        roll = np.radians(child.uniform(-2.0, 2.0))
        pose = Pose.from_centre(looking_at(centre, aim, roll), centre)
        cameras.append(Camera(f"C{first + index}", lens_of(child), pose))
    return Rig(tuple(cameras))


def looking_at(centre: Floats, aim: Floats, roll: float = 0.0) -> Floats:
    """(3, 3) world-to-camera rotation of a camera at `centre` that looks at `aim`, then is rolled by `roll` radians."""
    forward = (aim - centre) / np.linalg.norm(aim - centre)
    right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
    right = right / np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward])
    c, s = np.cos(roll), np.sin(roll)
    return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level)
