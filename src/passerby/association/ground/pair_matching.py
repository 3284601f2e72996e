"""Matching of two cameras' tracklets under a motion of the ground, and the motion that fits matched tracklets best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.association.ground.cooccurrence import SynchronousPairs
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints

WALKING = 0.7
"""Metres per second. Slower people have no clear direction and are weighted less."""
# A tracklet pair is a match if its common samples have this mean agreement, and this number at least.
_MIN_AGREEMENT, _MIN_SAMPLES = 0.25, 3
# Largest share of a pair's samples that better pairs have taken. Tracklets of one person may share a few samples at their ends.
_MAX_TAKEN = 0.2
# Squared tolerances beyond which an agreement is -1.
_NOTHING_BEYOND = 2.0
# Each camera's height is known from its level to about 9 %: standard deviation of the ratio of the two scales, and its limits.
_SCALE_SD, _SCALE_RANGE = 0.13, (0.7, 1.4)
# The priors have the weight of this share of the matched samples: errors of neighbouring samples are alike.
_PRIOR_SHARE = 0.05
# Largest condition of the normal matrix. It is larger where all people stand on one spot.
_MAX_CONDITION = 1e14


@dataclass(frozen=True)
class GroundMotion:
    """Motion between two cameras' grounds and clocks: `ground_b = turn * ground_a + shift`, `time_b = time_a + lag_s`."""

    turn: complex
    """Turn about the vertical, and the ratio of the two cameras' scales."""
    shift: complex
    """x + iy, metres of camera b."""
    lag_s: float
    """Seconds."""

    def then(self, other: GroundMotion) -> GroundMotion:
        """Chain this motion with one from camera b to camera c: return the motion from camera a to camera c."""
        return GroundMotion(other.turn * self.turn, other.turn * self.shift + other.shift, self.lag_s + other.lag_s)

    @property
    def inverse(self) -> GroundMotion:
        """The motion from camera b to camera a."""
        return GroundMotion(1 / self.turn, -self.shift / self.turn, -self.lag_s)


@dataclass(frozen=True, eq=False)
class TrackletMatches:
    """Matched tracklets and their encounters."""

    rows: Ints
    """(M,) rows of the encounters."""
    miss: Floats
    """(M,) distance in tolerances."""
    whitening: Floats
    """(M, 3) lower triangles (11, 21, 22) that convert metres to tolerances, along camera b's axes."""
    score: float
    """Encounters of walking people that agree, minus those that disagree."""
    tracklets_a: Ints
    """(K,) matched tracklets of camera a."""
    tracklets_b: Ints
    """(K,) their partners of camera b."""
    weight: Floats
    """(K,) agreement of each match, in samples."""


def agreement_of_pairs(met: SynchronousPairs, motion: GroundMotion, factor: float = 1.0) -> Floats:
    """Return the agreement (N,) of encounters with tolerances multiplied by `factor`.

    It is 1 where the two samples meet, 0 at the distance of a tolerance, and -1 beyond.
    """
    apart = _apart(met, motion, slice(None))
    tracks_a, tracks_b = met.tracks.a, met.tracks.b
    # No tolerance is larger than those along both rays combined, so that most encounters need no exact test.
    reach_a = (abs(motion.turn) * np.maximum(*tracks_a.sigma)) ** 2
    reach_b = np.maximum(*tracks_b.sigma) ** 2
    square = apart.real**2 + apart.imag**2
    near = np.flatnonzero(square < _NOTHING_BEYOND * factor**2 * (reach_a[met.a] + reach_b[met.b]))
    value = np.full(len(met), -1.0)
    miss = _missed(apart[near], _whitening(met, motion.turn, near) / factor)
    value[near] = np.maximum(1.0 - miss**2, -1.0)
    return value


def _apart(met: SynchronousPairs, motion: GroundMotion, rows: Ints | slice) -> NDArray[np.complex128]:
    """Return the differences of camera a's moved samples from camera b's, x + iy, metres."""
    a, b = met.a[rows], met.b[rows]
    tracks_a, tracks_b = met.tracks.a, met.tracks.b
    rest_s = motion.lag_s - met.lag * STEP_S
    return np.asarray(motion.turn * tracks_a.position[a] + motion.shift - tracks_b.position[b] - tracks_b.velocity[b] * rest_s)


def _missed(apart: NDArray[np.complex128], whitening: Floats) -> Floats:
    """Return the lengths of these differences in tolerances."""
    return np.hypot(whitening[:, 0] * apart.real, whitening[:, 1] * apart.real + whitening[:, 2] * apart.imag)


def _whitening(met: SynchronousPairs, turn: complex, rows: Ints) -> Floats:
    """Return lower triangles W (rows, 3), with `W^T W` the inverse of both positions' summed covariance, on camera b's axes."""
    xx = yy = xy = np.zeros(len(rows))
    for tracks, own, turned in ((met.tracks.a, met.a[rows], turn), (met.tracks.b, met.b[rows], 1.0 + 0.0j)):
        along, across = tracks.sigma
        ray = tracks.position[own] * turned
        ray = ray / np.maximum(np.abs(ray), 1e-9)
        extra = (along[own] ** 2 - across[own] ** 2) * abs(turned) ** 2
        base = across[own] ** 2 * abs(turned) ** 2
        xx = xx + base + extra * ray.real**2
        yy = yy + base + extra * ray.imag**2
        xy = xy + extra * ray.real * ray.imag
    # Inverse of the Cholesky factor of [[xx, xy], [xy, yy]].
    first = np.sqrt(xx)
    second = np.sqrt(np.maximum(yy - xy**2 / xx, 1e-12))
    return np.column_stack([1.0 / first, -xy / xx / second, 1.0 / second])


def match_tracklets(met: SynchronousPairs, motion: GroundMotion, factor: float) -> TrackletMatches | None:
    """Match tracklets that agree under a motion, the best first; two that overlap in time never share a partner.

    Returns None where they have too few samples.
    """
    tracks, pairs = met.tracks, met.tracklets
    agreeing = agreement_of_pairs(met, motion, factor)
    weight = pairs.summed(agreeing)
    affinity = np.zeros(len(pairs)) if tracks.affinity is None else tracks.affinity[pairs.a, pairs.b]
    good = (weight > _MIN_AGREEMENT * pairs.size) & (pairs.size >= _MIN_SAMPLES) & (weight + affinity > 0)
    chosen = _exclusive(met, good, weight + affinity)
    rows = np.flatnonzero(chosen[pairs.of_encounter])
    if len(rows) < _MIN_SAMPLES:
        return None
    slower = np.minimum(np.abs(tracks.a.velocity[met.a[rows]]), np.abs(tracks.b.velocity[met.b[rows]]))
    score = float((agreeing[rows] * np.minimum(1.0, slower / WALKING)).sum())
    whitening = _whitening(met, motion.turn, rows) / factor
    miss = _missed(_apart(met, motion, rows), whitening)
    return TrackletMatches(rows, miss, whitening, score, pairs.a[chosen], pairs.b[chosen], weight[chosen])


def _exclusive(met: SynchronousPairs, good: NDArray[np.bool_], weight: Floats) -> NDArray[np.bool_]:
    """Return a mask (P,) of the good pairs to keep. The best take their samples first, and a sample has one partner."""
    chosen = np.zeros(len(good), dtype=bool)
    taken_a, taken_b = np.zeros(len(met.tracks.a), dtype=bool), np.zeros(len(met.tracks.b), dtype=bool)
    candidates = np.flatnonzero(good)
    for pair in candidates[np.argsort(-weight[candidates], kind="stable")].tolist():
        rows = met.tracklets.encounters_of(pair)
        in_a, in_b = met.a[rows], met.b[rows]
        if max(np.count_nonzero(taken_a[in_a]), np.count_nonzero(taken_b[in_b])) > _MAX_TAKEN * len(rows):
            continue
        chosen[pair] = True
        taken_a[in_a] = True
        taken_b[in_b] = True
    return chosen


def fit_motion(met: SynchronousPairs, matched: TrackletMatches, start: GroundMotion, *, free_lag: bool) -> GroundMotion | None:
    """Fit the motion to matched samples by robust linear least squares about a start.

    Unknowns are the turn with its scale, the shift and, if the lag is free, its difference from the encounters' lag. A lag that
    is held must be that of the encounters. Returns None where the samples do not determine the unknowns.
    """
    a, b = met.a[matched.rows], met.b[matched.rows]
    tracks_a, tracks_b = met.tracks.a, met.tracks.b
    w = matched.whitening / np.sqrt(1.0 + (2 * matched.miss) ** 2)[:, None]
    p, q, v = tracks_a.position[a], tracks_b.position[b], tracks_b.velocity[b] * (1.0 if free_lag else 0.0)
    one, zero = np.ones(len(p)), np.zeros(len(p))
    x = np.column_stack([p.real, -p.imag, one, zero, -v.real, q.real])
    y = np.column_stack([p.imag, p.real, zero, one, -v.imag, q.imag])
    rows = np.concatenate([w[:, :1] * x, w[:, 1:2] * x + w[:, 2:] * y])
    A, target = rows[:, :5], rows[:, 5]
    H, g = A.T @ A, A.T @ target
    # Priors: the scale near 1, the difference of the lag small.
    unit = start.turn / abs(start.turn)
    prior = max(1.0, _PRIOR_SHARE * len(p))
    H[[0, 1], [0, 1]] += prior / _SCALE_SD**2
    g[:2] += prior / _SCALE_SD**2 * np.array([unit.real, unit.imag])
    H[4, 4] += prior
    if np.linalg.cond(H) > _MAX_CONDITION:
        return None
    solution = np.linalg.solve(H, g)
    turn = complex(solution[0], solution[1])
    scale = float(np.clip(abs(turn), *_SCALE_RANGE))
    lag_s = met.lag * STEP_S + float(solution[4]) if free_lag else start.lag_s
    return GroundMotion(turn / abs(turn) * scale, complex(solution[2], solution[3]), lag_s)
