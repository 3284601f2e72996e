"""The people of one camera as tracks on the ground below it, sampled on a grid of time.

Before anything is known of the other cameras, one camera's own people give its vertical and its height
(`geometry.single_view`), and so a place on the ground to every foot. Positions and velocities are local straight-line fits to
the samples around each grid time, so that cameras of different frame rates and clocks become comparable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from passerby.association.bodies import Bodies
from passerby.geometry.single_view import Level

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP_S = 0.5
"""Step of the time grid. A walking person moves 0.7 m meanwhile: no more than the ground positions are off by."""
CELL_M = 1.0
"""Cells in which a camera has seen people: about a step, and what ground positions are off by."""
MIN_TRACK_S = 1.0
"""Shorter tracklets have no direction."""
MAX_REACH_HEIGHTS = 25.0
"""Feet farther off than so many camera heights lie within 2.3 degrees of the horizon, where a tilt of one degree halves or
doubles the distance."""


@dataclass(frozen=True)
class Tolerance:
    """How far off a ground position may be: stride and box noise, and shares of the distance.

    The defaults hold for a camera levelled by its own people.
    """

    floor_m: float = 0.3
    along: float = 0.06
    """Along the ray: what is left of the level's tilt and height."""
    across: float = 0.025
    """Across the ray: what is left of its roll, and of the turn between two cameras."""
    foot_m: float = 0.0
    """Height by which a foot is off: it moves the place along the ray by so much for each camera height of distance."""


@dataclass(frozen=True, eq=False)
class GroundTracks:
    """Tracks on the ground of one camera: N samples of its tracklets at grid times, sorted by time.

    The frame is the camera's own, levelled: origin below the camera, z up, the view's heading along +y.
    """

    level: Level
    tolerance: Tolerance
    step: Ints
    """(N,) grid times: the camera's time is `step * STEP_S`."""
    tracklet: Ints
    """(N,) tracklet numbers."""
    position: NDArray[np.complex128]
    """(N,) x + iy, metres."""
    velocity: NDArray[np.complex128]
    """(N,) metres per second."""

    def __len__(self) -> int:
        return len(self.step)

    @cached_property
    def _walked(self) -> Ints:
        """Keys of the cells in which people were seen, and of their neighbours, sorted."""
        around = np.array([x + 1j * y for x in (-CELL_M, 0, CELL_M) for y in (-CELL_M, 0, CELL_M)])
        return np.unique(_cells((self.position[:, None] + around).ravel()))

    def covers(self, position: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """(N,) whether the camera has seen people about there."""
        if not len(self):
            return np.zeros(len(position), dtype=bool)
        key = _cells(position)
        at = np.minimum(np.searchsorted(self._walked, key), len(self._walked) - 1)
        return np.asarray(self._walked[at] == key)

    @property
    def sigma(self) -> tuple[Floats, Floats]:
        """(N,) how far off a position may be along its ray and (N,) across it, metres."""
        reach, t = np.abs(self.position), self.tolerance
        return t.floor_m + (t.along + t.foot_m / self.level.height) * reach, t.floor_m + t.across * reach


def _cells(position: NDArray[np.complex128]) -> Ints:
    """Keys of the cells of the ground that positions lie in."""
    x, y = (np.floor(part / CELL_M).astype(np.int64) for part in (position.real, position.imag))
    return np.asarray(x * 1_000_003 + y)


def ground_tracks(
    bodies: Bodies, level: Level, tolerance: Tolerance | None = None, *, shortest_s: float = MIN_TRACK_S
) -> GroundTracks:
    """Tracks of the bodies that belong to a tracklet (identity > -1).

    Args:
        bodies: one camera's people with their times.
        level: the camera's vertical and height.
        tolerance: how far off its ground positions may be.
        shortest_s: shorter tracklets are left out.
    """
    ground = level.ground_positions(bodies.bottom)
    use = np.isfinite(ground).all(axis=1) & (bodies.tracklet >= 0)
    use &= np.linalg.norm(np.nan_to_num(ground), axis=1) < MAX_REACH_HEIGHTS * level.height
    order = np.lexsort((bodies.seconds[use], bodies.tracklet[use]))
    tracklet, seconds = bodies.tracklet[use][order], bodies.seconds[use][order]
    place = (ground[use, 0] + 1j * ground[use, 1])[order]
    gaps = np.diff(seconds)[np.diff(tracklet) == 0]
    usual_gap = float(np.median(gaps)) if len(gaps) else STEP_S
    # Three samples at least, also of slow cameras.
    half = max(0.5, 1.51 * usual_gap)
    columns = _sampled(tracklet, seconds, place, half, shortest_s)
    return GroundTracks(level, tolerance or Tolerance(), *columns)


def _sampled(
    tracklet: Ints, seconds: Floats, place: NDArray[np.complex128], half: float, shortest_s: float
) -> tuple[Ints, Ints, NDArray[np.complex128], NDArray[np.complex128]]:
    """Local lines through the samples within `half` seconds of each grid time, by sums over sorted columns."""
    empty = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.complex128), np.zeros(0, np.complex128)
    if len(tracklet) == 0:
        return empty
    first = np.flatnonzero(np.concatenate([[True], np.diff(tracklet) > 0]))
    last = np.concatenate([first[1:], [len(tracklet)]]) - 1
    long = seconds[last] - seconds[first] >= shortest_s
    first, last = first[long], last[long]
    low, high = np.ceil(seconds[first] / STEP_S).astype(np.int64), np.floor(seconds[last] / STEP_S).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    owner = np.repeat(np.arange(len(first)), count)
    step = low[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    if len(step) == 0:
        return empty
    # Times of one tracklet after another, shifted so that one search serves all.
    start, stop = seconds[first], seconds[last]
    stride = float((stop - start).max()) + 4 * half
    base = np.searchsorted(first, np.arange(len(seconds)), side="right") - 1
    inside = (base >= 0) & (np.arange(len(seconds)) <= last[np.maximum(base, 0)])
    key = (seconds[inside] - start[base[inside]]) + base[inside] * stride
    at = step * STEP_S - start[owner] + owner * stride
    begin, end = np.searchsorted(key, at - half - 1e-9), np.searchsorted(key, at + half + 1e-9)
    value = place[inside]
    # Times relative to each tracklet's start and places relative to its first keep the sums small.
    t = seconds[inside] - start[base[inside]]
    origin = place[first]
    x = value - origin[base[inside]]
    sums = [_window(column, begin, end) for column in (np.ones_like(t), t, t * t, x, x * t)]
    n, st, stt = (total.real for total in sums[:3])
    sx, sxt = sums[3:]
    tau = step * STEP_S - start[owner]
    # Moments about the grid time.
    s1, s2 = st - n * tau, stt - 2 * tau * st + n * tau**2
    sxt = sxt - tau * sx
    spread = n * s2 - s1**2
    # Two samples do where they embrace the grid time from afar: a slow camera that misses a box has no more.
    earliest, latest = t[np.minimum(begin, len(t) - 1)], t[np.maximum(end - 1, 0)]
    embraced = (earliest <= tau + 1e-9) & (latest >= tau - 1e-9) & (latest - earliest > 0.5 * half)
    good = ((n >= 3) | ((n == 2) & embraced)) & (spread > 1e-9)
    spread = np.where(good, spread, 1.0)
    velocity = (n * sxt - s1 * sx) / spread
    position = (s2 * sx - s1 * sxt) / spread + origin[owner]
    good &= np.isfinite(position) & (np.abs(velocity) < 12.0)
    order = np.argsort(step[good], kind="stable")
    return step[good][order], tracklet[first][owner][good][order], position[good][order], velocity[good][order]


def _window(column: NDArray[np.complex128] | Floats, begin: Ints, end: Ints) -> NDArray[np.complex128]:
    """Sums of a column over [begin, end)."""
    total = np.concatenate([[0], np.cumsum(column.astype(np.complex128))])
    return np.asarray(total[end] - total[begin])
