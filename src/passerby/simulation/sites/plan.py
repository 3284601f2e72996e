"""The plan of an airport: floors with a corridor each, halls along it behind doors, stairs at its ends, and cameras.

Each floor is a separate plane: cameras of different floors share no ground. All zones are rectangles, so that a person can walk
straight between any two points of a zone.

The ground is a raster of `CELL_M`. A camera looks only at the cells around it, and is compared only with cameras that can see
the same cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera
from passerby.simulation.lenses import before_fold

CAMERAS_PER_FLOOR = 50
"""Approximate number of cameras on a floor; the floors of a site differ by one camera at most."""
CORRIDOR_WIDTH_M, WALL_M = 8.0, 0.5
HALL_M = (24.0, 18.0)
DOOR_M = (17.0, 19.0)
"""Distances of the door's two sides from the hall's west wall."""
CORRIDOR_CAMERAS, HALL_CAMERAS = 3, 4
"""Number of cameras of a unit: of the corridor beside a hall, and of the hall. Further cameras lengthen the corridor."""
PITCH_M = HALL_M[0] + WALL_M
BEYOND_LAST_M = 22.0
"""Length of the corridor beyond its last camera, which sees this part."""
LEVELS, LEVEL_M, BUILDING_M = 4, 5.0, 60.0
"""Number of floors in a building, height from floor to floor, and distance between buildings along y."""
STAIRS_S, PASSAGE_S = 12.0, 45.0
"""Time from floor to floor within a building, and between buildings; no camera sees people on the stairs."""
AIM_M = 8.0
"""Distance along the corridor between its camera and the point that the camera looks at."""
CELL_M = 0.5
RANGE_M = 24.0
"""Maximum distance of detected people; at this distance they are about 60 pixels high."""
STANDING_M = 1.7
"""A camera sees a cell if a person of this height there is in the image as a whole."""
RAY_STEP_M = 0.25
SIDE = 0.25
"""Maximum distance of feet and head beside the image, as a share of its width, for people who may be partly in it."""


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
        """Area, square metres."""
        return (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])


@dataclass(frozen=True)
class Link:
    """A door or stairs between two zones: a segment on the border of each zone, and the time to pass."""

    zones: tuple[int, int]
    ends: tuple[Floats, Floats]
    """For each zone (2, 2): the segment's end points, world, metres."""
    seconds: float
    """Time to pass; 0 for a door, which people pass at walking speed."""


@dataclass(frozen=True)
class Mount:
    """The place of a camera."""

    floor: int
    zone: int
    ground: tuple[float, float]
    """Point on the floor below the camera."""
    aim: tuple[float, float]
    """Point on the floor below the point that the camera looks at."""


@dataclass(frozen=True, eq=False)
class SitePlan:
    """A whole site."""

    zones: tuple[Zone, ...]
    links: tuple[Link, ...]
    mounts: tuple[Mount, ...]
    """Places of the cameras, in the order of their names."""
    floor_z_m: tuple[float, ...]
    """Height of each floor, metres."""

    @property
    def floors(self) -> Ints:
        """(C,) number of each camera's floor."""
        return np.array([mount.floor for mount in self.mounts])

    def free(self, floor: int) -> list[tuple[float, float, float, float]]:
        """Return the open parts of a floor, zones and doorways, as rectangles (x low, y low, x high, y high)."""
        own = {index: zone for index, zone in enumerate(self.zones) if zone.floor == floor}
        found = [(*zone.low, *zone.high) for zone in own.values()]
        for link in self.links:
            if link.seconds == 0 and link.zones[0] in own:
                points = np.concatenate(link.ends)
                found.append((*points.min(axis=0).tolist(), *points.max(axis=0).tolist()))
        return found


def airport(n_cameras: int, rng: np.random.Generator) -> SitePlan:
    """Return the plan for a number of cameras; positions and aims are jittered by `rng`."""
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
    """Add a corridor along x, halls to its north, and their cameras."""
    south = BUILDING_M * (floor // LEVELS)
    north = south + CORRIDOR_WIDTH_M
    units = n_cameras // (CORRIDOR_CAMERAS + HALL_CAMERAS)
    along = n_cameras - units * HALL_CAMERAS
    spacing = PITCH_M / CORRIDOR_CAMERAS
    length = max(2.0 + spacing * (along - 1) + BEYOND_LAST_M, units * PITCH_M)
    corridor = len(zones)
    zones.append(Zone(floor, "corridor", (0.0, south), (_round_to_raster(length), north)))
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


def _round_to_raster(length: float) -> float:
    """Round a length up to whole half metres, the raster of the walls."""
    return float(np.ceil(2 * length) / 2)


def _level(sides: Floats, y: float) -> Floats:
    """Return the end points (2, 2) of the segment at `y` between two x."""
    return np.column_stack([sides, np.full(2, y)])


def _stairs(zones: list[Zone], lower: int, upper: int) -> list[Link]:
    """Return the stairs between two corridors, at both ends."""
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


@dataclass(frozen=True, eq=False)
class Sight:
    """The cells that one camera sees, in a window of cells around it."""

    floor: int
    corner: tuple[int, int]
    """Numbers of the window's first cell along x and y."""
    in_view: Bools
    """(X, Y) whether a cell is in range, no wall hides it, and a part of a person there may be in the image."""
    seen: Bools
    """(X, Y) whether, in addition, a standing person there is whole in the image."""

    def lets_see(self, xy: Floats) -> Bools:
        """Return whether a part of a person at places (..., 2) of this floor may be in the image, (...)."""
        cell = np.floor(np.asarray(xy) / CELL_M).astype(np.int64) - self.corner
        inside = np.asarray(((cell >= 0) & (cell < self.in_view.shape)).all(axis=-1))
        cell = np.where(inside[..., None], cell, 0)
        return np.asarray(inside & self.in_view[cell[..., 0], cell[..., 1]])

    @property
    def cells(self) -> Ints:
        """(N, 2) numbers of the cells that are seen, along x and y."""
        return np.argwhere(self.seen) + self.corner


def sight_of(camera: Camera, plan: SitePlan, index: int, free: Sequence[tuple[float, float, float, float]]) -> Sight:
    """Compute the cells that one camera sees.

    Args:
        camera: camera with its pose.
        plan: plan of the site.
        index: index of the camera.
        free: open parts of the camera's floor (`SitePlan.free`).
    """
    mount = plan.mounts[index]
    reach = int(np.ceil(RANGE_M / CELL_M))
    centre = np.floor(np.array(mount.ground) / CELL_M).astype(np.int64)
    corner = centre - reach
    size = 2 * reach + 1
    is_open = np.zeros((size, size), dtype=np.bool_)
    for x_low, y_low, x_high, y_high in free:
        low = np.clip(np.floor(np.array([x_low, y_low]) / CELL_M).astype(np.int64) - corner, 0, size)
        high = np.clip(np.ceil(np.array([x_high, y_high]) / CELL_M).astype(np.int64) - corner, 0, size)
        is_open[low[0] : high[0], low[1] : high[1]] = True
    cells = np.argwhere(is_open)
    ground: Floats = np.asarray((cells + corner + 0.5) * CELL_M, dtype=np.float64)
    away = ground - mount.ground
    distance = np.hypot(away[:, 0], away[:, 1])
    near = np.flatnonzero(distance <= RANGE_M)
    partly, whole = _find_in_image(camera, ground[near], plan.floor_z_m[mount.floor])
    near, whole = near[partly], whole[partly]
    cells, away, distance = cells[near], away[near], distance[near]
    steps = np.arange(RAY_STEP_M, RANGE_M, RAY_STEP_M)
    along = np.minimum(steps, distance[:, None])[..., None] / np.maximum(distance, 1e-9)[:, None, None]
    on_way = np.floor((mount.ground + along * away[:, None]) / CELL_M).astype(np.int64) - corner
    clear = is_open[on_way[..., 0], on_way[..., 1]].all(axis=1)
    cells, whole = cells[clear], whole[clear]
    in_view, seen = np.zeros_like(is_open), np.zeros_like(is_open)
    in_view[cells[:, 0], cells[:, 1]] = True
    seen[cells[whole, 0], cells[whole, 1]] = True
    return Sight(mount.floor, (int(corner[0]), int(corner[1])), in_view, seen)


def _find_in_image(camera: Camera, ground: Floats, floor_z_m: float) -> tuple[Bools, Bools]:
    """Return whether a part of a standing person may be in the image (N,), and whether the whole person is (N,)."""
    assert camera.pose is not None
    size = np.array(camera.lens.size)
    inside = []
    for height in (0.0, STANDING_M):
        points = np.column_stack([ground, np.full(len(ground), floor_z_m + height)])
        own = points @ camera.pose.R_cw.T + camera.pose.t_cw
        front = (own[:, 2] > 0.3) & before_fold(camera.lens, own)
        pixel = camera.lens.project_rays(np.where(front[:, None], own, np.array([0.0, 0.0, 1.0])))
        beside = front & (pixel[:, 0] > -SIDE * size[0]) & (pixel[:, 0] < (1 + SIDE) * size[0])
        inside.append((beside, front & ((pixel > 0) & (pixel < size)).all(axis=1)))
    (foot_near, foot_in), (head_near, head_in) = inside
    return foot_near | head_near, foot_in & head_in


def shared_ground(sights: Sequence[Sight]) -> dict[tuple[int, int], float]:
    """Return the area of the common ground, square metres, by pairs of camera indices a < b."""
    owners: dict[tuple[int, int, int], list[int]] = {}
    for index, sight in enumerate(sights):
        for x, y in sight.cells.tolist():
            owners.setdefault((sight.floor, x, y), []).append(index)
    found: dict[tuple[int, int], int] = {}
    for cameras in owners.values():
        for k, a in enumerate(cameras):
            for b in cameras[k + 1 :]:
                found[a, b] = found.get((a, b), 0) + 1
    return {pair: count * CELL_M**2 for pair, count in sorted(found.items())}
