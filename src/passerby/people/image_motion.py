"""How fast people move through the pictures: what a camera's clock error does to where they are seen."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats, Ints

HALF_WINDOW_S = 0.4
"""Velocities are taken over twice this. Over less, noise of 2 % of the extent would grow to a tenth of a walker's velocity and
bend the offsets toward 0; over more, a gait and a turn would be lost."""
MAX_HALF_WINDOW_S = 1.0
"""Sparser samples do not show how fast a person moves in between."""
MAX_STRAY = 0.3
"""Who is farther from the line between the two neighbours than this share of the extent is another person, or turned: the
neighbours then say nothing of the velocity. Half of 3 m/s^2 times 0.4 s squared is 0.14 of a person's height."""

MIN_MOVE = 0.1
"""Who moves by less than this share of the extent between the neighbours counts as standing still: five times what
noise of 2 % in the edges alone would do. Velocities of noise would pretend that the clocks are known to be right."""


def image_velocity(frame: Ints, identity: Ints, points: Floats, extent: Floats, fps: float) -> Floats:
    """(N, 2) velocities in one camera's picture, pixels a second, by differences between samples before and after.

    The sample itself does not enter, so that its noise is not in its velocity.

    Args:
        frame: (N,) instants.
        identity: (N,) who, at most once a frame.
        points: (N, 2) pixels.
        extent: (N,) the person's size in the picture, pixels.
        fps: instants a second.

    Returns:
        Velocities; 0 where there is no sample on one of the two sides, none of the same motion, or almost no motion.
    """
    out = np.zeros((len(frame), 2))
    window = max(1, int(HALF_WINDOW_S * fps + 1e-9))
    if len(frame) == 0 or window > MAX_HALF_WINDOW_S * fps:
        return out
    span = int(np.ptp(frame)) + window + 1
    key = np.unique(identity, return_inverse=True)[1].ravel() * span + (frame - frame.min())
    order = np.argsort(key, kind="stable")
    ranked = key[order]
    before = order[np.searchsorted(ranked, key - window, side="left")]
    after = order[np.searchsorted(ranked, key + window, side="right") - 1]
    both = np.flatnonzero((frame[before] < frame) & (frame < frame[after]))
    before, after = before[both], after[both]
    seconds = (frame[after] - frame[before]) / fps
    velocity = (points[after] - points[before]) / seconds[:, None]
    middle = points[before] + velocity * ((frame[both] - frame[before]) / fps)[:, None]
    alike = np.linalg.norm(points[both] - middle, axis=1) <= MAX_STRAY * extent[both]
    moves = np.linalg.norm(points[after] - points[before], axis=1) >= MIN_MOVE * extent[both]
    out[both[alike & moves]] = velocity[alike & moves]
    return out
