"""How tall people are; without numpy, since the command line names it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M = 1.72, 0.09
"""Standing height of people, shoes on, and how much they differ (one sigma)."""


@dataclass(frozen=True)
class Stature:
    """Standing heights of a population, shoes on, metres."""

    mean_m: float
    sd_m: float
    mean_sd_m: float | None = None
    """How well the mean is known; None: 4.5 % of it (`POPULATION_BIAS`)."""


POPULATIONS: Mapping[str, Stature] = MappingProxyType(
    {
        "adults": Stature(PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M),
        # Ages 6 to 11, both sexes: the WHO reference of 2007 has medians from 1.16 to 1.44 m, on average 1.30 m, and 2 cm of
        # shoes. 9 cm from age to age and 6 cm among children of one age make 11 cm. A class is of one age: 8 cm, and 4.5 %.
        "children": Stature(1.32, 0.11, 0.10),
        # Half adults, half such children. The share of children is taken to be known to 20 %: 8 cm of the mean, and 4.5 %.
        "mixed": Stature(1.52, 0.22, 0.11),
    }
)
