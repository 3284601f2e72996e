"""The ground of each preset: paving, a court, a building site. Colours are blue, green, red."""

from __future__ import annotations

import numpy as np

from passerby.simulation.presets import Preset
from passerby.simulation.rendering.textures import Field, Noise, grid, line, mixed

STONE_M = 0.6
COARSE = (5.0, 1.7, 0.6)
FINE = (0.25, 0.09, 0.03)
WHITE = (225.0, 228.0, 228.0)
COURT_SHARE = 0.42
"""Half of the court's extent as a share of the area: its lines lie inside the area where people run."""


def ground(name: str, preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """(..., 3) colours of the ground in full light.

    Args:
        name: of the preset.
        preset: its area.
        x: place on the ground from the area's middle, metres.
        y: the same, the other axis.
        footprint: size of a pixel there, metres.
        noise: of the scene.
    """
    surface = {"terrace": _paving, "basketball": _court, "construction": _site}[name]
    return surface(preset, x, y, footprint, noise)


def _paving(preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """Stones of slightly different greys, dark joints, stains."""
    own = noise.of_cells(np.floor(x / STONE_M + 0.5), np.floor(y / STONE_M + 0.5)) * np.clip(STONE_M / (2 * footprint), 0, 1)
    level = 150 + 9 * own + 13 * noise.octaves(x, y, COARSE, footprint) + 11 * noise.octaves(y, x, FINE, footprint)
    tint = 4 * noise.smooth(x + 50, y, 1.1)
    colour = np.stack([level - 10 - tint, level - 2, level + 4 + tint], axis=-1)
    joints = np.maximum(
        line(grid(x - STONE_M / 2, STONE_M), 0.012, footprint), line(grid(y - STONE_M / 2, STONE_M), 0.012, footprint)
    )
    return mixed(colour, (80, 85, 88), np.float32(0.8) * joints)


def _court(preset: Preset, x: Field, y: Field, footprint: Field, noise: Noise) -> Field:
    """A painted court with white lines, asphalt around it."""
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
    """Earth with gravel and tyre tracks, and a slab of concrete."""
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
