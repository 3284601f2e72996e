"""Points and camera positions that a survey, a plan or a receiver knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from passerby.common.arrays import Floats

POINT_SD_M, POSITION_SD_M, GPS_SD_M = 0.05, 0.1, 3.0
"""Where a file tells no sd_m: a marked point on a plan, a camera by tape or total station, a camera by a phone's receiver."""


@dataclass(frozen=True, eq=False)
class KnownPoint:
    """A point with known coordinates, marked in one camera or more."""

    name: str
    xyz: Floats
    """(3,) metres, the wanted world."""
    pixels: Mapping[str, tuple[float, float]]
    """camera -> (u, v)."""
    sd_m: float = POINT_SD_M


@dataclass(frozen=True, eq=False)
class KnownPosition:
    """A camera with a known position."""

    camera: str
    place: Floats
    """(3,) x, y, z in metres; or latitude, longitude (degrees) and altitude (metres). z or altitude NaN where unknown."""
    sd_m: float = POSITION_SD_M
