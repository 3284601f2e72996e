"""Buildings and objects around the area, the ground of each preset, their textures, and the light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.simulation.options import Preset

BEHIND_M = {"terrace": 7.0, "basketball": 9.0, "construction": 12.0}
"""Distance from the cameras' rectangle to the buildings."""
PLASTERS = ((150, 165, 180), (120, 135, 165), (165, 170, 170), (105, 115, 130), (140, 170, 190), (90, 105, 150))
CRATES = ((70, 95, 125), (110, 105, 60), (60, 60, 140), (95, 100, 100), (70, 120, 80), (50, 130, 170))
WINDOW_M, STOREY_M, HOUSE_M = 2.4, 3.1, 9.0
Field = NDArray[np.float32]
TILE = 256
"""Number of cells after which a texture repeats."""
STONE_M = 0.6
COARSE = (5.0, 1.7, 0.6)
FINE = (0.25, 0.09, 0.03)
WHITE = (225.0, 228.0, 228.0)
COURT_SHARE = 0.42
"""Half of the court's extent as a share of the area: its lines lie inside the area where people run."""
ELEVATION_DEG = (38.0, 60.0)
"""Range of the sun's elevation: shadows are then 0.6 to 1.3 times as long as people are tall."""
AMBIENT = 0.52
SUN = 0.62
OVERCAST = 0.92
SHADOW = 0.55
"""Brightness of ground in the shadow, where only sky light reaches it, as a share of its brightness in the sun."""


@dataclass(frozen=True)
class Block:
    """A static box, axis-aligned: crates, containers, posts."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    colour: tuple[float, float, float]

    @property
    def middle(self) -> Floats:
        """(3,) centre of the block."""
        return np.asarray((np.array(self.low) + np.array(self.high)) / 2)

    @property
    def radius(self) -> float:
        """Radius of the sphere around the block, metres."""
        return float(np.linalg.norm(np.array(self.high) - np.array(self.low)) / 2)


def draw_blocks(name: str, preset: Preset, rng: np.random.Generator) -> tuple[Block, ...]:
    """Draw boxes and posts between the cameras and the buildings, where no person walks and where they hide no person."""
    inner = np.asarray(preset.area_m) / 2 + preset.standoff_m + 1.2
    room = BEHIND_M[name] - 2.4
    blocks = []
    for side in range(4):
        axis, sign = side % 2, 1 if side < 2 else -1
        for _ in range(3 if name != "construction" else 5):
            along, out = rng.uniform(-1, 1) * inner[1 - axis], inner[axis] + rng.uniform(0.2, 1.0) * room
            if rng.uniform() < 0.3:
                size = np.array([0.12, 0.12, rng.uniform(3.5, 6.0)])
            else:
                size = np.array([*rng.uniform(0.8, 2.4, 2), rng.uniform(0.4, 1.4)])
                size = size * (1.6 if name == "construction" else 1.0)
            middle = np.empty(2)
            middle[axis], middle[1 - axis] = sign * (out + size[axis] / 2), along
            low, high = np.array([*(middle - size[:2] / 2), 0.0]), np.array([*(middle + size[:2] / 2), size[2]])
            colour = CRATES[int(rng.integers(len(CRATES)))]
            blocks.append(Block(tuple(low.tolist()), tuple(high.tolist()), colour))
    return tuple(blocks)


def meet(block: Block, origin: Field, rays: Field) -> tuple[Field, NDArray[np.int64]]:
    """Compute where rays enter a block.

    Args:
        block: the block.
        origin: (3,) or (N, 3) start of the rays, metres.
        rays: (N, 3) or (3,) directions.

    Returns:
        (N,) distance in units of the ray's length, infinite for a miss; (N,) the axis (0, 1, 2) normal to the side that is hit.
    """
    entries, enter, leave = [], np.float32(-np.inf), np.float32(np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):
            first = (np.float32(block.low[axis]) - origin[..., axis]) / rays[..., axis]
            second = (np.float32(block.high[axis]) - origin[..., axis]) / rays[..., axis]
            entries.append(np.minimum(first, second))
            enter, leave = np.maximum(enter, entries[-1]), np.minimum(leave, np.maximum(first, second))
    side = np.where(enter == entries[0], 0, np.where(enter == entries[1], 1, 2))
    hit = (enter < leave) & (enter > 1e-4)
    return np.asarray(np.where(hit, enter, np.float32(np.inf)), dtype=np.float32), side


def sky(rays: Field, light: Light, noise: Noise) -> Field:
    """Compute colours (..., 3) of the sky in the directions of unit rays (..., 3)."""
    up = np.clip(rays[..., 2], 0.02, 1)
    cloud = noise.smooth(rays[..., 0] / up + 20, rays[..., 1] / up, 1.3) + 0.5 * noise.smooth(
        rays[..., 1] / up, rays[..., 0] / up, 0.4
    )
    if not light.sunny:
        level = 205 + 8 * cloud
        return np.stack([level + 4, level, level - 3], axis=-1)
    blue = np.stack([235 - 25 * up, 195 - 70 * up, 165 - 110 * up], axis=-1)
    return mixed(blue, (240, 238, 236), np.clip(0.5 * cloud + 0.1, 0, 0.8))


def wall(along: Field, up: Field, side: Field, footprint: Field, noise: Noise) -> tuple[Field, Field]:
    """Compute the colours of buildings with windows, and of hedges and trees in front of them.

    Args:
        along: place along a side of the surroundings, metres.
        up: height over the ground, metres.
        side: number of the side, 0 to 3.
        footprint: size of a pixel there, metres.
        noise: noise of the scene.

    Returns:
        (..., 3) colours in full light; (...) whether there is a building or a plant: the rest is sky.
    """
    house, own = np.floor(along / HOUSE_M), 40 * side
    roof = 7.0 + 4.5 * noise.of_cells(house, own + 1)
    plaster = np.array(PLASTERS, dtype=np.float32)[
        np.abs(noise.of_cells(house, own + 2) * 1000).astype(np.int64) % len(PLASTERS)
    ]
    rough = 7 * noise.octaves(along, up, (2.0, 0.5, 0.12), footprint)
    colour = plaster + rough[..., None]
    column, row = np.floor(along / WINDOW_M), np.floor(up / STOREY_M)
    glazed = (grid(along - WINDOW_M / 2, WINDOW_M) < 0.55) & (grid(up - 0.55 * STOREY_M, STOREY_M) < 0.75) & (up < roof - 0.6)
    pane = 55 + 25 * noise.of_cells(column + 7 * side, row)
    colour = mixed(colour, np.stack([1.25 * pane, 1.1 * pane, pane], axis=-1), 0.9 * glazed)
    colour = mixed(colour, 0.6 * plaster, 0.9 * ((up < 0.5) | (up > roof - 0.25)))
    solid = up < roof
    leaves = noise.octaves(along, up, (1.2, 0.45, 0.16), footprint)
    hedge = up < 1.1 + 0.25 * noise.smooth(along, own, 0.7) + 0.2 * noise.smooth(along, own, 5.0)
    hedge &= noise.smooth(along, own + 3, 11.0) > -0.25
    crown = noise.smooth(along, own + 5, 6.0) * 5.5 + 3.0 - np.abs(up - 4.5) * 0.8 + 1.2 * leaves
    green = hedge | ((crown > 2.6) & (up > 1.8))
    level = 78 + 34 * leaves
    foliage = np.stack([0.55 * level, level, 0.75 * level], axis=-1)
    return mixed(colour, foliage, green.astype(np.float32)), solid | green


class Noise:
    """Smooth noise over the plane."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._tile = rng.uniform(-1, 1, (TILE, TILE)).astype(np.float32)

    def smooth(self, x: Field, y: Field, cell: float) -> Field:
        """Return values of about -1 to 1 at places `x`, `y` (any shape), interpolated between values at every `cell` metres."""
        u, v = (axis * np.float32(1 / cell) for axis in (x, y))
        return np.asarray(cv2.remap(self._tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), dtype=np.float32)

    def of_cells(self, column: Field, row: Field) -> Field:
        """Return one value, -1 to 1, for each cell by its integer column and row."""
        return self._tile[np.mod(row, TILE).astype(np.int64), np.mod(column, TILE).astype(np.int64)]

    def octaves(self, x: Field, y: Field, cells: Sequence[float], footprint: Field) -> Field:
        """Return the sum over several sizes of cells; cells smaller than the pixel's `footprint` (metres) fade out."""
        total = np.zeros_like(x)
        for cell in cells:
            total += np.clip(cell / (2 * footprint) - 0.25, 0, 1) * self.smooth(x, y, cell)
        return total / np.float32(np.sqrt(len(cells)))


def line(distance: Field, width: float, footprint: Field) -> Field:
    """Compute the share of a pixel that a line covers, 0 to 1.

    Args:
        distance: distance from the line's middle, metres.
        width: width of the line, metres.
        footprint: width of the pixel on the surface, metres.
    """
    cover = np.clip(((width + footprint) / 2 - np.abs(distance)) / footprint, 0, 1)
    return np.asarray(cover * np.minimum(1.0, width / footprint), dtype=np.float32)


def grid(place: Field, pitch: float) -> Field:
    """Compute the distance from the nearest multiple of `pitch`, metres."""
    return np.asarray(np.abs(np.mod(place + pitch / 2, np.float32(pitch)) - np.float32(pitch / 2)), dtype=np.float32)


def mixed(colour: Field, other: Sequence[float] | Field, weight: Field) -> Field:
    """Mix `colour` (..., 3) with the share `weight` (...) of another one."""
    return np.asarray(colour + weight[..., None] * (np.asarray(other, dtype=np.float32) - colour), dtype=np.float32)


def ground(name: str, preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """Compute colours (..., 3) of the ground in full light.

    Args:
        name: name of the preset.
        preset: the preset, for its area.
        x: place on the ground from the area's middle, metres.
        y: the same along the other axis.
        footprint: size of a pixel there, metres.
        noise: noise of the scene.
    """
    surface = {"terrace": _paving, "basketball": _court, "construction": _site}[name]
    return surface(preset, x, y, footprint, noise)


def _paving(preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """Compute the colours of paving stones in slightly different greys, with dark joints and stains."""
    own = noise.of_cells(np.floor(x / STONE_M + 0.5), np.floor(y / STONE_M + 0.5)) * np.clip(STONE_M / (2 * footprint), 0, 1)
    level = 150 + 9 * own + 13 * noise.octaves(x, y, COARSE, footprint) + 11 * noise.octaves(y, x, FINE, footprint)
    tint = 4 * noise.smooth(x + 50, y, 1.1)
    colour = np.stack([level - 10 - tint, level - 2, level + 4 + tint], axis=-1)
    joints = np.maximum(
        line(grid(x - STONE_M / 2, STONE_M), 0.012, footprint), line(grid(y - STONE_M / 2, STONE_M), 0.012, footprint)
    )
    return mixed(colour, (80, 85, 88), np.float32(0.8) * joints)


def _court(preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """Compute the colours of a painted court with white lines, and of asphalt around it."""
    half_x, half_y = (np.float32(COURT_SHARE * extent) for extent in preset.area_m)
    inside = ((np.abs(x) < half_x) & (np.abs(y) < half_y)).astype(np.float32)
    rough = 9 * noise.octaves(x, y, COARSE, footprint) + 12 * noise.octaves(y, x, FINE, footprint)
    asphalt = np.stack([108 + rough, 110 + rough, 112 + rough], axis=-1)
    paint = np.stack([118 + 0.7 * rough, 128 + 0.7 * rough, 88 + 0.7 * rough], axis=-1)
    colour = mixed(asphalt, paint, inside)
    radius = np.asarray(np.hypot(x, y), dtype=np.float32)
    along = np.abs(y)
    within_x, within_y = (np.abs(x) < half_x + 0.025), (along < half_y + 0.025)
    lines = line(np.abs(x) - half_x, 0.05, footprint) * within_y
    lines = np.maximum(lines, line(along - half_y, 0.05, footprint) * within_x)
    lines = np.maximum(lines, line(y, 0.05, footprint) * within_x)
    lines = np.maximum(lines, line(radius - 1.8, 0.05, footprint))
    key = np.float32(0.32 * half_x)
    reach = np.float32(half_y * (1 - 5.8 / 14))
    lines = np.maximum(lines, line(np.abs(x) - key, 0.05, footprint) * ((along > reach) & within_y))
    lines = np.maximum(lines, line(along - reach, 0.05, footprint) * (np.abs(x) < key))
    arc = np.hypot(x, along - half_y + 1.6)
    lines = np.maximum(lines, line(arc - 0.82 * half_x, 0.05, footprint) * (along < half_y))
    worn = 0.85 + 0.12 * noise.smooth(x, y, 0.4)
    return mixed(colour, WHITE, np.asarray(lines * worn, dtype=np.float32))


def _site(preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """Compute the colours of earth with gravel and tyre tracks, and of a slab of concrete."""
    coarse, fine = noise.octaves(x, y, COARSE, footprint), noise.octaves(y, x, FINE, footprint)
    level = 128 + 20 * coarse + 20 * fine
    earth = np.stack([0.72 * level, 0.88 * level, level], axis=-1)
    concrete = np.stack([158 + 8 * coarse + 6 * fine] * 3, axis=-1) + np.array((-2.0, 0.0, 3.0), dtype=np.float32)
    edge_x, edge_y = 0.27 * preset.area_m[0], 0.30 * preset.area_m[1]
    slab = ((np.abs(x + 0.1 * preset.area_m[0]) < edge_x) & (np.abs(y - 2) < edge_y)).astype(np.float32)
    seams = np.maximum(line(grid(x, 3.0), 0.02, footprint), line(grid(y, 3.0), 0.02, footprint))
    wander: Field = x + 0.12 * y + 1.2 * noise.smooth(y, np.zeros_like(y) + 7, 6.0)
    track = np.maximum(line(wander - 6.5, 0.35, footprint), line(wander - 8.3, 0.35, footprint)) * (
        0.7 + 0.3 * noise.smooth(x, y, 0.15)
    )
    colour = mixed(earth, (62, 76, 88), np.asarray(0.55 * track, dtype=np.float32))
    return mixed(colour, mixed(concrete, (105, 105, 105), np.float32(0.8) * seams), slab)


@dataclass(frozen=True, eq=False)
class Light:
    """The light of the scene."""

    towards_sun: Floats
    """(3,) unit vector, world."""
    sunny: bool

    @classmethod
    def drawn(cls, sunny: bool, rng: np.random.Generator) -> Light:
        """Draw a sun of any azimuth, at an elevation in `ELEVATION_DEG`."""
        azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*ELEVATION_DEG))
        flat = np.cos(elevation)
        return cls(np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]), sunny)

    def on(self, normals: Floats) -> Floats:
        """Compute the brightness (..., 1) by unit normals (..., 3): Lambert's law, with less sky light if facing down."""
        sky = 0.80 + 0.20 * normals[..., 2:]
        if not self.sunny:
            return np.asarray(OVERCAST * sky)
        facing = np.einsum("...k,k->...", normals, self.towards_sun)
        return np.asarray(AMBIENT * sky + SUN * np.maximum(facing, 0.0)[..., None])
