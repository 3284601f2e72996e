"""Search for stretches of time in which a camera differs from the rest of its recording, as candidates for `changes`.

Poses and focal lengths are fitted to windows of time. Of all pairs of these fits, and of all stretches, the combination with
the least robust cost is refined: one stretch at an end of the recording, one within it, or any number of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import group_sums
from passerby.geometry.rotations import log_rotation
from passerby.hypotheses.camera_path import (
    FOCAL,
    MOST_COST,
    PRIOR_SD,
    SHIFT,
    STEPS,
    STEPS_WITHOUT,
    TURN,
    WITH_CLOCK,
    CameraPath,
    Equations,
    Stretches,
    costs_along,
    fit_path,
)
from passerby.hypotheses.comparison import FOLDS, Comparison
from passerby.hypotheses.correspondences import Correspondences

WINDOWS, WINDOW_ROWS = 10, 24
"""Largest number of windows of time, and least number of observations in each."""
ROUNDS, ROUNDS_WITHOUT = 4, 2
"""Number of times that the path and its stretches are fitted in turn: with all observations, and from there without a fifth."""
FOCALS = np.linspace(-0.8, 0.8, 9)
"""Logarithms of the factors on the focal length from which a window's fit starts."""
POORLY = 4.0
"""Mean cost of an observation, nats, above which the pose of a window is searched for again. It is 1.5 if all is right, and 6
if no person fits."""
MOST_TRIED, LEAST_TOGETHER = 60, 6
"""Largest number of pairs of a tracklet and a person in that search, and least number of observations of a pair."""
SCREENED_SHARE = 0.3
"""Difference between windows in the share of observations that no person explains, above which a change is searched for even if
linear steps predict none."""


def windows_of(m: Correspondences) -> np.ndarray:
    """Return the window of time (M,) of each observation; the windows have about equal numbers of observations."""
    n = max(1, min(WINDOWS, len(m) // WINDOW_ROWS))
    inner = np.quantile(m.own.step, np.arange(1, n) / n)
    return np.asarray(np.searchsorted(inner, m.own.step))


def is_suspicious(m: Correspondences, whole: CameraPath, block: Ints, log_prior: float) -> bool:
    """Check whether parts of the time seem to have different poses or focal lengths, by one linear step for each part.

    Args:
        m: the camera's observations with the people of their instants.
        whole: path of the camera at rest.
        block: (M,) block of each observation.
        log_prior: logarithm of the largest prior odds of a change.
    """
    window = np.unique(windows_of(m), return_inverse=True)[1]
    n = int(window.max()) + 1
    unexplained = costs_along(m, whole) >= MOST_COST - 1e-9
    if np.ptp(np.bincount(window, unexplained, n) / np.bincount(window, minlength=n)) > SCREENED_SHARE:
        return True
    equations = Equations.of(m, whole)
    return any(one.log_evidence + log_prior > 0 for one in _predict_blocks(equations, window, block))


def _predict_blocks(equations: Equations, window: Ints, block: Ints) -> Iterator[Comparison]:
    """Predict held-out blocks by two poses, each for some of the windows of time, to first order, against one pose.

    Yields a comparison for each division of the windows: each range of them against the rest.
    """
    n, blocks = int(window.max()) + 1, int(block.max()) + 1
    keys, of_key = np.unique(block * n + window, return_inverse=True)
    g, H = (group_sums(of_key, each, len(keys)) for each in (equations.gradient, equations.information))
    block, window = np.divmod(keys, n)
    fold, prior = block % FOLDS, np.diag(PRIOR_SD**-2.0)
    cell = fold * n + window
    G, K = (group_sums(cell, each, FOLDS * n).reshape(FOLDS, n, *each.shape[1:]) for each in (g, H))
    G, K = G.sum(axis=0) - G, K.sum(axis=0) - K  # without each fold

    def costs(windows: Bools) -> Floats:
        """Return the costs (blocks,) of the observations in these windows, by one pose for all of them."""
        step = -np.linalg.solve(K[:, windows].sum(axis=1) + prior, G[:, windows].sum(axis=1)[:, :, None])[fold, :, 0]
        of_key = np.einsum("ki,ki->k", g, step) + 0.5 * np.einsum("ki,kij,kj->k", step, H, step)
        return np.asarray(np.bincount(block, np.where(windows[window], of_key, 0.0), blocks), dtype=np.float64)

    one_pose = costs(np.ones(n, dtype=bool))
    for first, last in combinations(range(n + 1), 2):
        inside = (np.arange(n) >= first) & (np.arange(n) < last)
        if last - first < n:
            yield Comparison.of(costs(inside) + costs(~inside), one_pose)


def find_stretches(m: Correspondences, whole: CameraPath) -> list[CameraPath]:
    """Find paths with stretches of time: the best one at an end of the recording, the best one within it, and the best set."""
    window = windows_of(m)
    views = [whole]
    for w in np.unique(window):
        views += fit_views(m.part(window == w), views)
    costs = np.array([costs_along(m, view) for view in views])
    found: list[CameraPath] = []
    for switches in (1, 2, None):
        best = best_stretches(costs, switches)
        if best is None:
            continue
        first = _between(views[best.main], views[best.other], Stretches.of(m.own.step, best.inside))
        refined = refine_stretches(m, first, tuple(range(len(PRIOR_SD))))
        if refined is not None and not any(_alike(m, refined, one) for one in found):
            found.append(refined)
    return found


def refine_stretches(
    m: Correspondences, path: CameraPath, parts: tuple[int, ...], *, held: Bools | None = None
) -> CameraPath | None:
    """Fit a path and its stretches in turn; None if one pose fits all of the time best, or a part has too few observations.

    Args:
        m: the camera's observations with the people of their instants.
        path: initial path, with stretches.
        parts: columns of the change that are free.
        held: (M,) whether an observation is held out; the initial path was fitted to all.
    """
    assert isinstance(path.times, Stretches)
    used = m if held is None else m.part(~held)
    switches = path.times.switches if path.times.switches <= 2 else None
    rounds, steps = (ROUNDS, STEPS) if held is None else (ROUNDS_WITHOUT, STEPS_WITHOUT)
    for _ in range(rounds):
        inside = path.times.at(used.own.step)[:, 0] > 0
        if min(np.count_nonzero(inside), np.count_nonzero(~inside)) < WINDOW_ROWS:
            return None
        path = fit_path(used, path, parts, own=WITH_CLOCK, steps=steps)
        costs = np.array([costs_along(used, one) for one in (path.constant(np.zeros(7)), path.constant(path.coefficients[0]))])
        best = best_stretches(costs, switches, swap=False)
        if best is None:
            return None
        stretches, before = Stretches.of(used.own.step, best.inside), path.times
        if stretches == before:
            break
        path = replace(path, times=stretches)
    return path


@dataclass(frozen=True, eq=False)
class BestStretches:
    """Observations that view `other` explains better than view `main`, which explains the rest."""

    main: int
    other: int
    inside: Bools
    """(M,) whether `other` explains an observation."""


def best_stretches(costs: Floats, switches: int | None, *, swap: bool = True) -> BestStretches | None:
    """Find the stretches, their view and the view of the rest with the least cost; None if one view explains all best.

    Args:
        costs: (views, M) costs of the observations by each view, in the order of time, nats.
        switches: 1: one stretch, which begins or ends with the recording; 2: one within the recording; None: any number of
            stretches with three switches or more. Each switch then costs the logarithm of M, the number of times at which it
            may be.
        swap: whether any two views are tried; else the first view is that of the rest and the second that of the stretches.
    """
    n, count = costs.shape
    pairs = np.array([(a, b) for a in range(n) for b in range(n) if a != b] if swap else [(0, 1)]).reshape(-1, 2)
    least = float(costs.sum(axis=1).min()) - 1e-9
    if not len(pairs):
        return None
    if switches is None:
        return _any_stretches(costs, pairs, least)
    found: BestStretches | None = None
    for a, b in pairs:
        total = np.concatenate([[0.0], np.cumsum(costs[a] - costs[b])])
        if switches == 2:
            inner = total[1:count]
            end = int(np.argmax(inner - np.minimum.accumulate(inner)))
            begin = int(np.argmin(inner[: end + 1]))
            tried = [(inner[end] - inner[begin], begin + 1, end + 1)]
        else:
            suffix, prefix = int(np.argmin(total)), int(np.argmax(total))
            tried = [(total[-1] - total[suffix], suffix, count), (total[prefix], 0, prefix)]
        for gain, first, last in tried:
            cost = float(costs[a].sum() - gain)
            if cost < least - 1e-9 and 0 < last - first < count:
                rows = np.arange(count)
                least, found = cost, BestStretches(int(a), int(b), (rows >= first) & (rows < last))
    return found


def _any_stretches(costs: Floats, pairs: Ints, least: float) -> BestStretches | None:
    """Find the best set of stretches by dynamic programming over the observations, for all pairs (P, 2) of views at once."""
    count = costs.shape[1]
    gains, switch = costs[pairs[:, 0]] - costs[pairs[:, 1]], np.log(count)
    outside, inside = np.zeros((2, len(pairs)))
    from_inside, from_outside = np.zeros((2, count, len(pairs)), dtype=bool)
    for row in range(count):
        np.greater(inside - switch, outside, out=from_inside[row])
        np.greater(outside - switch, inside, out=from_outside[row])
        outside, inside = np.maximum(outside, inside - switch), np.maximum(inside, outside - switch) + gains[:, row]
    cost = costs[pairs[:, 0]].sum(axis=1) - np.maximum(outside, inside)
    best = int(np.argmin(cost))
    if cost[best] >= least:
        return None
    there, now = np.zeros(count, dtype=bool), bool(inside[best] > outside[best])
    for row in reversed(range(count)):
        there[row] = now
        now = not now if (from_outside if now else from_inside)[row, best] else now
    if np.count_nonzero(np.diff(there)) < 3:
        return None
    return BestStretches(int(pairs[best, 0]), int(pairs[best, 1]), there)


def fit_views(part: Correspondences, views: list[CameraPath]) -> list[CameraPath]:
    """Fit poses and focal lengths to a window's observations."""
    if len(part) < WINDOW_ROWS // 2:
        return []
    whole = views[0]
    starts = [*views, *(replace(whole, log_focal=whole.log_focal + float(focal)) for focal in FOCALS)]
    costs = np.array([costs_along(part, start).mean() for start in starts])
    found = [fit_path(part, starts[int(costs.argmin())])]
    if part.given:
        found.append(fit_path(part, whole, widening=64.0))
    elif costs.min() > POORLY:
        found += _searched(part, whole)
    return found


def _searched(part: Correspondences, start: CameraPath) -> list[CameraPath]:
    """Search for poses by taking each tracklet for each of the people: its rays are turned onto the person's positions."""
    known = part.own.identity[part.row] >= 0
    key = np.column_stack([part.own.identity[part.row], part.people.identity[part.person]])
    _, number, count = np.unique(key[known], axis=0, return_inverse=True, return_counts=True)
    number, pose = number.ravel(), start.pose
    ray = part.own.middle[part.row][known]
    reach = part.people.place[part.person][known] - pose.centre
    reach /= np.maximum(np.linalg.norm(reach, axis=1), 1e-9)[:, None]
    tried = []
    for k in np.argsort(-count, kind="stable")[:MOST_TRIED]:
        if count[k] < LEAST_TOGETHER:
            break
        own = number == k
        # The old pose decides if all rays are parallel; it has the weight of a tenth of the observations.
        B = ray[own].T @ reach[own] + 0.1 * count[k] * pose.R_cw
        u, _, vt = np.linalg.svd(B)
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        there = replace(start, pose=Pose.from_centre(turn, pose.centre))
        tried.append((float(costs_along(part, there).mean()), int(k), there))
    tried.sort(key=lambda one: one[:2])
    return [fit_path(part, one, widening=4.0) for _, _, one in tried[:3]]


def _between(main: CameraPath, other: CameraPath, stretches: Stretches) -> CameraPath:
    """Return the path with one camera state during some stretches, and another for the rest of the time."""
    change = np.zeros((1, len(PRIOR_SD)))
    change[0, TURN] = log_rotation(other.pose.R_cw @ main.pose.R_cw.T)
    change[0, SHIFT] = other.pose.centre - main.pose.centre
    change[0, FOCAL] = other.log_focal - main.log_focal
    return replace(main, times=stretches, change=change)


def _alike(m: Correspondences, one: CameraPath, other: CameraPath) -> bool:
    """Check whether the stretches of two paths contain the same observations."""
    return bool((one.times.at(m.own.step) == other.times.at(m.own.step)).all())
