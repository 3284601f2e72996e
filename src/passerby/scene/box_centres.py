"""Are boxes given by their centres, where their left and upper edges are expected?

Many detectors write centre, width and height. Read as corners, all boxes move right and down by half of themselves. Then people
at the right and the lower border of the images stand half outside, and nobody comes nearer to the left and the upper one
than half of a box. Boxes of people who are cut off by the border, drawn as if they were not, reach beyond left and right alike,
and some of them by more than half of themselves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.findings.finding import Finding, doubt

BEYOND, NEAR = 0.2, 0.3
"""Shares of a box: more of it lies beyond the right or lower border; less of it would fit before the left or upper one."""
FEWEST, MOST_ELSEWHERE = 10, 0.1
"""Boxes beyond each of the two borders, and how many may be near the border across, as a share of these."""
ALONE, HALF, MOST_FARTHER = 5, 0.55, 0.02
"""The same number in a camera by itself, where a box by its centre reaches beyond a border by half of itself at most; how many
may go farther, as a share. Bodies that are drawn whole are often cut off by more."""


def doubt_of_centres(rig: Rig, boxes: Iterable[Boxes]) -> Finding | None:
    """A doubt about the cameras whose boxes seem to be given by their centres; None where there are none.

    Args:
        rig: the cameras.
        boxes: their boxes, in the same order. One detector usually found them all, so that they are counted together; one
            camera may have boxes of another tool, so that each is looked at by itself as well.
    """
    counts = {camera.name: _Borders.of(seen, camera.lens.size) for camera, seen in zip(rig, boxes, strict=True)}
    together = _Borders(
        *(np.sum([getattr(one, key) for one in counts.values()], axis=0) for key in ("beyond", "farther", "near"))
    )
    if counts and together.one_sided(FEWEST):
        cameras = [name for name, own in counts.items() if own.beyond.any()]
    else:
        cameras = [name for name, own in counts.items() if own.one_sided(ALONE) and own.by_half]
    if not cameras:
        return None
    return doubt("boxes_by_centres", *cameras, beyond=int(sum(counts[name].beyond.sum() for name in cameras)))


@dataclass(frozen=True)
class _Borders:
    """(2,) numbers of boxes."""

    beyond: Ints
    """Beyond the right and the lower border,"""
    farther: Ints
    """those of them by more than half of themselves,"""
    near: Ints
    """and near the left and the upper one."""

    @classmethod
    def of(cls, boxes: Boxes, size: tuple[int, int]) -> _Borders:
        corner, extent = boxes.ltwh[:, :2], boxes.ltwh[:, 2:]
        over = (corner + extent - np.array(size)) / np.maximum(extent, 1e-9)
        return cls((over > BEYOND).sum(axis=0), (over > HALF).sum(axis=0), (corner < NEAR * extent).sum(axis=0))

    def one_sided(self, fewest: int) -> bool:
        """Whether so many are beyond each of two borders, and hardly any come near the other two."""
        return bool((self.beyond >= fewest).all() and (self.near <= MOST_ELSEWHERE * self.beyond).all())

    @property
    def by_half(self) -> bool:
        """Whether they reach as far as the half of a box, which hides no further."""
        return bool((self.farther <= MOST_FARTHER * self.beyond).all())
