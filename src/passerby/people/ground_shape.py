"""Test whether the people's ground is one plane, by the heights of their middles over the places where they walk.

The world's z is the normal of the people's ground, and z = 0 lies on it. An even slope changes only the direction that is
called up. A ground that is not one plane, with stairs, a ramp or a stage, tilts the fitted plane: people on all levels affect
it. Where no person changes the level, each person's trajectory is still level, and slopes against a plane through all levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import cauchy_weights, group_sums, residual_scale
from passerby.people.body_centres import TriangulatedPeople

DEGREE = 3
"""Degree of the polynomial that is fitted to the ground: it takes up most of the difference between a step or ramp and a
plane."""
STRETCH_S = 1.5
"""Heights of one person within this many seconds are averaged."""
LEAST_STRETCHES = 40
WALKING, WALK_S = 0.5, 1.0
"""Least speed of a walk, metres per second, and the time over which it is measured, seconds."""
UNSURE_M = 0.3
"""Positions whose height has a larger sigma are not used, metres."""
ROUNDS, LOSS = 10, 2.0
LEAST_M, LEAST_SIGMAS, LEAST_CHANCE = 0.12, 1.8, 8.0
"""Least rise in metres and in sigmas, and least `chance_sigmas`, at which a ground is reported as not plane. On flat ground the
last is 5 at most, usually below 1; a step of half a metre across a terrace or a building site makes it 10 to 17 in half a
minute."""
LARGE_M, LARGE_CHANCE = 0.3, 4.5
"""Rise in metres above which this lower `chance_sigmas` is enough, since such a rise must not be missed: the largest rise of 21
scenes of flat ground is 0.17."""
EXTENT = 0.05
"""Share of the people's trajectories that lies below the lowest part, and above the highest part."""
MOST_PLACES = 6000
"""Largest number of positions; of more, instants at even steps are taken."""
EXCESS = 4.0
"""Factor on the variance for the correlation between neighbouring stretches of one person."""


@dataclass(frozen=True, eq=False)
class GroundShape:
    """Difference of the people's ground from the plane that fits it best."""

    rise_m: float
    """Height of its highest part over its lowest part, both relative to the plane."""
    sigma_m: float
    """One sigma of `rise_m`."""
    low: tuple[float, float]
    """Position of the lowest part, world, metres."""
    high: tuple[float, float]
    """Position of the highest part, world, metres."""
    chance_sigmas: float
    """Total deviation from one plane, in standard deviations of its distribution by chance."""
    slope_deg: float
    """Slope of the ground below people's trajectories, against the world's z; each person has a height of their own."""
    slope_sigma_deg: float
    """One sigma of the slope, along the slope."""
    extent_m: float
    """Standard deviation of the positions along the slope."""

    @property
    def sure(self) -> bool:
        """Whether the ground differs from a plane significantly, and by an amount that matters."""
        least = LARGE_CHANCE if self.rise_m > LARGE_M else LEAST_CHANCE
        return self.rise_m > max(LEAST_M, LEAST_SIGMAS * self.sigma_m) and self.chance_sigmas > least


def ground_shape(people: TriangulatedPeople, per_second: float) -> GroundShape | None:
    """Estimate the shape of the ground from the middles of people; return None for fewer than `LEAST_STRETCHES` stretches.

    Args:
        people: positions of middles by all cameras, world z up.
        per_second: instants a second.
    """
    sure = np.sqrt(people.covariance[:, 2, 2]) < UNSURE_M
    if np.count_nonzero(sure) > MOST_PLACES:
        instants = np.unique(people.instant[sure])
        sure &= np.isin(people.instant, instants[:: int(np.ceil(np.count_nonzero(sure) / MOST_PLACES))])
    sure &= _walking(people, per_second)
    xy, z = people.place[sure, :2], people.place[sure, 2]
    length = max(1, round(STRETCH_S * per_second))
    stretch = np.column_stack([people.identity[sure], people.instant[sure] // length])
    key, group = np.unique(stretch, axis=0, return_inverse=True)
    if len(key) < LEAST_STRETCHES:
        return None
    group, count = group.ravel(), np.bincount(group.ravel())
    place = group_sums(group, xy, len(key)) / count[:, None]
    # People differ in height: heights of the same person at different places are compared.
    _, person = np.unique(key[:, 0], return_inverse=True)
    return _shape(person.ravel(), place, group_sums(group, z, len(key)) / count)


def _walking(people: TriangulatedPeople, per_second: float) -> NDArray[np.bool_]:
    """Return a mask (N,) of people who walk, and so are upright. Work near the ground in one place would look like a hole."""
    step = max(1, round(WALK_S * per_second))
    order = np.lexsort((people.instant, people.identity))
    who, when, where = people.identity[order], people.instant[order], people.place[order, :2]
    out = np.zeros(len(order), dtype=bool)
    if len(order) <= step:
        return out
    same = who[step:] == who[:-step]
    seconds = (when[step:] - when[:-step]) / per_second
    far = np.linalg.norm(where[step:] - where[:-step], axis=1)
    walks = same & (seconds < 2 * WALK_S + 1 / per_second) & (far > WALKING * seconds)
    middle = np.flatnonzero(walks) + step // 2
    out[order[middle]] = True
    return out


def _shape(person: Ints, place: Floats, height: Floats) -> GroundShape:
    """Fit a polynomial of the position and a height of each person, by reweighted least squares, and return the shape.

    Args:
        person: (S,) person of each stretch, 0 to P - 1.
        place: (S, 2) metres.
        height: (S,) of the middle, metres.
    """
    spread = np.maximum(2.0 * place.std(axis=0), 0.25)
    x, y = ((place - place.mean(axis=0)) / spread).T
    plane = np.column_stack([np.ones(len(x)), x, y])
    bent = np.column_stack([x**a * y ** (d - a) for d in range(2, DEGREE + 1) for a in range(d + 1)])
    bent = bent - plane @ np.linalg.lstsq(plane, bent, rcond=None)[0]
    n = bent.shape[1]
    own = (person[:, None] == np.arange(int(person.max()) + 1)).astype(np.float64)
    design = np.column_stack([bent, plane[:, 1:], own])
    # A weak prior holds the bending where few positions determine it.
    ridge = np.diag(np.where(np.arange(design.shape[1]) < n, 1e-2, 1e-6))
    weight = np.ones(len(x))
    for _ in range(ROUNDS):
        inverse = np.linalg.inv((design * weight[:, None]).T @ design + ridge)
        solved = inverse @ (design.T @ (weight * height))
        miss = height - design @ solved
        weight = cauchy_weights((miss / (LOSS * residual_scale(miss, 0.01))) ** 2)
    # Robust variance of the residuals, by the weights that they got (Huber 1981).
    variance = float((weight**2 * miss**2).sum() / max(weight.sum() - design.shape[1], 1.0))
    covariance = inverse[:n, :n] * variance * EXCESS
    slope, steep_covariance = solved[n : n + 2] / spread, inverse[n : n + 2, n : n + 2] * variance * EXCESS
    steep = float(np.linalg.norm(slope))
    along = slope / max(steep, 1e-12)
    surface = bent @ solved[:n]
    order = np.argsort(surface, kind="stable")
    low, high = (int(order[int(share * (len(order) - 1))]) for share in (EXTENT, 1.0 - EXTENT))
    between = bent[high] - bent[low]
    square = float(solved[:n] @ np.linalg.solve(covariance, solved[:n]))
    return GroundShape(
        float(surface[high] - surface[low]), float(np.sqrt(between @ covariance @ between)),
        (float(place[low, 0]), float(place[low, 1])), (float(place[high, 0]), float(place[high, 1])),
        (square - n) / float(np.sqrt(2.0 * n)),
        float(np.degrees(np.arctan(steep))), float(np.degrees(np.sqrt(along / spread @ steep_covariance @ (along / spread)))),
        float(np.std(place @ along)),
    )  # fmt: skip
