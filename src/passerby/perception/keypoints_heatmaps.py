"""Joints by networks that draw each joint's place on a map of its own, such as HRNet, Simple Baselines and ViTPose."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.observations import BODY_17
from passerby.perception.top_down import JOINT_COUNTS, Answers, TopDownKeypoints


class HeatmapKeypoints(TopDownKeypoints):
    """One output [N, J, h, w], a map of the crop with a bump at each joint; its height is the confidence."""

    kind: ClassVar[str] = "heatmaps"
    # As these networks are trained and published.
    margin: ClassVar[float] = 1.25
    outputs_needed: ClassVar[str] = "one output [N, keypoints, height, width] of 17, 26 or 133 keypoints, COCO's 17 first"

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """One map a joint that is known."""
        return len(shapes) == 1 and len(shapes[0]) == 3 and shapes[0][0] in JOINT_COUNTS and min(shapes[0][1:]) >= 3

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """The tops of the bumps, as fractions of the map.

        Families differ in where they place a map's cell on the crop, from its corner (HRNet) to corner on corner (UDP,
        ViTPose): here its middle, which is half-way between them and within 1.5 of 256 pixels of both.
        """
        maps = answers[0][:, : len(BODY_17)].astype(np.float64)
        n, joints, height, width = maps.shape
        best = maps.reshape(n, joints, -1).argmax(axis=2)
        row, column = np.divmod(best, width)
        person, joint = np.arange(n)[:, None], np.arange(joints)[None, :]
        across = maps[person, joint, row, :]
        along = maps[person, joint, :, column]
        xy = np.stack([(_top(across, column) + 0.5) / width, (_top(along, row) + 0.5) / height], axis=-1)
        return xy, maps.max(axis=(2, 3))


def _top(line: Floats, place: NDArray[np.int64]) -> Floats:
    """(N, J) the top of a bell about the largest value of lines (N, J, L): of the parabola through three logarithms."""
    length = line.shape[2]
    near = np.clip(place, 1, length - 2)[..., None] + np.array([-1, 0, 1])
    before, at, after = np.moveaxis(np.log(np.maximum(np.take_along_axis(line, near, axis=2), 1e-12)), 2, 0)
    bend = 2.0 * at - before - after
    inner = (place > 0) & (place < length - 1) & (bend > 1e-9)
    shift = np.where(inner, 0.5 * (after - before) / np.where(inner, bend, 1.0), 0.0)
    return np.asarray(place + np.clip(shift, -0.5, 0.5))
