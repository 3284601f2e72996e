"""The view graph: selection of pairwise registrations that agree with each other, and the clock offsets from them.

Every pair has several guesses. A guess is believed when the paths through third cameras lead to the same turn, shift and lag.
Where no third camera confirms it, it is believed when no other guess of the pair has a similar score. A spanning tree is built
of the best believed guesses. Of each pair the guess is kept that agrees with the tree, or none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.association.ground.pair_matching import GroundMotion
from passerby.association.ground.registration import BELIEVED_SHARE, PairRegistration, Registration
from passerby.common.arrays import Floats

# Tolerances within which two paths to the same camera agree: a few times the error of one registration.
_TURN_SD, _LAG_SD_S, _SHIFT_FLOOR_M, _SHIFT_SHARE = np.deg2rad(8.0), 0.4, 1.0, 0.12
# A guess that no third camera supports is believed if the runner-up has less than this share of its score.
ALONE_RUNNER_UP = 0.5
MANY_SAMPLES, MANY_SHARE, MANY_RUNNER_UP = 500.0, 0.55, 0.65
"""A guess with a score above the first and a share above the second is also believed if the runner-up has less than the third.
In a corridor people go to and fro on one line: the reversed motion fits half as well, and no third camera sees the place. Of
598 pairs of a simulated site of 100 cameras (seed 800) 23 are so, all right; the shares of wrong guesses are 0.35 at most, and
their runners-up usually above 0.65."""
# A guess that third cameras support is believed if they agree with it at least this much (0 to 1).
_MIN_SUPPORT = 0.15
# Largest distance of a guess from the tree's path, in the units above, times the root of the path's edges.
_MAX_MISS = 3.0
_MIN_SCORE = 12.0
"""Scores below this number of agreeing samples of walkers (half a second each) occur by chance."""
USED_SHARE = 0.35
"""Least share of the people that both cameras should see. A guess with less is not used, even where it agrees with the tree,
unless it is in the tree or clear of chance."""


@dataclass(frozen=True, eq=False)
class Edge:
    """One pair of the view graph."""

    a: int
    b: int
    guess: Registration | None
    """The guess that is kept, or the pair's best where none is; None where the pair has no guess at all."""
    runner_up: float
    """Score of the best other guess, as a share of this one's; above 1 where third cameras changed the pair's own order."""
    support: float
    """Agreement of the paths through third cameras with it, 0 to 1."""
    used: bool


@dataclass(frozen=True, eq=False)
class ViewGraph:
    """The pairs that agree, and the cameras that they join."""

    edges: tuple[Edge, ...]
    groups: tuple[tuple[int, ...], ...]
    """Cameras joined by used edges, the largest group first."""
    offset_s: Floats
    """(C,) offset to add to each camera's clock, seconds, so that a group shows one time; 0 for the first of each group."""


def view_graph(pairs: Sequence[PairRegistration], n_cameras: int) -> ViewGraph:
    """Build the view graph from the registrations that agree.

    Args:
        pairs: registrations of pairs with a < b.
        n_cameras: number of cameras.
    """
    guesses = [(pair, guess) for pair in pairs for guess in pair.candidates if guess.score >= _MIN_SCORE]
    support = _support(guesses, n_cameras)
    belief = np.array([_belief(pair, guess, s) for (pair, guess), s in zip(guesses, support, strict=True)])
    tree = _tree(guesses, belief, n_cameras)
    placed = _placed([guesses[i] for i in tree], n_cameras)
    edges = []
    of_pair: dict[int, list[int]] = {}
    for i, (pair, _) in enumerate(guesses):
        of_pair.setdefault(id(pair), []).append(i)
    in_tree = set(tree)
    for pair in pairs:
        own = of_pair.get(id(pair), [])
        kept = _kept(pair, [guesses[i][1] for i in own], placed)
        chosen = own[kept] if kept is not None else (own[0] if own else None)
        if chosen is None:
            edges.append(Edge(pair.a, pair.b, pair.candidates[0] if pair.candidates else None, pair.runner_up, 0.0, False))
            continue
        guess = guesses[chosen][1]
        rest = [other.score for other in pair.candidates if other is not guess]
        used = kept is not None and (chosen in in_tree or guess.share >= USED_SHARE or _clear(pair, guess))
        edges.append(Edge(pair.a, pair.b, guess, max([*rest, 0.0]) / guess.score, float(support[chosen]), used))
    groups = _groups(edges, n_cameras)
    return ViewGraph(tuple(edges), groups, _offsets(edges, groups, n_cameras))


def _belief(pair: PairRegistration, guess: Registration, support: float) -> float:
    """Return the weight of a guess in the spanning tree; 0 for a guess that is not believed."""
    rest = max([other.score for other in pair.candidates if other is not guess], default=0.0)
    if guess.share < BELIEVED_SHARE and not _clear(pair, guess):
        return 0.0
    many = guess.score > MANY_SAMPLES and guess.share > MANY_SHARE
    alone = guess.score > 0 and rest / guess.score < (MANY_RUNNER_UP if many else ALONE_RUNNER_UP)
    if not alone and support < _MIN_SUPPORT:
        return 0.0
    clarity = max(1.0 - rest / guess.score, 0.05)
    return float(np.sqrt(guess.merit) * clarity * (0.05 + support))


def _clear(pair: PairRegistration, guess: Registration) -> bool:
    """Check whether a guess is its pair's best and is clear of chance."""
    return pair.clear_of_chance and guess is pair.candidates[0]


def _miss(way: GroundMotion, guess: Registration) -> float:
    """Return the squared distance between the motion of a path and a guess, in standard deviations."""
    turned = float(np.angle(way.turn / guess.turn)) / _TURN_SD
    late = (way.lag_s - guess.lag_s) / _LAG_SD_S
    there = guess.turn * guess.middle + guess.shift
    apart = abs(way.turn * guess.middle + way.shift - there)
    shifted = apart / (_SHIFT_FLOOR_M + _SHIFT_SHARE * (abs(guess.middle) + abs(there)))
    return float(turned**2 + late**2 + shifted**2)


def _support(guesses: Sequence[tuple[PairRegistration, Registration]], n_cameras: int) -> Floats:
    """Return for each guess (G,) the best agreement, 0 to 1, averaged over the third cameras with guesses for both pairs."""
    by_pair: dict[tuple[int, int], list[tuple[GroundMotion, float]]] = {}
    beside: list[set[int]] = [set() for _ in range(n_cameras)]
    for pair, guess in guesses:
        clarity = min(1.0, guess.merit / max(pair.candidates[0].merit, 1e-9))
        by_pair.setdefault((pair.a, pair.b), []).append((guess.motion, clarity))
        by_pair.setdefault((pair.b, pair.a), []).append((guess.motion.inverse, clarity))
        beside[pair.a].add(pair.b)
        beside[pair.b].add(pair.a)
    out = np.zeros(len(guesses))
    for index, (pair, guess) in enumerate(guesses):
        votes = []
        for c in sorted(beside[pair.a] & beside[pair.b]):
            ways = [
                np.exp(-0.5 * _miss(first.then(second), guess)) * clear * clear_too
                for first, clear in by_pair[pair.a, c]
                for second, clear_too in by_pair[c, pair.b]
            ]
            votes.append(max(ways))
        out[index] = float(np.mean(votes)) if votes else 0.0
    return out


def _tree(guesses: Sequence[tuple[PairRegistration, Registration]], belief: Floats, n_cameras: int) -> list[int]:
    """Return the indices of a maximum spanning forest (Kruskal)."""
    label = list(range(n_cameras))
    tree = []
    for index in np.argsort(-belief, kind="stable").tolist():
        pair = guesses[index][0]
        if belief[index] <= 0 or label[pair.a] == label[pair.b]:
            continue
        old, new = label[pair.a], label[pair.b]
        label = [new if value == old else value for value in label]
        tree.append(index)
    return tree


def _placed(tree: Sequence[tuple[PairRegistration, Registration]], n_cameras: int) -> dict[int, tuple[int, int, GroundMotion]]:
    """Return for every camera its tree's first camera, the number of edges from it, and the motion from it."""
    ways: list[list[tuple[int, GroundMotion]]] = [[] for _ in range(n_cameras)]
    for pair, guess in tree:
        ways[pair.a].append((pair.b, guess.motion))
    for pair, guess in tree:
        ways[pair.b].append((pair.a, guess.motion.inverse))
    placed: dict[int, tuple[int, int, GroundMotion]] = {}
    for root in range(n_cameras):
        if root in placed:
            continue
        placed[root] = (root, 0, GroundMotion(1 + 0j, 0j, 0.0))
        waiting = [root]
        for a in waiting:
            for second, motion in ways[a]:
                if second not in placed:
                    placed[second] = (root, placed[a][1] + 1, placed[a][2].then(motion))
                    waiting.append(second)
    return placed


def _kept(pair: PairRegistration, own: Sequence[Registration], placed: dict[int, tuple[int, int, GroundMotion]]) -> int | None:
    """Return the index of the pair's guess that agrees best with the tree; None where none agrees."""
    (root_a, hops_a, to_a), (root_b, hops_b, to_b) = placed[pair.a], placed[pair.b]
    if root_a != root_b or not own:
        return None
    way = to_a.inverse.then(to_b)
    miss = [_miss(way, guess) for guess in own]
    best = int(np.argmin(miss))
    return best if np.sqrt(miss[best]) < _MAX_MISS * np.sqrt(max(1, hops_a + hops_b)) else None


def _groups(edges: Sequence[Edge], n_cameras: int) -> tuple[tuple[int, ...], ...]:
    label = list(range(n_cameras))
    for edge in edges:
        if edge.used:
            old, new = max(label[edge.a], label[edge.b]), min(label[edge.a], label[edge.b])
            label = [new if value == old else value for value in label]
    groups = [tuple(c for c in range(n_cameras) if label[c] == value) for value in sorted(set(label))]
    return tuple(sorted(groups, key=lambda group: (-len(group), group[0])))


def _offsets(edges: Sequence[Edge], groups: Sequence[Sequence[int]], n_cameras: int) -> Floats:
    """Fit offsets to the lags of the used edges: least absolute deviations by reweighting, group by group."""
    offset = np.zeros(n_cameras)
    number = {camera: k for k, group in enumerate(groups) for camera in group}
    used: list[list[tuple[int, int, Registration]]] = [[] for _ in groups]
    for edge in edges:
        if edge.used and edge.guess is not None:
            used[number[edge.a]].append((edge.a, edge.b, edge.guess))
    for group, own in zip(groups, used, strict=True):
        if own:
            place = {camera: k for k, camera in enumerate(group)}
            offset[list(group)] = _group_offsets([(place[a], place[b], guess) for a, b, guess in own], len(group))
    return offset


def _group_offsets(used: Sequence[tuple[int, int, Registration]], n_cameras: int) -> Floats:
    """Fit the offsets (C,) of the cameras of one group, 0 for its first."""
    rows = np.zeros((len(used) + 1, n_cameras))
    target = np.zeros(len(rows))
    for k, (a, b, guess) in enumerate(used):
        # For an event that both see, time_b = time_a + lag, and time + offset is the same for both.
        rows[k, a], rows[k, b], target[k] = 1.0, -1.0, guess.lag_s
    rows[-1, 0] = 1e3
    base = np.append([np.sqrt(guess.score) for _, _, guess in used], 1.0)
    weight, offset = base, np.zeros(n_cameras)
    for _ in range(20):
        offset = np.linalg.lstsq(rows * weight[:, None], target * weight, rcond=None)[0]
        miss = np.abs(rows @ offset - target)
        weight = base / np.sqrt(np.maximum(miss, 0.02))
        weight[-1] = 1.0
    return np.asarray(offset - 0.0)
