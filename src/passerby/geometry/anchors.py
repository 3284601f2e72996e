"""What a rig can be laid upon: rays to points with known coordinates, known positions of cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, islice
from math import comb
from typing import Protocol, Self

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.geometry.rotations import exp_rotation
from passerby.geometry.similarity import Similarity, fit_plane_similarity, fit_similarity
from passerby.geometry.triangulation import triangulate

SUBSETS = 500
"""Minimal subsets that are tried; with a third of the places wrong, 200 of them are sound pairs, 150 sound triples."""
MEETS_GROUND = 0.02
"""A ray that falls by less than a fiftieth of its length tells of no place on the ground: a pixel is metres there."""


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
