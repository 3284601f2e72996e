"""Alignment of a rig with known places: rays to points with known coordinates, or known positions of cameras.

Both are weighted least squares over the motion `X -> scale R X + t`. By default R turns about the vertical only and t lies in
the ground plane, so that the ground and the vertical stay those of the people. The fit is robust: motions from minimal subsets
are compared by their least trimmed squares (Rousseeuw, "Least median of squares regression", JASA 1984), and a place is left
out where its residual is impossible by the noise of the places that agree (an F test).
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
"""Weight of the stated standard deviations in the estimate of the true noise, in degrees of freedom."""
POOR = 3.0
"""Limit of the noise in units of the stated standard deviations, and of the ratio of the noise of two explanations."""
STEPS, HALVINGS = 50, 12
"""Largest numbers of Gauss-Newton steps and of halvings of a step; from a near start, four or five steps are enough."""
LONGEST = 0.5
"""Largest turn (radians) or change of the logarithm of the scale in one step."""
EXACT = 1e-22
"""Sum of squares below which residuals, a ten-billionth of their standard deviations, are rounding errors."""
STEP = 1e-6
"""Step of the numerical derivatives: radians, metres or logarithm of the scale. Differences are exact to ten digits for places
within a kilometre."""
FALSE_ALARM = 1e-3
"""Probability that a sound set of places, with the stated noise, loses one of them."""
SUBSETS = 500
"""Number of minimal subsets tried; with a third of the places wrong, 200 of them are sound pairs, 150 sound triples."""
MEETS_GROUND = 0.02
"""A ray that falls by less than a fiftieth of its length fixes no place on the ground: a pixel there is metres."""


@dataclass(frozen=True, eq=False)
class WorldFit:
    """A fitted motion of the world, and its uncertainty."""

    motion: Similarity
    used: Bools
    """(M,) whether the row is used in the fit; the other rows are gross errors."""
    noise: float
    """Root of the sum of squares of the used residuals, in stated standard deviations, over the degrees of freedom; 0 without
    any."""
    turn_sigma: float
    """One sigma of the heading, radians; with `tilt`, one sigma of the most uncertain turn."""
    place_sigma: float
    """One sigma of the place of the targets' centre, metres (root of the trace)."""
    scale_sigma: float
    """One sigma of the scale, relative; 0 where the scale was not fitted."""
    covariance: Floats
    """(n, n) covariance of the fitted parameters: turns (about the vertical, with `tilt` about all axes), radians; shifts (on
    the ground, with `tilt` in space), metres; and the logarithm of the scale, where it was fitted."""
    centre: Floats
    """(3,) fixed point of the turns and the scale: the middle of the used targets. Without `tilt`, the scale changes heights
    relative to the ground."""


def fit_world(places: Places, *, with_scale: bool = False, tilt: bool = False) -> WorldFit:
    """Fit the motion that aligns a rig with known places.

    Args:
        places: rays to points, or positions.
        with_scale: whether the scale is fitted too.
        tilt: whether the vertical and the height are fitted too.

    Raises:
        EvidenceError: the places are too few or too close together to determine the motion.
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
    """Return whether the targets' mirror image is explained far better than the targets: their coordinates are left-handed."""
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
    # With a gross error among the places: the mirror image must leave out clearly fewer places.
    return int(mirrored.used.sum()) >= int(fit.used.sum()) + 2 and mirrored.noise < POOR


def _robust_start(places: Places, with_scale: bool, tilt: bool) -> tuple[Similarity, Bools]:
    """Find the motion with the least trimmed squares, and the rows (M,) that these squares are summed over."""
    n, minimal = len(places.group), 3 if tilt else 2
    if len(np.unique(places.group)) < minimal:
        raise EvidenceError(
            f"{len(np.unique(places.group))} known points or positions do not fix the world frame: {minimal} or more are needed"
        )
    # A subset that is always fitted without residuals does not show which place is wrong.
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
    """Return whether each value (M,) is one of the `count` smallest."""
    chosen = np.zeros(len(values), dtype=bool)
    chosen[np.argsort(values, kind="stable")[:count]] = True
    return chosen


def _square_residuals(places: Places, motion: Similarity) -> Floats:
    """Return the squared residuals (M,) over their variances."""
    return np.asarray((places.residuals(motion) ** 2).sum(axis=1) / places.sigma(motion) ** 2)


def _refine_fit(places: Places, start: Similarity, used: Bools, with_scale: bool, tilt: bool) -> WorldFit:
    """Fit the motion by weighted least squares over the used rows, from a start nearby."""
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
    """Return the derivatives (M K, n_free) at a zero step, by central differences."""
    steps = STEP * np.eye(n_free)
    return np.stack([(misses(motion, step) - misses(motion, -step)) / (2 * STEP) for step in steps], axis=1)


def _bound_step(step: NDArray[np.floating], tilt: bool) -> Floats:
    """Shorten a step that turns or scales by more than `LONGEST`: beyond it, the linearised residuals are invalid."""
    turns_and_scale = np.append(step[: 3 if tilt else 1], step[6 if tilt else 3 :])
    return np.asarray(step * min(1.0, LONGEST / max(float(np.abs(turns_and_scale).max()), 1e-12)), dtype=np.float64)


def _inverse(normal: Floats) -> Floats:
    """Invert a normal matrix; directions that it does not determine get a huge variance."""
    values, vectors = np.linalg.eigh(normal)
    return np.asarray((vectors / np.maximum(values, 1e-9)) @ vectors.T)


def _apply_step(start: Similarity, centre: Floats, step: Floats, tilt: bool) -> Similarity:
    """Apply a small step to a motion: turns (about the vertical, or all three), shifts, logarithm of the scale."""
    turn, shift = (step[:3], step[3:6]) if tilt else (np.array([0.0, 0.0, step[0]]), np.array([step[1], step[2], 0.0]))
    growth = float(np.exp(step[6 if tilt else 3])) if len(step) in (4, 7) else 1.0
    rotation = exp_rotation(turn)
    translation = growth * rotation @ (start.translation - centre) + centre + shift
    if not tilt:
        translation[2] = growth * start.translation[2]
    return Similarity(growth * start.scale, rotation @ start.rotation, translation)


def _find_agreeing(places: Places, fit: WorldFit, with_scale: bool, tilt: bool) -> Bools:
    """Return whether each row's residual (M,) is possible by the noise of the used rows (F test)."""
    k, n = places.dimensions, len(places.group)
    squared = _square_residuals(places, fit.motion)
    free = max(k * int(fit.used.sum()) - (6 if tilt else 3) - int(with_scale), 0)
    weight = STATED_WEIGHT + free
    variance = (STATED_WEIGHT + free * fit.noise**2) / weight
    limit = float(fdtri(k, weight, 1 - FALSE_ALARM / n))
    # For rows that were not used, the uncertainty of the fit is added; it grows with their distance.
    reach = np.linalg.norm(places.target - places.target[fit.used].mean(axis=0), axis=1)
    spread = np.where(fit.used, 0.0, np.hypot(fit.place_sigma, reach * np.hypot(fit.turn_sigma, fit.scale_sigma)))
    own = variance + (spread / places.sigma(fit.motion)) ** 2
    return np.asarray(squared / k / own <= limit)


class Places(Protocol):
    """Known places that a rig is aligned with: M rows, each with a residual of `dimensions` independent components."""

    @property
    def target(self) -> Floats:
        """(M, 3) known coordinates in the new world frame, metres."""

    @property
    def group(self) -> Ints:
        """(M,) rows with the same number belong to the same target."""

    @property
    def dimensions(self) -> int:
        """Number of independent components of a row's residual."""

    def sigma(self, motion: Similarity) -> Floats:
        """Return the stated standard deviation (M,) of the rows' residuals under a motion, metres."""

    def residuals(self, motion: Similarity) -> Floats:
        """Return the residuals (M, K) under a motion, metres."""

    def starts(self, *, with_scale: bool, tilt: bool) -> Iterator[Similarity]:
        """Yield the motions that fit minimal subsets of the rows."""

    def mirrored(self) -> Self:
        """Return the same places with the targets' y reversed."""


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points with known coordinates, each seen along one or more rays."""

    centre: Floats
    """(M, 3) camera centres, the rig's world, metres."""
    ray: Floats
    """(M, 3) unit viewing rays, the rig's world."""
    target: Floats
    group: Ints
    sd: Floats
    """(M,) standard deviation of the coordinates and of the camera's position, metres."""
    angle_sd: Floats
    """(M,) standard deviation of the ray, radians."""

    @property
    def dimensions(self) -> int:
        """Number of independent components: the two directions across the ray."""
        return 2

    def sigma(self, motion: Similarity) -> Floats:
        """Return the standard deviation (M,) at the point, across the ray, metres."""
        distance = np.linalg.norm(self.target - motion.apply(self.centre), axis=1)
        return np.asarray(np.hypot(self.sd, self.angle_sd * distance))

    def residuals(self, motion: Similarity) -> Floats:
        """Return the vector (M, 3) from the ray to the point, across the ray; from the camera to a point behind it."""
        ray = self.ray @ motion.rotation.T
        away = self.target - motion.apply(self.centre)
        along = np.maximum((away * ray).sum(axis=1), 0.0)
        return np.asarray(away - along[:, None] * ray)

    def on_plane(self, motion: Similarity) -> Floats:
        """Return where the moved rays meet the horizontal plane of their points (M, 2); NaN for rays nearly parallel to it."""
        ray, centre = self.ray @ motion.rotation.T, motion.apply(self.centre)
        with np.errstate(divide="ignore", invalid="ignore"):
            length = (self.target[:, 2] - centre[:, 2]) / ray[:, 2]
            met = centre[:, :2] + length[:, None] * ray[:, :2]
        return np.where(((length > 0) & (np.abs(ray[:, 2]) > MEETS_GROUND))[:, None], met, np.nan)

    def points(self) -> tuple[Ints, Floats]:
        """Return the groups (P,) whose rays can be triangulated, and the points (P, 3) in the rig's world."""
        n = int(self.group.max()) + 1
        rows = np.arange(len(self.group))
        met = triangulate(rows, self.group, self.ray, np.tile(np.eye(3), (len(rows), 1, 1)), -self.centre, n)
        sound = np.flatnonzero(np.isfinite(met).all(axis=1))
        return sound, met[sound]

    def starts(self, *, with_scale: bool, tilt: bool) -> Iterator[Similarity]:
        """Yield motions from pairs of rays that meet the plane of their points; with `tilt` also from triples of points."""
        if tilt:
            which, points = self.points()
            first = np.array([int(np.flatnonzero(self.group == index)[0]) for index in which], dtype=np.int64)
            yield from _space_motions(points, self.target[first], np.asarray(which), with_scale)
        met = self.on_plane(Similarity(1.0, np.eye(3), np.zeros(3)))
        sound = np.flatnonzero(np.isfinite(met).all(axis=1))
        yield from _plane_motions(met[sound], self.target[sound, :2], self.group[sound], with_scale)

    def mirrored(self) -> Self:
        """Return the same places with the targets' y reversed."""
        return replace(self, target=self.target * (1.0, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class KnownPositions:
    """Camera centres with known coordinates."""

    centre: Floats
    """(M, 3) camera centres in the rig's world, metres."""
    target: Floats
    sd: Floats
    """(M,) standard deviation of each coordinate, metres."""
    heights: bool
    """Whether the third coordinate is used."""

    @property
    def group(self) -> Ints:
        """(M,) a different number for each position."""
        return np.arange(len(self.centre))

    @property
    def dimensions(self) -> int:
        """Number of independent components: two on the ground, or three in space."""
        return 3 if self.heights else 2

    def sigma(self, motion: Similarity) -> Floats:
        """Return the stated standard deviations (M,), metres."""
        del motion
        return self.sd

    def residuals(self, motion: Similarity) -> Floats:
        """Return the vectors (M, 2 or 3) from the moved cameras to their known positions, metres."""
        return np.asarray((self.target - motion.apply(self.centre))[:, : self.dimensions])

    def starts(self, *, with_scale: bool, tilt: bool) -> Iterator[Similarity]:
        """Yield motions from pairs of positions, or with `tilt` from triples."""
        if tilt:
            yield from _space_motions(self.centre, self.target, self.group, with_scale)
        else:
            yield from _plane_motions(self.centre[:, :2], self.target[:, :2], self.group, with_scale)

    def mirrored(self) -> Self:
        """Return the same places with the targets' y reversed."""
        return replace(self, target=self.target * (1.0, -1.0, 1.0))


def _plane_motions(source: Floats, target: Floats, group: Ints, with_scale: bool) -> Iterator[Similarity]:
    """Yield motions along the ground from pairs of places (M, 2)."""
    for rows in _subsets(group, 2):
        ends = source[rows], target[rows]
        if min(np.ptp(end, axis=0).max() for end in ends) < 1e-6:
            continue
        flat = fit_plane_similarity(*ends, with_scale=with_scale)
        yield Similarity(flat.scale, exp_rotation(np.array([0.0, 0.0, flat.yaw])), np.append(flat.translation, 0.0))


def _space_motions(source: Floats, target: Floats, group: Ints, with_scale: bool) -> Iterator[Similarity]:
    """Yield motions in space from triples of places (M, 3) that are not on one line."""
    for rows in _subsets(group, 3):
        if min(_breadth(source[rows]), _breadth(target[rows])) < 1e-4:
            continue
        yield fit_similarity(source[rows], target[rows], with_scale=with_scale)


def _breadth(points: Floats) -> float:
    """Return the ratio of the second to the first singular value of centred points: 0 for points on a line."""
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(singular[1] / singular[0]) if singular[0] > 1e-6 else 0.0


def _subsets(group: Ints, size: int) -> Iterator[list[int]]:
    """Yield subsets of `size` rows of different groups: all of them, or about `SUBSETS` at even steps."""
    everyone = (list(rows) for rows in combinations(range(len(group)), size) if len({int(group[row]) for row in rows}) == size)
    yield from islice(everyone, 0, None, max(1, comb(len(group), size) // SUBSETS))
