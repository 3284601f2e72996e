"""Joints by MoveNet's single-person networks: one square crop in, 17 joints out."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from passerby.common.arrays import Floats
from passerby.perception.top_down import Answers, TopDownKeypoints


class MovenetKeypoints(TopDownKeypoints):
    """MoveNet lightning and thunder (Google): output [N, 1, 17, 3], each joint's y, x as fractions of the crop, and score."""

    kind: ClassVar[str] = "movenet"
    # Median distance to OpenPose's joints (44 pictures of one person, boxes 5 % larger than the joints' extent) as a share of
    # the box's height, lightning and thunder: 1.46 % and 1.26 % at 1.0, 1.51 and 1.28 at 1.1, 1.59 and 1.35 at 1.2, 1.70 and
    # 1.42 at 1.3. 1.1 has the most of lightning's joints within 5 % (97 %) and bears a box that cuts off the feet. A second
    # pass on a crop about the first one's joints, as where there is no detector, does not pay: 1.59, 1.37 % in twice the time.
    margin: ClassVar[float] = 1.1
    outputs_needed: ClassVar[str] = "one output [N, 1, 17, 3]: y, x and score of COCO's 17 keypoints"

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """One output of 17 joints with three numbers each."""
        return len(shapes) == 1 and shapes[0] in ((1, 17, 3), (17, 3))

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """As fractions of the crop already."""
        joints = answers[0].reshape(len(answers[0]), 17, 3).astype(np.float64)
        return joints[..., [1, 0]], joints[..., 2]
