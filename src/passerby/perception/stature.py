"""How tall people appear in a camera's picture, depending on where they stand: learnt from people who stand alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.geometry.robust import cauchy_weights, residual_scale

LEAST_BOXES = 12
"""Fewer boxes say too little about a plane of three unknowns."""
ROUNDS = 20
TRIALS = 200


@dataclass(frozen=True, eq=False)
class Stature:
    """Height of an upright person's box as a function of its foot: for a camera above a plane it is linear in the picture.

    h = a + b x + c y, pixels, for the middle (x, y) of the box's bottom edge; exact for a pinhole camera whose vertical
    vanishing point is far away (Hoiem, Efros and Hebert, *Putting Objects in Perspective*, IJCV 2008, equation 4).
    """

    plane: Floats
    """(3,) a, b, c."""
    spread: float
    """Standard deviation of a person's height about it, as a fraction."""
    boxes: int
    """How many boxes it was learnt from."""

    def height(self, foot: Floats) -> Floats:
        """(N,) expected heights of boxes whose bottom edges' middles are `foot` (N, 2), pixels; at least 1."""
        return np.asarray(np.maximum(self.plane[0] + foot @ self.plane[1:], 1.0))


def learn_stature(ltwh: Floats, rng: np.random.Generator) -> Stature | None:
    """The stature that most of the boxes (N, 4) agree with; None where they are too few or do not agree."""
    if len(ltwh) < LEAST_BOXES:
        return None
    foot = np.column_stack([ltwh[:, 0] + 0.5 * ltwh[:, 2], ltwh[:, 1] + ltwh[:, 3]])
    height = ltwh[:, 3]
    centre, scale = foot.mean(axis=0), np.maximum(foot.std(axis=0), 1.0)
    normal = np.column_stack([np.ones(len(foot)), (foot - centre) / scale])
    plane = _consensus(normal, height, rng)
    for _ in range(ROUNDS):
        error = height / np.maximum(normal @ plane, 1.0) - 1.0
        weight = cauchy_weights((error / 0.1) ** 2) / np.maximum(normal @ plane, 1.0)
        # A weak pull to no slope, a tenth of a box: without boxes at different places the slope is unknown.
        ridge = np.diag([0.0, 1.0, 1.0]) * 0.1 / np.median(height)
        rows = np.vstack([normal * weight[:, None], ridge])
        plane = np.linalg.lstsq(rows, np.concatenate([height * weight, np.zeros(3)]), rcond=None)[0]
    error = height / np.maximum(normal @ plane, 1.0) - 1.0
    near = np.abs(error) < 0.25
    if near.sum() < LEAST_BOXES or near.mean() < 0.4:
        return None
    slope = plane[1:] / scale
    spread = min(residual_scale(error[near], 0.03), 0.15)
    return Stature(np.array([plane[0] - slope @ centre, *slope]), spread, int(near.sum()))


def _consensus(design: Floats, height: Floats, rng: np.random.Generator) -> Floats:
    """(3,) of the planes through three boxes, the one that the most boxes lie near to (RANSAC)."""
    best, most = np.array([np.median(height), 0.0, 0.0]), -1.0
    for trial in range(TRIALS):
        if trial:
            rows = rng.choice(len(height), 3, replace=False)
            if abs(np.linalg.det(design[rows])) < 1e-3:
                continue
            plane = np.linalg.solve(design[rows], height[rows])
        else:
            plane = best
        expected = design @ plane
        if (expected < 0.2 * height).any():
            continue
        support = float(np.sum(cauchy_weights(((height / expected - 1.0) / 0.1) ** 2)))
        if support > most:
            best, most = plane, support
    return best
