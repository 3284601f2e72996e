"""Tracklets of any frame rate on one grid of time: local straight-line fits to the samples around each grid time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEP_S = 0.5
"""Step of the time grid. A walking person moves 0.7 m meanwhile: no more than first ground positions are off by."""
HALF_WINDOW_S = 0.5
"""Samples so far from a grid time enter its fit, more where a camera is slow: three at least."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Sampled:
    """M samples at grid times, tracklet after tracklet."""

    step: Ints
    """(M,) grid times: the time is `step * STEP_S`."""
    tracklet: Ints
    """(M,)"""
    value: Floats
    """(M, K)"""
    rate: Floats
    """(M, K) change per second."""


def sampled(tracklet: Ints, seconds: Floats, values: Floats, shortest_s: float = 0.0) -> Sampled:
    """Sample columns on the grid; a sample rests on three rows or more.

    Args:
        tracklet: (N,) sorted.
        seconds: (N,) sorted within each tracklet.
        values: (N, K).
        shortest_s: shorter tracklets are left out.
    """
    n_columns = values.shape[1]
    nothing = Sampled(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, n_columns)), np.zeros((0, n_columns)))
    if len(tracklet) == 0:
        return nothing
    gaps = np.diff(seconds)[np.diff(tracklet) == 0]
    half = max(HALF_WINDOW_S, 1.51 * (float(np.median(gaps)) if len(gaps) else STEP_S))
    first = np.flatnonzero(np.concatenate([[True], np.diff(tracklet) > 0]))
    last = np.concatenate([first[1:], [len(tracklet)]]) - 1
    owner_of_row = np.repeat(np.arange(len(first)), last - first + 1)
    start = seconds[first]
    low = np.ceil(start / STEP_S).astype(np.int64)
    high = np.floor(seconds[last] / STEP_S).astype(np.int64)
    count = np.where(seconds[last] - start >= shortest_s, np.maximum(high - low + 1, 0), 0)
    owner = np.repeat(np.arange(len(first)), count)
    if len(owner) == 0:
        return nothing
    step = low[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    # Times of one tracklet after another, spread so that one search serves all.
    stride = float((seconds[last] - start).max()) + 4 * half
    key = seconds - start[owner_of_row] + owner_of_row * stride
    at = step * STEP_S - start[owner]
    begin = np.searchsorted(key, at + owner * stride - half - 1e-9)
    end = np.searchsorted(key, at + owner * stride + half + 1e-9)
    # Relative to each tracklet's first row the sums stay small.
    t, x = seconds - start[owner_of_row], values - values[first][owner_of_row]
    n, st, stt = (_window(column[:, None], begin, end)[:, 0] for column in (np.ones_like(t), t, t * t))
    sx, sxt = _window(x, begin, end), _window(x * t[:, None], begin, end)
    s1, s2, sxt = st - n * at, stt - 2 * at * st + n * at**2, sxt - at[:, None] * sx
    spread = n * s2 - s1**2
    good = (n >= 3) & (spread > 1e-9)
    n, s1, s2, spread, sx, sxt = n[good, None], s1[good, None], s2[good, None], spread[good, None], sx[good], sxt[good]
    value = (s2 * sx - s1 * sxt) / spread + values[first][owner[good]]
    return Sampled(step[good], tracklet[first][owner[good]], value, (n * sxt - s1 * sx) / spread)


def _window(columns: Floats, begin: Ints, end: Ints) -> Floats:
    """(M, K) sums of columns over rows [begin, end)."""
    total = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])
    return np.asarray(total[end] - total[begin])


def first_of(key: Ints, cost: Floats) -> Ints:
    """For every key the index of its smallest cost."""
    order = np.lexsort((cost, key))
    _, first = np.unique(key[order], return_index=True)
    return np.asarray(order[first])
