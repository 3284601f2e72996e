"""Figures of how surely a rig measures: what `calibration.json` has as `figures.measuring`, under the same names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats


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

    def scaled(self, scale: float) -> CameraMeasuring:
        """The same in a world whose lengths are multiplied."""
        ground = None if self.ground is None else self.ground.scaled(scale)
        return CameraMeasuring(points=self.points.scaled(scale), across=self.across.scaled(scale), ground=ground)


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

    def scaled(self, scale: float) -> MeasuringFigures:
        """The same in a world whose lengths are multiplied."""
        height = self.ground_height_mm
        return MeasuringFigures(
            places=self.places, points=self.points.scaled(scale),
            ground=None if self.ground is None else self.ground.scaled(scale),
            ground_height_mm=None if height is None else scale * height,
            cameras={name: one.scaled(scale) for name, one in self.cameras.items()},
        )  # fmt: skip
