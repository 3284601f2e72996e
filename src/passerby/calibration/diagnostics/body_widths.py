"""Are people as wide as people are? What boxes say of the scale besides their heights.

A rig whose scale rests on how tall people are taken to be is wrong by as much as the boxes are: people who wade or bend down,
who stand behind a counter, or are boxed with their mirror image in a wet floor. All angles fit. But then the boxes are too
wide, or too narrow, for people.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.findings.finding import Finding, doubt

BORDER_PX = 2.0
"""A box that is nearer to the picture's border may be cut off by it."""
MIN_BOXES = 100
NARROWEST_M, WIDEST_M = 0.4, 1.0
"""Median width of the boxes, metres: 0.55 to 0.70 in ordinary simulated scenes, whose people swing arms and legs (seeds
from 940000, 24 scenes); 0.44 to 0.81 with detectors that leave 5 % of the height away at each edge, or add 10 % (9 of
them). Pedestrians are annotated 0.41 times as wide as tall (Dollar et al. 2012, *Pedestrian Detection: An Evaluation of
the State of the Art*)."""


def doubts_of_widths(rig: Rig, observations: Observations, keys: Floats, places: Floats, grown: float = 1.0) -> list[Finding]:
    """A doubt where boxes are too narrow or too wide for people at the scale of the rig.

    Arguments as of `body_widths`; `grown` is what the lengths of the rig are multiplied by afterwards.
    """
    widths = grown * body_widths(rig, observations, keys, places)
    if len(widths) < MIN_BOXES:
        return []
    width = float(np.median(widths))
    return [] if NARROWEST_M <= width <= WIDEST_M else [doubt("boxes_misshapen", width_m=width)]


def body_widths(rig: Rig, observations: Observations, keys: Floats, places: Floats) -> Floats:
    """(K,) metres, the widths of boxes of people who were placed by two cameras or more; those at a picture's border left out.

    Args:
        rig: lenses and poses.
        observations: people at common instants.
        keys: (N, 2) frame and identity of who was placed.
        places: (N, 3) where, world, metres.
    """
    out = [np.zeros(0)]
    for camera in rig.posed() if len(keys) else ():
        boxes, size = observations[camera.name].boxes, np.array(camera.lens.size)
        low, high = boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]
        row, place = _placed(np.column_stack([boxes.frame, boxes.identity]), keys)
        whole = (low[row] > BORDER_PX).all(axis=1) & (high[row] < size - BORDER_PX).all(axis=1)
        row, place = row[whole], place[whole]
        middle = (low[row, 1] + high[row, 1]) / 2
        left, right = (camera.lens.bearings(np.column_stack([x[row, 0], middle])) for x in (low, high))
        angle = 2 * np.arcsin(np.clip(np.linalg.norm(left - right, axis=1) / 2, 0.0, 1.0))
        out.append(np.linalg.norm(places[place] - camera.centre, axis=1) * angle)
    widths = np.concatenate(out)
    return np.asarray(widths[np.isfinite(widths)])


def _placed(rows: Floats, keys: Floats) -> tuple[Ints, Ints]:
    """Rows (K,) whose frame and identity are among the keys (N, 2), and which key (K,) it is."""
    number = np.unique(np.concatenate([keys, rows]), axis=0, return_inverse=True)[1].ravel()
    key_of = np.full(int(number.max()) + 1, -1)
    key_of[number[: len(keys)]] = np.arange(len(keys))
    key = key_of[number[len(keys) :]]
    found = np.flatnonzero(key >= 0)
    return found, key[found]
