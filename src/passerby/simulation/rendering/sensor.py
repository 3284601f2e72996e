"""What a camera's sensor does to its pictures: white balance, blur, drifting light, noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.perception.pictures import Picture
from passerby.simulation.rendering.options import RenderOptions

BANK = 4
"""Fields of noise that are made once; every frame shows one of them, moved at random."""
MARGIN_PX = 64
DRIFT_S = (20.0, 60.0)
"""Period of the light's drift."""


class Sensor:
    """One camera's sensor."""

    def __init__(self, size: tuple[int, int], options: RenderOptions, rng: np.random.Generator) -> None:
        """Draw the sensor of a camera whose pictures have `size` (width, height)."""
        self._rng, self._options, self._size = rng, options, size
        gain, balance = rng.uniform(0.94, 1.05), rng.uniform(0.97, 1.03, 3)
        self._gain = tuple((gain * balance).tolist())
        self._period, self._start = rng.uniform(*DRIFT_S), rng.uniform(0, 2 * np.pi)
        self._bank = [self._field() for _ in range(BANK)] if options.noise > 0 else []

    def _field(self) -> NDArray[np.int16]:
        """Noise of the asked strength in all channels, a third of its variance in common, slightly correlated in space."""
        width, height = self._size[0] + MARGIN_PX, self._size[1] + MARGIN_PX
        common = self._rng.standard_normal((height, width, 1), dtype=np.float32)
        own = self._rng.standard_normal((height, width, 3), dtype=np.float32)
        field = cv2.GaussianBlur(np.sqrt(1 / 3) * common + np.sqrt(2 / 3) * own, (3, 3), 0.5)
        return np.asarray(np.round(field * (self._options.noise / field.std())), dtype=np.int16)

    def __call__(self, picture: Picture, seconds: float) -> Picture:
        """The picture as the sensor delivers it at a time of the scene; frames must come in their order."""
        if self._options.blur_px > 0:
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), self._options.blur_px), dtype=np.uint8)
        drift = 1 + self._options.light_drift * np.sin(2 * np.pi * seconds / self._period + self._start)
        scales = tuple(float(gain * drift) for gain in self._gain)
        picture = np.asarray(cv2.multiply(picture, np.array((*scales, 1.0))), dtype=np.uint8)
        if self._bank:
            field = self._bank[int(self._rng.integers(BANK))]
            x, y = (int(move) for move in self._rng.integers(0, MARGIN_PX, 2))
            moved = field[y : y + self._size[1], x : x + self._size[0]]
            picture = np.asarray(cv2.add(picture, moved, dtype=cv2.CV_8U), dtype=np.uint8)
        return picture
