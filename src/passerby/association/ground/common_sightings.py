"""Turn between two groups of cameras, and common identities, from people near the passage that both groups see at one time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from passerby.association.ground.pair_matching import GroundMotion
from passerby.association.ground.passages import (
    APART_S,
    DAMPING,
    MOST_SQUARE,
    OTHER_LAGS_S,
    STEPS,
    Complexes,
    Passage,
)
from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import expanded_ranges, group_numbers, least_of_groups
from passerby.people.ground_positions import Places

NEAR_M = 5.0
"""Radius about the place where people pass, metres, within which boxes of both groups are compared."""
SIGHTED_TURNS, SIGHTED_CELL_M, FARTHEST_M, NEAR_CELLS = 72, 0.25, 2.0, 3
"""Number of turns that are compared, size of the cells in which their shifts are counted, largest distance of a shift from the
one found by ends of tracks, and number of cells within which pairs of boxes are fitted."""
CERTAIN, LIKELY, APART_DEG, RIVAL = 2.5, 0.5, 20.0, 0.8
"""The turn is undetermined in two cases: its log-likelihood is less than `CERTAIN` times the largest of any other lag, or a
turn that differs by more than `APART_DEG` has at least the share `RIVAL` of its votes. Of turns and shifts with at least the
share `LIKELY` of the largest log-likelihood, the one with most votes is taken. Simulated airports (seeds 801, 804, 806, 811 of
25 cameras, 820 of 100): at 14 of 18 doors the ratio is 3.1 to 37, and the turn is then within 7 degrees, at 11 of them within
2.1 (by the ends of tracks alone: up to 35); at three, where the two groups see few people at one time, 0.5 to 2.1; at one
another turn has as many votes; between groups without common ground the ratio is 0.3 to 1.5."""
SAME_PERSON = 3.0
"""Log-likelihood, nats, above which a person of one group is one of the other: twenty times as probable."""
TOGETHER = 0.25
"""Least log-likelihood of common people of two cameras that see people together, as a share of that of the best two cameras.
(Simulated airports, seeds 804 and 806: 59 to 100 % for eight pairs of cameras at four doors, 4 % at most for others.)"""
TO_COMPLEX = np.array([1.0, 1.0j])


def refine_by_sightings(found: Passage, a: Places, b: Places) -> Passage:
    """Refine the motion by boxes of both groups near the passage at one time, including cut-off boxes and unknown people.

    Every two boxes at one time propose a shift for each turn. Votes at other lags measure chance: boxes of different people
    meet at any time, especially where a turn and a shift lay one group's people over the other's.

    The passage is returned unchanged where the turn is undetermined: other lags have as many votes, or another turn has nearly
    as many.

    Args:
        found: a significant passage.
        a: boxes of the first group's cameras.
        b: boxes of the second group's cameras.
    """
    there = found.motion.turn * found.place + found.motion.shift
    near_a, near_b = (
        side.take(np.abs(side.place @ TO_COMPLEX - at) < NEAR_M) for side, at in ((a, found.place), (b, there))
    )  # fmt: skip
    here, seen = near_a.place @ TO_COMPLEX - found.place, near_b.place @ TO_COMPLEX - there
    turns = np.exp(2j * np.pi * np.arange(SIGHTED_TURNS) / SIGHTED_TURNS)

    def votes(later_s: float) -> Floats:
        i, j = _at_one_time(near_a, near_b, found.motion.lag_s + later_s)
        return np.array([_count_shifts(seen[j] - turn * here[i]) for turn in turns.tolist()])

    away = np.arange(2 * APART_S, OTHER_LAGS_S, APART_S)
    by_chance = np.array([votes(later_s) for later_s in np.concatenate([-away, away]).tolist()])
    together = votes(0.0)
    likelihood = _log_likelihood(together, by_chance)
    at_others = max(_log_likelihood(one, np.delete(by_chance, n, axis=0)).max() for n, one in enumerate(by_chance))
    more = np.where(likelihood >= LIKELY * likelihood.max(), together - by_chance.mean(axis=0), 0.0)
    number, x, y = np.unravel_index(int(more.argmax()), more.shape)
    turn, shift = complex(turns[number]), complex(*((np.array([x, y]) + 1.5) * SIGHTED_CELL_M - FARTHEST_M))
    rivals = np.abs(np.angle(turns / turn)) > np.deg2rad(APART_DEG)
    if likelihood.max() <= CERTAIN * at_others or more[rivals].max() >= RIVAL * more.max():
        return found
    i, j = _at_one_time(near_a, near_b, found.motion.lag_s)
    alike = np.abs(seen[j] - turn * here[i] - shift) < NEAR_CELLS * SIGHTED_CELL_M
    i, j = i[alike], j[alike]
    pairs = _Sighted(near_a.place[i], near_b.place[j], near_a.covariance[i], near_b.covariance[j], i, j)
    motion = pairs.fit(GroundMotion(turn, there + shift - turn * found.place, found.motion.lag_s))
    return replace(found, motion=motion, turn_known=True)


@dataclass(frozen=True, eq=False)
class Alike:
    """Pairs of people of two groups that may be one person."""

    pairs: Ints
    """(K, 2) their identities, the most likely first."""
    cameras: Ints
    """(M, 2) numbers of the cameras of the first and the second group that see them at one position."""


def compare_people(passage: Passage, a: Places, b: Places) -> Alike:
    """Find pairs of people of two groups that may be one person: they are at one position whenever both groups see them.

    Only cameras that see many of them together are returned. For other cameras a single different person would be enough.

    Args:
        passage: has the motion between the groups.
        a: boxes with identities of the first group's cameras.
        b: boxes with identities of the second group's cameras.
    """
    i, j = _at_one_time(a, b, passage.motion.lag_s)
    turn, shift = passage.motion.turn, passage.motion.shift
    R = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
    miss = a.place[i] @ R.T + (shift.real, shift.imag) - b.place[j]
    square = np.einsum("ki,kij,kj->k", miss, np.linalg.inv(R @ a.covariance[i] @ R.T + b.covariance[j]), miss)
    both = np.column_stack([a.identity[i], b.identity[j]])
    number = group_numbers(*both.T)
    pairs = np.empty((number.max(initial=-1) + 1, 2), dtype=np.int64)
    pairs[number] = both
    gain = np.zeros((len(pairs), len(a.centre), len(b.centre)))
    np.add.at(gain, (number, a.camera[i], b.camera[j]), np.log((1 + MOST_SQUARE) / (1 + square)))
    total = gain.sum(axis=(1, 2))
    seen = gain[total > SAME_PERSON].sum(axis=0)
    together = (seen > TOGETHER * seen.max()) & (seen > 0)
    surest = np.argsort(-total, kind="stable")[: np.count_nonzero(total > SAME_PERSON)]
    return Alike(pairs[surest], np.argwhere(together))


def _at_one_time(a: Places, b: Places, lag_s: float) -> tuple[Ints, Ints]:
    """Return the rows of `a` and of `b` that are half a time step apart at most."""
    seconds_a, seconds_b = a.start_s + a.step * a.step_s + lag_s, b.start_s + b.step * b.step_s
    half = 0.5 * max(a.step_s, b.step_s)
    low, high = (np.searchsorted(seconds_b, seconds_a + apart) for apart in (-half, half))
    return expanded_ranges(low, high - low)


def _log_likelihood(votes: Floats, by_chance: Floats) -> Floats:
    """Return the log-likelihood, nats, of votes by people that both groups see, relative to chance.

    Chance is measured by the votes at other lags (L, ...). The likelihood is Poisson's, divided by the overdispersion of the
    other lags: boxes of people who stand come in hundreds. (Quasi-likelihood: Wedderburn, Biometrika 1974.)
    """
    mean = by_chance.mean(axis=0) + 1.0
    gain = np.where(votes > mean, votes * np.log(np.maximum(votes, 1.0) / mean) - (votes - mean), 0.0)
    return np.asarray(gain * mean / (by_chance.var(axis=0) + mean))


def _count_shifts(shift: Complexes) -> Floats:
    """Count the shifts of at most `FARTHEST_M` in each square of three by three cells: (n, n)."""
    edges = np.arange(-FARTHEST_M, FARTHEST_M + 0.5 * SIGHTED_CELL_M, SIGHTED_CELL_M)
    votes = np.histogram2d(shift.real, shift.imag, bins=(edges, edges))[0]
    return np.asarray(sliding_window_view(votes, (3, 3)).sum(axis=(2, 3)))


@dataclass(frozen=True, eq=False)
class _Sighted:
    """K pairs of boxes of two groups at one time."""

    a: Floats
    """(K, 2) positions, metres; `b` are those of the second group."""
    b: Floats
    covariance_a: Floats
    """(K, 2, 2)"""
    covariance_b: Floats
    row_a: Ints
    """(K,) rows of the boxes."""
    row_b: Ints

    def fit(self, motion: GroundMotion) -> GroundMotion:
        """Fit the motion robustly to the pairs, near a first one; each box has one partner at most."""
        turn, shift = motion.turn, motion.shift
        for _ in range(STEPS):
            R = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
            miss = self.a @ R.T + (shift.real, shift.imag) - self.b
            information = np.linalg.inv(R @ self.covariance_a @ R.T + self.covariance_b)
            square = np.einsum("ki,kij,kj->k", miss, information, miss)
            mutual = np.intersect1d(least_of_groups(self.row_a, square), least_of_groups(self.row_b, square))
            weighed = information[mutual] / (1.0 + square[mutual] / 2.0)[:, None, None]
            turned = 1j * turn * (self.a[mutual] @ TO_COMPLEX)
            J = np.zeros((len(mutual), 2, 3))
            J[:, 0, 0], J[:, 1, 0], J[:, 0, 1], J[:, 1, 2] = turned.real, turned.imag, 1.0, 1.0
            normal = np.einsum("kia,kij,kjb->ab", J, weighed, J) + np.diag(DAMPING[:3])
            delta = np.linalg.solve(normal, np.einsum("kia,kij,kj->a", J, weighed, miss[mutual])).tolist()
            turn, shift = turn * np.exp(-1j * delta[0]), shift - complex(delta[1], delta[2])
        return GroundMotion(turn, shift, motion.lag_s)
