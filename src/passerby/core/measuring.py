"""Measuring errors of a rig: of points that several cameras see, and of places on the ground that one camera sees.

A principal point that is off by a few degrees and a camera that is turned in the opposite direction give nearly the same camera
for every point that it will measure. So errors of pose and of intrinsics alone do not show how well a rig can be used. Here
known points are projected by the true cameras, and measured from these pixels by the estimated ones:

- *points*: up to 1.8 m above places on the ground, triangulated by all cameras that see them;
- *ground*: the places themselves, where one camera's ray meets z = 0.

Both are compared with the truth after one similarity of the whole rig, the least-squares one of the points.

Also has figures of how well a rig measures: `figures.measuring` in `calibration.json`, under the same names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from passerby.common.arrays import Bools, Floats
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Boxes
from passerby.geometry.rotations import Similarity, fit_similarity
from passerby.geometry.triangulation import triangulate_views

HEIGHTS_M = (0.0, 0.6, 1.2, 1.8)
"""Heights of the points above each place, those of a person, metres."""
MOST_PLACES = 400
GRID = 64
"""Number of places along each side of the grid that is laid over the area where no people are given."""
FARTHEST = 10.0
"""Largest distance of a place from a camera, as a multiple of the camera's height: a person there appears a tenth as tall as
right below the camera."""
LEAST_POINTS = 8


@dataclass(frozen=True)
class Distances:
    """Errors of a number of measurements, millimetres."""

    median_mm: float
    p90_mm: float
    """90th percentile: nine of ten errors are no larger."""
    count: int
    each_mm: Floats | None = field(default=None, repr=False, compare=False)
    """(count,) each single error, millimetres."""

    @classmethod
    def of(cls, metres: Floats) -> Distances | None:
        """Summarise distances (N,), metres; None where there are none."""
        if not len(metres):
            return None
        each = 1000 * metres
        return cls(float(np.median(each)), float(np.quantile(each, 0.9)), len(metres), each)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"median_mm": self.median_mm, "p90_mm": self.p90_mm, "count": self.count}


@dataclass(frozen=True)
class MeasuringErrors:
    """Errors of what a rig measures."""

    places: int
    """Number of places on the ground at which it is tested."""
    of_people: bool
    """Whether people walked there; otherwise the places are a grid over the ground that two cameras or more see."""
    points: Distances
    ground: Distances | None
    """None where no camera sees the ground."""
    cameras: Mapping[str, Distances]
    """Errors on the ground, by camera."""
    scale: float
    """Scale of the similarity: true lengths over measured ones."""


def measuring_errors(estimate: Rig, truth: Rig, people: Mapping[str, Boxes] | None = None) -> MeasuringErrors | None:
    """Compute the measuring errors of an estimated rig.

    Args:
        estimate: cameras without a pose are left out.
        truth: the true rig, with the ground at z = 0.
        people: boxes by camera, pixels; places are where the true cameras see their lower edges on the ground. None: a grid.

    Returns:
        The errors; None where two cameras see fewer than `LEAST_POINTS` points, or the points fix no similarity.
    """
    posed = Rig(tuple(camera for camera in truth.posed() if camera.name in estimate.posed().names))
    places = find_common_ground(posed) if people is None else places_of_people(posed, people)
    return measure_change(truth, estimate, places, of_people=people is not None)


def measure_change(before: Rig, after: Rig, places: Floats, *, of_people: bool = True) -> MeasuringErrors | None:
    """Compute the differences of what two rigs measure from the same pixels, after one similarity of the whole rig.

    Args:
        before: its ground is z = 0.
        after: the same cameras by name; cameras without a pose in one of the rigs are left out.
        places: (N, 2) on the ground, metres, in the world of `before`.
        of_people: whether people walked there.

    Returns:
        The differences; None where two cameras see fewer than `LEAST_POINTS` points, or the points fix no similarity.
    """
    names = [camera.name for camera in before.posed() if camera.name in after.posed().names]
    true, found = (Rig(tuple(rig[name] for name in names)) for rig in (before, after))
    if len(names) < 2 or not len(places):
        return None
    points = points_above(places)
    pixels = true.project(points)
    measured = _triangulate_seen(found, pixels)
    known = np.isfinite(measured).all(axis=1)
    if known.sum() < LEAST_POINTS:
        return None
    try:
        placement = fit_similarity(measured[known], points[known])
    except EvidenceError:
        return None
    of_points = Distances.of(np.linalg.norm(placement.apply(measured[known]) - points[known], axis=1))
    assert of_points is not None
    by_camera = {name: _measure_on_ground(found, name, pixels[name][: len(places)], places, placement) for name in names}
    cameras = {name: one for name, metres in by_camera.items() if (one := Distances.of(metres)) is not None}
    ground = Distances.of(np.concatenate(list(by_camera.values())))
    return MeasuringErrors(len(places), of_people, of_points, ground, cameras, placement.scale)


def points_above(places: Floats) -> Floats:
    """Return points (4 N, 3) at `HEIGHTS_M` above places (N, 2) on the ground z = 0; the places themselves come first."""
    return np.concatenate([np.column_stack([places, np.full(len(places), height)]) for height in HEIGHTS_M])


def find_common_ground(rig: Rig) -> Floats:
    """Return places (N, 2) on the ground z = 0, metres, evenly spread over the nearby ground that two cameras or more see."""
    seen = []
    for camera in rig:
        u, v = (np.linspace(0, size - 1, 24) for size in camera.lens.size)
        grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        on_ground = camera.ground(grid[camera.sees_ground(grid)]).xy
        seen.append(on_ground[_find_nearby(on_ground, camera.centre)])
    every = np.concatenate(seen) if seen else np.zeros((0, 2))
    if not len(every):
        return np.zeros((0, 2))
    axes = (np.linspace(low, high, GRID) for low, high in zip(every.min(axis=0), every.max(axis=0), strict=True))
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    shown = rig.project(np.column_stack([places, np.zeros(len(places))]))
    near = [np.isfinite(shown[camera.name]).all(axis=1) & _find_nearby(places, camera.centre) for camera in rig]
    return _thin_places(places[np.sum(near, axis=0) > 1])


def places_of_people(rig: Rig, people: Mapping[str, Boxes]) -> Floats:
    """Return the places (N, 2) on the ground z = 0, metres, that cameras see at the lower edges of whole boxes.

    Places farther than `FARTHEST` are left out. A box that ends near the horizon, often not a person's, would be at a place
    that no rig measures, and the similarity would be fitted to it.

    Args:
        rig: the cameras.
        people: boxes by camera, pixels; those of other cameras are left out.
    """
    found = []
    for camera in rig:
        boxes = people.get(camera.name, Boxes.empty())
        ltwh = boxes.ltwh[boxes.inside(camera.lens.size)]
        feet = ltwh[:, :2] + ltwh[:, 2:] * (0.5, 1.0)
        on_ground = camera.ground(feet[camera.sees_ground(feet)]).xy
        found.append(_thin_places(on_ground[_find_nearby(on_ground, camera.centre)], MOST_PLACES // max(len(rig), 1) + 1))
    return np.concatenate(found) if found else np.zeros((0, 2))


def _find_nearby(places: Floats, centre: Floats) -> Bools:
    return np.asarray(np.linalg.norm(places - centre[:2], axis=1) <= FARTHEST * max(centre[2], 0.0))


def _thin_places(places: Floats, most: int = MOST_PLACES) -> Floats:
    """Return at most this many of the places, evenly spread over their order."""
    rows = np.linspace(0, len(places) - 1, min(len(places), most)).round().astype(np.int64)
    return np.asarray(places[rows])


def _triangulate_seen(rig: Rig, pixels: Mapping[str, Floats]) -> Floats:
    """Triangulate points (N, 3) that two cameras or more see at pixels (N, 2); NaN elsewhere."""
    rays = np.full((len(rig), len(next(iter(pixels.values()))), 3), np.nan)
    for c, camera in enumerate(rig):
        seen = np.isfinite(pixels[camera.name]).all(axis=1)
        rays[c, seen] = camera.lens.bearings(pixels[camera.name][seen])
    poses = [camera.pose for camera in rig if camera.pose is not None]
    rotations, translations = np.stack([pose.R_cw for pose in poses]), np.stack([pose.t_cw for pose in poses])
    return triangulate_views(rays, rotations, translations, np.array([camera.lens.focal**2 for camera in rig]))[0]


def _measure_on_ground(rig: Rig, name: str, pixels: Floats, places: Floats, placement: Similarity) -> Floats:
    """Return the errors (N,), metres, of those places (P, 2) that a camera shows at pixels (P, 2) on its ground."""
    camera = rig[name]
    shown = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    shown = shown[camera.sees_ground(pixels[shown])]
    found = placement.apply(camera.ground(pixels[shown]).xyz)
    return np.asarray(np.linalg.norm(found[:, :2] - places[shown], axis=1))


@dataclass(frozen=True, kw_only=True)
class MeasuringSigma:
    """One sigma of measurements at the places where people walked, millimetres: root mean square distances."""

    median_mm: float
    p90_mm: float
    """At nine of ten places it is no larger."""

    @classmethod
    def of(cls, metres: Floats) -> MeasuringSigma:
        """Summarise sigmas (N,), metres; N >= 1."""
        return cls(median_mm=float(1000 * np.median(metres)), p90_mm=float(1000 * np.quantile(metres, 0.9)))

    def with_error(self, sigma_mm: float) -> MeasuringSigma:
        """Return the sigmas with an additional independent error, one sigma."""
        return MeasuringSigma(
            median_mm=float(np.hypot(self.median_mm, sigma_mm)), p90_mm=float(np.hypot(self.p90_mm, sigma_mm))
        )

    def scaled(self, scale: float) -> MeasuringSigma:
        """Return the sigmas in a world whose lengths are multiplied by `scale`."""
        return MeasuringSigma(median_mm=scale * self.median_mm, p90_mm=scale * self.p90_mm)


@dataclass(frozen=True, kw_only=True)
class CameraMeasuring:
    """Sigmas of what one camera measures, after one similarity of the whole rig."""

    points: MeasuringSigma
    """Sigma of the points that it and other cameras see, triangulated by all of them."""
    across: MeasuringSigma
    """Sigma of the distances by which its rays pass these points."""
    ground: MeasuringSigma | None
    """Sigma of positions on the ground from it alone. None where it sees none, or where the ground is unknown."""
    reach: float | None = None
    """Length along the ground for each metre that its rays to these positions descend, median."""

    @property
    def height_mm(self) -> float | None:
        """Height above or below the ground at which its rays pass these positions, median; for flat and steep rays alike."""
        return None if self.ground is None else self.ground.median_mm / max(self.reach or 1.0, 1.0)

    def scaled(self, scale: float) -> CameraMeasuring:
        """Return the same in a world whose lengths are multiplied by `scale`."""
        ground = None if self.ground is None else self.ground.scaled(scale)
        return replace(self, points=self.points.scaled(scale), across=self.across.scaled(scale), ground=ground)


@dataclass(frozen=True, kw_only=True)
class MeasuringFigures:
    """Sigmas of what the rig measures where people walked, from intrinsics and poses, after one similarity of the rig."""

    places: int
    """Number of positions on the ground at which they are computed."""
    points: MeasuringSigma
    """Sigma of points up to 1.8 m above them, triangulated by all cameras that see them."""
    ground: MeasuringSigma | None
    """Sigma of positions on the ground from single cameras. It includes the sigma of the height of z = 0."""
    ground_height_mm: float | None
    """One sigma of the height of z = 0, from the uncertainty of where the lower edge of a box lies on a person."""
    cameras: Mapping[str, CameraMeasuring]
    """Sigmas by camera."""

    def with_errors(self, points_mm: float, ground_mm: Mapping[str, float]) -> MeasuringFigures:
        """Return the same with independent errors added, one sigma: of points, and of positions on the ground by camera."""
        cameras = {
            name: replace(
                one, points=one.points.with_error(points_mm), across=one.across.with_error(points_mm),
                ground=None if one.ground is None else one.ground.with_error(ground_mm.get(name, 0.0)),
            )
            for name, one in self.cameras.items()
        }  # fmt: skip
        ground = self.ground
        if ground is not None and ground_mm:
            ground = ground.with_error(float(np.sqrt(np.mean(np.square(list(ground_mm.values()))))))
        return replace(self, points=self.points.with_error(points_mm), ground=ground, cameras=cameras)

    def on_uneven_ground(self, height_m: float) -> MeasuringFigures:
        """Return the same for ground that is `height_m`, one sigma, above or below z = 0."""
        cameras = {
            name: one if one.ground is None or one.reach is None
            else replace(one, ground=one.ground.with_error(1000 * height_m * one.reach))
            for name, one in self.cameras.items()
        }  # fmt: skip
        reach = [one.reach for one in cameras.values() if one.ground is not None and one.reach is not None]
        if self.ground is None or not reach:
            return self
        mean = float(np.sqrt(np.mean(np.square(reach))))
        return replace(self, cameras=cameras, ground=self.ground.with_error(1000 * height_m * mean))

    def scaled(self, scale: float) -> MeasuringFigures:
        """Return the same in a world whose lengths are multiplied by `scale`."""
        height = self.ground_height_mm
        return MeasuringFigures(
            places=self.places, points=self.points.scaled(scale),
            ground=None if self.ground is None else self.ground.scaled(scale),
            ground_height_mm=None if height is None else scale * height,
            cameras={name: one.scaled(scale) for name, one in self.cameras.items()},
        )  # fmt: skip


def add_measuring_sigmas(rig: Rig, measuring: MeasuringFigures | None) -> Rig:
    """Return the rig with these sigmas of points and of positions on the ground in its cameras."""

    def known(camera: Camera) -> Camera:
        own = None if measuring is None else measuring.cameras.get(camera.name)
        if own is None or camera.sigma is None:
            return camera
        ground_m = None if own.ground is None else own.ground.median_mm / 1000
        return replace(camera, sigma=replace(camera.sigma, points_m=own.points.median_mm / 1000, ground_m=ground_m))

    return replace(rig, cameras=tuple(map(known, rig)))
