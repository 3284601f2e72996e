"""Where people are in a picture: the rectangles of boxes, and those around joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from passerby.core.observations import Boxes, Keypoints


def extents_of(part: Boxes | Keypoints) -> NDArray[np.float64]:
    """(N, 4) left, top, right, bottom of each person, pixels; of joints around those that were found, zeros where none was."""
    if isinstance(part, Boxes):
        return np.column_stack([part.ltwh[:, :2], part.ltwh[:, :2] + part.ltwh[:, 2:]])
    found = part.score[..., None] > 0
    some = found.any(axis=1)
    low = np.where(some, np.where(found, part.xy, np.inf).min(axis=1, initial=np.inf), 0.0)
    high = np.where(some, np.where(found, part.xy, -np.inf).max(axis=1, initial=-np.inf), 0.0)
    return np.column_stack([low, high])
