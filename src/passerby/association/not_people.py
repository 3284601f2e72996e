"""Removal of boxes of posters, mannequins and trolleys that the user marks as no people."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from passerby.association.tracking.tracking import overlaps
from passerby.core.observations import UNKNOWN, CameraObservations
from passerby.core.pointing import Sighting, find_pointed

SAME_PLACE = 0.5
"""Least intersection over union for the same place. The median box of a tracklet in a poster's place overlaps it by more."""


def without_people(seen: CameraObservations, not_people: Collection[Sighting]) -> CameraObservations:
    """Remove the tracklets of the marked boxes from a camera's people, and those that stay in the place of a marked box.

    Args:
        seen: boxes and joints with numbers of tracklets, -1 for none.
        not_people: the marked boxes of this camera.
    """
    gone: set[int] = set()
    alone = np.zeros(len(seen.boxes), dtype=bool)
    for one in not_people:
        found = find_pointed(seen, one.frame, one.at)
        if found is None:
            continue
        kind, row = found
        gone.add(int((seen.boxes if kind == "boxes" else seen.keypoints).identity[row]))
        if kind == "boxes":
            overlap = overlaps(seen.boxes.ltwh[row : row + 1], seen.boxes.ltwh)[0]
            for who in np.unique(seen.boxes.identity[overlap > SAME_PLACE]).tolist():
                if np.median(overlap[seen.boxes.identity == who]) > SAME_PLACE:
                    gone.add(int(who))
            alone |= (seen.boxes.identity == UNKNOWN) & (overlap > SAME_PLACE)
    gone.discard(UNKNOWN)
    names = np.array(sorted(gone), dtype=np.int64)
    boxes, joints = seen.boxes, seen.keypoints
    kept = boxes.take(~np.isin(boxes.identity, names) & ~alone), joints.take(~np.isin(joints.identity, names))
    return CameraObservations(*kept, seen.wands)
