"""Where two cameras may stand to each other: a Hough transform over turn, lag and shift.

Every two people seen at one moment propose a shift for every turn and lag; where the turn and the lag are right, the proposals
of all pairs that really are one person fall on one spot. Velocities must agree too, which removes most pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from passerby.association.encounters import TrackPair, encounters
from passerby.association.ground_tracks import STEP_S
from passerby.association.pair_matching import WALKING, GroundMotion

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]

SAME_TURN, SAME_LAG_S, SAME_SHIFT_M = np.deg2rad(25.0), 1.6, 6.0
"""Spots this near to a better one are the same: their refinements would meet."""
# The grid: a turn is found to 5 degrees, a shift to a cell. Shifts are counted on a torus, so that cost and memory do not
# depend on how far apart the cameras are; what falls onto one spot from several rounds is told apart after.
_TURNS, _CELLS, _CELL_M = 36, 64, 1.5
_BLUR_CELLS = 1.0
# Instants that vote; more would only say the same again.
_INSTANTS = 240
# Velocities agree within this (metres per second), more for the fast.
_VELOCITY_SD = 0.5
_MIN_VOICE = 0.05
"""Voters that weigh less at a turn are not counted."""


@dataclass(frozen=True)
class _Spot:
    """A cell of the grid."""

    votes: float
    lag: int
    """Grid steps of time."""
    turn: int
    cell: int

    def is_near(self, other: _Spot) -> bool:
        if abs(self.lag - other.lag) * STEP_S > SAME_LAG_S:
            return False
        turned = _around(self.turn - other.turn, _TURNS) * 2 * np.pi / _TURNS
        if turned > 0:
            # Another turn, about the people, moves the shift as well.
            return bool(turned <= SAME_TURN)
        x, y = divmod(self.cell, _CELLS)
        other_x, other_y = divmod(other.cell, _CELLS)
        return bool(np.hypot(_around(x - other_x, _CELLS), _around(y - other_y, _CELLS)) * _CELL_M < SAME_SHIFT_M)


def _around(difference: int, period: int) -> int:
    """Distance on a circle."""
    return abs((difference + period // 2) % period - period // 2)


def likely_motions(tracks: TrackPair, max_lag_s: float, most: int) -> list[GroundMotion]:
    """The motions with most votes, the best first, distinct from each other.

    Args:
        tracks: of both cameras.
        max_lag_s: largest difference of the two clocks, seconds.
        most: number of motions.
    """
    turns = np.exp(2j * np.pi * np.arange(_TURNS) / _TURNS)
    peaks: list[_Spot] = []
    voters = {}
    for lag in _lags(tracks, max_lag_s).tolist():
        voters[lag] = _voters(tracks, lag)
        votes = _counted(voters[lag], turns).reshape(_TURNS, -1)
        peaks += [_Spot(float(votes[k, cell]), lag, k, cell) for k, cell in enumerate(votes.argmax(axis=1).tolist())]
    peaks.sort(key=lambda spot: (-spot.votes, abs(spot.lag), spot.turn))
    best: list[_Spot] = []
    for spot in peaks:
        if spot.votes <= 0 or len(best) == most:
            break
        if not any(spot.is_near(other) for other in best):
            best.append(spot)
    return [
        GroundMotion(complex(turns[spot.turn]), _unwrapped(voters[spot.lag], turns[spot.turn], spot.cell), spot.lag * STEP_S)
        for spot in best
    ]


def _lags(tracks: TrackPair, max_lag_s: float) -> Ints:
    """Lags in grid steps at which the two recordings overlap, the shortest first."""
    most = int(np.ceil(max_lag_s / STEP_S))
    low, high = tracks.b.step[0] - tracks.a.step[-1], tracks.b.step[-1] - tracks.a.step[0]
    lags = np.arange(max(-most, low), min(most, high) + 1)
    return lags[np.argsort(np.abs(lags), kind="stable")]


@dataclass(frozen=True, eq=False)
class _Voters:
    """Encounters whose speeds agree."""

    position_a: Complexes
    velocity_a: Complexes
    position_b: Complexes
    velocity_b: Complexes
    sd: Floats
    weight: Floats


def _voters(tracks: TrackPair, lag: int) -> _Voters:
    met = encounters(tracks, lag, _INSTANTS)
    velocity_a, velocity_b = tracks.a.velocity[met.a], tracks.b.velocity[met.b]
    fast_a, fast_b = np.abs(velocity_a), np.abs(velocity_b)
    sd = _VELOCITY_SD * np.maximum(1.0, 0.5 * (fast_a + fast_b))
    weight = np.minimum(1.0, np.minimum(fast_a, fast_b) / WALKING)
    # A position that is known poorly smears its vote over many cells.
    reach = np.hypot(tracks.a.sigma[0][met.a], tracks.b.sigma[0][met.b])
    weight = weight / np.maximum(1.0, reach / _CELL_M)
    if tracks.likeness is not None:
        weight = weight * np.exp(tracks.likeness[tracks.a.tracklet[met.a], tracks.b.tracklet[met.b]])
    use = (np.abs(fast_a - fast_b) < 2.5 * sd) & (weight > _MIN_VOICE)
    position_a, position_b = tracks.a.position[met.a[use]], tracks.b.position[met.b[use]]
    return _Voters(position_a, velocity_a[use], position_b, velocity_b[use], sd[use], weight[use])


def _voices(voters: _Voters, turn: complex) -> Floats:
    """Weights of the voters at a turn, by how well the velocities agree."""
    apart = turn * voters.velocity_a - voters.velocity_b
    return np.asarray(voters.weight * np.exp(-0.5 * (apart.real**2 + apart.imag**2) / voters.sd**2))


def _counted(voters: _Voters, turns: Complexes) -> Floats:
    """(turns, cells, cells) votes for shifts, smoothed."""
    counts = np.zeros(_TURNS * _CELLS * _CELLS)
    for k, turn in enumerate(turns):
        weight = _voices(voters, complex(turn))
        use = np.flatnonzero(weight > _MIN_VOICE)
        shift = voters.position_b[use] - turn * voters.position_a[use]
        x = np.floor(shift.real / _CELL_M).astype(np.int64) % _CELLS
        y = np.floor(shift.imag / _CELL_M).astype(np.int64) % _CELLS
        counts[k * _CELLS**2 : (k + 1) * _CELLS**2] = np.bincount(x * _CELLS + y, weight[use], _CELLS**2)
    grid = counts.reshape(_TURNS, _CELLS, _CELLS)
    for axis in (1, 2):
        grid = gaussian_filter1d(grid, _BLUR_CELLS, axis=axis, mode="wrap", truncate=2.5)
    return np.asarray(grid)


def _unwrapped(voters: _Voters, turn: complex, cell: int) -> complex:
    """The shift of a cell of the torus: the round of the torus that most of its votes come from, and their mean."""
    weight = _voices(voters, turn)
    shift = voters.position_b - turn * voters.position_a
    x, y = divmod(cell, _CELLS)
    period = _CELLS * _CELL_M
    dx = shift.real - (x + 0.5) * _CELL_M
    dy = shift.imag - (y + 0.5) * _CELL_M
    round_x, round_y = np.round(dx / period), np.round(dy / period)
    near = np.hypot(dx - round_x * period, dy - round_y * period) < 1.5 * _CELL_M
    rounds, which = np.unique(np.column_stack([round_x, round_y])[near], axis=0, return_inverse=True)
    top = int(np.argmax(np.bincount(which.ravel(), weight[near], len(rounds))))
    use = np.flatnonzero(near)[which.ravel() == top]
    return complex(np.average(shift[use], weights=weight[use]))
