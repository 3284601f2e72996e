"""People whose boxes a file states, in place of a detector."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from passerby.common.arrays import Ints
from passerby.core.observations import Boxes, Keypoints, Vectors
from passerby.perception.kept import hash_of_arrays
from passerby.perception.pictures import Detections, Frame


class GivenBoxes:
    """The boxes that a file states, in place of a detector."""

    def __init__(self, boxes: Boxes) -> None:
        self._boxes = boxes
        self._order = np.argsort(boxes.frame, kind="stable")
        self._frames = boxes.frame[self._order]

    @property
    def identity(self) -> dict[str, Any]:
        """The boxes' content."""
        return {"detector": "given", "boxes": hash_of_arrays(self._boxes.frame, self._boxes.ltwh)}

    def __call__(self, frame: Frame) -> Detections:
        """The boxes of a frame, in the order of the file."""
        rows = self._rows(frame.number)
        return Detections(self._boxes.ltwh[rows], self._boxes.score[rows])

    def named(self, frame: Ints, appearance: Vectors | None, keypoints: Keypoints) -> tuple[Boxes, Keypoints]:
        """All boxes in the order of the file, with the embeddings of those that were looked at, and the joints by their names.

        `frame` are the frame numbers of the rows that were looked at, as the pictures came.
        """
        rows = np.concatenate([self._rows(number) for number in np.unique(frame).tolist()] or [np.zeros(0, np.int64)])
        boxes = self._boxes
        if appearance is not None:
            vectors = no_embeddings(len(boxes), appearance.shape[1])
            vectors[rows] = appearance
            boxes = replace(boxes, embedding=vectors)
        return boxes, replace(keypoints, identity=boxes.identity[rows]) if len(keypoints) else keypoints

    def _rows(self, number: int) -> Ints:
        low, high = np.searchsorted(self._frames, (number, number + 1))
        return np.asarray(self._order[low:high])


def no_embeddings(rows: int, dimensions: int) -> Vectors:
    """(rows, dimensions): embeddings of boxes that were not looked at."""
    return np.zeros((rows, dimensions), dtype=np.float32)
