"""The unit of stated lengths, as far as people's heights show that it is not the metre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

METRES = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "feet": 0.3048, "yards": 0.9144, "kilometres": 1e3}
"""By unit, its length in metres."""
GROSS, GROSS_SIGMAS = 2.5, 3.0
"""No people are so many times as tall, or as small, as expected: so many sigmas beyond, the unit is wrong, whichever it is."""
LEAST_SIGMAS, MATCH_SIGMAS = 6.0, 2.0
"""A smaller factor is a wrong unit where it is so many sigmas from 1, and so few from the factor of a unit."""
LEAST_MATCH = 0.25
"""A gross factor is that of a unit where their logarithms differ by less, whatever the sigma. Units differ by 0.9 and more."""


@dataclass(frozen=True)
class WrongUnit:
    """Stated lengths that are not in metres."""

    times: float
    """Stated lengths over those by people's heights."""
    unit: str | None
    """The unit that they seem to be in; None where no usual unit is so long."""

    @property
    def in_words(self) -> str:
        """What is wrong and what to write, as the end of a sentence about lengths."""
        size = f"{self.times:.3g} times as long" if self.times > 1 else f"{1 / self.times:.3g} times as short"
        if self.unit is None:
            return f"{size} as people's heights make them: give metres"
        if METRES[self.unit] < 1:
            change = f"multiply them by {METRES[self.unit]:g}"
        else:
            change = f"multiply them by {METRES[self.unit]:.0f}"
        return f"{size} as people's heights make them, so they seem to be in {self.unit}: give metres ({change})"


def find_wrong_unit(log_times: float, sd: float) -> WrongUnit | None:
    """The unit that stated lengths are in, if people's heights show that it is not the metre.

    Args:
        log_times: logarithm of stated lengths over those by people's heights.
        sd: one sigma of it.
    """
    away = {unit: abs(log_times + float(np.log(metres))) for unit, metres in METRES.items()}
    unit = min(away, key=lambda one: away[one])
    if abs(log_times) > np.log(GROSS) + GROSS_SIGMAS * sd:
        return WrongUnit(float(np.exp(log_times)), unit if away[unit] < max(LEAST_MATCH, MATCH_SIGMAS * sd) else None)
    if abs(log_times) > LEAST_SIGMAS * sd and away[unit] < MATCH_SIGMAS * sd:
        return WrongUnit(float(np.exp(log_times)), unit)
    return None
