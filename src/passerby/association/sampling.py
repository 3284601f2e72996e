"""Tracklets of any frame rate on one time grid: local straight-line fits to the samples around each grid time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import expanded_ranges

Values = TypeVar("Values", NDArray[np.float64], NDArray[np.complex128])

STEP_S = 0.5
"""Step of the time grid, seconds. A walking person moves 0.7 m in it: no more than the error of first ground positions."""
HALF_WINDOW_S = 0.5
"""Largest distance of samples in a fit from its grid time, seconds. It is larger for a slow camera, so that three samples fit.
"""


@dataclass(frozen=True, eq=False)
class InterpolatedSamples(Generic[Values]):
    """M samples at grid times, tracklet after tracklet."""

    step: Ints
    """(M,) grid times: the time is `step * STEP_S`."""
    tracklet: Ints
    """(M,)"""
    value: Values
    """(M, K)"""
    rate: Values
    """(M, K) change per second."""


def interpolate_samples(
    tracklet: Ints, seconds: Floats, values: Values, *, shortest_s: float = 0.0, two_suffice: bool = False
) -> InterpolatedSamples[Values]:
    """Sample columns on the grid; a sample is fitted to three rows or more.

    Args:
        tracklet: (N,) sorted.
        seconds: (N,) sorted within each tracklet.
        values: (N, K), real or complex.
        shortest_s: shorter tracklets are left out.
        two_suffice: two rows are enough if they lie on both sides of the grid time and far apart: a slow camera that misses a
            box has no more.
    """
    half = _half_window(tracklet, seconds)
    first, last = _ends(tracklet)
    long = seconds[last] - seconds[first] >= shortest_s
    rows = np.repeat(long, last - first + 1)
    tracklet, seconds, values = tracklet[rows], seconds[rows], values[rows]
    first, last = _ends(tracklet)
    start = seconds[first]
    low, high = np.ceil(start / STEP_S).astype(np.int64), np.floor(seconds[last] / STEP_S).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    owner, step = expanded_ranges(low, count)
    # Relative to each tracklet's first row, so that the sums stay small.
    owner_of_row = np.repeat(np.arange(len(first)), last - first + 1)
    t, x, at = seconds - start[owner_of_row], values - values[first][owner_of_row], step * STEP_S - start[owner]
    # Keys put the times of all tracklets one after another, so that one search serves all.
    stride = float((seconds[last] - start).max(initial=0.0)) + 4 * half
    key = t + owner_of_row * stride
    begin = np.searchsorted(key, at + owner * stride - half - 1e-9)
    end = np.searchsorted(key, at + owner * stride + half + 1e-9)
    n, st, stt = (_window(column[:, None], begin, end)[:, 0] for column in (np.ones_like(t), t, t * t))
    sx, sxt = _window(x, begin, end), _window(x * t[:, None], begin, end)
    # Moments about the grid time.
    s1, s2, sxt = st - n * at, stt - 2 * at * st + n * at**2, sxt - at[:, None] * sx
    spread = n * s2 - s1**2
    enough = n >= 3
    if two_suffice:
        enough |= (n == 2) & _embraced(t, at, begin, end, half)
    good = enough & (spread > 1e-9)
    n, s1, s2, spread, sx, sxt = n[good, None], s1[good, None], s2[good, None], spread[good, None], sx[good], sxt[good]
    value = (s2 * sx - s1 * sxt) / spread + values[first][owner[good]]
    return InterpolatedSamples(step[good], tracklet[first][owner[good]], value, (n * sxt - s1 * sx) / spread)


def _half_window(tracklet: Ints, seconds: Floats) -> float:
    """Return the largest distance of samples from a grid time, seconds: wide enough for three samples of a slow camera."""
    gaps = np.diff(seconds)[np.diff(tracklet) == 0]
    return max(HALF_WINDOW_S, 1.51 * (float(np.median(gaps)) if len(gaps) else STEP_S))


def _ends(tracklet: Ints) -> tuple[Ints, Ints]:
    """Return the first and the last row of each tracklet of a sorted column."""
    change = np.flatnonzero(np.diff(tracklet) > 0)
    some = min(len(tracklet), 1)
    return np.append(np.zeros(some, np.int64), change + 1), np.append(change, np.full(some, len(tracklet) - 1))


def _embraced(t: Floats, at: Floats, begin: Ints, end: Ints, half: float) -> NDArray[np.bool_]:
    """Check (M,) whether the rows [begin, end) lie on both sides of the grid time, and far apart."""
    earliest, latest = t[np.minimum(begin, len(t) - 1)], t[np.maximum(end - 1, 0)]
    return np.asarray((earliest <= at + 1e-9) & (latest >= at - 1e-9) & (latest - earliest > 0.5 * half))


def _window(columns: Values, begin: Ints, end: Ints) -> Values:
    """Return the sums (M, K) of columns over rows [begin, end)."""
    total = np.concatenate([np.zeros_like(columns, shape=(1, columns.shape[1])), np.cumsum(columns, axis=0)])
    summed: Values = total[end] - total[begin]
    return summed
