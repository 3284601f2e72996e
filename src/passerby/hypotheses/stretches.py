"""Search for stretches of time in which a camera differs from the rest of its recording, as candidates for `changes`.

Poses and focal lengths are fitted to windows of time. Of all pairs of these fits, and of all stretches, the combination with
the least robust cost is refined.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats
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
    Stretch,
    costs_along,
    fit_path,
)
from passerby.hypotheses.correspondences import Correspondences

WINDOWS, WINDOW_ROWS = 10, 24
"""Largest number of windows of time, and least number of observations in each."""
ROUNDS, ROUNDS_WITHOUT = 4, 2
"""Number of times that the path and its stretch are fitted in turn: with all observations, and from there without a fifth."""
FOCALS = np.linspace(-0.8, 0.8, 9)
"""Logarithms of the factors on the focal length from which a window's fit starts."""
POORLY = 4.0
"""Mean cost of an observation, nats, above which the pose of a window is searched for again. It is 1.5 if all is right, and 6
if no person fits."""
MOST_TRIED, LEAST_TOGETHER = 60, 6
"""Largest number of pairs of a tracklet and a person in that search, and least number of observations of a pair."""
SCREENED_SHIFT, SCREENED_SHARE = 0.02, 0.3
"""No stretch is searched for under two conditions: one linear step moves no part of the recording by more than the first share
of a person's extent, about 3 cm; and the share of observations that no person explains differs between windows by at most the
second."""


def windows_of(m: Correspondences) -> np.ndarray:
    """Return the window of time (M,) of each observation; the windows have about equal numbers of observations."""
    n = max(1, min(WINDOWS, len(m) // WINDOW_ROWS))
    inner = np.quantile(m.own.step, np.arange(1, n) / n)
    return np.asarray(np.searchsorted(inner, m.own.step))


def is_suspicious(m: Correspondences, whole: CameraPath) -> bool:
    """Check whether parts of the time seem to have different poses or focal lengths, by one linear step for each part."""
    window = np.unique(windows_of(m), return_inverse=True)[1]
    n = int(window.max()) + 1
    unexplained = costs_along(m, whole) >= MOST_COST - 1e-9
    if np.ptp(np.bincount(window, unexplained, n) / np.bincount(window, minlength=n)) > SCREENED_SHARE:
        return True
    equations = Equations.of(m, whole)
    H = group_sums(window, equations.information, n).cumsum(axis=0)
    g = group_sums(window, equations.gradient, n).cumsum(axis=0)
    prior = np.diag(PRIOR_SD**-2.0)
    before = -np.linalg.solve(H[:-1] + prior, g[:-1, :, None])[:, :, 0]
    after = -np.linalg.solve(H[-1] - H[:-1] + prior, (g[-1] - g[:-1])[:, :, None])[:, :, 0]
    moved = np.einsum("kij,wj->wki", equations.by_own, after - before)
    shift = np.median(np.linalg.norm(moved, axis=2) / m.own.extent_px, axis=1)
    return bool(shift.max(initial=0.0) > SCREENED_SHIFT)


def find_stretches(m: Correspondences, whole: CameraPath) -> list[CameraPath]:
    """Find paths with a stretch of time: the best stretch at an end of the recording, and the best one within it."""
    window = windows_of(m)
    views = [whole]
    for w in np.unique(window):
        views += _views_of(m.part(window == w), views)
    costs = np.array([costs_along(m, view) for view in views])
    found: list[CameraPath] = []
    for middle in (False, True):
        best = best_stretch(costs, middle=middle)
        if best is None:
            continue
        first = _between(views[best.main], views[best.other], best.stretch_of(m))
        refined = refine_stretch(m, first, tuple(range(len(PRIOR_SD))))
        if refined is not None and not any(_alike(m, refined, one) for one in found):
            found.append(refined)
    return found


def refine_stretch(
    m: Correspondences, path: CameraPath, parts: tuple[int, ...], *, held: Bools | None = None
) -> CameraPath | None:
    """Fit a path and its stretch in turn; None if one pose fits all of the time best, or a part has too few observations.

    Args:
        m: the camera's observations with the people of their instants.
        path: initial path, with a stretch.
        parts: columns of the change that are free.
        held: (M,) whether an observation is held out; the initial path was fitted to all.
    """
    assert isinstance(path.times, Stretch)
    used = m if held is None else m.part(~held)
    middle = np.isfinite(path.times.first) and np.isfinite(path.times.last)
    rounds, steps = (ROUNDS, STEPS) if held is None else (ROUNDS_WITHOUT, STEPS_WITHOUT)
    for _ in range(rounds):
        inside = path.times.at(used.own.step)[:, 0] > 0
        if min(np.count_nonzero(inside), np.count_nonzero(~inside)) < WINDOW_ROWS:
            return None
        path = fit_path(used, path, parts, own=WITH_CLOCK, steps=steps)
        costs = np.array([costs_along(used, one) for one in (path.constant(np.zeros(7)), path.constant(path.coefficients[0]))])
        best = best_stretch(costs, middle=bool(middle), swap=False)
        if best is None:
            return None
        stretch, before = best.stretch_of(used), path.times
        if stretch == before:
            break
        path = replace(path, times=stretch)
    return path


@dataclass(frozen=True)
class BestStretch:
    """Rows [first, last) that view `other` explains better than `main`, which explains the rest."""

    main: int
    other: int
    first: int
    last: int
    count: int
    """Number of all rows."""

    def stretch_of(self, m: Correspondences) -> Stretch:
        """Return the stretch as times."""
        t = m.own.step
        return Stretch(
            float(t[self.first]) if self.first > 0 else -np.inf, float(t[self.last - 1]) if self.last < self.count else np.inf
        )


def best_stretch(costs: Floats, *, middle: bool, swap: bool = True) -> BestStretch | None:
    """Find the stretch, its view and the view of the rest with the least cost; None if one view explains all best.

    Args:
        costs: (views, M) costs of the observations by each view, in the order of time.
        middle: whether the stretch lies within the recording; else it begins or ends with it.
        swap: whether any two views are tried; else the first view is that of the rest and the second that of the stretch.
    """
    n, count = costs.shape
    best: tuple[float, BestStretch | None] = (float(costs.sum(axis=1).min()) - 1e-9, None)
    for a in range(n):
        for b in range(n):
            if a == b or (not swap and (a, b) != (0, 1)):
                continue
            total = np.concatenate([[0.0], np.cumsum(costs[a] - costs[b])])
            if middle:
                inner = total[1:count]
                end = int(np.argmax(inner - np.minimum.accumulate(inner)))
                begin = int(np.argmin(inner[: end + 1]))
                tried = [(inner[end] - inner[begin], begin + 1, end + 1)]
            else:
                suffix, prefix = int(np.argmin(total)), int(np.argmax(total))
                tried = [(total[-1] - total[suffix], suffix, count), (total[prefix], 0, prefix)]
            for gain, first, last in tried:
                cost = float(total[-1] + costs[b].sum() - gain)
                if cost < best[0] - 1e-9 and 0 < last - first < count:
                    best = cost, BestStretch(a, b, first, last, count)
    return best[1]


def _views_of(part: Correspondences, views: list[CameraPath]) -> list[CameraPath]:
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


def _between(main: CameraPath, other: CameraPath, stretch: Stretch) -> CameraPath:
    """Return the path with one camera state during a stretch, and another for the rest of the time."""
    change = np.zeros((1, len(PRIOR_SD)))
    change[0, TURN] = log_rotation(other.pose.R_cw @ main.pose.R_cw.T)
    change[0, SHIFT] = other.pose.centre - main.pose.centre
    change[0, FOCAL] = other.log_focal - main.log_focal
    return replace(main, times=stretch, change=change)


def _alike(m: Correspondences, one: CameraPath, other: CameraPath) -> bool:
    """Check whether two stretches contain the same observations."""
    return bool((one.times.at(m.own.step) == other.times.at(m.own.step)).all())
