"""The motion of the world that brings a rig onto known places: rays to points with coordinates, or positions of cameras.

Both are weighted least squares over `X -> scale R X + t`. By default R turns about the vertical alone and t lies in the ground
plane, so that the ground and the vertical stay those of the people. Robust: the motions that minimal subsets ask for are
compared by their least trimmed squares (Rousseeuw, "Least median of squares regression", JASA 1984), and a place is left out
where those that agree make its residual impossible (an F test).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, islice
from math import comb
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.geometry.rotations import Similarity, exp_rotation, fit_plane_similarity, fit_similarity
from passerby.geometry.triangulation import triangulate

STATED_WEIGHT = 4.0
"""The stated standard deviations count as much as so many residuals when the true noise is judged."""
POOR = 3.0
"""Residuals of three times their stated standard deviations, and noise three times that of another explanation."""
STEPS, HALVINGS = 50, 12
"""Gauss-Newton from a start that is near ends after four or five steps."""
LONGEST = 0.5
"""Radians, or logarithm of scale."""
EXACT = 1e-22
"""Residuals of a ten-billionth of their standard deviations are rounding."""
STEP = 1e-6
"""Radians, metres or logarithm of scale: differences are exact to ten digits for places within a kilometre."""
FALSE_ALARM = 1e-3
"""How often a sound set of places, with the noise that is stated, loses one."""
SUBSETS = 500
"""Minimal subsets that are tried; with a third of the places wrong, 200 of them are sound pairs, 150 sound triples."""
MEETS_GROUND = 0.02
"""A ray that falls by less than a fiftieth of its length tells of no place on the ground: a pixel is metres there."""


@dataclass(frozen=True, eq=False)
class WorldFit:
    """A fitted motion of the world, and its uncertainty."""

    motion: Similarity
    used: Bools
    """(M,) the rows that it rests upon; the others are gross errors."""
    noise: float
    """Root mean square of the used residuals over their stated standard deviations, corrected for what was fitted."""
    turn_sigma: float
    """One sigma of the heading, radians; with `tilt` of the most uncertain turn."""
    place_sigma: float
    """One sigma of the place of the targets' centre, metres (root of the trace)."""
    scale_sigma: float
    """Relative one sigma of the scale; 0 where it was kept."""
    covariance: Floats
    """(n, n) of what was fitted: turns (about the vertical, with `tilt` about all axes), radians; shifts (on the ground, with
    `tilt` in space), metres; and the logarithm of the scale, where it was fitted."""
    centre: Floats
    """(3,) about which the turns and the scale are: the middle of the used targets. Without `tilt` heights grow from the
    ground."""


def fit_world(places: Places, *, with_scale: bool = False, tilt: bool = False) -> WorldFit:
    """The motion that lays a rig upon known places.

    Args:
        places: rays to points, or positions.
        with_scale: whether the scale is fitted too.
        tilt: whether the vertical and the height are fitted too.

    Raises:
        EvidenceError: the places are too few or too close together to fix the motion.
    """
    start, rows = _robust_start(places, with_scale, tilt)
    fit = _refine_fit(places, start, rows, with_scale, tilt)
    for _ in range(20):
        sound = _find_agreeing(places, fit, with_scale, tilt)
        if (sound == fit.used).all() or np.count_nonzero(sound) < np.count_nonzero(rows):
            break
        fit = _refine_fit(places, fit.motion, sound, with_scale, tilt)
    return fit


def fits_mirrored(places: Places, fit: WorldFit, *, with_scale: bool, tilt: bool) -> bool:
    """Whether the targets' mirror image is explained far better than the targets: left-handed coordinates."""
    if len(np.unique(places.group)) < 3 or (fit.used.all() and fit.noise <= POOR):
        return False
    image = places.mirrored()
    try:
        mirrored = fit_world(image, with_scale=with_scale, tilt=tilt)
        everything = np.ones(len(places.group), dtype=bool)
        here = _refine_fit(places, fit.motion, everything, with_scale, tilt).noise
        there = _refine_fit(image, mirrored.motion, everything, with_scale, tilt).noise
    except EvidenceError:
        return False
    if here > POOR and there < here / POOR:
        return True
    # With a gross error among them: the image needs to leave out clearly fewer.
    return int(mirrored.used.sum()) >= int(fit.used.sum()) + 2 and mirrored.noise < POOR


def _robust_start(places: Places, with_scale: bool, tilt: bool) -> tuple[Similarity, Bools]:
    """The motion with the least trimmed squares, and the rows that they are taken over."""
    n, minimal = len(places.group), 3 if tilt else 2
    if len(np.unique(places.group)) < minimal:
        raise EvidenceError(
            f"{len(np.unique(places.group))} known points or positions do not fix the world frame: {minimal} or more are needed"
        )
    # A subset that is always fitted without residual cannot tell who is wrong.
    kept = min(n, max(minimal + int(with_scale or tilt), (n + minimal) // 2))
    best, least = None, np.inf
    for motion in places.starts(with_scale=with_scale, tilt=tilt):
        squared = np.sort(_square_residuals(places, motion))
        if squared[:kept].sum() < least:
            best, least = motion, float(squared[:kept].sum())
    if best is None:
        raise EvidenceError("the known points or positions lie in one spot or on one line: they do not fix the world frame")
    rows = _find_smallest(_square_residuals(places, best), kept)
    for _ in range(10):
        best = _refine_fit(places, best, rows, with_scale, tilt).motion
        again = _find_smallest(_square_residuals(places, best), kept)
        if (again == rows).all():
            break
        rows = again
    return best, rows


def _find_smallest(values: Floats, count: int) -> Bools:
    """(M,) whether a value is one of the `count` smallest."""
    chosen = np.zeros(len(values), dtype=bool)
    chosen[np.argsort(values, kind="stable")[:count]] = True
    return chosen


def _square_residuals(places: Places, motion: Similarity) -> Floats:
    """(M,) squared residuals over their variances."""
    return np.asarray((places.residuals(motion) ** 2).sum(axis=1) / places.sigma(motion) ** 2)


def _refine_fit(places: Places, start: Similarity, used: Bools, with_scale: bool, tilt: bool) -> WorldFit:
    """Weighted least squares over the used rows, from a motion nearby."""
    sigma, centre = places.sigma(start)[used, None], places.target[used].mean(axis=0)
    n_free = (6 if tilt else 3) + int(with_scale)

    def misses(motion: Similarity, step: Floats) -> Floats:
        return np.asarray((places.residuals(_apply_step(motion, centre, step, tilt))[used] / sigma).ravel())

    motion, residual = start, misses(start, np.zeros(n_free))
    for _ in range(STEPS):
        if residual @ residual < EXACT:
            break
        step = _bound_step(np.linalg.lstsq(_jacobian(misses, motion, n_free), -residual, rcond=1e-12)[0], tilt)
        for _ in range(HALVINGS):
            there = misses(motion, step)
            if there @ there < residual @ residual:
                break
            step = step / 2
        else:
            break
        gain = 1 - there @ there / (residual @ residual)
        motion, residual = _apply_step(motion, centre, step, tilt), there
        if gain < 1e-12:
            break
    jacobian, squares = _jacobian(misses, motion, n_free), float(residual @ residual)
    free = places.dimensions * int(used.sum()) - n_free
    noise = float(np.sqrt(squares / free)) if free > 0 else 0.0
    variance = (STATED_WEIGHT + squares) / (STATED_WEIGHT + max(free, 0))
    covariance = variance * _inverse(jacobian.T @ jacobian)
    n_turns = 3 if tilt else 1
    turns = np.linalg.eigvalsh(covariance[:n_turns, :n_turns])[-1]
    shifts = slice(3, 6) if tilt else slice(1, 3)
    place = np.trace(covariance[shifts, shifts])
    scale = float(np.sqrt(covariance[-1, -1])) if with_scale else 0.0
    return WorldFit(motion, used.copy(), noise, float(np.sqrt(turns)), float(np.sqrt(place)), scale, covariance, centre)


def _jacobian(misses: Callable[[Similarity, Floats], Floats], motion: Similarity, n_free: int) -> Floats:
    """(M K, n_free) derivatives at a step of nothing, by central differences."""
    steps = STEP * np.eye(n_free)
    return np.stack([(misses(motion, step) - misses(motion, -step)) / (2 * STEP) for step in steps], axis=1)


def _bound_step(step: NDArray[np.floating], tilt: bool) -> Floats:
    """The step, shortened where it turns or stretches by more than `LONGEST`: beyond, its linear residuals mean nothing."""
    turns_and_scale = np.append(step[: 3 if tilt else 1], step[6 if tilt else 3 :])
    return np.asarray(step * min(1.0, LONGEST / max(float(np.abs(turns_and_scale).max()), 1e-12)), dtype=np.float64)


def _inverse(normal: Floats) -> Floats:
    """The inverse of a normal matrix; what it does not fix gets a huge variance."""
    values, vectors = np.linalg.eigh(normal)
    return np.asarray((vectors / np.maximum(values, 1e-9)) @ vectors.T)


def _apply_step(start: Similarity, centre: Floats, step: Floats, tilt: bool) -> Similarity:
    """A motion after a small step: turns (about the vertical, or all three), shifts, logarithm of the scale."""
    turn, shift = (step[:3], step[3:6]) if tilt else (np.array([0.0, 0.0, step[0]]), np.array([step[1], step[2], 0.0]))
    growth = float(np.exp(step[6 if tilt else 3])) if len(step) in (4, 7) else 1.0
    rotation = exp_rotation(turn)
    translation = growth * rotation @ (start.translation - centre) + centre + shift
    if not tilt:
        translation[2] = growth * start.translation[2]
    return Similarity(growth * start.scale, rotation @ start.rotation, translation)


def _find_agreeing(places: Places, fit: WorldFit, with_scale: bool, tilt: bool) -> Bools:
    """(M,) the rows whose residuals are possible by the noise of the used ones."""
    k, n = places.dimensions, len(places.group)
    squared = _square_residuals(places, fit.motion)
    free = max(k * int(fit.used.sum()) - (6 if tilt else 3) - int(with_scale), 0)
    weight = STATED_WEIGHT + free
    variance = (STATED_WEIGHT + free * fit.noise**2) / weight
    limit = float(fdtri(k, weight, 1 - FALSE_ALARM / n))
    # Rows that were not used also carry the uncertainty of the fit, the more the further they are away.
    reach = np.linalg.norm(places.target - places.target[fit.used].mean(axis=0), axis=1)
    spread = np.where(fit.used, 0.0, np.hypot(fit.place_sigma, reach * np.hypot(fit.turn_sigma, fit.scale_sigma)))
    own = variance + (spread / places.sigma(fit.motion)) ** 2
    return np.asarray(squared / k / own <= limit)


class Places(Protocol):
    """What the world is laid upon: M rows, each with a residual of `dimensions` independent components."""

    @property
    def target(self) -> Floats:
        """(M, 3) known coordinates, the new world, metres."""

    @property
    def group(self) -> Ints:
        """(M,) rows with the same number tell of the same target."""

    @property
    def dimensions(self) -> int:
        """Independent components of a row's residual."""

    def sigma(self, motion: Similarity) -> Floats:
        """(M,) stated standard deviation of the rows' residuals under a motion, metres."""

    def residuals(self, motion: Similarity) -> Floats:
        """(M, K) residuals, metres."""

    def starts(self, *, with_scale: bool, tilt: bool) -> Iterator[Similarity]:
        """The motions that minimal subsets of the rows ask for."""

    def mirrored(self) -> Self:
        """The same with the targets' y reversed."""


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points with known coordinates, each seen along one ray or more."""

    centre: Floats
    """(M, 3) camera centres, the rig's world, metres."""
    ray: Floats
    """(M, 3) unit viewing rays, the rig's world."""
    target: Floats
    group: Ints
    sd: Floats
    """(M,) of the coordinates and of the camera's place, metres."""
    angle_sd: Floats
    """(M,) of the ray, radians."""

    @property
    def dimensions(self) -> int:
        """A ray tells what lies across it."""
        return 2

    def sigma(self, motion: Similarity) -> Floats:
        """(M,) metres at the point, across the ray."""
        distance = np.linalg.norm(self.target - motion.apply(self.centre), axis=1)
        return np.asarray(np.hypot(self.sd, self.angle_sd * distance))

    def residuals(self, motion: Similarity) -> Floats:
        """(M, 3) from the ray to the point, across the ray; from the camera where the point lies behind it."""
        ray = self.ray @ motion.rotation.T
        away = self.target - motion.apply(self.centre)
        along = np.maximum((away * ray).sum(axis=1), 0.0)
        return np.asarray(away - along[:, None] * ray)

    def on_plane(self, motion: Similarity) -> Floats:
        """(M, 2) where the moved rays meet the horizontal plane of their points; NaN for those that run nearly along it."""
        ray, centre = self.ray @ motion.rotation.T, motion.apply(self.centre)
        with np.errstate(divide="ignore", invalid="ignore"):
            length = (self.target[:, 2] - centre[:, 2]) / ray[:, 2]
            met = centre[:, :2] + length[:, None] * ray[:, :2]
        return np.where(((length > 0) & (np.abs(ray[:, 2]) > MEETS_GROUND))[:, None], met, np.nan)

    def points(self) -> tuple[Ints, Floats]:
        """Groups (P,) of two rays or more that meet, and where they do: (P, 3), the rig's world."""
        n = int(self.group.max()) + 1
        rows = np.arange(len(self.group))
        met = triangulate(rows, self.group, self.ray, np.tile(np.eye(3), (len(rows), 1, 1)), -self.centre, n)
        sound = np.flatnonzero(np.isfinite(met).all(axis=1))
        return sound, met[sound]

    def starts(self, *, with_scale: bool, tilt: bool) -> Iterator[Similarity]:
        """From pairs of rays that meet the plane of their points; with `tilt` also from triples of points in space."""
        if tilt:
            which, points = self.points()
            first = np.array([int(np.flatnonzero(self.group == index)[0]) for index in which], dtype=np.int64)
            yield from _space_motions(points, self.target[first], np.asarray(which), with_scale)
        met = self.on_plane(Similarity(1.0, np.eye(3), np.zeros(3)))
        sound = np.flatnonzero(np.isfinite(met).all(axis=1))
        yield from _plane_motions(met[sound], self.target[sound, :2], self.group[sound], with_scale)

    def mirrored(self) -> Self:
        """Left-handed targets."""
        return replace(self, target=self.target * (1.0, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class KnownPositions:
    """Camera centres with known coordinates."""

    centre: Floats
    """(M, 3) the rig's world, metres."""
    target: Floats
    sd: Floats
    """(M,) in each coordinate, metres."""
    heights: bool
    """Whether the third coordinate counts."""

    @property
    def group(self) -> Ints:
        """Every position is one of its own."""
        return np.arange(len(self.centre))

    @property
    def dimensions(self) -> int:
        """Two on the ground, or three in space."""
        return 3 if self.heights else 2

    def sigma(self, motion: Similarity) -> Floats:
        """(M,) as stated."""
        del motion
        return self.sd

    def residuals(self, motion: Similarity) -> Floats:
        """(M, 2 or 3) from the moved camera to its known position."""
        return np.asarray((self.target - motion.apply(self.centre))[:, : self.dimensions])

    def starts(self, *, with_scale: bool, tilt: bool) -> Iterator[Similarity]:
        """From pairs, or with `tilt` from triples."""
        if tilt:
            yield from _space_motions(self.centre, self.target, self.group, with_scale)
        else:
            yield from _plane_motions(self.centre[:, :2], self.target[:, :2], self.group, with_scale)

    def mirrored(self) -> Self:
        """Left-handed targets."""
        return replace(self, target=self.target * (1.0, -1.0, 1.0))


def _plane_motions(source: Floats, target: Floats, group: Ints, with_scale: bool) -> Iterator[Similarity]:
    """Motions along the ground from pairs of places (M, 2)."""
    for rows in _subsets(group, 2):
        ends = source[rows], target[rows]
        if min(np.ptp(end, axis=0).max() for end in ends) < 1e-6:
            continue
        flat = fit_plane_similarity(*ends, with_scale=with_scale)
        yield Similarity(flat.scale, exp_rotation(np.array([0.0, 0.0, flat.yaw])), np.append(flat.translation, 0.0))


def _space_motions(source: Floats, target: Floats, group: Ints, with_scale: bool) -> Iterator[Similarity]:
    """Motions in space from triples of places (M, 3) that are not on one line."""
    for rows in _subsets(group, 3):
        if min(_breadth(source[rows]), _breadth(target[rows])) < 1e-4:
            continue
        yield fit_similarity(source[rows], target[rows], with_scale=with_scale)


def _breadth(points: Floats) -> float:
    """Second over first singular value of centred points: 0 on a line."""
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(singular[1] / singular[0]) if singular[0] > 1e-6 else 0.0


def _subsets(group: Ints, size: int) -> Iterator[list[int]]:
    """Rows of different groups, every subset or evenly chosen ones."""
    everyone = (list(rows) for rows in combinations(range(len(group)), size) if len({int(group[row]) for row in rows}) == size)
    yield from islice(everyone, 0, None, max(1, comb(len(group), size) // SUBSETS))
