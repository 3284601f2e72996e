"""Scale cues: what a user knows about lengths in the scene, each with its standard deviation.

All cues enter one adjustment as priors, so that they combine by their weights and the pull of each can be told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

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
