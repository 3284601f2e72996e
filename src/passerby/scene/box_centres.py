"""Are boxes given by their centres, where their left and upper edges are expected?

Many detectors write centre, width and height. Read as corners, all boxes move right and down by half of themselves. Then people
at the right and the lower border of the images stand half outside, and nobody comes nearer to the left and the upper one
than half of a box. Boxes of people who are cut off by the border, drawn as if they were not, reach beyond left and right alike.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.findings.finding import Finding, doubt

BEYOND, NEAR = 0.2, 0.3
"""Shares of a box: more of it lies beyond the right or lower border; less of it would fit before the left or upper one."""
FEWEST, MOST_ELSEWHERE = 10, 0.1
"""Boxes beyond each of the two borders, and how many may be near the border across, as a share of these."""


def doubt_of_centres(rig: Rig, boxes: Iterable[Boxes]) -> Finding | None:
    """A doubt about the cameras whose boxes seem to be given by their centres; None where there are none.

    Args:
        rig: the cameras.
        boxes: their boxes, in the same order. One detector usually found them all, so that they are counted together.
    """
    counts = {camera.name: _beyond_and_near(seen, camera.lens.size) for camera, seen in zip(rig, boxes, strict=True)}
    beyond, near = np.sum([*counts.values()], axis=0).reshape(-1, 2, 2).sum(axis=0) if counts else np.zeros((2, 2))
    if (beyond < FEWEST).any() or (near > MOST_ELSEWHERE * beyond).any():
        return None
    cameras = [name for name, (own, _) in counts.items() if own.any()]
    return doubt("boxes_by_centres", *cameras, beyond=int(beyond.sum()))


def _beyond_and_near(boxes: Boxes, size: tuple[int, int]) -> tuple[Ints, Ints]:
    """(2,) boxes beyond the right and the lower border, and (2,) near the left and the upper one."""
    corner, extent = boxes.ltwh[:, :2], boxes.ltwh[:, 2:]
    beyond = corner + extent > np.array(size) + BEYOND * extent
    return beyond.sum(axis=0), (corner < NEAR * extent).sum(axis=0)
