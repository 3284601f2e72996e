"""Joints by networks that give each joint a row of scores along x and one along y, as RTMPose does.

SimCC: Li et al., "SimCC: a simple coordinate classification perspective for human pose estimation", ECCV 2022; RTMPose: Jiang
et al., arXiv 2303.07399.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.observations import BODY_17
from passerby.perception.top_down import JOINT_COUNTS, Answers, TopDownKeypoints


class SimccKeypoints(TopDownKeypoints):
    """RTMPose and its like: outputs [N, J, k W] and [N, J, k H] for an input W x H, with k (usually 2) bins a pixel."""

    kind: ClassVar[str] = "simcc"
    # As these networks are trained and published.
    margin: ClassVar[float] = 1.25
    outputs_needed: ClassVar[str] = (
        "two outputs [N, keypoints, bins along x] and [N, keypoints, bins along y] of 17, 26 or 133 keypoints, COCO's 17 first"
    )

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """Two outputs of as many rows, with the joints that are known."""
        return (
            len(shapes) == 2
            and all(len(shape) == 2 and shape[1] >= 2 for shape in shapes)
            and shapes[0][0] == shapes[1][0]
            and shapes[0][0] in JOINT_COUNTS
        )

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """The best bins: bin b stands for the crop's pixel b / k, counted from the middle of its first.

        The confidence is the lesser of the two maxima, as their publisher's.
        """
        fractions, scores = [], []
        for bins, pixels in zip(answers, self._crops.size, strict=True):
            rows = bins[:, : len(BODY_17)]
            per_pixel = rows.shape[2] / pixels
            fractions.append((rows.argmax(axis=2) / per_pixel + 0.5) / pixels)
            scores.append(rows.max(axis=2).astype(np.float64))
        return np.stack(fractions, axis=-1), np.minimum(*scores)
