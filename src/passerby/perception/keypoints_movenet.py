"""Joints by MoveNet's single-person networks: one square crop in, 17 joints out."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from passerby.observations import Floats
from passerby.perception.top_down import Answers, TopDownKeypoints


class MovenetKeypoints(TopDownKeypoints):
    """MoveNet lightning and thunder (Google): output [N, 1, 17, 3], each joint's y, x as fractions of the crop, and score."""

    kind: ClassVar[str] = "movenet"
    margin: ClassVar[float] = 1.25
    outputs_needed: ClassVar[str] = "one output [N, 1, 17, 3]: y, x and score of COCO's 17 joints"

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """One output of 17 joints with three numbers each."""
        return len(shapes) == 1 and shapes[0] in ((1, 17, 3), (17, 3))

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """As fractions of the crop already."""
        joints = answers[0].reshape(len(answers[0]), 17, 3).astype(np.float64)
        return joints[..., [1, 0]], joints[..., 2]
