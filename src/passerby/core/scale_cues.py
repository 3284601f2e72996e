"""Knowledge of a user about lengths and places: scale cues with standard deviations, plans, surveyed points, the unit.

All cues enter one adjustment as priors, so that they combine by their weights and the weight of each can be stated. The module
also has:

- a floor plan or satellite picture with its scale, and the cameras and ground points that a user placed on it;
- points and camera positions known from a survey, a plan or a receiver;
- the unit of stated lengths, where people's heights show that it is not the metre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.observations import Observations
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M

MOST_STEPS = 200
"""Largest number of time steps at which a wand is measured: a spread of 5 % between them gives 0.4 % for their median."""
Pixel = tuple[float, float]
CLICK_SD_PX = 2.0
"""Standard deviation of a person's click on a mark in a plan or in a camera's image, pixels."""
UNIT_SD = 0.002
"""Relative standard deviation of metres per pixel where it is not stated: a drawing's scale bar measured over 500 pixels to one
pixel."""
POINT_SD_M, POSITION_SD_M, GPS_SD_M = 0.05, 0.1, 3.0
"""Defaults without an sd_m in the file: a marked point on a plan, a camera by tape or total station, one by a phone's
receiver."""
METRES = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "feet": 0.3048, "yards": 0.9144, "kilometres": 1e3}
"""Length of each unit, metres."""
GROSS, GROSS_SIGMAS = 2.5, 3.0
"""No people are this many times as tall, or as short, as expected. A factor this many sigmas beyond means a wrong unit, any
unit."""
LEAST_SIGMAS, MATCH_SIGMAS = 6.0, 2.0
"""A smaller factor means a wrong unit where it is more than the first number of sigmas from 1, and less than the second from
the factor of a unit."""
LEAST_MATCH = 0.25
"""A gross factor belongs to a unit if their logarithms differ by less than this, for any sigma. Those of units differ by 0.9 or
more."""


@dataclass(frozen=True)
class PopulationHeight:
    """Standing height of people, shoes on."""

    mean_m: float = PERSON_HEIGHT_M
    sd_m: float = PERSON_HEIGHT_SD_M
    mean_sd_m: float | None = None
    """Standard deviation of the mean for these people and what boxes or joints show of them. None: `POPULATION_BIAS` of it."""


@dataclass(frozen=True)
class PersonHeight:
    """The standing height of one person, by identity."""

    identity: int
    metres: float
    sd_m: float = 0.01
    place: str = ""
    """The table of the scene file that states it, for people named by a pixel: users do not know their identities."""


@dataclass(frozen=True, eq=False)
class KnownLength:
    """A known distance between two marked points, each marked in two or more cameras."""

    metres: float
    sd_m: float
    points: Mapping[str, NDArray[np.float64]]
    """camera name -> (2, 2) pixels of the two ends, the ends in the same order in all cameras."""
    name: str = ""
    """Lengths of one name are one object at several times: the error of the stated length is the same in all of them."""


@dataclass(frozen=True)
class Wand:
    """A stick of known length that is carried through the scene. `CameraObservations.wands` has its two ends."""

    points: tuple[str, str]
    """The names of its two ends in the keypoint files."""
    metres: float
    sd_m: float


@dataclass(frozen=True)
class CameraDistance:
    """A known distance between the centres of two cameras."""

    between: tuple[str, str]
    metres: float
    sd_m: float


@dataclass(frozen=True)
class CameraHeight:
    """A known height of a camera's centre above the ground."""

    camera: str
    metres: float
    sd_m: float


@dataclass(frozen=True, eq=False)
class PlannedCamera:
    """A camera placed on the plan."""

    camera: str
    at: Pixel
    """Pixel of the plan."""
    sd_m: float
    """Standard deviation of each coordinate, metres."""


@dataclass(frozen=True, eq=False)
class PlannedPoint:
    """A point of the ground placed on the plan, and the pixels at which cameras see it."""

    name: str
    at: Pixel
    """Pixel of the plan."""
    pixels: Mapping[str, Pixel]
    """camera -> pixel of its image."""
    sd_m: float
    """Standard deviation of each coordinate on the plan, metres."""


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """A plan seen from above, in pixels: u to the right, v downwards, (0, 0) the centre of the first pixel."""

    name: str
    """Name of the plan in reports."""
    metres_per_pixel: float
    unit_sd: float
    """Relative standard deviation of `metres_per_pixel`."""
    cameras: tuple[PlannedCamera, ...] = ()
    points: tuple[PlannedPoint, ...] = ()
    origin: Pixel = (0.0, 0.0)
    """Pixel of the world's origin."""
    click_sd_px: float = CLICK_SD_PX
    """Standard deviation of a click in a camera's image, pixels."""

    def metres(self, pixels: Floats) -> Floats:
        """Convert pixels (N, 2) of the plan to metres of the world: x right, y up, from the origin."""
        return np.asarray((np.asarray(pixels, dtype=np.float64) - self.origin) * (1.0, -1.0) * self.metres_per_pixel)


@dataclass(frozen=True, eq=False)
class ScaleCues:
    """All that is known about the scale."""

    population: PopulationHeight = field(default_factory=PopulationHeight)
    people: tuple[PersonHeight, ...] = ()
    lengths: tuple[KnownLength, ...] = ()
    distances: tuple[CameraDistance, ...] = ()
    camera_heights: tuple[CameraHeight, ...] = ()
    wands: tuple[Wand, ...] = ()
    """The number of each is its identity in `CameraObservations.wands`."""
    plan: FloorPlan | None = None


def lengths_of_wands(wands: Sequence[Wand], observations: Observations) -> tuple[KnownLength, ...]:
    """Return each wand as a known length at up to `MOST_STEPS` time steps at which two or more cameras see both ends.

    Args:
        wands: their numbers are the identities in `observations`.
        observations: at common time steps.
    """
    found = []
    for number, wand in enumerate(wands):
        seen: dict[int, dict[str, NDArray[np.float64]]] = {}
        for name, camera in observations.cameras.items():
            own = camera.wands.take(np.flatnonzero(camera.wands.identity == number))
            for frame, ends in zip(own.frame.tolist(), own.xy, strict=True):
                seen.setdefault(frame, {})[name] = ends
        shared = [frame for frame in sorted(seen) if len(seen[frame]) > 1]
        chosen = np.unique(np.linspace(0, len(shared) - 1, min(len(shared), MOST_STEPS)).round().astype(int))
        name = f"wand {wand.points[0]} to {wand.points[1]}"
        found += [KnownLength(wand.metres, wand.sd_m, seen[shared[k]], name) for k in chosen]
    return tuple(found)


def combine_heights(people: Sequence[PersonHeight]) -> tuple[PersonHeight, ...]:
    """Combine the heights of each person, weighted by their precision.

    One measurement stated twice is no better than once, and two that differ are no better than their difference. So the
    standard deviation is the root sum of squares of the smallest one and half the difference.
    """
    by_identity: dict[int, list[PersonHeight]] = {}
    for one in people:
        by_identity.setdefault(one.identity, []).append(one)
    return tuple(own[0] if len(own) == 1 else _combine_heights(own) for own in by_identity.values())


def _combine_heights(own: Sequence[PersonHeight]) -> PersonHeight:
    metres, sd_m = (np.array([getattr(one, key) for one in own]) for key in ("metres", "sd_m"))
    mean = float(np.average(metres, weights=sd_m**-2.0))
    spread = float(np.hypot(sd_m.min(), np.ptp(metres) / 2))
    return PersonHeight(own[0].identity, mean, spread, " and ".join(dict.fromkeys(one.place for one in own if one.place)))


@dataclass(frozen=True, eq=False)
class KnownPoint:
    """A point with known coordinates, marked in one camera or more."""

    name: str
    xyz: Floats
    """(3,) metres, in the world that the user wants."""
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


@dataclass(frozen=True)
class WrongUnit:
    """Stated lengths that are not in metres."""

    times: float
    """Stated lengths over those from people's heights."""
    unit: str | None
    """The unit in which they seem to be; None where no usual unit has this length."""

    @property
    def in_words(self) -> str:
        """The error and its remedy, as the end of a sentence about lengths."""
        size = f"{self.times:.3g} times as long" if self.times > 1 else f"{1 / self.times:.3g} times as short"
        if self.unit is None:
            return f"{size} as people's heights make them: give metres"
        if METRES[self.unit] < 1:
            change = f"multiply them by {METRES[self.unit]:g}"
        else:
            change = f"multiply them by {METRES[self.unit]:.0f}"
        return f"{size} as people's heights make them, so they seem to be in {self.unit}: give metres ({change})"


def find_wrong_unit(log_times: float, sd: float) -> WrongUnit | None:
    """Find the unit of stated lengths if people's heights show that it is not the metre.

    Args:
        log_times: logarithm of stated lengths over those from people's heights.
        sd: one sigma of it.
    """
    away = {unit: abs(log_times + float(np.log(metres))) for unit, metres in METRES.items()}
    unit = min(away, key=lambda one: away[one])
    if abs(log_times) > np.log(GROSS) + GROSS_SIGMAS * sd:
        return WrongUnit(float(np.exp(log_times)), unit if away[unit] < max(LEAST_MATCH, MATCH_SIGMAS * sd) else None)
    if abs(log_times) > LEAST_SIGMAS * sd and away[unit] < MATCH_SIGMAS * sd:
        return WrongUnit(float(np.exp(log_times)), unit)
    return None
