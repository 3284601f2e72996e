"""Scale cues: what a user knows about lengths in the scene, each with its standard deviation.

All cues enter one adjustment as priors, so that they combine by their weights and the weight of each can be stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from passerby.core.floor_plan import FloorPlan
from passerby.core.observations import Observations
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M

MOST_STEPS = 200
"""Time steps at which a wand is measured: a spread of 5 % between them leaves 0.4 % of their median."""


@dataclass(frozen=True)
class PopulationHeight:
    """How tall people are: standing height, shoes on."""

    mean_m: float = PERSON_HEIGHT_M
    sd_m: float = PERSON_HEIGHT_SD_M
    mean_sd_m: float | None = None
    """How well the mean is known of these people, and by what boxes or joints show of them. None: `POPULATION_BIAS` of it."""


@dataclass(frozen=True)
class PersonHeight:
    """The standing height of one person, by identity."""

    identity: int
    metres: float
    sd_m: float = 0.01
    place: str = ""
    """The table of the scene file that states it, for people named by a pixel: their identities were found, and say nothing."""


@dataclass(frozen=True, eq=False)
class KnownLength:
    """A known distance between two marked points, each marked in two or more cameras."""

    metres: float
    sd_m: float
    points: Mapping[str, NDArray[np.float64]]
    """camera name -> (2, 2) pixels of the two ends, the ends in the same order in all cameras."""
    name: str = ""
    """Lengths of one name are one object at several times: the error of its stated length is the same in all of them."""


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
    """Each wand as a known length at each of up to `MOST_STEPS` time steps at which two or more cameras see both ends.

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
    """One height for each person. Heights of one person are weighted by their precision.

    One measurement stated twice is no better than once, and two that differ are no better than their difference: the standard
    deviation is the smallest one with half the difference added.
    """
    by_identity: dict[int, list[PersonHeight]] = {}
    for one in people:
        by_identity.setdefault(one.identity, []).append(one)
    return tuple(own[0] if len(own) == 1 else _combined(own) for own in by_identity.values())


def _combined(own: Sequence[PersonHeight]) -> PersonHeight:
    metres, sd_m = (np.array([getattr(one, key) for one in own]) for key in ("metres", "sd_m"))
    mean = float(np.average(metres, weights=sd_m**-2.0))
    spread = float(np.hypot(sd_m.min(), np.ptp(metres) / 2))
    return PersonHeight(own[0].identity, mean, spread, " and ".join(dict.fromkeys(one.place for one in own if one.place)))
