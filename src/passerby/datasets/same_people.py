"""Which of the people whose positions were annotated is which of those whose boxes were: two annotations, each with its ids."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Boxes
from passerby.datasets.published import GroundTruth

FARTHEST_M = 0.6
"""Two are the same person where the median distance of the box's foot point from the position is below: half a shoulder's
width, half a cell of EPFL's grid (0.13 m), and some pixels at the far end. Strangers are metres apart."""
LEAST_SIGHTINGS = 3


def with_identities_of(boxes: Mapping[str, Boxes], rig: Rig, ground: GroundTruth) -> tuple[GroundTruth, tuple[str, ...]]:
    """The positions with the identities of the boxes; and what to note.

    Box and position are compared through the true poses: the middle of a box's lower edge is taken for a point of the ground.
    A person without boxes gets a number above all of theirs.

    Args:
        boxes: by camera, true identities.
        rig: poses of these cameras, metres.
        ground: positions, with identities of their own.
    """
    feet = [_feet(rig[camera], seen) for camera, seen in boxes.items() if rig[camera].pose is not None and len(seen)]
    if not feet or not len(ground):
        return ground, ()
    frame, who = (np.concatenate([part[column] for part in feet]) for column in (0, 1))
    xy = np.concatenate([part[2] for part in feet])
    ours, theirs = np.unique(who[who > UNKNOWN]), np.unique(ground.identity)
    if not len(ours):
        return ground, ()
    apart = np.array([[_distance(frame, who, xy, one, ground, other) for one in ours] for other in theirs])
    rows, columns = linear_sum_assignment(np.where(np.isfinite(apart), apart, 1e6))
    pairs = [pair for pair in zip(rows.tolist(), columns.tolist(), strict=True) if apart[pair] < FARTHEST_M]
    same = {int(theirs[row]): int(ours[column]) for row, column in pairs}
    strangers = [int(identity) for identity in theirs if int(identity) not in same]
    names = same | {identity: int(ours.max()) + number for number, identity in enumerate(strangers, start=1)}
    identity = np.array([names[int(one)] for one in ground.identity], dtype=np.int64)
    note = f"Of {len(theirs)} people with positions, {len(same)} were found among those with boxes, and have their numbers."
    return GroundTruth(ground.frame, identity, ground.xy), (note,)


def _feet(camera: Camera, boxes: Boxes) -> tuple[Ints, Ints, Floats]:
    """Frame, identity and (N, 2) place on the ground of a camera's boxes."""
    assert camera.pose is not None
    pixels = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] * (0.5, 1.0)
    rays = camera.lens.bearings(pixels) @ camera.pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = camera.centre[:2] - rays[:, :2] * (camera.centre[2] / rays[:, 2:])
    down = rays[:, 2] < 0
    return boxes.frame[down], boxes.identity[down], xy[down]


def _distance(frame: Ints, who: Ints, xy: Floats, one: int, ground: GroundTruth, other: int) -> float:
    """Median distance of one person's foot points from another's positions, metres; infinite where they rarely meet."""
    there = ground.identity == other
    place = dict(zip(ground.frame[there].tolist(), ground.xy[there], strict=True))
    rows = [row for row in np.flatnonzero(who == one).tolist() if int(frame[row]) in place]
    if len(rows) < LEAST_SIGHTINGS:
        return float("inf")
    return float(np.median(np.linalg.norm(xy[rows] - np.array([place[int(frame[row])] for row in rows]), axis=1)))
