"""The picture of a camera without people, by one ray for each quarter of a pixel through the distorted lens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.perception.pictures import Picture
from passerby.simulation.options import PRESETS, Preset
from passerby.simulation.rendering.surroundings import (
    BEHIND_M,
    SHADOW,
    Block,
    Field,
    Light,
    Noise,
    draw_blocks,
    ground,
    meet,
    sky,
    wall,
)

SUPERSAMPLING = 2
RAY_PITCH_PX = 8
"""Distance of the pixels whose rays are computed; others are interpolated, with an error below a hundredth of a pixel."""
ROWS_AT_ONCE = 128


@dataclass(frozen=True, eq=False)
class World:
    """The static world around one area."""

    name: str
    """Name of the preset."""
    middle: Floats
    """(2,) middle of the area, world, metres."""
    light: Light
    noise: Noise
    blocks: tuple[Block, ...]

    @classmethod
    def drawn(cls, name: str, middle: Floats, light: Light, rng: np.random.Generator) -> World:
        """Draw the textures and the blocks of a world."""
        texture, furniture = rng.spawn(2)
        return cls(name, middle, light, Noise(texture), draw_blocks(name, PRESETS[name], furniture))

    @property
    def preset(self) -> Preset:
        """The preset of this world."""
        return PRESETS[self.name]


def background(camera: Camera, world: World) -> Picture:
    """Render the camera's picture (H, W, 3) of the empty world."""
    width, height = camera.lens.size
    plane = _ray_grid(camera)
    picture = np.empty((height, width, 3), dtype=np.uint8)
    for top in range(0, height, ROWS_AT_ONCE):
        rows = min(ROWS_AT_ONCE, height - top)
        colours = _colours(camera, world, _rays(camera, plane, top, rows))
        fine = np.clip(colours, 0, 255)
        picture[top : top + rows] = np.round(cv2.resize(fine, (width, rows), interpolation=cv2.INTER_AREA)).astype(np.uint8)
    return picture


def _ray_grid(camera: Camera) -> Field:
    """Compute unit rays (h, w, 3), world, at every `RAY_PITCH_PX` pixels, from one pitch outside the picture's corner."""
    assert camera.pose is not None
    width, height = camera.lens.size
    x, y = (np.arange(-1, size // RAY_PITCH_PX + 3, dtype=np.float64) * RAY_PITCH_PX for size in (width, height))
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    rays = camera.lens.bearings(pixels.reshape(-1, 2))
    bad = ~np.isfinite(rays).all(axis=1)
    if bad.any():  # the range of the lens ends inside the picture: pixels without a ray get that of the optical axis
        rays[bad] = np.array([0.0, 0.0, 1.0])
    return np.asarray((rays @ camera.pose.R_cw).reshape(pixels.shape[:2] + (3,)), dtype=np.float32)


def _rays(camera: Camera, plane: Field, top: int, rows: int) -> Field:
    """Interpolate the unit rays (2 rows, 2 W, 3) of the fine pixels of some rows."""
    width = camera.lens.size[0]
    x = ((np.arange(width * SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5) / RAY_PITCH_PX + 1
    y = (top + (np.arange(rows * SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5) / RAY_PITCH_PX + 1
    # The bilinear interpolation is written out, because cv2.remap has only 32 steps between two points.
    left, above = np.floor(x).astype(int), np.floor(y).astype(int)
    by_x, by_y = (x - left).astype(np.float32)[None, :, None], (y - above).astype(np.float32)[:, None, None]
    columns = plane[:, left] * (1 - by_x) + plane[:, left + 1] * by_x
    rays = columns[above] * (1 - by_y) + columns[above + 1] * by_y
    length = np.sqrt(rays[..., 0] ** 2 + rays[..., 1] ** 2 + rays[..., 2] ** 2)
    return np.asarray(rays / length[..., None], dtype=np.float32)


def _colours(camera: Camera, world: World, rays: Field) -> Field:
    """Compute the colours (..., 3) of the surfaces that the rays hit, in the light of the scene."""
    eye = camera.centre - np.array([*world.middle, 0.0])
    pixel = np.float32(1.0 / (camera.lens.focal * SUPERSAMPLING))
    half = np.asarray(world.preset.area_m) / 2 + world.preset.standoff_m + BEHIND_M[world.name]
    with np.errstate(divide="ignore"):
        to_walls = np.where(rays[..., :2] > 0, (half - eye[:2]) / rays[..., :2], (-half - eye[:2]) / rays[..., :2]).astype(
            np.float32
        )
        to_ground = np.where(rays[..., 2] < -1e-6, -eye[2] / rays[..., 2], np.inf).astype(np.float32)
    axis = (to_walls[..., 1] < to_walls[..., 0]).astype(np.int64)
    to_wall = np.minimum(to_walls[..., 0], to_walls[..., 1])
    colours = sky(rays, world.light, world.noise)
    on_wall = to_wall < to_ground
    _set(colours, on_wall, _wall_colours(world, eye, rays[on_wall], axis[on_wall], to_wall[on_wall], pixel))
    place = rays[~on_wall] * to_ground[~on_wall][:, None] + eye.astype(np.float32)
    _set(colours, ~on_wall, _ground_colours(world, place, rays[~on_wall], to_ground[~on_wall], half, pixel))
    _add_blocks(world, eye.astype(np.float32), rays.reshape(-1, 3), np.minimum(to_wall, to_ground).ravel(), colours, pixel)
    return colours


def _add_blocks(world: World, eye: Field, rays: Field, reach: Field, colours: Field, pixel: np.float32) -> None:
    """Draw the blocks over `colours`, in place, where they are nearer than `reach`, (N,) metres along the rays (N, 3)."""
    flat = colours.reshape(-1, 3)
    for block in world.blocks:
        apart = block.middle - eye
        distance = float(np.linalg.norm(apart))
        cone = np.cos(np.arcsin(min(1.0, block.radius / distance)))
        near = np.flatnonzero(np.einsum("nk,k->n", rays, (apart / distance).astype(np.float32)) >= cone - 1e-4)
        if not len(near):
            continue
        enter, side = meet(block, eye, rays[near])
        shown = enter < reach[near]
        if shown.any():
            seen = near[shown]
            place = rays[seen] * enter[shown][:, None] + eye
            flat[seen] = _block_colours(world, block, place, rays[seen], side[shown], enter[shown] * pixel)
            reach[seen] = enter[shown]


def _set(colours: Field, where: NDArray[np.bool_], values: Field) -> None:
    """Set the colours at `where` to the values that are finite, in place."""
    known = np.isfinite(values[..., 0])
    inside = np.flatnonzero(where)[known]
    colours.reshape(-1, 3)[inside] = values[known]


def _wall_colours(world: World, eye: Floats, rays: Field, axis: NDArray[np.int64], reach: Field, pixel: np.float32) -> Field:
    """Compute colours (N, 3) at the walls; NaN where there is only sky."""
    if not len(rays):
        return rays
    place = rays * reach[:, None] + eye.astype(np.float32)
    along = np.where(axis == 0, place[:, 1], place[:, 0])
    facing = np.where(axis == 0, rays[:, 0], rays[:, 1])
    side = (axis + 2 * (facing < 0)).astype(np.float32)
    colours, there = _apply_in_pieces(lambda a, u, s, f: wall(a, u, s, f, world.noise), along, place[:, 2], side, reach * pixel)
    normals = np.zeros((len(rays), 3))
    normals[np.arange(len(rays)), axis] = -np.sign(facing)
    lit = colours * world.light.on(normals).astype(np.float32)
    return np.where(there[:, None], lit, np.float32(np.nan))


def _ground_colours(world: World, place: Field, rays: Field, reach: Field, half: Floats, pixel: np.float32) -> Field:
    """Compute colours (N, 3) of the ground with the shadows of the blocks; it is darker along the walls."""
    if not len(rays):
        return rays
    # A size between the pixel's width and its length along the ground: lines far away fade out instead of becoming dashes.
    footprint = np.asarray(reach * pixel / np.maximum(-rays[:, 2], 0.01) ** 0.75, dtype=np.float32)
    (colours,) = _apply_in_pieces(
        lambda x, y, f: (ground(world.name, world.preset, x, y, f, world.noise),), place[:, 0], place[:, 1], footprint
    )
    from_wall = np.minimum(half[0] - np.abs(place[:, 0]), half[1] - np.abs(place[:, 1]))
    brightness = world.light.on(np.array([[0.0, 0.0, 1.0]]))[0, 0] * (1 - 0.35 * np.exp(-np.maximum(from_wall, 0) / 0.6))
    if world.light.sunny:
        brightness[_find_shadowed(world, place)] *= SHADOW
    return np.asarray(colours * brightness[:, None], dtype=np.float32)


def _find_shadowed(world: World, place: Field) -> NDArray[np.int64]:
    """Return the indices of the places on the ground (N, 3) that lie in the shadow of a block."""
    sun = world.light.towards_sun.astype(np.float32)
    flat = float(np.hypot(sun[0], sun[1]) / sun[2])
    dark = [np.zeros(0, dtype=np.int64)]
    for block in world.blocks:
        # The shadow of a block points away from the sun; its length is the block's height over the slope of the sun's rays.
        length = block.high[2] * flat
        middle = block.middle[:2] - sun[:2] / np.hypot(sun[0], sun[1]) * length / 2
        reach = length / 2 + block.radius
        x, y = place[:, 0] - np.float32(middle[0]), place[:, 1] - np.float32(middle[1])
        near = np.flatnonzero((np.abs(x) < reach) & (np.abs(y) < reach))
        dark.append(near[np.isfinite(meet(block, place[near], sun)[0])])
    return np.unique(np.concatenate(dark))


def _block_colours(world: World, block: Block, place: Field, rays: Field, axis: NDArray[np.int64], footprint: Field) -> Field:
    """Compute colours (N, 3) on the sides of a block, whose normals are along the world's axes `axis`."""
    normals = np.zeros((len(rays), 3))
    index = np.arange(len(rays))
    normals[index, axis] = -np.sign(rays[index, axis])
    (grain,) = _apply_in_pieces(
        lambda a, b, f: (world.noise.octaves(a, b, (0.8, 0.2, 0.05), f),), place[:, 0] + place[:, 1], place[:, 2], footprint
    )
    colour = np.array(block.colour, dtype=np.float32) + 8 * grain[:, None]
    return np.asarray(colour * world.light.on(normals), dtype=np.float32)


def _apply_in_pieces(function: Callable[..., tuple[Field, ...]], *columns: Field) -> tuple[Field, ...]:
    """Apply a texture function of pictures to columns (N,) of any length, because OpenCV's remap takes at most 32767."""
    count = len(columns[0])
    width = 4096
    padded = [np.resize(np.asarray(column, dtype=np.float32), (-(-count // width), width)) for column in columns]
    return tuple(part.reshape(-1, *part.shape[2:])[:count] for part in function(*padded))
