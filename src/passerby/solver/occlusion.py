"""Which boxes show a whole person, judged by how their edges fit the people that all cameras agree on.

A detector's box often ends early: feet hidden behind a nearer person, a dark head before a dark wall; or it holds two people.
Its centre is then off by half of what is missing, which the centre's own residual barely distinguishes from noise while
the box's
height, of little weight, barely contradicts. Both edges together tell: each is either an edge of the person, with the
noise of all
such edges, or broken and anywhere near. How many are broken, and how noisy the others are, the boxes say themselves
(expectation and maximisation on a mixture of a normal and an even distribution).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.geometry.groups import residual_scale

BROKEN_DENSITY = 3.0
"""A broken edge lies evenly within a sixth of the person's height either way. Rendered videos, a network's boxes and a
background's: orientation off by 0.608 and 0.733 degrees; within a quarter 0.630 and 0.799; single weights instead 0.818 and
1.028."""
NARROWEST = 6.0
"""A broken edge is anywhere within at least so many sigmas of sound ones: where these are as noisy as a sixth of a person,
they would show nothing, and all boxes would pass for broken."""
CLEAN = 0.01
"""Of the true edges of people who bend and reach up to this share looks broken (simulated: 0.000 to 0.010). It is taken off, so
that boxes without fault are weighed alike."""
MIN_BOXES = 30
MIN_SIGMA = 0.01
"""No detector's edges are better known than this share of the height: feet move."""
LEAST_WEIGHT = 1e-3
_STEPS = 30


@dataclass(frozen=True, eq=False)
class Wholeness:
    """How whole boxes are."""

    weight: Floats
    """(M,) probability that both edges are the person's, at least `LEAST_WEIGHT`."""
    broken: float
    """Share of the edges that are broken, beyond what clean boxes feign."""


def weight_truncated_boxes(top: Floats, bottom: Floats) -> Wholeness:
    """The probabilities that boxes are whole.

    Args:
        top: (M,) residuals of the upper edges down the picture, as shares of the boxes' heights.
        bottom: (M,) the same of the lower edges.
    """
    if len(top) < MIN_BOXES:
        return Wholeness(np.ones(len(top)), 0.0)
    (sound_top, broken_top), (sound_bottom, broken_bottom) = _sound(top), _sound(bottom)
    weight = np.maximum(sound_top * sound_bottom, LEAST_WEIGHT)
    return Wholeness(weight, 0.5 * (broken_top + broken_bottom))


def _sound(residual: Floats) -> tuple[Floats, float]:
    """(M,) probability of each edge to be the person's, and the share of the broken ones beyond `CLEAN`."""
    sigma, broken = residual_scale(residual, MIN_SIGMA), 0.05
    for _ in range(_STEPS):
        sound = _posterior(residual, sigma, broken)
        broken = max(1 - float(sound.mean()), 1e-4)
        sigma = max(float(np.sqrt((sound * residual**2).sum() / sound.sum())), MIN_SIGMA)
    excess = max(broken - CLEAN, 0.0)
    return _posterior(residual, sigma, excess), excess


def _posterior(residual: Floats, sigma: float, broken: float) -> Floats:
    """(M,) probability that residuals come from sound edges."""
    sound = (1 - broken) * np.exp(-0.5 * (residual / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    density = min(BROKEN_DENSITY, 1 / (NARROWEST * sigma))
    return np.asarray(sound / np.maximum(sound + broken * density, 1e-300)) if broken > 0 else np.ones(len(residual))
