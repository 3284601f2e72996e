"""Standing heights of people; a module without numpy, because the command line uses it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M = 1.72, 0.09
"""Standing height of people, shoes on, metres: mean and standard deviation."""


@dataclass(frozen=True)
class Stature:
    """Standing heights of a population, shoes on, metres."""

    mean_m: float
    sd_m: float
    mean_sd_m: float | None = None
    """Standard deviation of the mean, metres; None: 4.5 % of it (`POPULATION_BIAS`)."""


POPULATIONS: Mapping[str, Stature] = MappingProxyType(
    {
        "adults": Stature(PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M),
        # Ages 6 to 11, both sexes: the WHO reference of 2007 has medians from 1.16 to 1.44 m, on average 1.30 m; shoes add 2
        # cm. 9 cm between ages and 6 cm among children of one age make 11 cm. A class is of one age: its mean is known to 8 cm,
        # and 4.5 %.
        "children": Stature(1.32, 0.11, 0.10),
        # Half adults, half such children. The share of children is assumed to be known to 20 %: 8 cm of the mean, and 4.5 %.
        "mixed": Stature(1.52, 0.22, 0.11),
    }
)
