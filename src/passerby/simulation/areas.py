"""Scenes in several areas that have no common ground: each has cameras and people of its own.

With a single area everything is drawn as if there were no other; the first of several stands where the single one would.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Pose, Rig
from passerby.simulation.body import BodyState
from passerby.simulation.motion import Motion, simulate_motion
from passerby.simulation.options import MIN_PEOPLE, SimulationOptions
from passerby.simulation.placement import place_cameras

AREA_DISTANCE_M = 250.0
"""From one area's middle to the next one's, along x: ten times the largest area."""


@dataclass(frozen=True, eq=False)
class Areas:
    """Who is where. C cameras, P people."""

    of_camera: Ints
    """(C,) area, from 0."""
    of_person: Ints
    """(P,) area, from 0."""

    @classmethod
    def of(cls, options: SimulationOptions) -> Areas:
        """The areas that the options ask for: people are shared out in proportion to the cameras."""
        cameras, numbers = options.group_sizes, np.arange(len(options.group_sizes))
        return cls(np.repeat(numbers, cameras), np.repeat(numbers, share_out(options.n_people, cameras)))

    def __iter__(self) -> Iterator[int]:
        return iter(range(int(self.of_camera.max()) + 1))

    @staticmethod
    def middle(area: int) -> Floats:
        """(2,) the middle of an area, world, metres."""
        return np.array([AREA_DISTANCE_M * area, 0.0])


def share_out(people: int, cameras: Sequence[int]) -> tuple[int, ...]:
    """How many people each area has: `MIN_PEOPLE` first, then in proportion to its cameras, by largest remainders."""
    if len(cameras) == 1:
        return (people,)
    least = np.full(len(cameras), MIN_PEOPLE)
    wanted = (people - least.sum()) * np.array(cameras) / sum(cameras)
    whole = np.floor(wanted).astype(np.int64)
    first = np.argsort(whole - wanted, kind="stable")[: people - least.sum() - whole.sum()]
    whole[first] += 1
    return tuple((least + whole).tolist())


def place_groups(options: SimulationOptions, areas: Areas, rngs: Sequence[np.random.Generator]) -> Rig:
    """The cameras of all areas, named C1, C2, ... throughout; one generator for each area."""
    scene = options.scene
    cameras: list[Camera] = []
    for area in areas:
        count, first = int((areas.of_camera == area).sum()), len(cameras) + 1
        group = place_cameras(
            count, scene.area_m, scene.standoff_m, options.camera_height, scene.picture, rngs[area], first=first,
            lenses=options.lenses,
        )  # fmt: skip
        cameras += [_moved(camera, areas.middle(area)) if area else camera for camera in group]
    return Rig(tuple(cameras))


def move_groups(
    options: SimulationOptions, areas: Areas, heights: Floats, seconds: float, rngs: Sequence[np.random.Generator]
) -> Motion:
    """The motion of the people of all areas; one generator for each area.

    Args:
        options: of the scene.
        areas: who is where.
        heights: (P,) metres.
        seconds: length of the scene.
        rngs: one for each area.
    """
    parts = []
    for area in areas:
        part = simulate_motion(options.scene, heights[areas.of_person == area], seconds, rngs[area])
        if area:
            part = replace(part, state=replace(part.state, xy=part.state.xy + areas.middle(area)))
        parts.append(part)
    if len(parts) == 1:
        return parts[0]
    columns = {
        item.name: np.concatenate([getattr(part.state, item.name) for part in parts], axis=1) for item in fields(BodyState)
    }
    return Motion(parts[0].times, BodyState(**columns), np.concatenate([part.present_from for part in parts]))


def _moved(camera: Camera, by: Floats) -> Camera:
    assert camera.pose is not None
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.pose.centre + np.array([*by, 0.0])))
