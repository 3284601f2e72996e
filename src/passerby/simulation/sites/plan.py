"""The plan of an airport: floors with a corridor each, halls along it behind doors, stairs at its ends, and cameras.

A floor is a plane of its own: cameras of different floors share no ground. All zones are rectangles, so that a person
who is in one walks straight from any of its points to any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints

CAMERAS_PER_FLOOR = 50
"""A floor has about so many; the floors of a site differ by one camera at most."""
CORRIDOR_WIDTH_M, WALL_M = 8.0, 0.5
HALL_M = (24.0, 18.0)
DOOR_M = (17.0, 19.0)
"""From the hall's west wall: where the door's sides are."""
CORRIDOR_CAMERAS, HALL_CAMERAS = 3, 4
"""Of a unit: a hall, and the corridor beside it. Cameras that are left over lengthen the corridor."""
PITCH_M = HALL_M[0] + WALL_M
BEYOND_LAST_M = 22.0
"""The corridor goes on behind its last camera by so much: what that camera sees."""
LEVELS, LEVEL_M, BUILDING_M = 4, 5.0, 60.0
"""Floors lie `LEVEL_M` above each other, so many in a building; buildings are `BUILDING_M` apart along y."""
STAIRS_S, PASSAGE_S = 12.0, 45.0
"""What it takes from floor to floor, within a building and between buildings; no camera sees it."""
AIM_M = 8.0
"""Cameras of a corridor look at a point so far ahead."""


@dataclass(frozen=True)
class Zone:
    """A rectangle that people walk in."""

    floor: int
    kind: str
    """corridor | hall"""
    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def area_m2(self) -> float:
        """Square metres."""
        return (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])


@dataclass(frozen=True)
class Link:
    """A door or stairs between two zones: a segment on the border of each, and what it takes to pass."""

    zones: tuple[int, int]
    ends: tuple[Floats, Floats]
    """For each zone (2, 2): the segment's end points, world, metres."""
    seconds: float
    """0 for a door, which is passed at walking speed."""


@dataclass(frozen=True)
class Mount:
    """Where a camera hangs."""

    floor: int
    zone: int
    ground: tuple[float, float]
    """Below the camera."""
    aim: tuple[float, float]
    """The point on the floor above which it looks."""


@dataclass(frozen=True, eq=False)
class SitePlan:
    """A whole site."""

    zones: tuple[Zone, ...]
    links: tuple[Link, ...]
    mounts: tuple[Mount, ...]
    """One for each camera, in the order of their names."""
    floor_z_m: tuple[float, ...]
    """Height of each floor."""

    @property
    def floors(self) -> Ints:
        """(C,) floor of each camera."""
        return np.array([mount.floor for mount in self.mounts])

    def free(self, floor: int) -> list[tuple[float, float, float, float]]:
        """Where the floor is open, as rectangles (x low, y low, x high, y high): zones and doorways."""
        own = {index: zone for index, zone in enumerate(self.zones) if zone.floor == floor}
        found = [(*zone.low, *zone.high) for zone in own.values()]
        for link in self.links:
            if link.seconds == 0 and link.zones[0] in own:
                points = np.concatenate(link.ends)
                found.append((*points.min(axis=0).tolist(), *points.max(axis=0).tolist()))
        return found


def airport(n_cameras: int, rng: np.random.Generator) -> SitePlan:
    """The plan for so many cameras; positions and aims are jittered by `rng`."""
    n_floors = max(1, round(n_cameras / CAMERAS_PER_FLOOR))
    if n_cameras >= 2 * (CORRIDOR_CAMERAS + HALL_CAMERAS):
        n_floors = max(2, n_floors)
    zones: list[Zone] = []
    links: list[Link] = []
    mounts: list[Mount] = []
    corridors = []
    for floor, part in enumerate(np.array_split(np.arange(n_cameras), n_floors)):
        corridors.append(len(zones))
        _add_floor(floor, len(part), zones, links, mounts, rng)
    for floor in range(n_floors - 1):
        links += _stairs(zones, corridors[floor], corridors[floor + 1])
    heights = tuple(LEVEL_M * (floor % LEVELS) for floor in range(n_floors))
    return SitePlan(tuple(zones), tuple(links), tuple(mounts), heights)


def _add_floor(
    floor: int, n_cameras: int, zones: list[Zone], links: list[Link], mounts: list[Mount], rng: np.random.Generator
) -> None:
    """A corridor along x, halls to its north, and their cameras."""
    south = BUILDING_M * (floor // LEVELS)
    north = south + CORRIDOR_WIDTH_M
    units = n_cameras // (CORRIDOR_CAMERAS + HALL_CAMERAS)
    along = n_cameras - units * HALL_CAMERAS
    spacing = PITCH_M / CORRIDOR_CAMERAS
    length = max(2.0 + spacing * (along - 1) + BEYOND_LAST_M, units * PITCH_M)
    corridor = len(zones)
    zones.append(Zone(floor, "corridor", (0.0, south), (_whole(length), north)))
    for k in range(along):
        x, y = 2.0 + spacing * k + rng.uniform(-0.7, 0.7), (south + 0.5, north - 0.5)[k % 2]
        aim = x + AIM_M + rng.uniform(-1.0, 1.0), south + CORRIDOR_WIDTH_M / 2 + rng.uniform(-0.7, 0.7)
        mounts.append(Mount(floor, corridor, (x, y), aim))
    for unit in range(units):
        west, hall = unit * PITCH_M, len(zones)
        low = np.array([west, north + WALL_M])
        high = low + HALL_M
        zones.append(Zone(floor, "hall", (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))))
        sides = west + np.array(DOOR_M)
        links.append(Link((corridor, hall), (_level(sides, north), _level(sides, north + WALL_M)), 0.0))
        for corner in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])):
            middle = (low + high) / 2
            ground = np.array(corner) + 0.5 * np.sign(middle - corner)
            aim_at = middle + rng.uniform(-2.0, 2.0, 2)
            mounts.append(Mount(floor, hall, (float(ground[0]), float(ground[1])), (float(aim_at[0]), float(aim_at[1]))))


def _whole(length: float) -> float:
    """The length in whole half metres, the raster on which walls are."""
    return float(np.ceil(2 * length) / 2)


def _level(sides: Floats, y: float) -> Floats:
    """(2, 2) the segment at `y` between two x."""
    return np.column_stack([sides, np.full(2, y)])


def _stairs(zones: list[Zone], lower: int, upper: int) -> list[Link]:
    """Stairs at both ends between two corridors."""
    one, other = zones[lower], zones[upper]
    seconds = STAIRS_S if one.floor // LEVELS == other.floor // LEVELS else PASSAGE_S
    found = []
    for end in (0, 1):
        ends = tuple(
            np.array([[(zone.low, zone.high)[end][0], y] for y in (zone.low[1] + 2.0, zone.high[1] - 2.0)])
            for zone in (one, other)
        )
        found.append(Link((lower, upper), (ends[0], ends[1]), seconds))
    return found
