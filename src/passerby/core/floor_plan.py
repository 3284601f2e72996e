"""A floor plan or satellite picture with its scale, and what a user placed on it: cameras, and points of the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats

Pixel = tuple[float, float]

CLICK_SD_PX = 2.0
"""How well a person clicks on a mark, in a plan or in a camera's image."""
UNIT_SD = 0.002
"""Relative standard deviation of metres per pixel where it is not stated: a drawing's scale bar measured over 500 pixels to one
pixel."""


@dataclass(frozen=True, eq=False)
class PlannedCamera:
    """A camera placed on the plan."""

    camera: str
    at: Pixel
    """Of the plan."""
    sd_m: float
    """Of each coordinate, metres."""


@dataclass(frozen=True, eq=False)
class PlannedPoint:
    """A point of the ground placed on the plan, and where cameras see it."""

    name: str
    at: Pixel
    """Of the plan."""
    pixels: Mapping[str, Pixel]
    """camera -> pixel of its image."""
    sd_m: float
    """Of each coordinate on the plan, metres."""


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """A plan seen from above, in pixels: u to the right, v downwards, (0, 0) the centre of the first pixel."""

    name: str
    """What reports call it."""
    metres_per_pixel: float
    unit_sd: float
    """Relative standard deviation of `metres_per_pixel`."""
    cameras: tuple[PlannedCamera, ...] = ()
    points: tuple[PlannedPoint, ...] = ()
    origin: Pixel = (0.0, 0.0)
    """Where the world's origin lies."""
    click_sd_px: float = CLICK_SD_PX
    """Of a click in a camera's image."""

    def metres(self, pixels: Floats) -> Floats:
        """(N, 2) pixels of the plan as metres of the world: x right, y up, from the origin."""
        return np.asarray((np.asarray(pixels, dtype=np.float64) - self.origin) * (1.0, -1.0) * self.metres_per_pixel)
