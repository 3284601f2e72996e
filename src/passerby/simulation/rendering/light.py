"""The light of a scene: a sun and the sky, or the sky alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats

ELEVATION_DEG = (38.0, 60.0)
"""How high the sun may stand: shadows are then 0.6 to 1.3 times as long as people are tall."""
AMBIENT = 0.52
SUN = 0.62
OVERCAST = 0.92
SHADOW = 0.55
"""Ground in the shadow is this bright, of its brightness in the sun: sky light alone reaches it."""


@dataclass(frozen=True, eq=False)
class Light:
    """Where the light comes from."""

    towards_sun: Floats
    """(3,) unit vector, world."""
    sunny: bool

    @classmethod
    def drawn(cls, sunny: bool, rng: np.random.Generator) -> Light:
        """A sun anywhere in the sky, at a moderate height."""
        azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*ELEVATION_DEG))
        flat = np.cos(elevation)
        return cls(np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]), sunny)

    def on(self, normals: Floats) -> Floats:
        """(..., 1) brightness of surfaces with unit normals (..., 3): Lambert's law, less sky where they look down."""
        sky = 0.80 + 0.20 * normals[..., 2:]
        if not self.sunny:
            return np.asarray(OVERCAST * sky)
        facing = np.einsum("...k,k->...", normals, self.towards_sun)
        return np.asarray(AMBIENT * sky + SUN * np.maximum(facing, 0.0)[..., None])
