"""Two cameras registered by the people who walk on their common ground, without knowing who is who.

Two levelled cameras differ by a turn about the vertical, a shift along the ground and a lag of their clocks. Every pair of
people seen at one moment proposes a shift for every turn and lag; where the turn and the lag are right, the proposals of all
pairs that really are one person fall on one spot (a Hough transform over turn, lag and shift). Velocities must agree too, which
removes most pairs. The best spots are then refined by matching tracklets and least squares, and compared: a runner-up that
scores nearly as well means that the registration cannot be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from passerby.association.ground_tracks import STEP_S, GroundTracks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]

# The grid of the Hough transform: a turn is found to 5 degrees, a shift to a cell. Shifts are counted on a torus, so that cost
# and memory do not depend on how far apart the cameras are; what falls onto one spot from several rounds is told apart after.
_TURNS, _CELLS, _CELL_M = 36, 64, 1.5
_BLUR_CELLS = 1.0
# Instants that vote and instants that the refinement looks at; more would only say the same again.
_VOTING_INSTANTS, _MATCHING_INSTANTS = 240, 1500
# Velocities agree within this (metres per second), more for the fast; people slower than this tell no direction and count less.
_VELOCITY_SD, _WALKING = 0.5, 0.7
# Spots this near to a better one are the same: their refinements would meet.
_SAME_TURN, _SAME_LAG_S, _SAME_SHIFT_M = np.deg2rad(25.0), 1.6, 6.0
_CANDIDATES = 6
# The levels know each camera's height to about 9 %, so the two scales differ by about this much.
_SCALE_SD = 0.13
_REFINEMENT_TOLERANCES = (2.5, 2.0, 1.5, 1.2, 1.0, 1.0)
# A tracklet pair is a match when so many of its common samples agree, on average over their weight.
_MIN_AGREEMENT, _MIN_SAMPLES = 0.25, 3


@dataclass(frozen=True, eq=False)
class Registration:
    """One guess at how camera b stands to camera a: `ground_b = turn * ground_a + shift`, at `time_b = time_a + lag_s`."""

    turn: complex
    """Turn about the vertical, and the ratio of the two cameras' scales."""
    shift: complex
    """x + iy, metres of camera b."""
    lag_s: float
    """Seconds: camera b's clock shows so much more than camera a's."""
    score: float
    """Samples of walking people that agree, less those that disagree."""
    samples: int
    """Samples of matched tracklets."""
    middle: complex
    """Where camera a's matched people were, on the mean, metres of camera a."""
    tracklets_a: Ints
    """(K,) matched tracklets of camera a,"""
    tracklets_b: Ints
    """(K,) and of camera b,"""
    weight: Floats
    """(K,) with the agreement of each match, in samples."""


@dataclass(frozen=True, eq=False)
class PairRegistration:
    """All guesses for a pair of cameras, the best first."""

    a: int
    b: int
    candidates: tuple[Registration, ...]

    @property
    def runner_up(self) -> float:
        """The second-best score as a share of the best; 1 where nothing stands out."""
        if not self.candidates or self.candidates[0].score <= 0:
            return 1.0
        return max(self.candidates[1].score, 0.0) / self.candidates[0].score if len(self.candidates) > 1 else 0.0


def register_pair(
    a: int, b: int, tracks_a: GroundTracks, tracks_b: GroundTracks, max_lag_s: float, likeness: Floats | None = None
) -> PairRegistration:
    """Register two cameras by their ground tracks.

    Args:
        a: number of the first camera.
        b: number of the second camera.
        tracks_a: tracks of the first camera, in its own levelled frame and clock.
        tracks_b: tracks of the second camera.
        max_lag_s: largest difference of the two clocks that is searched for; 0 takes them as in step.
        likeness: (T_a, T_b) log-likelihood ratio of tracklets (by their numbers) showing one person rather than two, from their
            appearance; None where nothing is known.
    """
    if not len(tracks_a) or not len(tracks_b):
        return PairRegistration(a, b, ())
    spots = _hough(tracks_a, tracks_b, _lags(tracks_a, tracks_b, max_lag_s), likeness)
    found = [_refined(tracks_a, tracks_b, spot, max_lag_s, likeness) for spot in spots]
    ranked = sorted((guess for guess in found if guess is not None), key=lambda guess: -guess.score)
    distinct: list[Registration] = []
    for guess in ranked:
        if not any(_same(guess, other, tracks_a) for other in distinct):
            distinct.append(guess)
    return PairRegistration(a, b, tuple(distinct))


def _lags(tracks_a: GroundTracks, tracks_b: GroundTracks, max_lag_s: float) -> Ints:
    """Lags in grid steps at which the two recordings overlap."""
    most = int(np.ceil(max_lag_s / STEP_S))
    low, high = tracks_b.step[0] - tracks_a.step[-1], tracks_b.step[-1] - tracks_a.step[0]
    lags = np.arange(max(-most, low), min(most, high) + 1)
    return lags[np.argsort(np.abs(lags), kind="stable")]


@dataclass(frozen=True, eq=False)
class _Together:
    """Rows of both cameras that show somebody at the same time, every combination."""

    a: Ints
    b: Ints

    @classmethod
    def at(cls, tracks_a: GroundTracks, tracks_b: GroundTracks, lag: int, most_instants: int) -> _Together:
        steps = np.intersect1d(tracks_a.step, tracks_b.step - lag)
        if len(steps) > most_instants:
            steps = steps[np.linspace(0, len(steps) - 1, most_instants).astype(np.int64)]
        # The columns are sorted by step.
        low_a, high_a = np.searchsorted(tracks_a.step, steps), np.searchsorted(tracks_a.step, steps, side="right")
        low_b = np.searchsorted(tracks_b.step, steps + lag)
        high_b = np.searchsorted(tracks_b.step, steps + lag, side="right")
        n_a, n_b = high_a - low_a, high_b - low_b
        count = n_a * n_b
        instant = np.repeat(np.arange(len(steps)), count)
        within = np.arange(len(instant)) - np.repeat(np.cumsum(count) - count, count)
        return cls(low_a[instant] + within // n_b[instant], low_b[instant] + within % n_b[instant])


@dataclass(frozen=True, eq=False)
class _Spot:
    """A place in the space of turns, lags and shifts where many proposals meet."""

    votes: float
    turn: complex
    shift: complex
    lag: int


def _hough(tracks_a: GroundTracks, tracks_b: GroundTracks, lags: Ints, likeness: Floats | None) -> list[_Spot]:
    """The best distinct spots."""
    turns = np.exp(2j * np.pi * np.arange(_TURNS) / _TURNS)
    best: list[tuple[float, int, int, int]] = []
    voters = {}
    for lag in lags.tolist():
        voters[lag] = _voters(tracks_a, tracks_b, lag, likeness)
        counts = _counted(voters[lag], turns)
        peak = counts.reshape(_TURNS, -1).argmax(axis=1)
        votes = counts.reshape(_TURNS, -1)[np.arange(_TURNS), peak]
        best += [(float(votes[k]), lag, k, int(peak[k])) for k in range(_TURNS)]
    best.sort(key=lambda item: (-item[0], abs(item[1]), item[2]))
    spots: list[_Spot] = []
    taken: list[tuple[int, int, int]] = []
    for votes_here, lag, k, cell in best:
        if votes_here <= 0 or len(spots) == _CANDIDATES:
            break
        if any(_near(lag, k, cell, other) for other in taken):
            continue
        taken.append((lag, k, cell))
        shift = _unwrapped(voters[lag], turns[k], cell)
        spots.append(_Spot(votes_here, complex(turns[k]), shift, lag))
    return spots


def _near(lag: int, turn: int, cell: int, other: tuple[int, int, int]) -> bool:
    if abs(lag - other[0]) * STEP_S > _SAME_LAG_S:
        return False
    apart = abs((turn - other[1] + _TURNS // 2) % _TURNS - _TURNS // 2) * 2 * np.pi / _TURNS
    if apart > _SAME_TURN:
        return False
    if apart > 0:
        return True  # another turn about the people moves the shift as well
    dx, dy = (
        abs((x - y + _CELLS // 2) % _CELLS - _CELLS // 2)
        for x, y in zip(divmod(cell, _CELLS), divmod(other[2], _CELLS), strict=True)
    )
    return bool(np.hypot(dx, dy) * _CELL_M < _SAME_SHIFT_M)


@dataclass(frozen=True, eq=False)
class _Voters:
    """Pairs of samples whose speeds agree."""

    position_a: Complexes
    velocity_a: Complexes
    position_b: Complexes
    velocity_b: Complexes
    sd: Floats
    weight: Floats


def _voters(tracks_a: GroundTracks, tracks_b: GroundTracks, lag: int, likeness: Floats | None) -> _Voters:
    rows = _Together.at(tracks_a, tracks_b, lag, _VOTING_INSTANTS)
    velocity_a, velocity_b = tracks_a.velocity[rows.a], tracks_b.velocity[rows.b]
    fast_a, fast_b = np.abs(velocity_a), np.abs(velocity_b)
    sd = _VELOCITY_SD * np.maximum(1.0, 0.5 * (fast_a + fast_b))
    weight = np.minimum(1.0, np.minimum(fast_a, fast_b) / _WALKING)
    # A position that is known poorly smears its vote over many cells.
    reach = np.hypot(tracks_a.sigma[0][rows.a], tracks_b.sigma[0][rows.b])
    weight = weight / np.maximum(1.0, reach / _CELL_M)
    if likeness is not None:
        weight = weight * np.exp(likeness[tracks_a.tracklet[rows.a], tracks_b.tracklet[rows.b]])
    use = (np.abs(fast_a - fast_b) < 2.5 * sd) & (weight > 0.05)
    return _Voters(
        tracks_a.position[rows.a[use]], velocity_a[use], tracks_b.position[rows.b[use]], velocity_b[use], sd[use], weight[use]
    )


def _voices(voters: _Voters, turn: Complexes | complex) -> Floats:
    """Weights of the voters at a turn, by how well the velocities agree."""
    apart = turn * voters.velocity_a - voters.velocity_b
    return np.asarray(voters.weight * np.exp(-0.5 * (apart.real**2 + apart.imag**2) / voters.sd**2))


def _counted(voters: _Voters, turns: Complexes) -> Floats:
    """(turns, cells, cells) votes for shifts, smoothed."""
    counts = np.zeros(_TURNS * _CELLS * _CELLS)
    for k, turn in enumerate(turns):
        weight = _voices(voters, complex(turn))
        use = np.flatnonzero(weight > 0.05)
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


def _refined(
    tracks_a: GroundTracks, tracks_b: GroundTracks, spot: _Spot, max_lag_s: float, likeness: Floats | None
) -> Registration | None:
    """Alternate between matching tracklets and the least-squares motion, from tolerant to strict."""
    turn, shift, lag_s = spot.turn, spot.shift, spot.lag * STEP_S
    together, at_lag = None, None
    matched = None
    for factor in _REFINEMENT_TOLERANCES:
        lag = round(lag_s / STEP_S)
        if lag != at_lag or together is None:
            together, at_lag = _Together.at(tracks_a, tracks_b, lag, _MATCHING_INSTANTS), lag
        if not len(together.a):
            return None
        rest = lag_s - lag * STEP_S
        matched = _matched(tracks_a, tracks_b, together, turn, shift, rest, factor, likeness)
        if len(matched.rows) < _MIN_SAMPLES:
            return None
        fitted = _fitted(tracks_a, tracks_b, together, matched, turn, free_lag=max_lag_s > 0)
        if fitted is None:
            return None
        turn, shift = fitted[0], fitted[1]
        if max_lag_s > 0:
            lag_s = float(np.clip(lag * STEP_S + fitted[2], -max_lag_s - STEP_S, max_lag_s + STEP_S))
    assert matched is not None
    assert together is not None
    return Registration(
        turn,
        shift,
        lag_s,
        matched.score,
        len(matched.rows),
        complex(np.mean(tracks_a.position[together.a[matched.rows]])),
        matched.tracklets_a,
        matched.tracklets_b,
        matched.weight,
    )


@dataclass(frozen=True, eq=False)
class _Matched:
    """Matched tracklets, and the combinations of samples (rows of `_Together`) in them."""

    rows: Ints
    miss: Floats
    """(rows,) in tolerances."""
    whitening: Floats
    """(rows, 3) the lower triangle (11, 21, 22) that turns metres into tolerances, along camera b's axes."""
    score: float
    tracklets_a: Ints
    tracklets_b: Ints
    weight: Floats


def _matched(
    tracks_a: GroundTracks, tracks_b: GroundTracks, together: _Together, turn: complex, shift: complex, rest_s: float,
    factor: float, likeness: Floats | None,
) -> _Matched:  # fmt: skip
    """Tracklets that run together under a motion, the best first; two that overlap in time never share a partner."""
    a, b = together.a, together.b
    agreeing, miss, whitening = _agreements(tracks_a, tracks_b, together, turn, shift, rest_s, factor)
    n_b = int(tracks_b.tracklet.max()) + 1
    pair, which = np.unique(tracks_a.tracklet[a] * n_b + tracks_b.tracklet[b], return_inverse=True)
    samples = np.bincount(which, minlength=len(pair))
    weight = np.bincount(which, agreeing, len(pair))
    like = np.zeros(len(pair)) if likeness is None else likeness[pair // n_b, pair % n_b]
    good = (weight > _MIN_AGREEMENT * samples) & (samples >= _MIN_SAMPLES) & (weight + like > 0)
    chosen = _exclusive(np.flatnonzero(good), weight + like, which, tracks_a, tracks_b, together, pair // n_b, pair % n_b)
    rows = np.flatnonzero(chosen[which])
    moving = np.minimum(1.0, np.minimum(np.abs(tracks_a.velocity[a[rows]]), np.abs(tracks_b.velocity[b[rows]])) / _WALKING)
    kept = np.flatnonzero(chosen)
    return _Matched(
        rows,
        miss[rows],
        whitening[rows],
        float((agreeing[rows] * moving).sum()),
        pair[kept] // n_b,
        pair[kept] % n_b,
        weight[kept],
    )


def _whitening(tracks_a: GroundTracks, tracks_b: GroundTracks, together: _Together, turn: complex) -> Floats:
    """(N, 3) lower triangles W with `W^T W` the inverse of both positions' joint covariance, along camera b's axes."""
    xx = yy = xy = np.zeros(len(together.a))
    for tracks, rows, turned in ((tracks_a, together.a, turn), (tracks_b, together.b, 1.0 + 0.0j)):
        along, across = tracks.sigma
        ray = tracks.position[rows] * turned
        ray = ray / np.maximum(np.abs(ray), 1e-9)
        extra = (along[rows] ** 2 - across[rows] ** 2) * abs(turned) ** 2
        base = across[rows] ** 2 * abs(turned) ** 2
        xx = xx + base + extra * ray.real**2
        yy = yy + base + extra * ray.imag**2
        xy = xy + extra * ray.real * ray.imag
    # Inverse of the Cholesky factor of [[xx, xy], [xy, yy]].
    first = np.sqrt(xx)
    second = np.sqrt(np.maximum(yy - xy**2 / xx, 1e-12))
    return np.column_stack([1.0 / first, -xy / xx / second, 1.0 / second])


def _exclusive(
    good: Ints, weight: Floats, which: Ints, tracks_a: GroundTracks, tracks_b: GroundTracks, together: _Together,
    tracklet_a: Ints, tracklet_b: Ints,
) -> NDArray[np.bool_]:  # fmt: skip
    """The pairs (mask) kept when the best take their samples first: a sample has one partner."""
    chosen = np.zeros(len(tracklet_a), dtype=bool)
    order = good[np.argsort(-weight[good], kind="stable")]
    by_pair = np.argsort(which, kind="stable")
    first = np.searchsorted(which[by_pair], np.arange(len(tracklet_a) + 1))
    taken_a, taken_b = np.zeros(len(tracks_a), dtype=bool), np.zeros(len(tracks_b), dtype=bool)
    for pair in order.tolist():
        rows = by_pair[first[pair] : first[pair + 1]]
        in_a, in_b = together.a[rows], together.b[rows]
        # A few samples where two tracklets of one person touch do not part them.
        if taken_a[in_a].mean() > 0.2 or taken_b[in_b].mean() > 0.2:
            continue
        chosen[pair] = True
        taken_a[in_a] = True
        taken_b[in_b] = True
    return chosen


def _fitted(
    tracks_a: GroundTracks, tracks_b: GroundTracks, together: _Together, matched: _Matched, turn: complex, *, free_lag: bool
) -> tuple[complex, complex, float] | None:
    """Turn with scale, shift and rest of the lag by robust linear least squares on matched samples."""
    a, b = together.a[matched.rows], together.b[matched.rows]
    w = matched.whitening / np.sqrt(1.0 + (2 * matched.miss) ** 2)[:, None]
    p, q, v = tracks_a.position[a], tracks_b.position[b], tracks_b.velocity[b] * (1.0 if free_lag else 0.0)
    one, zero = np.ones(len(p)), np.zeros(len(p))
    x = np.column_stack([p.real, -p.imag, one, zero, -v.real, q.real])
    y = np.column_stack([p.imag, p.real, zero, one, -v.imag, q.imag])
    rows = np.concatenate([w[:, :1] * x, w[:, 1:2] * x + w[:, 2:] * y])
    A, target = rows[:, :5], rows[:, 5]
    H, g = A.T @ A, A.T @ target
    # Priors, as strong as one sample in its tolerance is on the position: the scale near 1, the rest of the lag small.
    unit = turn / abs(turn)
    effective = max(1.0, 0.05 * len(p))
    H[[0, 1], [0, 1]] += effective / _SCALE_SD**2
    g[:2] += effective / _SCALE_SD**2 * np.array([unit.real, unit.imag])
    H[4, 4] += effective
    if np.linalg.cond(H) > 1e14:
        return None
    solution = np.linalg.solve(H, g)
    found = complex(solution[0], solution[1])
    return found / abs(found) * float(np.clip(abs(found), 0.7, 1.4)), complex(solution[2], solution[3]), float(solution[4])


def agreement(
    tracks_a: GroundTracks, tracks_b: GroundTracks, turn: complex, shift: complex, lag_s: float
) -> tuple[Ints, Ints, Floats, Ints]:
    """How well every two tracklets of two cameras run together under a motion.

    Returns:
        (K,) tracklets of camera a, (K,) tracklets of camera b, (K,) the sum over their common samples of the agreement (1 where
        they meet, 0 a tolerance apart, -1 beyond), and (K,) the number of these samples.
    """
    lag = round(lag_s / STEP_S)
    together = _Together.at(tracks_a, tracks_b, lag, len(tracks_a) + 1)
    a, b = together.a, together.b
    if not len(a):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64)
    value = _agreements(tracks_a, tracks_b, together, turn, shift, lag_s - lag * STEP_S, 1.0)[0]
    n_b = int(tracks_b.tracklet.max()) + 1
    pair, which = np.unique(tracks_a.tracklet[a] * n_b + tracks_b.tracklet[b], return_inverse=True)
    total = np.asarray(np.bincount(which, value, len(pair)), np.float64)
    return pair // n_b, pair % n_b, total, np.asarray(np.bincount(which, minlength=len(pair)), np.int64)


def _agreements(
    tracks_a: GroundTracks, tracks_b: GroundTracks, together: _Together, turn: complex, shift: complex, rest_s: float,
    factor: float,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Agreement of each combination from 1 down to -1, its miss in tolerances, and the whitening."""
    a, b = together.a, together.b
    whitening = _whitening(tracks_a, tracks_b, together, turn) / factor
    apart = turn * tracks_a.position[a] + shift - tracks_b.position[b] - tracks_b.velocity[b] * rest_s
    miss = np.hypot(whitening[:, 0] * apart.real, whitening[:, 1] * apart.real + whitening[:, 2] * apart.imag)
    return np.maximum(1.0 - miss**2, -1.0), miss, whitening


def _same(guess: Registration, other: Registration, tracks_a: GroundTracks) -> bool:
    """Whether two guesses put camera a's people at about the same places at about the same time."""
    middle = complex(np.mean(tracks_a.position))
    apart = abs(guess.turn * middle + guess.shift - other.turn * middle - other.shift)
    turned = abs(np.angle(guess.turn / other.turn))
    return bool(apart < _SAME_SHIFT_M and turned < _SAME_TURN and abs(guess.lag_s - other.lag_s) < _SAME_LAG_S)
