"""Tracklets of two cameras matched under a motion of the ground, and the motion that fits matched tracklets best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.association.encounters import Encounters
from passerby.association.ground_tracks import STEP_S

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WALKING = 0.7
"""Metres per second: slower people tell no direction and count less."""
# A tracklet pair is a match when so many of its common samples agree, on average over their weight.
_MIN_AGREEMENT, _MIN_SAMPLES = 0.25, 3
# A few samples where two tracklets of one person touch do not part them.
_MAX_TAKEN = 0.2
# The levels know each camera's height to about 9 %, so the two scales differ by about this much, and never by more than these.
_SCALE_SD, _SCALE_RANGE = 0.13, (0.7, 1.4)
# The priors weigh as much as this share of the matched samples: neighbouring samples are off alike.
_PRIOR_SHARE = 0.05
# A normal matrix worse than this is that of people who all stand on one spot.
_MAX_CONDITION = 1e14


@dataclass(frozen=True)
class GroundMotion:
    """From camera a's ground and clock to camera b's: `ground_b = turn * ground_a + shift` at `time_b = time_a + lag_s`."""

    turn: complex
    """Turn about the vertical, and the ratio of the two cameras' scales."""
    shift: complex
    """x + iy, metres of camera b."""
    lag_s: float
    """Seconds."""


@dataclass(frozen=True, eq=False)
class Agreements:
    """How well N encounters meet under a motion."""

    value: Floats
    """(N,) 1 where the two samples meet, 0 a tolerance apart, -1 beyond."""
    miss: Floats
    """(N,) distance in tolerances."""
    whitening: Floats
    """(N, 3) the lower triangle (11, 21, 22) that turns metres into tolerances, along camera b's axes."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched tracklets and their encounters."""

    rows: Ints
    """(M,) rows of the encounters."""
    miss: Floats
    """(M,) as in `Agreements`."""
    whitening: Floats
    """(M, 3) as in `Agreements`."""
    score: float
    """Encounters of walking people that agree, less those that disagree."""
    tracklets_a: Ints
    """(K,) matched tracklets of camera a,"""
    tracklets_b: Ints
    """(K,) and of camera b,"""
    weight: Floats
    """(K,) with the agreement of each match, in samples."""


def agreements(met: Encounters, motion: GroundMotion, factor: float = 1.0) -> Agreements:
    """How well encounters meet when the tolerances are `factor` times as wide."""
    tracks_a, tracks_b = met.tracks.a, met.tracks.b
    rest_s = motion.lag_s - met.lag * STEP_S
    whitening = _whitening(met, motion.turn) / factor
    apart = motion.turn * tracks_a.position[met.a] + motion.shift - tracks_b.position[met.b] - tracks_b.velocity[met.b] * rest_s
    miss = np.hypot(whitening[:, 0] * apart.real, whitening[:, 1] * apart.real + whitening[:, 2] * apart.imag)
    return Agreements(np.maximum(1.0 - miss**2, -1.0), miss, whitening)


def _whitening(met: Encounters, turn: complex) -> Floats:
    """(N, 3) lower triangles W with `W^T W` the inverse of both positions' joint covariance, along camera b's axes."""
    xx = yy = xy = np.zeros(len(met))
    for tracks, rows, turned in ((met.tracks.a, met.a, turn), (met.tracks.b, met.b, 1.0 + 0.0j)):
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


def matches(met: Encounters, motion: GroundMotion, factor: float) -> Matches | None:
    """Tracklets that run together under a motion, the best first; two that overlap in time never share a partner.

    None where they have too few samples to tell anything.
    """
    tracks, pairs = met.tracks, met.tracklets
    agreeing = agreements(met, motion, factor)
    weight = pairs.summed(agreeing.value)
    likeness = np.zeros(len(pairs)) if tracks.likeness is None else tracks.likeness[pairs.a, pairs.b]
    good = (weight > _MIN_AGREEMENT * pairs.size) & (pairs.size >= _MIN_SAMPLES) & (weight + likeness > 0)
    chosen = _exclusive(met, good, weight + likeness)
    rows = np.flatnonzero(chosen[pairs.of_encounter])
    if len(rows) < _MIN_SAMPLES:
        return None
    slower = np.minimum(np.abs(tracks.a.velocity[met.a[rows]]), np.abs(tracks.b.velocity[met.b[rows]]))
    score = float((agreeing.value[rows] * np.minimum(1.0, slower / WALKING)).sum())
    return Matches(
        rows, agreeing.miss[rows], agreeing.whitening[rows], score, pairs.a[chosen], pairs.b[chosen], weight[chosen]
    )  # fmt: skip


def _exclusive(met: Encounters, good: NDArray[np.bool_], weight: Floats) -> NDArray[np.bool_]:
    """(P,) which of the good tracklet pairs are kept when the best take their samples first: a sample has one partner."""
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


def fitted_motion(met: Encounters, matched: Matches, start: GroundMotion, *, free_lag: bool) -> GroundMotion | None:
    """The motion that brings matched samples together: robust linear least squares about a start.

    Unknowns are the turn with its scale, the shift, and what is left of the lag after the encounters' own, if it is free.
    None where the samples do not determine them.
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
    # Priors: the scale near 1, the rest of the lag small.
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
