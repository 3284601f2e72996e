"""What a user may choose about the pictures of a simulated scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.errors import InputError

CLOTHES = ("individual", "alike")


@dataclass(frozen=True)
class RenderOptions:
    """Options of the pictures. Raises `InputError` for a value out of range."""

    clothes: str = "individual"
    """individual (everybody's own) | alike (the same vest and trousers for all: only height, hair, skin and shoes differ)."""
    shadows: bool = True
    """The sun casts shadows; without, the sky is overcast and there are contact shadows only."""
    noise: float = 2.5
    """Standard deviation of the sensor's noise, grey levels of 0 to 255."""
    light_drift: float = 0.015
    """Amplitude of the slow change of the light, as a fraction."""
    blur_px: float = 0.5
    """Standard deviation of the optics' blur, pixels; 0 for none."""

    def __post_init__(self) -> None:
        if self.clothes not in CLOTHES:
            raise InputError(f"clothes {self.clothes!r} do not exist: choose one of {', '.join(CLOTHES)}")
        for name, high in (("noise", 50.0), ("light_drift", 0.3), ("blur_px", 5.0)):
            value = getattr(self, name)
            if not np.isfinite(value) or not 0 <= value <= high:
                raise InputError(f"{name} = {value} is out of range: give a value from 0 to {high:g}")
