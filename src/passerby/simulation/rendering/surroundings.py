"""What stands around the area: buildings, hedges and trees on the four sides, the sky above, boxes and posts before them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.simulation.presets import Preset
from passerby.simulation.rendering.light import Light
from passerby.simulation.rendering.textures import Field, Noise, grid, mixed

BEHIND_M = {"terrace": 7.0, "basketball": 9.0, "construction": 12.0}
"""From the cameras' rectangle to the buildings."""
PLASTERS = ((150, 165, 180), (120, 135, 165), (165, 170, 170), (105, 115, 130), (140, 170, 190), (90, 105, 150))
CRATES = ((70, 95, 125), (110, 105, 60), (60, 60, 140), (95, 100, 100), (70, 120, 80), (50, 130, 170))
WINDOW_M, STOREY_M, HOUSE_M = 2.4, 3.1, 9.0


@dataclass(frozen=True)
class Block:
    """A static box, axis-aligned: crates, containers, posts."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    colour: tuple[float, float, float]

    @property
    def middle(self) -> Floats:
        """(3,) its centre."""
        return np.asarray((np.array(self.low) + np.array(self.high)) / 2)

    @property
    def radius(self) -> float:
        """Of the sphere around it."""
        return float(np.linalg.norm(np.array(self.high) - np.array(self.low)) / 2)


def draw_blocks(name: str, preset: Preset, rng: np.random.Generator) -> tuple[Block, ...]:
    """Boxes and posts in the ring between the cameras and the buildings, where no person walks and no camera looks past
    them.
    """
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
    """Where rays enter a block.

    Args:
        block: the block.
        origin: (3,) or (N, 3) where the rays start, metres.
        rays: (N, 3) or (3,) directions.

    Returns:
        (N,) distance in units of the ray's length, infinite where it misses; (N,) the axis (0, 1, 2) of the side that it meets.
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
    """(..., 3) colours of the sky in the directions of unit rays (..., 3)."""
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
    """Buildings with windows, hedges and trees before them.

    Args:
        along: place along a side of the surroundings, metres.
        up: height over the ground, metres.
        side: number of the side, 0 to 3.
        footprint: size of a pixel there, metres.
        noise: of the scene.

    Returns:
        (..., 3) colours in full light; (...) whether there is anything: the rest is sky.
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
