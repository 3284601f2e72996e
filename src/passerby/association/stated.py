"""Corrections of identities by the user: boxes that are one person, or different people."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from passerby.association.associate import Pairs, Tracklets
from passerby.association.camera_tracklets import CameraTracklets
from passerby.core.observations import UNKNOWN, CameraObservations
from passerby.core.pointing import Sighting, StatedIdentities, find_pointed

STATED = 1e6
"""Evidence of a statement of the user: more than all other evidence on two tracklets, even hours of it."""


def tracklet_at(one: Sighting, seen: CameraObservations) -> int:
    """Return the tracklet of a camera's person at a pixel; -1 where there is none."""
    found = find_pointed(seen, one.frame, one.at)
    if found is None:
        return UNKNOWN
    kind, row = found
    return int((seen.boxes if kind == "boxes" else seen.keypoints).identity[row])


def stated_pairs(tracklets: Tracklets, cameras: Sequence[CameraTracklets], stated: StatedIdentities) -> Pairs | None:
    """Return the user's statements as evidence on pairs of tracklets; None where there are none."""
    number = {camera.name: c for c, camera in enumerate(cameras)}
    rows: list[tuple[int, int, float]] = []
    for groups, weight in ((stated.same, STATED), (stated.different, -STATED)):
        for group in groups:
            own = [
                (number[one.camera], tracklet)
                for one in group
                if one.camera in number and (tracklet := tracklet_at(one, cameras[number[one.camera]].seen)) > UNKNOWN
            ]
            through = sorted({int(tracklets.first[c]) + tracklet for c, tracklet in own})
            rows += [(i, j, weight) for i, j in combinations(through, 2)]
    if not rows:
        return None
    first, second, weights = zip(*rows, strict=True)
    return np.array(first, np.int64), np.array(second, np.int64), np.array(weights)
