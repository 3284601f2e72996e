"""Did a camera move while it filmed? Its own sightings against where the other cameras see the people.

A camera that is moved explains what it sees by one pose before and by another after. Poses are fitted to windows of time; of
all pairs of them, and of all stretches of time, that is kept which lowers the robust cost the most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.calibration.diagnostics.correspondences import (
    MOST_COST,
    Correspondences,
    PoseObservations,
    fit_costs,
    pose_residuals,
    resect_rows,
)
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import group_sums
from passerby.geometry.robust import cut_cauchy_cost
from passerby.geometry.rotations import angle_between, log_rotation
from passerby.people.resection import BEYOND, LOSS, PoseFit, weak_prior

WINDOWS, WINDOW_ROWS = 10, 24
"""Windows of time at most, and sightings in each at least."""
ROUNDS = 4
CLUSTER_S = 3.0
"""Sightings of one person within so many seconds are off alike."""
ASTRAY = 0.3
"""Windows whose shares of sightings that no pose explains differ by more are looked at closely."""
POORLY = 8.0
"""Mean cost of a sighting above which the pose of a window is searched for anew: 3 where all is well, 12 where nobody fits."""
MOST_TRIED, LEAST_TOGETHER = 60, 6
MIDDLE_GAIN = 15.0
BORNE_OUT = 0.75, 1.6
"""A move is told where both of its poses are so much better in their time than the other's, as a share of what the move would
make of it. In simulated scenes (docs/results/limits.md) it is 0.85 to 0.96 for moves of 0.1 to 0.5 m or 1 to 10 degrees, and
0.71 at most where people are taken for others; nothing there comes near the upper limit."""
ZOOM_BORNE_OUT = 0.6
"""The least of it for a zoom, which people who are taken for others do not resemble (docs/results/limits.md)."""
LEAST_GAIN, LEAST_SIGMAS, LEAST_SHIFT = 40.0, 10.0, 0.03


@dataclass(frozen=True, eq=False)
class PoseChange:
    """A camera that stood elsewhere during a stretch of time."""

    first: int
    """Instant at which the stretch begins,"""
    last: int
    """and the last one in it."""
    at_start: bool
    """Whether it begins with the recording,"""
    at_end: bool
    """or ends with it."""
    main: Pose
    """Where the camera was for the rest of the time,"""
    other: Pose
    """and during the stretch."""
    gain: float
    """By how much two poses lower half the robust cost of one."""
    sigmas: float
    """How far the poses differ, in their sigmas (Mahalanobis), neighbouring samples of one person taken together."""
    shift: float
    """How far the people are moved in the picture, as a share of their extent (median)."""
    rows: tuple[int, int]
    """Sightings of the rest and of the stretch that agree with their pose."""
    borne_out: tuple[float, float]
    """How much worse the pose of the other time fits the sightings of the rest, and of the stretch, as a share of what so large
    a move would make of them: about 1, if it was one."""
    zoom: float = 1.0
    """The focal length during the stretch, in that of the rest."""

    @property
    def metres(self) -> float:
        """How far the camera was moved."""
        return float(np.linalg.norm(self.other.centre - self.main.centre))

    @property
    def degrees(self) -> float:
        """How far it was turned."""
        return float(np.degrees(angle_between(self.other.R_cw, self.main.R_cw)))

    @property
    def sure(self) -> bool:
        """Whether it is beyond doubt, and large enough to matter."""
        least = BORNE_OUT[0] if self.zoom == 1.0 else ZOOM_BORNE_OUT
        return (
            least < min(self.borne_out) <= max(self.borne_out) < BORNE_OUT[1]
            and self.gain > LEAST_GAIN
            and self.sigmas > LEAST_SIGMAS
            and self.shift > LEAST_SHIFT
            and min(self.rows) >= WINDOW_ROWS
        )


def detect_pose_change(m: Correspondences, pose: Pose, per_second: float = 5.0, *, screened: bool = True) -> PoseChange | None:
    """The stretch of time during which the camera most likely stood elsewhere; None where nothing hints at one.

    Args:
        m: the camera's sightings with the people of their instants.
        pose: of the whole recording, as found without regard to changes.
        per_second: instants a second.
        screened: whether to look closer only where a linear look finds something.
    """
    if len(m) < 2 * WINDOW_ROWS:
        return None
    every = np.ones(len(m), dtype=bool)
    whole = resect_rows(m, every, pose, steps=3)
    n_windows = min(WINDOWS, len(m) // WINDOW_ROWS)
    window = np.minimum(np.searchsorted(np.quantile(m.own.instant, np.arange(1, n_windows) / n_windows), m.own.instant), 99)
    if screened and not _suspicious(m, whole, window):
        return None
    poses = [whole.pose]
    for w in np.unique(window):
        poses += _window_poses(m, window == w, poses)
    costs = np.array([fit_costs(m, candidate).cost for candidate in poses])
    single = min(
        fit_costs(m, resect_rows(m, every, poses[int(costs.sum(axis=1).argmin())]).pose).cost.sum(), costs.sum(axis=1).min()
    )
    main, other, stretch = best_stretch(costs)
    return refined_change((m, m), (poses[main], poses[other]), stretch, float(single), per_second)


def refined_change(
    views: tuple[Correspondences, Correspondences], pair: tuple[Pose, Pose], stretch: NDArray[np.bool_], single: float,
    per_second: float, *, zoom: float = 1.0,
) -> PoseChange | None:  # fmt: skip
    """The change of pose whose stretch and whose poses are found by turns; None where all of the time falls to one pose.

    Args:
        views: the sightings as the lens of the rest of the time sees them, and as that of the stretch does.
        pair: first poses, of the rest and of the stretch.
        stretch: (M,) first stretch.
        single: robust cost of the best single pose.
        per_second: instants a second.
        zoom: of the stretch, against the rest.
    """
    for _ in range(ROUNDS):
        if min(np.count_nonzero(stretch), np.count_nonzero(~stretch)) < WINDOW_ROWS:
            return None
        fits = resect_rows(views[0], ~stretch, pair[0]), resect_rows(views[1], stretch, pair[1])
        pair = fits[0].pose, fits[1].pose
        costs = np.array([fit_costs(view, one).cost for view, one in zip(views, pair, strict=True)])
        before = stretch
        *_, stretch = best_stretch(costs, swap=False)
        if (before == stretch).all():
            break
    if not stretch.any() or stretch.all():
        return None
    two = float(np.where(stretch, costs[1], costs[0]).sum())
    at_start, at_end = bool(stretch[0]), bool(stretch[-1])
    if (at_start or at_end) and np.count_nonzero(stretch) > np.count_nonzero(~stretch):
        stretch, pair, fits, costs, views, zoom = ~stretch, pair[::-1], fits[::-1], costs[::-1], views[::-1], 1 / zoom
        at_start, at_end = bool(stretch[0]), bool(stretch[-1])
    inside = views[0].own.instant[stretch]
    agreeing = costs < MOST_COST - 1e-9
    return PoseChange(
        int(inside.min()), int(inside.max()), at_start, at_end, pair[0], pair[1], 0.5 * (single - two),
        _sigmas(views, fits, per_second), _shift(views, pair),
        (int(np.count_nonzero(agreeing[0] & ~stretch)), int(np.count_nonzero(agreeing[1] & stretch))),
        _borne_out(views, pair, costs, stretch), zoom,
    )  # fmt: skip


def _suspicious(m: Correspondences, whole: PoseFit[PoseObservations], window: Ints) -> bool:
    """Whether windows of time would like another pose each, or hold many sightings that no pose explains.

    One Gauss-Newton step before and after each end of a window, from the sums of all that is needed.
    """
    n = int(window.max()) + 1
    astray = fit_costs(m, whole.pose).cost >= MOST_COST - 1e-9
    share = np.bincount(window, astray, n) / np.maximum(np.bincount(window, minlength=n), 1)
    if np.ptp(share) > ASTRAY:
        return True
    H, g = group_sums(window, whole.equations.information, n), group_sums(window, whole.equations.gradient, n)
    prior = weak_prior()
    H, g = H.cumsum(axis=0), g.cumsum(axis=0)
    before = -np.linalg.solve(H[:-1] + prior, g[:-1, :, None])[:, :, 0]
    after = -np.linalg.solve(H[-1] - H[:-1] + prior, (g[-1] - g[:-1])[:, :, None])[:, :, 0]
    moved = np.abs(np.einsum("kij,wj->wki", whole.equations.by_pose, after - before))
    shift = np.median(np.linalg.norm(moved, axis=2) / m.own.extent_px, axis=1)
    return bool(shift.max() > 0.7 * LEAST_SHIFT)


def _window_poses(m: Correspondences, rows: NDArray[np.bool_], poses: list[Pose]) -> list[Pose]:
    """Poses that a window's sightings like."""
    part = m.part(rows)
    every = np.ones(len(part), dtype=bool)
    if len(part) < WINDOW_ROWS // 2:
        return []
    costs = np.array([fit_costs(part, pose).cost.mean() for pose in poses])
    best = poses[int(costs.argmin())]
    found = [resect_rows(part, every, best).pose]
    if part.given:
        found.append(resect_rows(part, every, poses[0], widening=64.0).pose)
    elif costs.min() > POORLY:
        found += _searched(part, poses[0])
    return found


def _searched(part: Correspondences, start: Pose) -> list[Pose]:
    """Poses by trying each of the camera's tracklets as each of the people: a turn that lays his rays on his places."""
    known = part.own.identity[part.row] >= 0
    key = np.column_stack([part.own.identity[part.row], part.people.identity[part.person]])
    pairs, number, count = np.unique(key[known], axis=0, return_inverse=True, return_counts=True)
    del pairs
    number = number.ravel()
    ray = part.own.ray[part.row][known]
    reach = part.people.place[part.person][known] - start.centre
    reach /= np.maximum(np.linalg.norm(reach, axis=1), 1e-9)[:, None]
    every, tried = np.ones(len(part), dtype=bool), []
    for k in np.argsort(-count, kind="stable")[:MOST_TRIED]:
        if count[k] < LEAST_TOGETHER:
            break
        own = number == k
        # The old pose breaks the tie where all rays are alike: as much as a tenth of the sightings would.
        B = ray[own].T @ reach[own] + 0.1 * count[k] * start.R_cw
        u, _, vt = np.linalg.svd(B)
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        pose = Pose.from_centre(turn, start.centre)
        tried.append((float(fit_costs(part, pose).cost.mean()), int(k), pose))
    tried.sort(key=lambda one: one[:2])
    return [resect_rows(part, every, pose, widening=4.0).pose for _, _, pose in tried[:3]]


def best_stretch(costs: Floats, *, swap: bool = True) -> tuple[int, int, NDArray[np.bool_]]:
    """Which pose explains a stretch of the rows and which the rest, and (M,) the stretch; costs are (poses, M) in time's order.

    A stretch in the middle needs one more change of pose, and has to gain `MIDDLE_GAIN` more than one at an end.
    """
    n, count = costs.shape
    best: tuple[float, int, int, int, int] = (np.inf, 0, 0, 0, 0)
    for a in range(n):
        for b in range(n):
            if a == b or (not swap and (a, b) != (0, 1)):
                continue
            total = np.concatenate([[0.0], np.cumsum(costs[a] - costs[b])])
            low = np.minimum.accumulate(total)
            end = int(np.argmax(total - low))
            begin = int(np.argmin(total[: end + 1]))
            suffix, prefix = int(np.argmin(total)), int(np.argmax(total))
            ways = (
                (total[-1] - total[suffix], suffix, count), (total[prefix], 0, prefix),
                (total[end] - total[begin] - 2 * MIDDLE_GAIN, begin, end),
            )  # fmt: skip
            for gain, first, last in ways:
                cost = float(costs[a].sum() - gain)
                if cost < best[0] - 1e-9:
                    best = cost, a, b, first, last
    _, a, b, first, last = best
    stretch = np.zeros(count, dtype=bool)
    stretch[first:last] = True
    return a, b, stretch


def _sigmas(
    views: tuple[Correspondences, Correspondences], fits: tuple[PoseFit[PoseObservations], PoseFit[PoseObservations]],
    per_second: float,
) -> float:  # fmt: skip
    """How far two poses are apart, in sigmas by the scatter of clusters of sightings (sandwich)."""
    length, m = max(1, round(CLUSTER_S * per_second)), views[0]
    total = np.zeros((6, 6))
    for fit in fits:
        person, instant = m.people.identity[m.person[fit.equations.pairs]], m.own.instant[m.row[fit.equations.pairs]]
        _, cluster = np.unique(np.column_stack([person, instant // length]), axis=0, return_inverse=True)
        n = int(cluster.max()) + 1
        summed = group_sums(cluster.ravel(), fit.equations.gradient, n)
        inverse = np.linalg.inv(fit.normal)
        total += inverse @ (summed.T @ summed * n / max(n - 6, 1)) @ inverse
    a, b = fits[0].pose, fits[1].pose
    apart = np.concatenate([log_rotation(b.R_cw @ a.R_cw.T), b.centre - a.centre])
    scale = np.sqrt(np.maximum(np.diag(total), 1e-18))
    inverse = np.linalg.pinv(total / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    square = float((apart / scale) @ inverse @ (apart / scale))
    return float(np.sqrt(max(square, 0.0)))


def _borne_out(
    views: tuple[Correspondences, Correspondences], pair: tuple[Pose, Pose], costs: Floats, stretch: NDArray[np.bool_]
) -> tuple[float, float]:
    """How much worse the other pose is, as a share of what the move would make of it, in the rest and in the stretch."""
    out = []
    for own, other, rows in ((0, 1, ~stretch), (1, 0, stretch)):
        pairs = fit_costs(views[own], pair[own]).pair
        here, information = pose_residuals(views[own], pair[own], pairs)[:2]
        apart = pose_residuals(views[other], pair[other], pairs)[0] - here
        expected = cut_cauchy_cost(np.einsum("ki,kij,kj->k", apart, information, apart), LOSS, BEYOND)
        rows = rows & (costs.min(axis=0) < MOST_COST - 1e-9)
        out.append(float((costs[other] - costs[own])[rows].sum() / max(float(expected[rows].sum()), 1e-9)))
    return out[0], out[1]


def _shift(views: tuple[Correspondences, Correspondences], pair: tuple[Pose, Pose]) -> float:
    """Median distance in the picture between the people seen by two poses, as a share of their extent."""
    first, own = fit_costs(views[0], pair[0]).pair, views[0].own
    a, b = (pose_residuals(view, pose, first)[0] for view, pose in zip(views, pair, strict=True))
    return float(np.median(np.linalg.norm(a - b, axis=1) / own.extent_px[views[0].row[first]]))
