"""Did a camera zoom while it filmed? Its sightings by focal lengths that differ between two stretches of time.

A zoom also looks like a walk of the camera along its axis, and a pose takes most of it up. So a stretch is a zoom where another
focal length from the same place explains it no worse than another pose with the same focal length does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from passerby.calibration.diagnostics.correspondences import Correspondences, fit_costs, pose_residuals, resect_rows
from passerby.calibration.diagnostics.pose_change import (
    CLUSTER_S,
    LEAST_GAIN,
    WINDOW_ROWS,
    PoseChange,
    best_stretch,
    refined_change,
)
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import group_sums
from passerby.geometry.robust import cut_cauchy_weights
from passerby.people.resection import BEYOND, LOSS, weak_prior

FACTORS = 1.07 ** np.arange(-13, 14)
"""Tried at first: from 0.4 to 2.4."""
STEPS = 0.04, 0.015, 0.005
"""By which the logarithm of a factor is then refined."""
MOST_STEPS = 8
"""Of each size."""
MOST_PAIRS = 4000
"""Of sightings and people, by which focal lengths are sought: of more, even steps of the sightings are taken."""
HINT = 0.5
"""Share of the gain of a sure change that a zoom has to have by poses that were fitted without regard to it."""
LEAST_ZOOM = 0.02
"""Logarithm of a factor below which nothing is called a zoom."""
TURNED_ZOOM = 0.08
"""That of a camera that was moved as well."""
ZOOM_SIGMAS = 5.0


@dataclass(frozen=True, eq=False)
class _View:
    """A focal length, in that of the lens, and a pose."""

    zoom: float
    pose: Pose
    cost: float
    """Robust cost of the sightings that they were fitted to."""


def detect_zoom(m: Correspondences, pose: Pose, per_second: float = 5.0, *, stated: bool = True) -> PoseChange | None:
    """The stretch of time during which the camera most likely had another focal length; None where nothing hints at one.

    Args:
        m: the camera's sightings with the people of their instants.
        pose: of the whole recording, as found without regard to changes.
        per_second: instants a second.
        stated: whether the lens was calibrated: what it does not hold for is then the stretch, however long it is.
    """
    if len(m) < 2 * WINDOW_ROWS:
        return None
    few = _thinned(m)
    whole = resect_rows(few, np.ones(len(few), dtype=bool), pose, steps=3).pose
    costs = np.array([fit_costs(few.zoomed(float(factor)), whole).cost for factor in FACTORS])
    main, other, stretch = best_stretch(costs)
    if min(np.count_nonzero(stretch), np.count_nonzero(~stretch)) < WINDOW_ROWS:
        return None
    two = costs[other][stretch].sum() + costs[main][~stretch].sum()
    if 0.5 * (costs.sum(axis=1).min() - two) < HINT * LEAST_GAIN:
        return None
    views = (
        _best_view(few.part(~stretch), whole, float(FACTORS[main])),
        _best_view(few.part(stretch), whole, float(FACTORS[other])),
    )
    starts = (whole, 1.0), *((view.pose, view.zoom) for view in views)
    single = min((_best_view(few, start, factor) for start, factor in starts), key=lambda view: view.cost)
    inside = few.own.instant[stretch]
    change = refined_change(
        (m.zoomed(views[0].zoom), m.zoomed(views[1].zoom)), (views[0].pose, views[1].pose),
        (m.own.instant >= inside.min()) & (m.own.instant <= inside.max()),
        _best_view(m, single.pose, single.zoom, free=False).cost, per_second, zoom=views[1].zoom / views[0].zoom,
    )  # fmt: skip
    return None if change is None else _as_zoom(m, change, per_second, stated)


def _as_zoom(m: Correspondences, change: PoseChange, per_second: float, stated: bool) -> PoseChange | None:
    """A change as the zoom that it is; None where it is rather a move."""
    stretch = (m.own.instant >= change.first) & (m.own.instant <= change.last)
    if min(np.count_nonzero(stretch), np.count_nonzero(~stretch)) < WINDOW_ROWS:
        return None
    rest = _best_view(_thinned(m.part(~stretch)), change.main, 1.0)
    zoom = zoom_of(_thinned(m.part(stretch)).zoomed(rest.zoom), rest.pose, change.other, per_second, start=change.zoom)
    if zoom is None:
        return None
    found = replace(change, zoom=zoom.factor, sigmas=zoom.sigmas)
    far, near = abs(math.log(rest.zoom)), abs(math.log(rest.zoom * zoom.factor))
    return _exchanged(found, m.own.instant[~stretch]) if stated and near < far - LEAST_ZOOM else found


def _exchanged(change: PoseChange, rest: Ints) -> PoseChange:
    """The change whose stretch is the rest of the time, at these instants; as it was where that has two parts."""
    if not (change.at_start or change.at_end):
        return change
    return replace(
        change, first=int(rest.min()), last=int(rest.max()), at_start=change.at_end, at_end=change.at_start,
        main=change.other, other=change.main, rows=change.rows[::-1], borne_out=change.borne_out[::-1], zoom=1 / change.zoom,
    )  # fmt: skip


@dataclass(frozen=True)
class Zoom:
    """Another focal length."""

    factor: float
    sigmas: float
    """How far its logarithm is from 0, in its sigmas, neighbouring samples of one person taken together."""
    pose: Pose
    """With it."""


def zoom_of(part: Correspondences, held: Pose, moved: Pose, per_second: float, *, start: float = 1.0) -> Zoom | None:
    """The zoom that explains a stretch of sightings, if it explains them better than a move does.

    Args:
        part: the sightings of the stretch, by the lens of the rest of the time.
        held: the pose of the rest of the time.
        moved: about the pose that the stretch has by that same lens, or by the zoomed one.
        per_second: instants a second.
        start: a first factor.
    """
    costs = [fit_costs(part.zoomed(float(factor)), held).cost.sum() for factor in FACTORS]
    first = float(FACTORS[int(np.argmin(costs))])
    alone = _best_view(part, held, first, resected=False)
    by_move = min(_best_view(part, pose, 1.0, free=False).cost for pose in (moved, held))
    if alone.cost <= by_move:
        return _sure_zoom(part, alone, per_second, held=True)
    both = min(
        (_best_view(part, pose, factor) for pose, factor in ((held, alone.zoom), (moved, start))),
        key=lambda view: view.cost,
    )
    if 0.5 * (by_move - both.cost) < LEAST_GAIN or abs(np.log(both.zoom)) < TURNED_ZOOM:
        return None
    return _sure_zoom(part, both, per_second, held=False)


def _sure_zoom(part: Correspondences, view: _View, per_second: float, *, held: bool) -> Zoom | None:
    """The zoom of a view, its pose held or not; None where it is small, or hardly known."""
    sigmas = float(abs(np.log(view.zoom)) / _zoom_sigma(part, view, per_second, held=held))
    small = abs(np.log(view.zoom)) < LEAST_ZOOM
    return None if small or sigmas < ZOOM_SIGMAS else Zoom(view.zoom, sigmas, view.pose)


def _thinned(m: Correspondences) -> Correspondences:
    """About so many sightings that they make `MOST_PAIRS` pairs."""
    step = math.ceil(len(m.row) / MOST_PAIRS)
    return m if step < 2 else m.part(np.arange(len(m)) % step == 0)


def _best_view(m: Correspondences, pose: Pose, factor: float, *, free: bool = True, resected: bool = True) -> _View:
    """The focal length and the pose that sightings fit, near first ones; `free` and `resected`: which of them may change."""
    every = np.ones(len(m), dtype=bool)

    def view(zoom: float, start: Pose) -> _View:
        seen = m.zoomed(zoom)
        there = resect_rows(seen, every, start).pose if resected else start
        return _View(zoom, there, float(fit_costs(seen, there).cost.sum()))

    best = view(factor, pose)
    for step in STEPS if free else ():
        signs: tuple[int, ...] = (-1, 1)
        for _ in range(MOST_STEPS):
            tried = {sign: view(best.zoom * float(np.exp(sign * step)), best.pose) for sign in signs}
            sign, better = min(tried.items(), key=lambda one: one[1].cost)
            if better.cost >= best.cost:
                break
            best, signs = better, (sign,)  # behind lies the view before
    return best


def _zoom_sigma(m: Correspondences, view: _View, per_second: float, *, held: bool) -> float:
    """One sigma of the logarithm of a view's focal length, its pose held or unknown.

    By the scatter of clusters (sandwich), to which the formal covariance is added: rather too large than too small.
    """
    seen = m.zoomed(view.zoom)
    pairs = fit_costs(seen, view.pose).pair
    residual, information, by_pose, square = pose_residuals(seen, view.pose, pairs)
    step = 1e-4
    ends = [pose_residuals(m.zoomed(view.zoom * float(np.exp(sign * step))), view.pose, pairs)[0] for sign in (-1, 1)]
    by_all = np.concatenate([by_pose, ((ends[1] - ends[0]) / (2 * step))[:, :, None]], axis=2)
    weighed: Floats = cut_cauchy_weights(square, LOSS, BEYOND)[:, None, None] * (by_all.transpose(0, 2, 1) @ information)
    gradient = (weighed @ residual[:, :, None])[:, :, 0]
    normal = (weighed @ by_all).sum(axis=0)
    normal[:6, :6] += weak_prior()
    normal[6, 6] += 1.0
    person, instant = m.people.identity[m.person[pairs]], m.own.instant[m.row[pairs]]
    length = max(1, round(CLUSTER_S * per_second))
    cluster = np.unique(np.column_stack([person, instant // length]), axis=0, return_inverse=True)[1].ravel()
    n = int(cluster.max()) + 1
    summed = group_sums(cluster, gradient, n)
    if held:
        normal, summed = normal[6:, 6:], summed[:, 6:]
    inverse = np.linalg.inv(normal)
    covariance = inverse @ (summed.T @ summed * n / max(n - 7, 1) + normal) @ inverse
    return float(np.sqrt(covariance[-1, -1]))
