"""Textures as functions of place: the same point of the world has the same colour in every camera."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]

TILE = 256
"""Cells after which a texture repeats."""


class Noise:
    """Smooth noise over the plane."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._tile = rng.uniform(-1, 1, (TILE, TILE)).astype(np.float32)

    def smooth(self, x: Field, y: Field, cell: float) -> Field:
        """About -1 to 1, interpolated between values at every `cell` metres of the places `x`, `y` (any shape)."""
        u, v = (axis * np.float32(1 / cell) for axis in (x, y))
        return np.asarray(cv2.remap(self._tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), dtype=np.float32)

    def of_cells(self, column: Field, row: Field) -> Field:
        """-1 to 1, one value for each cell by its whole numbers."""
        return self._tile[np.mod(row, TILE).astype(np.int64), np.mod(column, TILE).astype(np.int64)]

    def octaves(self, x: Field, y: Field, cells: Sequence[float], footprint: Field) -> Field:
        """A sum over several sizes of cells; cells smaller than the pixel's `footprint` (metres) fade away."""
        total = np.zeros_like(x)
        for cell in cells:
            total += np.clip(cell / (2 * footprint) - 0.25, 0, 1) * self.smooth(x, y, cell)
        return total / np.float32(np.sqrt(len(cells)))


def line(distance: Field, width: float, footprint: Field) -> Field:
    """How much of a pixel a line covers, 0 to 1.

    Args:
        distance: metres from the line's middle.
        width: of the line, metres.
        footprint: width of the pixel on the surface, metres.
    """
    cover = np.clip(((width + footprint) / 2 - np.abs(distance)) / footprint, 0, 1)
    return np.asarray(cover * np.minimum(1.0, width / footprint), dtype=np.float32)


def grid(place: Field, pitch: float) -> Field:
    """Distance from the nearest multiple of `pitch`, metres."""
    return np.asarray(np.abs(np.mod(place + pitch / 2, np.float32(pitch)) - np.float32(pitch / 2)), dtype=np.float32)


def mixed(colour: Field, other: Sequence[float] | Field, weight: Field) -> Field:
    """`colour` (..., 3) with the share `weight` (...) of another one."""
    return np.asarray(colour + weight[..., None] * (np.asarray(other, dtype=np.float32) - colour), dtype=np.float32)
