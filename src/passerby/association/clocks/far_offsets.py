"""Search for the lag of two cameras over all lags at which their recordings overlap, where clocks differ by more than expected.

The full search (`hough`) takes some 20 ms a lag: too long for thousands of lags. Here fewer encounters vote at fewer turns, on
a coarser grid, at every second lag. Only the lags with most votes are registered in full.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.association.ground.cooccurrence import TrackPair, find_synchronous_pairs
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.ground.hough import SAME_LAG_S
from passerby.association.ground.pair_matching import WALKING
from passerby.association.ground.registration import Registration, register_pair
from passerby.association.sampling import STEP_S

LEAST_OVERLAP_S = 20.0
"""Least overlap of two recordings at a lag, seconds: a result needs 30 samples, 15 s of a walker."""
MOST_LAGS = 4000
"""Largest number of lags, a second apart, at some 5 ms each: 20 s for differences of up to half an hour. Larger differences are
not found."""
_STRIDE = 2
"""Grid steps between two lags: in half of these, 0.5 s, a walker moves less than half a cell."""
_TURNS, _CELLS, _CELL_M, _VELOCITY_SD = 18, 64, 2.0, 0.5
_INSTANTS, _VOTERS = 120, 4000
_REGISTERED = 6
"""Number of lags with most votes that are registered in full."""


def far_registration(a: GroundTracks, b: GroundTracks, beyond_s: float, alone_below: float) -> Registration | None:
    """Register two cameras at a lag above `beyond_s` seconds; return None where no registration stands out.

    Args:
        a: tracks of the first camera.
        b: tracks of the second.
        beyond_s: lags up to this have been searched, seconds.
        alone_below: the best registration at any other lag must have less than this share of the best score.
    """
    found: list[Registration] = []
    for lag in find_lag_candidates(TrackPair(a, b), beyond_s):
        near = register_pair(0, 1, a, replace(b, step=b.step - lag), SAME_LAG_S)
        if near.candidates and near.runner_up < alone_below:
            best = near.candidates[0]
            found.append(replace(best, lag_s=best.lag_s + lag * STEP_S))
    found.sort(key=lambda one: -one.score)
    if not found or any(
        other.score >= alone_below * found[0].score for other in found[1:] if abs(other.lag_s - found[0].lag_s) > SAME_LAG_S
    ):
        return None
    return found[0]


def find_lag_candidates(tracks: TrackPair, beyond_s: float) -> list[int]:
    """Find the lags above `beyond_s` seconds with most votes, in grid steps, the best first, none near another."""
    least = int(LEAST_OVERLAP_S / STEP_S)
    low, high = tracks.b.step[0] - tracks.a.step[-1] + least, tracks.b.step[-1] - tracks.a.step[0] - least
    half = _STRIDE * (MOST_LAGS // 2)
    lags = np.arange(max(low, -half), min(high, half) + 1, _STRIDE)
    lags = lags[np.abs(lags) * STEP_S > beyond_s]
    most = min(_INSTANTS, tracks.instants_of(_VOTERS))
    votes = np.array([_votes(tracks, int(lag), most) for lag in lags])
    chosen: list[int] = []
    for k in np.argsort(-votes, kind="stable").tolist():
        if len(chosen) == _REGISTERED or votes[k] <= 0:
            break
        if all(abs(int(lags[k]) - lag) * STEP_S > SAME_LAG_S for lag in chosen):
            chosen.append(int(lags[k]))
    return chosen


def _votes(tracks: TrackPair, lag: int, most_instants: int) -> float:
    """Return the largest number of votes of any motion at a lag."""
    met = find_synchronous_pairs(tracks, lag, most_instants, 1)
    if not len(met):
        return 0.0
    velocity_a, velocity_b = tracks.a.velocity[met.a], tracks.b.velocity[met.b]
    fast = np.minimum(np.abs(velocity_a), np.abs(velocity_b))
    use = np.flatnonzero((np.abs(np.abs(velocity_a) - np.abs(velocity_b)) < 2 * _VELOCITY_SD) & (fast > 0.5 * WALKING))
    velocity_a, velocity_b = velocity_a[use], velocity_b[use]
    place_a, place_b = tracks.a.position[met.a[use]] / _CELL_M, tracks.b.position[met.b[use]] / _CELL_M
    best = 0.0
    for turn in np.exp(2j * np.pi * np.arange(_TURNS) / _TURNS):
        rows = np.flatnonzero(np.abs(turn * velocity_a - velocity_b) < 1.5 * _VELOCITY_SD)
        shift = place_b[rows] - turn * place_a[rows]
        cell = np.floor(np.column_stack([shift.real, shift.imag])).astype(np.int64) & (_CELLS - 1)
        counts = np.bincount(cell[:, 0] * _CELLS + cell[:, 1], minlength=_CELLS**2).reshape(_CELLS, _CELLS)
        # The votes of one motion may fall into up to four cells.
        across = counts + np.roll(counts, -1, 0)
        best = max(best, float((across + np.roll(across, -1, 1)).max()))
    return best
