"""Cameras around an area and people who walk in it, as examples of data sets are generated from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Pose, Rig

RADIUS_M, HEIGHT_M = 0.16, 1.8
"""Of the cylinder that stands for a person."""
MIRROR = np.array([-1.0, 1.0, 1.0])


def looking(name: str, lens: Lens, centre: Floats, target: Floats) -> Camera:
    """A level camera at `centre` that looks at `target`, world z up."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Camera(name, lens, Pose.from_centre(np.stack([right, np.cross(forward, right), forward]), centre))


def around(names: list[str], lens: Lens, middle: tuple[float, float], radius: float, seed: int) -> Rig:
    """Cameras about a circle, two to three metres up, each with a lens a little of its own."""
    rng = np.random.default_rng(seed)
    cameras = []
    for index, name in enumerate(names):
        angle = 2 * np.pi * index / len(names) + rng.uniform(-0.2, 0.2)
        at = np.array([*middle, 0.0]) + radius * np.array([np.cos(angle), np.sin(angle), 0.0]) + [0, 0, rng.uniform(2, 3)]
        matrix = lens.matrix * np.array([[rng.uniform(0.97, 1.03), 1, 1], [1, rng.uniform(0.97, 1.03), 1], [1, 1, 1]])
        own = Lens(lens.size, matrix, lens.distortions * rng.uniform(0.8, 1.2))
        cameras.append(looking(name, own, at, np.array([*middle, 1.0])))
    return Rig(tuple(cameras))


def paths(people: int, frames: int, middle: tuple[float, float], half: float, step: float, seed: int) -> Floats:
    """(T, P, 2) ground positions of people who walk from side to side, on a grid of cells of `step` metres."""
    rng = np.random.default_rng(seed)
    start, end = (rng.uniform(-half, half, (people, 2)) for _ in range(2))
    share = (1 - np.cos(np.linspace(0, 2 * np.pi, frames) + rng.uniform(0, 6, (people, 1)))) / 2
    position = np.array(middle) + start[:, None] + share[..., None] * (end - start)[:, None]
    return np.asarray(step * np.round(position.transpose(1, 0, 2) / step))


@dataclass(frozen=True, eq=False)
class Walk:
    """What was put into a data set: T instants, P people."""

    rig: Rig
    """True cameras, right-handed, z up, metres."""
    positions: Floats
    """(T, P, 2) metres on the ground."""

    def cylinder_box(self, camera: Camera, xy: Floats, whole: bool = False) -> tuple[int, int, int, int] | None:
        """Left, top, right and bottom of a person's cylinder, whole pixels, not cut; None where it is not in the picture.

        The lower edge is the projection of the position, as in MultiviewX (generatePOM.py), or that of the `whole` cylinder.
        """
        assert camera.pose is not None
        corners = np.array([[x, y, z] for x in (-RADIUS_M, RADIUS_M) for y in (-RADIUS_M, RADIUS_M) for z in (0, HEIGHT_M)])
        points = np.array([*xy, 0.0]) + corners
        if ((points @ camera.pose.R_cw.T + camera.pose.t_cw)[:, 2] < 0.5).any():
            return None
        pixels = camera.project(points)
        bottom = pixels[:, 1].max() if whole else camera.project(np.array([[*xy, 0.0]]))[0, 1]
        left, top, right = pixels[:, 0].min(), pixels[:, 1].min(), pixels[:, 0].max()
        width, height = camera.lens.size
        if not (right > 1 and left < width - 1 and bottom > 1 and top < height - 1):
            return None
        return int(np.floor(left)), int(np.floor(top)), int(np.floor(right)), int(np.floor(bottom))
