"""What the rows of a YOLOX network mean: one row for each cell of grids of several strides.

Ge et al., "YOLOX: Exceeding YOLO Series in 2021". A row holds the box, the objectness and the class scores. Some exports hold
the box in pixels of the input, others as the network gives it: its centre in cells from its own cell's corner, and the
logarithms of width and height in cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats

Values = NDArray[np.floating]

STRIDES = (8, 16, 32, 64)
PERSON = 0
"""The class of people, in COCO's order and in networks of that one class."""


@dataclass(frozen=True, eq=False)
class Cells:
    """The N cells of all grids, in the order of the rows."""

    corner: Floats
    """(N, 2) column and row in the cell's own grid."""
    stride: Floats
    """(N,) pixels of the input."""

    def __len__(self) -> int:
        return len(self.stride)


def cells_of(size: tuple[int, int], strides: tuple[int, ...]) -> Cells:
    """The cells of grids over an input of this height and width, row by row, the finest grid first."""
    corners, sizes = [], []
    for stride in strides:
        row, column = np.mgrid[: size[0] // stride, : size[1] // stride].reshape(2, -1)
        corners.append(np.stack([column, row], axis=1))
        sizes.append(np.full(len(row), float(stride)))
    return Cells(np.concatenate(corners).astype(np.float64), np.concatenate(sizes))


def matching_cells(size: tuple[int, int], rows: int) -> Cells | None:
    """The cells of the three or four grids that have this many rows; None where neither has."""
    for strides in (STRIDES[:3], STRIDES):
        cells = cells_of(size, strides)
        if len(cells) == rows:
            return cells
    return None


def is_decoded(rows: Values, cells: Cells) -> bool:
    """Whether the boxes of rows (N, 5 + C) are in pixels of the input, determined by where their centres lie.

    A cell's box is near the cell. So either the centres less the cells' corners are small, or the centres themselves are,
    counted in cells; across the input, the two differ by tens.
    """
    if (rows[:, 2:4] <= 0).any():
        return False
    pixels = np.abs(rows[:, :2] / cells.stride[:, None] - cells.corner)
    return bool(np.median(pixels) < np.median(np.abs(rows[:, :2])))


def people(rows: Values, cells: Cells, decoded: bool, floor: float) -> tuple[Floats, Floats]:
    """The boxes of people among the rows of one picture.

    Args:
        rows: (N, 5 + C) box, objectness, class scores.
        cells: the N cells.
        decoded: whether the boxes are in pixels already.
        floor: least score.

    Returns:
        (M, 4) left, top, right, bottom in pixels of the network's input and (M,) scores, objectness times the class's score,
        of the rows whose best class is a person.
    """
    score = rows[:, 4] * rows[:, 5 + PERSON]
    kept = np.flatnonzero(score >= floor)
    kept = kept[rows[kept, 5:].max(axis=1) <= rows[kept, 5 + PERSON]]
    centre, size = rows[kept, :2].astype(np.float64), rows[kept, 2:4].astype(np.float64)
    if not decoded:
        stride = cells.stride[kept, None]
        centre = (centre + cells.corner[kept]) * stride
        size = np.exp(np.minimum(size, 20.0)) * stride
    sound = np.isfinite(centre).all(axis=1) & np.isfinite(size).all(axis=1) & (size > 0).all(axis=1)
    boxes = np.concatenate([centre - size / 2, centre + size / 2], axis=1)
    return boxes[sound], score[kept][sound].astype(np.float64)
