"""Did a camera move while it filmed? Its own sightings against where the other cameras see the people.

A camera that is moved explains what it sees by one pose before and by another after. Poses are fitted to windows of time; of
all pairs of them, and of all stretches of time, that is kept which lowers the robust cost the most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose
from passerby.geometry.groups import group_sums, least_of_groups, rows_of_equal
from passerby.geometry.reprojection import pose_jacobian, project_near
from passerby.geometry.robust import cut_cauchy_cost, cut_cauchy_weights
from passerby.geometry.rotations import angle_between, log_rotation
from passerby.people.body_centres import BodyCentres, TriangulatedPeople
from passerby.people.resection import BEYOND, LOSS, STEPS, PoseEquations, PoseFit, fit_pose, weak_prior

MOST_COST = float(cut_cauchy_cost(np.array(BEYOND), LOSS, BEYOND))
"""Of a sighting that shows somebody else."""
WINDOWS, WINDOW_ROWS, MOST_ROWS = 10, 24, 4000
"""Windows of time at most, sightings in each at least, and sightings of a camera at most: of more, even steps are taken."""
ROUNDS = 4
SIZE_SD = 0.25
"""By how much (as a logarithm) the size of a box may differ from that of a person of middling height where it is."""
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
make of it: 0.8 to 0.95 for moves of 0.1 to 0.5 m or 1 to 10 degrees; people on a stretch of time who are taken for others, or
work near the ground, stay below 0.3 on one side, or come to 1.9 and 3.6, as what is worse than any move makes it. On PETS2009,
whose cameras stand still and see people up to 94 m away, it comes to 0.68 at most."""
LEAST_GAIN, LEAST_SIGMAS, LEAST_SHIFT = 40.0, 10.0, 0.03


@dataclass(frozen=True, eq=False)
class Correspondences:
    """One camera's sightings, and to each all the people that it may show: K pairs."""

    own: BodyCentres
    people: TriangulatedPeople
    row: Ints
    """(K,) row of `own`, ascending."""
    person: Ints
    """(K,) row of `people`."""
    person_height_m: float
    given: bool
    """Whether the sightings' identities are the people's."""

    def __len__(self) -> int:
        return len(self.own)

    def part(self, rows: NDArray[np.bool_]) -> Correspondences:
        """The sightings (M,) that are marked."""
        number = np.cumsum(rows) - 1
        kept = rows[self.row]
        return Correspondences(
            self.own.take(rows), self.people, number[self.row[kept]], self.person[kept], self.person_height_m, self.given
        )


def match_people(own: BodyCentres, people: TriangulatedPeople, person_height_m: float, *, given: bool) -> Correspondences:
    """A camera's sightings with the people of their instants.

    Args:
        own: sightings, in the order of their instants.
        people: by the other cameras.
        person_height_m: typical standing height, metres.
        given: whether the sightings' identities are the people's.
    """
    instants = np.unique(own.instant[np.isin(own.instant, people.instant)])
    count = np.searchsorted(own.instant, instants, side="right") - np.searchsorted(own.instant, instants)
    if count.sum() > MOST_ROWS:
        instants = instants[:: int(np.ceil(count.sum() / MOST_ROWS))]
    own = own.take(np.isin(own.instant, instants))
    row, person = rows_of_equal(own.instant, people.instant)
    if given:
        same = own.identity[row] == people.identity[person]
        row, person = row[same], person[same]
    used = np.unique(row)
    return Correspondences(own.take(used), people, np.searchsorted(used, row), person, person_height_m, given)


@dataclass(frozen=True, eq=False)
class _Fit:
    """What a pose makes of the sightings M."""

    cost: Floats
    """(M,) robust square in sigmas, at most `BEYOND`'s."""
    pair: Ints
    """(M,) the pair of the person that fits best."""


def _residuals(m: Correspondences, pose: Pose, pairs: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """Residuals (K, 2), their information (K, 2, 2), derivatives by the pose (K, 2, 6), squares (K,)."""
    row, person = m.row[pairs], m.person[pairs]
    d = (m.people.place[person] - pose.centre) @ pose.R_cw.T
    ray, tangent = m.own.ray[row], m.own.tangent[row]
    residual, by_d = project_near(ray, tangent, d)
    by_pose, by_point = pose_jacobian(by_d, d, np.broadcast_to(pose.R_cw, (len(d), 3, 3)))
    S = by_point @ m.people.covariance[person] @ by_point.transpose(0, 2, 1)
    S[:, 0, 0] += m.own.sigma_px[row] ** 2
    S[:, 1, 1] += m.own.sigma_px[row] ** 2
    information = np.asarray(np.linalg.inv(S), dtype=np.float64)
    square = np.einsum("ki,kij,kj->k", residual, information, residual)
    # Whoever is of the wrong size is another person.
    distance = np.maximum(np.linalg.norm(d, axis=1), 0.3)
    pixels = np.linalg.norm(tangent, axis=(1, 2)) / np.sqrt(2.0)
    size = np.log(m.own.extent_px[row] * distance / (pixels * m.person_height_m)) / SIZE_SD
    behind = np.einsum("ki,ki->k", ray, d) < 0.3 * distance
    return residual, information, by_pose, np.where(behind, 1e6, square + np.maximum(size**2 - 4.0, 0.0))


def _fit(m: Correspondences, pose: Pose) -> _Fit:
    """The costs under a pose, each sighting given to the person who fits best."""
    square = _residuals(m, pose, np.arange(len(m.row)))[3]
    first = least_of_groups(m.row, square)
    return _Fit(cut_cauchy_cost(square[first], LOSS, BEYOND), first)


@dataclass(frozen=True, eq=False)
class _Seen(PoseEquations):
    """What R sightings ask of a pose."""

    pairs: Ints
    """(R,)"""
    by_pose: Floats
    """(R, 2, 6) pixels by the unknowns."""


def _resected(
    m: Correspondences, rows: NDArray[np.bool_], start: Pose, *, widening: float = 1.0, steps: int = STEPS
) -> PoseFit[_Seen]:
    """A pose fitted to some of the sightings, each of the person who fits best by then."""

    def equations_at(pose: Pose, wide: float) -> _Seen:
        pairs = _fit(m, pose).pair[rows]
        residual, information, by_pose, square = _residuals(m, pose, pairs)
        weight = cut_cauchy_weights(square, LOSS * wide, BEYOND * wide**2)
        weighed = weight[:, None, None] * (by_pose.transpose(0, 2, 1) @ information)
        return _Seen((weighed @ residual[:, :, None])[:, :, 0], weighed @ by_pose, pairs, by_pose)

    return fit_pose(start, equations_at, widening=widening, steps=steps)


def resect_correspondences(m: Correspondences, start: Pose) -> Pose:
    """The pose that a camera's sightings fit, near `start`."""
    return _resected(m, np.ones(len(m), dtype=bool), start, widening=4.0).pose


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
        return (
            BORNE_OUT[0] < min(self.borne_out) <= max(self.borne_out) < BORNE_OUT[1]
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
    whole = _resected(m, every, pose, steps=3)
    n_windows = min(WINDOWS, len(m) // WINDOW_ROWS)
    window = np.minimum(np.searchsorted(np.quantile(m.own.instant, np.arange(1, n_windows) / n_windows), m.own.instant), 99)
    if screened and not _suspicious(m, whole, window):
        return None
    poses = [whole.pose]
    for w in np.unique(window):
        poses += _window_poses(m, window == w, poses)
    costs = np.array([_fit(m, candidate).cost for candidate in poses])
    single = min(_fit(m, _resected(m, every, poses[int(costs.sum(axis=1).argmin())]).pose).cost.sum(), costs.sum(axis=1).min())
    main, other, stretch = _best_stretch(costs)
    fits = whole, whole
    pair = poses[main], poses[other]
    for _ in range(ROUNDS):
        if min(np.count_nonzero(stretch), np.count_nonzero(~stretch)) < WINDOW_ROWS:
            return None
        fits = _resected(m, ~stretch, pair[0]), _resected(m, stretch, pair[1])
        pair = fits[0].pose, fits[1].pose
        costs = np.array([_fit(m, one).cost for one in pair])
        before = stretch
        *_, stretch = _best_stretch(costs, swap=False)
        if (before == stretch).all():
            break
    if not stretch.any() or stretch.all():
        return None
    two = float(np.where(stretch, costs[1], costs[0]).sum())
    at_start, at_end = bool(stretch[0]), bool(stretch[-1])
    if (at_start or at_end) and np.count_nonzero(stretch) > np.count_nonzero(~stretch):
        stretch, pair, fits, costs = ~stretch, pair[::-1], fits[::-1], costs[::-1]
        at_start, at_end = bool(stretch[0]), bool(stretch[-1])
    inside = m.own.instant[stretch]
    agreeing = costs < MOST_COST - 1e-9
    return PoseChange(
        int(inside.min()), int(inside.max()), at_start, at_end, pair[0], pair[1], 0.5 * (float(single) - two),
        _sigmas(m, fits, per_second), _shift(m, pair),
        (int(np.count_nonzero(agreeing[0] & ~stretch)), int(np.count_nonzero(agreeing[1] & stretch))),
        _borne_out(m, pair, costs, stretch),
    )  # fmt: skip


def _suspicious(m: Correspondences, whole: PoseFit[_Seen], window: Ints) -> bool:
    """Whether windows of time would like another pose each, or hold many sightings that no pose explains.

    One Gauss-Newton step before and after each end of a window, from the sums of all that is needed.
    """
    n = int(window.max()) + 1
    astray = _fit(m, whole.pose).cost >= MOST_COST - 1e-9
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
    costs = np.array([_fit(part, pose).cost.mean() for pose in poses])
    best = poses[int(costs.argmin())]
    found = [_resected(part, every, best).pose]
    if part.given:
        found.append(_resected(part, every, poses[0], widening=64.0).pose)
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
        tried.append((float(_fit(part, pose).cost.mean()), int(k), pose))
    tried.sort(key=lambda one: one[:2])
    return [_resected(part, every, pose, widening=4.0).pose for _, _, pose in tried[:3]]


def _best_stretch(costs: Floats, *, swap: bool = True) -> tuple[int, int, NDArray[np.bool_]]:
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


def _sigmas(m: Correspondences, fits: tuple[PoseFit[_Seen], PoseFit[_Seen]], per_second: float) -> float:
    """How far two poses are apart, in sigmas by the scatter of clusters of sightings (sandwich)."""
    length = max(1, round(CLUSTER_S * per_second))
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


def _borne_out(m: Correspondences, pair: tuple[Pose, Pose], costs: Floats, stretch: NDArray[np.bool_]) -> tuple[float, float]:
    """How much worse the other pose is, as a share of what the move would make of it, in the rest and in the stretch."""
    out = []
    for own, other, rows in ((0, 1, ~stretch), (1, 0, stretch)):
        pairs = _fit(m, pair[own]).pair
        here, information = _residuals(m, pair[own], pairs)[:2]
        apart = _residuals(m, pair[other], pairs)[0] - here
        expected = cut_cauchy_cost(np.einsum("ki,kij,kj->k", apart, information, apart), LOSS, BEYOND)
        rows = rows & (costs.min(axis=0) < MOST_COST - 1e-9)
        out.append(float((costs[other] - costs[own])[rows].sum() / max(float(expected[rows].sum()), 1e-9)))
    return out[0], out[1]


def _shift(m: Correspondences, pair: tuple[Pose, Pose]) -> float:
    """Median distance in the picture between the people seen by two poses, as a share of their extent."""
    first = _fit(m, pair[0]).pair
    a, b = (_residuals(m, pose, first)[0] for pose in pair)
    return float(np.median(np.linalg.norm(a - b, axis=1) / m.own.extent_px[m.row[first]]))
