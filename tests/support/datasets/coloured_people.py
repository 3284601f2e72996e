"""A tiny set of people known by the colours of shirt and trousers, before walls of any colour, as two cameras see them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

SIZE = (24, 48)
"""Width and height of the pictures."""


def coloured_person(path: Path, who: int, rng: np.random.Generator, gain: float) -> Path:
    """A picture of a person; wall, place, light and noise are drawn."""
    width, height = SIZE
    shown = np.broadcast_to(rng.uniform(0, 255, 3), (height, width, 3)).astype(np.float32)
    shirt, trousers = np.random.default_rng((7, who)).uniform(0, 255, (2, 3))
    left, top = rng.integers(3, 8), rng.integers(2, 8)
    shown[top + 4 : top + 20, left : left + 12] = shirt
    shown[top + 20 : top + 38, left : left + 12] = trousers
    shown = shown * gain * rng.uniform(0.85, 1.15) + rng.normal(0, 8, shown.shape)
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), shown.clip(0, 255).astype(np.uint8))
    return path


def coloured_people(folder: Path, people: int = 6, learnt: int = 4, searched: int = 2, seed: int = 0) -> Path:
    """A folder per identity: `learnt` pictures of each person in train, `searched` others each in query and gallery."""
    rng = np.random.default_rng(seed)
    for who in range(people):
        number = 0
        for part, count in (("train", learnt), ("query", searched), ("gallery", searched)):
            for k in range(count):
                camera = {"train": k % 2 + 1, "query": 1, "gallery": 2}[part]
                name = f"{part}/{who:04d}/{who:04d}_c{camera}s1_{number:06d}_00.png"
                coloured_person(folder / name, who, rng, 1.0 if camera == 1 else 0.8)
                number += 1
    return folder
