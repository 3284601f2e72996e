"""Detection of boxes that do not show a whole person, by how their edges fit the people that all cameras agree on.

A detector's box often ends early: feet are hidden behind a nearer person, or a dark head is before a dark wall; or the box
contains two people. Its centre is then wrong by half of the missing part. The centre's own residual barely distinguishes this
from noise, and the box's height has little weight. Both edges together show it: each is either an edge of the person, with the
noise of all such edges, or broken and anywhere near. The share of broken edges and the noise of the others are estimated from
the boxes (expectation maximisation on a mixture of a normal and a uniform distribution).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.geometry.groups import residual_scale

BROKEN_DENSITY = 3.0
"""Density of a broken edge: it lies uniformly within a sixth of the person's height either way. Rendered videos, a network's
boxes and a background's: orientation errors of 0.608 and 0.733 degrees; within a quarter 0.630 and 0.799; with single weights
instead 0.818 and 1.028."""
NARROWEST = 6.0
"""Smallest width of the distribution of broken edges, in sigmas of sound ones. With a narrower one, where sound edges are as
noisy as a sixth of a person, broken and sound edges could not be distinguished, and all boxes would count as broken."""
CLEAN = 0.01
"""Share of the true edges of people who bend and reach that looks broken (simulated: 0.000 to 0.010). It is subtracted, so
that boxes without errors get equal weights."""
MIN_BOXES = 30
MIN_SIGMA = 0.01
"""Smallest sigma of an edge for all detectors, as a share of the height: feet move."""
LEAST_WEIGHT = 1e-3
_STEPS = 30


@dataclass(frozen=True, eq=False)
class Wholeness:
    """Probabilities that boxes show whole people."""

    weight: Floats
    """(M,) probability that both edges are the person's, at least `LEAST_WEIGHT`."""
    broken: float
    """Share of broken edges, in excess of the share `CLEAN` that clean boxes seem to have."""


def weight_truncated_boxes(top: Floats, bottom: Floats) -> Wholeness:
    """Compute the probabilities that boxes are whole.

    Args:
        top: (M,) residuals of the upper edges, positive down the image, as shares of the boxes' heights.
        bottom: (M,) the same of the lower edges.
    """
    if len(top) < MIN_BOXES:
        return Wholeness(np.ones(len(top)), 0.0)
    (sound_top, broken_top), (sound_bottom, broken_bottom) = _sound(top), _sound(bottom)
    weight = np.maximum(sound_top * sound_bottom, LEAST_WEIGHT)
    return Wholeness(weight, 0.5 * (broken_top + broken_bottom))


def _sound(residual: Floats) -> tuple[Floats, float]:
    """Return the probability (M,) that each edge is the person's, and the share of broken edges in excess of `CLEAN`."""
    sigma, broken = residual_scale(residual, MIN_SIGMA), 0.05
    for _ in range(_STEPS):
        sound = _posterior(residual, sigma, broken)
        broken = max(1 - float(sound.mean()), 1e-4)
        sigma = max(float(np.sqrt((sound * residual**2).sum() / sound.sum())), MIN_SIGMA)
    excess = max(broken - CLEAN, 0.0)
    return _posterior(residual, sigma, excess), excess


def _posterior(residual: Floats, sigma: float, broken: float) -> Floats:
    """Return the probability (M,) that residuals come from sound edges."""
    sound = (1 - broken) * np.exp(-0.5 * (residual / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    density = min(BROKEN_DENSITY, 1 / (NARROWEST * sigma))
    return np.asarray(sound / np.maximum(sound + broken * density, 1e-300)) if broken > 0 else np.ones(len(residual))
