"""Figures of how well a rig measures: what `calibration.json` has as `figures.measuring`, under the same names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Rig


@dataclass(frozen=True, kw_only=True)
class MeasuringSigma:
    """One sigma of measurements at the places where people walked, millimetres: root mean square distances."""

    median_mm: float
    p90_mm: float
    """At nine of ten places it is no larger."""

    @classmethod
    def of(cls, metres: Floats) -> MeasuringSigma:
        """Of (N,) sigmas, metres; N >= 1."""
        return cls(median_mm=float(1000 * np.median(metres)), p90_mm=float(1000 * np.quantile(metres, 0.9)))

    def with_error(self, sigma_mm: float) -> MeasuringSigma:
        """The same with an error of its own, one sigma, that is independent of it."""
        return MeasuringSigma(
            median_mm=float(np.hypot(self.median_mm, sigma_mm)), p90_mm=float(np.hypot(self.p90_mm, sigma_mm))
        )

    def scaled(self, scale: float) -> MeasuringSigma:
        """The same in a world whose lengths are multiplied."""
        return MeasuringSigma(median_mm=scale * self.median_mm, p90_mm=scale * self.p90_mm)


@dataclass(frozen=True, kw_only=True)
class CameraMeasuring:
    """What one camera measures, after one similarity of the whole rig."""

    points: MeasuringSigma
    """Of the points that it and other cameras see, triangulated by all of them;"""
    across: MeasuringSigma
    """how far its rays to them pass beside them;"""
    ground: MeasuringSigma | None
    """positions on the ground by it alone. None where it sees none, or where the ground is unknown."""
    reach: float | None = None
    """How far its rays to these positions go along the ground for each metre that they fall, median."""

    @property
    def height_mm(self) -> float | None:
        """How far above or below the ground its rays pass these positions, median: however flat they are."""
        return None if self.ground is None else self.ground.median_mm / max(self.reach or 1.0, 1.0)

    def scaled(self, scale: float) -> CameraMeasuring:
        """The same in a world whose lengths are multiplied."""
        ground = None if self.ground is None else self.ground.scaled(scale)
        return replace(self, points=self.points.scaled(scale), across=self.across.scaled(scale), ground=ground)


@dataclass(frozen=True, kw_only=True)
class MeasuringFigures:
    """What the rig measures where people walked, with intrinsics and poses together, after one similarity of the whole rig."""

    places: int
    """Positions on the ground at which it is computed."""
    points: MeasuringSigma
    """Of points up to 1.8 m above them, triangulated by all cameras that see them;"""
    ground: MeasuringSigma | None
    """positions on the ground by single cameras. It includes that of the height of z = 0."""
    ground_height_mm: float | None
    """One sigma of the height of z = 0 by what the lower edge of a box is."""
    cameras: Mapping[str, CameraMeasuring]
    """By camera."""

    def with_errors(self, points_mm: float, ground_mm: Mapping[str, float]) -> MeasuringFigures:
        """The same with independent errors, one sigma: of points, and of positions on the ground by camera."""
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
        """The same where the ground is `height_m`, one sigma, above or below z = 0."""
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
        """The same in a world whose lengths are multiplied."""
        height = self.ground_height_mm
        return MeasuringFigures(
            places=self.places, points=self.points.scaled(scale),
            ground=None if self.ground is None else self.ground.scaled(scale),
            ground_height_mm=None if height is None else scale * height,
            cameras={name: one.scaled(scale) for name, one in self.cameras.items()},
        )  # fmt: skip


def with_measuring_sigmas(rig: Rig, measuring: MeasuringFigures | None) -> Rig:
    """The rig with these sigmas of points and of positions on the ground in its cameras."""

    def known(camera: Camera) -> Camera:
        own = None if measuring is None else measuring.cameras.get(camera.name)
        if own is None or camera.sigma is None:
            return camera
        ground_m = None if own.ground is None else own.ground.median_mm / 1000
        return replace(camera, sigma=replace(camera.sigma, points_m=own.points.median_mm / 1000, ground_m=ground_m))

    return replace(rig, cameras=tuple(map(known, rig)))
