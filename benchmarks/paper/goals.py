"""What is asked of the errors on the simulated scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Goal:
    """Errors after the similarity placement: mean over the cameras."""

    acceptable: tuple[float, float]
    """(mm, degrees): the best of today's engines."""
    aim: tuple[float, float]


PRESETS: Mapping[str, Goal] = MappingProxyType(
    {
        "terrace": Goal((15, 0.12), (7.5, 0.06)),
        "basketball": Goal((30, 0.12), (15, 0.06)),
        "construction": Goal((15, 0.06), (7.5, 0.03)),
    }
)
"""By simulated scene, with `BOX_NOISE`."""
SCALE_GOAL = (0.03, 0.015)
"""Error of the scale, acceptable and aim."""
GRAVITY_GOAL_DEG, GROUND_GOAL_MM = 0.3, 50.0
BOX_NOISE = 0.02
"""Sigma of each edge of a box, as a share of its height."""
