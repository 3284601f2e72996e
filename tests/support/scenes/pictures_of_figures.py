"""Pictures of figures before a textured ground, with the boxes that they fill."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from passerby.perception.pictures import Frame

WIDTH, HEIGHT = 480, 360
HORIZON = 60.0
RATIO = 0.45
"""Height of a figure over the distance of its foot from the horizon."""


@dataclass(frozen=True)
class Figure:
    x: float
    """Middle of the foot, pixels."""
    foot: float
    colour: tuple[int, int, int] = (40, 60, 170)
    height: float | None = None
    """Pixels; by the foot's place where None."""
    shadow: float | None = None
    """What is left of the light in its shadow, which lies on the ground to the right."""

    @property
    def tall(self) -> float:
        return self.height or RATIO * (self.foot - HORIZON)

    @property
    def ltwh(self) -> list[float]:
        return [self.x - 0.16 * self.tall, self.foot - self.tall, 0.32 * self.tall, self.tall]


@cache
def ground(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(rng.normal(0, 1, (36, 48)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    fine = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0)
    level = 135 + 12 * coarse + 25 * fine
    scene = np.clip(level[..., None] * np.array([0.9, 1.0, 1.05]), 20, 245)
    scene.setflags(write=False)
    return scene


def _parts(figure: Figure) -> np.ndarray:
    """(H, W) the silhouette: head, trunk and two legs that fill the box exactly."""
    h, x, foot = figure.tall, figure.x, figure.foot
    scale, shift = 16, 4

    def at(u: float, v: float) -> tuple[int, int]:
        return round((x + u * h - 0.5) * scale), round((foot - v * h - 0.5) * scale)

    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.ellipse(mask, at(0, 0.935), (round(0.05 * h * scale), round(0.065 * h * scale)), 0, 0, 360, 255, -1, cv2.LINE_8, shift)
    trunk = [at(-0.11, 0.86), at(0.11, 0.86), at(0.13, 0.45), at(-0.13, 0.45)]
    cv2.fillPoly(mask, [np.array(trunk)], 255, cv2.LINE_8, shift)
    for side in (-1, 1):
        leg = [at(side * 0.02, 0.46), at(side * 0.12, 0.46), at(side * 0.16, 0.0), at(side * 0.06, 0.0)]
        cv2.fillPoly(mask, [np.array(leg)], 255, cv2.LINE_8, shift)
    return mask


def picture(
    figures: list[Figure],
    rng: np.random.Generator,
    gain: float = 1.0,
    noise: float = 2.5,
    seed: int = 0,
    scene: np.ndarray | None = None,
) -> np.ndarray:
    canvas = (ground(seed) if scene is None else scene).copy()
    for figure in figures:
        if figure.shadow is not None:
            axes = (round(0.35 * figure.tall), max(round(0.05 * figure.tall), 3))
            dark = np.zeros((HEIGHT, WIDTH))
            centre = (round(figure.x + 0.4 * figure.tall), round(figure.foot - 0.03 * figure.tall))
            cv2.ellipse(dark, centre, axes, 0, 0, 360, 1.0, -1)
            dark = cv2.GaussianBlur(dark, (0, 0), 1.0)
            canvas *= (1.0 - (1.0 - figure.shadow) * dark)[..., None]
    for figure in sorted(figures, key=lambda one: one.foot):
        mask = _parts(figure) > 0
        rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
        folds = 15 * np.sin(rows / 5.0 + columns / 3.0)
        canvas[mask] = np.array(figure.colour) + folds[mask][:, None]
    return np.clip(canvas * gain + rng.normal(0, noise, canvas.shape), 0, 255).astype(np.uint8)


COLOURS = [(40, 60, 170), (150, 70, 40), (60, 140, 60), (200, 200, 210), (45, 40, 40), (30, 160, 190)]


def walkers(instant: int, shadow: float | None = None) -> list[Figure]:
    """Three figures who cross the picture at different distances, apart from each other."""
    phase = instant * 37.0
    return [
        Figure(60 + (phase * 1.1 + 100) % 360, 180 + 10 * np.sin(instant), COLOURS[instant % 6], shadow=shadow),
        Figure(60 + (phase * 0.7) % 360, 250 + 10 * np.cos(instant), COLOURS[(instant + 2) % 6], shadow=shadow),
        Figure(80 + (phase * 0.9 + 200) % 320, 330 + 8 * np.sin(2 * instant), COLOURS[(instant + 4) % 6], shadow=shadow),
    ]


def recording(count: int = 40, shadow: float | None = None, more: list[Figure] | None = None) -> list[Frame]:
    """So many pictures of walkers, one a second."""
    rng = np.random.default_rng(5)
    return [Frame(i + 1, float(i), picture([*apart(walkers(i, shadow)), *(more or [])], rng)) for i in range(count)]


def apart(figures: list[Figure]) -> list[Figure]:
    """The figures of whom no nearer one hides a part."""
    kept: list[Figure] = []
    for figure in figures[::-1]:
        if all(abs(figure.x - other.x) > 0.6 * other.tall for other in kept):
            kept.append(figure)
    return kept
