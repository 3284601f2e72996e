"""How sure refined lenses are, and what that does to the poses: priors that are no normal distributions, and what misleads."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.solver.people_state import PeopleState

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LensPriors:
    """What is known of refined lenses beside the sightings, (C, L) each."""

    core: Floats
    """Scales of the Cauchy distributions of the stated lenses."""
    drift: Floats
    """How far what all sightings of a camera have in common misleads its lens, one sigma."""


def with_lenses(covariance: Floats, state: PeopleState, lenses: LensPriors, size: int) -> tuple[Floats, Floats, Floats]:
    """The covariance with what misleads the lenses, and with their priors as they are.

    What sightings alone say of an unknown is its variance less the prior as it was linearised; the drift adds to it. The
    product of both distributions gives the standard deviation by quadrature, and all other unknowns follow by their
    regression on it.

    Args:
        covariance: of the shared unknowns, those of each camera's lens the last of its `size`.
        state: the optimum.
        lenses: priors and drift.
        size: number of a camera's unknowns.

    Returns:
        The covariance; (C, L) standard deviations of the lenses' unknowns; the same by sightings alone.
    """
    n, k = lenses.core.shape
    places = (np.arange(n)[:, None] + 1) * size - k + np.arange(k)
    added, sigma, alone = np.zeros_like(covariance), np.zeros((n, k)), np.zeros((n, k))
    for c, u in itertools.product(range(n), range(k)):
        at, variance = places[c, u], float(covariance[places[c, u], places[c, u]])
        value, core = float(state.lens[c, u]), float(lenses.core[c, u])
        prior = 1 / (core**2 + value**2)
        told = max(1 / variance - prior, 0.001 / variance)
        alone[c, u] = np.hypot(1 / np.sqrt(told), lenses.drift[c, u])
        sigma[c, u] = posterior_sd(value * (1 + prior / told), float(alone[c, u]), core, value)
        along = covariance[:, at] / variance
        added += max(sigma[c, u] ** 2 - variance, 0.0) * np.outer(along, along)
    return covariance + added, sigma, alone


def posterior_sd(seen: float, seen_sd: float, core: float, at: float) -> float:
    """Root mean square distance from `at` of a value that is seen as `seen` +- `seen_sd` and is Cauchy distributed about 0."""
    fine = np.linspace(-1, 1, 2001)
    grid = np.unique(np.concatenate([seen + 6 * seen_sd * fine, 20 * core * fine]))
    density = np.exp(-0.5 * ((grid - seen) / seen_sd) ** 2) / (core**2 + grid**2)
    return float(np.sqrt(np.trapezoid(density * (grid - at) ** 2, grid) / np.trapezoid(density, grid)))
