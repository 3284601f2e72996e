"""Scale cues: what a user knows about lengths in the scene, each with its standard deviation.

All cues enter one adjustment as priors, so that they combine by their weights and the pull of each can be told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from passerby.core.floor_plan import FloorPlan
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M


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
    plan: FloorPlan | None = None


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
