"""Smoothing of a walker's trajectory: constant velocity, forward filter and backward smoother.

Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA Journal 1965; the motion is white-noise
acceleration (Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 6.2.2).
Long trajectories are smoothed in blocks side by side: measurements some seconds outside a block do not affect it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints

ACCELERATION = 0.5
"""Density of the white-noise acceleration, m^2/s^3: within a second a person's velocity changes by 0.7 m/s (one sigma)."""
START_SPEED = 1.5
"""One sigma of an unknown velocity, m/s."""
UNSEEN = 1e8
"""Variance of a missing measurement, m^2."""
BLOCK, MARGIN_S = 400, 6.0
"""Instants of a block, and seconds added before and after it: measurements 6 s away move a position by micrometres."""

CELLS = 60_000
"""Approximate number of instants in blocks that are smoothed side by side: memory stays at 40 MB for any recording."""


def smooth(
    seconds: Floats, place: Floats, covariance: Floats, part: Ints, acceleration: float = ACCELERATION
) -> tuple[Floats, Floats]:
    """Smooth measured positions.

    Args:
        seconds: (N,) ascending within a part.
        place: (N, 2) measured, metres; NaN where nothing was seen.
        covariance: (N, 2, 2) of the measurements.
        part: (N,) ascending numbers of parts, smoothed independently; the first position of each part is measured.
        acceleration: density of the white-noise acceleration, m^2/s^3.

    Returns:
        (N, 2) positions; (N, 2, 2) their covariances, valid if measurements are independent of each other.
    """
    blocks = _blocks(seconds, part)
    out, out_covariance = np.full_like(place, np.nan), np.full((len(place), 2, 2), np.nan)
    if not len(blocks):
        return out, out_covariance
    length = blocks[:, 3] - blocks[:, 0]
    order = np.argsort(-length, kind="stable")
    while len(order):
        side_by_side = max(1, CELLS // int(length[order[0]]))
        chosen, order = blocks[order[:side_by_side]], order[side_by_side:]
        rows, xy, spread = _smoothed_blocks(chosen, seconds, place, covariance, acceleration)
        out[rows], out_covariance[rows] = xy, spread
    return out, out_covariance


def _smoothed_blocks(
    blocks: Ints, seconds: Floats, place: Floats, covariance: Floats, acceleration: float
) -> tuple[Ints, Floats, Floats]:
    """Smooth blocks: return the rows (K,) of their cores, positions (K, 2) and covariances (K, 2, 2)."""
    length = int((blocks[:, 3] - blocks[:, 0]).max())
    index = np.arange(length)
    rows = np.minimum(blocks[:, :1] + index, blocks[:, 3:] - 1)
    real: NDArray[np.bool_] = blocks[:, :1] + index < blocks[:, 3:]
    step = np.diff(seconds[rows], axis=1, prepend=seconds[rows[:, :1]])
    found: NDArray[np.bool_] = np.asarray(np.isfinite(place).all(axis=1))
    seen = real & found[rows]
    measured = np.where(seen[:, :, None], place[rows], 0.0)
    noise = np.where(seen[:, :, None, None], covariance[rows], UNSEEN * np.eye(2))
    state, spread = _run(step, measured, noise, _start(place, rows, seen), acceleration)
    core: NDArray[np.bool_] = (blocks[:, 1:2] - blocks[:, :1] <= index) & (index < blocks[:, 2:3] - blocks[:, :1])
    return rows[core], state[core][:, :2], spread[core][:, :2, :2]


def _blocks(seconds: Floats, part: Ints) -> Ints:
    """Cut the parts into blocks (B, 4), as rows: begin of the margin, begin and end of the core, end of the margin."""
    blocks = []
    edges = np.flatnonzero(np.diff(part, prepend=part[:1] - 1, append=part[-1:] + 1)) if len(part) else np.zeros(0, np.int64)
    for low, high in pairwise(edges):
        for first in range(int(low), int(high), BLOCK):
            last = min(first + BLOCK, int(high))
            before = low + np.searchsorted(seconds[low:high], seconds[first] - MARGIN_S)
            after = low + np.searchsorted(seconds[low:high], seconds[last - 1] + MARGIN_S, side="right")
            blocks.append((int(before), first, last, int(after)))
    return np.array(blocks, dtype=np.int64).reshape(-1, 4)


def _start(place: Floats, rows: Ints, seen: NDArray[np.bool_]) -> Floats:
    """Return the first measured position (B, 2) of each block; 0 where there is none."""
    first = rows[np.arange(len(rows)), np.argmax(seen, axis=1)]
    any_seen: NDArray[np.bool_] = np.asarray(seen.any(axis=1))
    return np.where(any_seen[:, None], place[first], 0.0)


def _run(step: Floats, place: Floats, noise: Floats, start: Floats, acceleration: float) -> tuple[Floats, Floats]:
    """Filter and smooth B blocks of (B, L) steps: return states x, y, vx, vy (B, L, 4) and covariances (B, L, 4, 4)."""
    n, length = step.shape
    transition = np.broadcast_to(np.eye(4), (length, n, 4, 4)).copy()
    transition[:, :, 0, 2] = transition[:, :, 1, 3] = step.T
    state, spread = np.zeros((length, n, 4)), np.zeros((length, n, 4, 4))
    ahead, ahead_spread = np.zeros((length, n, 4)), np.zeros((length, n, 4, 4))
    x = np.concatenate([start, np.zeros((n, 2))], axis=1)
    P = np.broadcast_to(np.diag([1e4, 1e4, START_SPEED**2, START_SPEED**2]), (n, 4, 4))
    for k in range(length):
        F = transition[k]
        x = (F @ x[:, :, None])[:, :, 0]
        P = F @ P @ F.transpose(0, 2, 1) + _process(step[:, k], acceleration)
        ahead[k], ahead_spread[k] = x, P
        gain = P[:, :, :2] @ _inverse2(P[:, :2, :2] + noise[:, k])
        x = x + (gain @ (place[:, k] - x[:, :2])[:, :, None])[:, :, 0]
        P = P - gain @ P[:, :2, :]
        P = 0.5 * (P + P.transpose(0, 2, 1))
        state[k], spread[k] = x, P
    for k in range(length - 2, -1, -1):
        back = np.linalg.solve(ahead_spread[k + 1], transition[k + 1] @ spread[k]).transpose(0, 2, 1)
        state[k] += (back @ (state[k + 1] - ahead[k + 1])[:, :, None])[:, :, 0]
        spread[k] += back @ (spread[k + 1] - ahead_spread[k + 1]) @ back.transpose(0, 2, 1)
    return state.transpose(1, 0, 2), spread.transpose(1, 0, 2, 3)


def _process(step: Floats, acceleration: float) -> Floats:
    """Return the process noise (B, 4, 4) that acceleration adds in a step."""
    Q = np.zeros((len(step), 4, 4))
    for axis in (0, 1):
        Q[:, axis, axis] = step**3 / 3
        Q[:, axis, axis + 2] = Q[:, axis + 2, axis] = step**2 / 2
        # Steps of zero length, as after the end of a short block, would leave a singular covariance.
        Q[:, axis + 2, axis + 2] = step
    return acceleration * Q + 1e-12 * np.eye(4)


def _inverse2(m: Floats) -> Floats:
    """Invert matrices (B, 2, 2)."""
    a, b, c, d = m[:, 0, 0], m[:, 0, 1], m[:, 1, 0], m[:, 1, 1]
    return np.asarray(np.array([[d, -b], [-c, a]]).transpose(2, 0, 1) / (a * d - b * c)[:, None, None])
