"""Possible relative poses of two cameras: a Hough transform over turn, lag and shift.

Every two people seen at one time propose a shift for every turn and lag. At the right turn and lag, the proposals of all pairs
that are one person fall into one cell. Velocities must agree too, which removes most pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.association.ground.cooccurrence import TrackPair, find_synchronous_pairs
from passerby.association.ground.pair_matching import WALKING, GroundMotion
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Ints

Singles = NDArray[np.float32]
SingleComplexes = NDArray[np.complex64]
Complexes = NDArray[np.complex128]

SAME_TURN, SAME_LAG_S, SAME_SHIFT_M = np.deg2rad(25.0), 1.6, 6.0
"""Differences below which two cells are the same motion: their refinements would converge to one."""
# The grid: a turn is found to 5 degrees, a shift to a cell. Shifts are counted on a torus, so that cost and memory do not
# depend on the distance of the cameras. Shifts that differ by periods of the torus are separated later.
_TURNS, _CELLS, _CELL_M = 36, 64, 1.5
_BLUR_CELLS = 1.0
_INSTANTS = 240
"""Largest number of instants that vote; more would be redundant."""
# Velocities agree within this (metres per second), or more for fast people.
_VELOCITY_SD = 0.5
_LEAST_VOICE = float(np.log(0.05))
"""Logarithm of the least weight: voters with a smaller weight at a turn are not counted."""


@dataclass(frozen=True)
class _Spot:
    """A cell of the grid."""

    votes: float
    lag: int
    """Grid steps of time."""
    turn: int
    cell: int

    def is_near(self, other: _Spot) -> bool:
        """Check whether both are one motion: their lags, turns and shifts differ by less than the spread of the votes."""
        if abs(self.lag - other.lag) * STEP_S > SAME_LAG_S:
            return False
        turned = _around(self.turn - other.turn, _TURNS) * 2 * np.pi / _TURNS
        if turned > 0:
            # Another turn about the people changes the shift too.
            return bool(turned <= SAME_TURN)
        x, y = divmod(self.cell, _CELLS)
        other_x, other_y = divmod(other.cell, _CELLS)
        return bool(np.hypot(_around(x - other_x, _CELLS), _around(y - other_y, _CELLS)) * _CELL_M < SAME_SHIFT_M)


def _around(difference: int, period: int) -> int:
    """Return the distance on a circle."""
    return abs((difference + period // 2) % period - period // 2)


def hough_motion_candidates(tracks: TrackPair, max_lag_s: float, most: int, most_voters: int = 20_000) -> list[GroundMotion]:
    """Find the motions with most votes, the best first, distinct from each other.

    Args:
        tracks: tracks of both cameras.
        max_lag_s: largest difference of the two clocks, seconds.
        most: largest number of motions.
        most_voters: approximate number of encounters that vote at each lag.
    """
    peaks: list[_Spot] = []
    voters = {}
    most_instants, blur = min(_INSTANTS, tracks.instants_of(most_voters)), _blur()
    for lag in _lags(tracks, max_lag_s).tolist():
        voters[lag] = _voters(tracks, lag, most_instants)
        votes = _counted(voters[lag], blur)
        peaks += [_Spot(float(votes[k, cell]), lag, k, cell) for k, cell in enumerate(votes.argmax(axis=1).tolist())]
    peaks.sort(key=lambda spot: (-spot.votes, abs(spot.lag), spot.turn))
    best: list[_Spot] = []
    for spot in peaks:
        if spot.votes <= 0 or len(best) == most:
            break
        if not any(spot.is_near(other) for other in best):
            best.append(spot)
    turns = _turns().tolist()
    return [
        GroundMotion(turns[spot.turn], _unwrapped(voters[spot.lag], turns[spot.turn], spot.cell), spot.lag * STEP_S)
        for spot in best
    ]


def _lags(tracks: TrackPair, max_lag_s: float) -> Ints:
    """Return the lags in grid steps at which the two recordings overlap, the shortest first."""
    most = int(np.ceil(max_lag_s / STEP_S))
    low, high = tracks.b.step[0] - tracks.a.step[-1], tracks.b.step[-1] - tracks.a.step[0]
    lags = np.arange(max(-most, low), min(most, high) + 1)
    return lags[np.argsort(np.abs(lags), kind="stable")]


@dataclass(frozen=True, eq=False)
class _Voters:
    """Encounters whose speeds agree. Single precision and lengths in cells are enough for the grid."""

    position_a: SingleComplexes
    """(V,) x + iy, cells."""
    position_b: SingleComplexes
    """(V,) x + iy, cells."""
    voice: Singles
    """(3, V) logarithm of a voter's weight at a turn: the constant, and the coefficients of the turn's cosine and sine."""

    def loud_at(self, turn: complex) -> tuple[Ints, Singles]:
        """Return the rows that are counted at a turn, and their weights."""
        voice = self.voice[0] + self.voice[1] * np.float32(turn.real) + self.voice[2] * np.float32(turn.imag)
        rows = np.flatnonzero(voice > _LEAST_VOICE)
        return rows, np.exp(voice.take(rows))

    def shifts_at(self, turn: complex, rows: Ints) -> Singles:
        """Return the shifts (rows, 2) that rows propose at a turn, cells."""
        shift = self.position_b.take(rows) - np.complex64(turn) * self.position_a.take(rows)
        return shift.view(np.float32).reshape(-1, 2)


def _voters(tracks: TrackPair, lag: int, most_instants: int) -> _Voters:
    met = find_synchronous_pairs(tracks, lag, most_instants)
    velocity_a, velocity_b = tracks.a.velocity[met.a], tracks.b.velocity[met.b]
    fast_a, fast_b = np.abs(velocity_a), np.abs(velocity_b)
    sd = _VELOCITY_SD * np.maximum(1.0, 0.5 * (fast_a + fast_b))
    weight = np.minimum(1.0, np.minimum(fast_a, fast_b) / WALKING)
    # The vote of an uncertain position is spread over many cells.
    reach = np.hypot(tracks.a.sigma[0][met.a], tracks.b.sigma[0][met.b])
    weight = weight / np.maximum(1.0, reach / _CELL_M)
    if tracks.affinity is not None:
        weight = weight * np.exp(tracks.affinity[tracks.a.tracklet[met.a], tracks.b.tracklet[met.b]])
    use = np.flatnonzero((np.abs(fast_a - fast_b) < 2.5 * sd) & (weight > np.exp(_LEAST_VOICE)))
    # The difference of the velocities, |turn * velocity_a - velocity_b|, is normally distributed; its square is expanded.
    along = velocity_a[use] * velocity_b[use].conj() / sd[use] ** 2
    level = np.log(weight[use]) - 0.5 * (fast_a[use] ** 2 + fast_b[use] ** 2) / sd[use] ** 2
    return _Voters(
        (tracks.a.position[met.a[use]] / _CELL_M).astype(np.complex64),
        (tracks.b.position[met.b[use]] / _CELL_M).astype(np.complex64),
        np.stack([level, along.real, -along.imag]).astype(np.float32),
    )


def _counted(voters: _Voters, blur: Singles) -> Singles:
    """Count the votes for shifts, smoothed: (turns, cells * cells)."""
    counts = np.empty((_TURNS, _CELLS * _CELLS), dtype=np.float32)
    for k, turn in enumerate(_turns().tolist()):
        rows, weight = voters.loud_at(turn)
        # Cells beyond the torus wrap around, also negative ones: its size is a power of two.
        cell = np.floor(voters.shifts_at(turn, rows)).astype(np.int32) & (_CELLS - 1)
        counts[k] = np.bincount(cell[:, 0] * _CELLS + cell[:, 1], weight, _CELLS**2)
    smoothed = np.asarray(blur @ counts.reshape(_TURNS, _CELLS, _CELLS) @ blur, dtype=np.float32)
    return smoothed.reshape(_TURNS, -1)


def _turns() -> Complexes:
    return np.asarray(np.exp(2j * np.pi * np.arange(_TURNS) / _TURNS))


def _blur() -> Singles:
    """Return the symmetric matrix (cells, cells) that smooths one axis of the torus."""
    from_first = np.minimum(np.arange(_CELLS), _CELLS - np.arange(_CELLS))
    kernel = np.exp(-0.5 * (from_first / _BLUR_CELLS) ** 2)
    kernel[kernel < 1e-12] = 0.0  # products below the smallest normal number take processors many times as long
    return np.stack([np.roll(kernel / kernel.sum(), shift) for shift in range(_CELLS)]).astype(np.float32)


def _unwrapped(voters: _Voters, turn: complex, cell: int) -> complex:
    """Return the shift of a cell of the torus, metres: the mean of its votes from the period of the torus that has most."""
    rows, weight = voters.loud_at(turn)
    shift = voters.shifts_at(turn, rows).astype(np.float64)
    apart = shift - np.array(divmod(cell, _CELLS)) - 0.5
    rounds = np.round(apart / _CELLS)
    distance = np.hypot(*(apart - rounds * _CELLS).T)
    # Votes are farther away where they come only from neighbouring cells, by the smoothing.
    near = distance < max(1.5, 1.01 * float(distance.min()))
    distinct, which = np.unique(rounds[near], axis=0, return_inverse=True)
    top = int(np.argmax(np.bincount(which.ravel(), weight[near], len(distinct))))
    use = np.flatnonzero(near)[which.ravel() == top]
    x, y = np.average(shift[use], axis=0, weights=weight[use]) * _CELL_M
    return complex(x, y)
