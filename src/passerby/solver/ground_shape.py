"""Is the people's ground one plane? How high their middles are, over the places where they walk.

The world's z is the normal of the people's ground, and its zero lies on it. A slope that is even changes nothing but what is
called up. A ground that is not one plane, with stairs, a ramp or a stage, tilts the whole of it: people on either level pull.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.solver.left_out import People

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CELLS = 4
"""Cells along each side of the area that nine of ten places lie in."""
STRETCH_S = 3.0
"""Heights of one person within so many seconds are off alike."""
LEAST_STRETCHES, LEAST_CELLS = 4, 5
WALKING, WALK_S = 0.5, 1.0
"""Metres per second, over so many seconds."""
UNSURE_M = 0.3
"""Places whose height is less sure than this tell nothing."""
ROUNDS, LOSS = 10, 2.0
LEAST_M, LEAST_SIGMAS, LEAST_CHANCE = 0.15, 3.5, 6.5
"""A ground is told to be no plane where its rise is so large and so many sigmas, and all cells together so far from chance. On
flat ground the last is 1 or 2; a step of half a metre across a terrace makes it 15 in half a minute, one of a metre on a
building site, where people crouch, 13."""
MOST_PLACES = 6000
"""Places at most: of more, even steps of instants are taken."""
EXCESS = 2.0
"""Factor on the variance for what stretches of one person have in common in a cell."""


@dataclass(frozen=True, eq=False)
class GroundShape:
    """How the people's ground differs from the plane that fits it best."""

    rise_m: float
    """From its lowest to its highest cell, both against the plane."""
    sigma_m: float
    """One sigma of it."""
    low: tuple[float, float]
    """Where the lowest is, world, metres,"""
    high: tuple[float, float]
    """and the highest."""
    chance_sigmas: float
    """How far the cells are from one plane altogether, in sigmas of what chance makes."""

    @property
    def sure(self) -> bool:
        """Whether the ground is beyond doubt no plane, by so much that it matters."""
        return self.rise_m > max(LEAST_M, LEAST_SIGMAS * self.sigma_m) and self.chance_sigmas > LEAST_CHANCE


def ground_shape(people: People, per_second: float) -> GroundShape | None:
    """The shape of the ground by the middles of people; None where too few places tell.

    Args:
        people: places of middles by all cameras, world z up.
        per_second: instants a second.
    """
    sure = np.sqrt(people.covariance[:, 2, 2]) < UNSURE_M
    if np.count_nonzero(sure) > MOST_PLACES:
        instants = np.unique(people.instant[sure])
        sure &= np.isin(people.instant, instants[:: int(np.ceil(np.count_nonzero(sure) / MOST_PLACES))])
    sure &= _walking(people, per_second)
    xy, z = people.place[sure, :2], people.place[sure, 2]
    if len(z) < 10 * LEAST_CELLS:
        return None
    length = max(1, round(STRETCH_S * per_second))
    stretch = np.column_stack([people.identity[sure], people.instant[sure] // length])
    # People differ in height: what counts is how high one and the same person is at different places.
    _, person = np.unique(people.identity[sure], return_inverse=True)
    low, high = np.quantile(xy, 0.05, axis=0), np.quantile(xy, 0.95, axis=0)
    size = np.maximum(high - low, 0.5) / CELLS
    cell = np.clip(np.floor((xy - low) / size), 0, CELLS - 1).astype(np.int64)
    number = cell[:, 0] * CELLS + cell[:, 1]
    key, first, group = np.unique(np.column_stack([number, stretch]), axis=0, return_index=True, return_inverse=True)
    count = np.bincount(group.ravel())
    height = np.bincount(group.ravel(), z) / count
    place = np.column_stack([np.bincount(group.ravel(), column) / count for column in xy.T])
    return _shape(key[:, 0], person[first], place, height)


def _walking(people: People, per_second: float) -> NDArray[np.bool_]:
    """(N,) who walks: he is upright. Whoever works near the ground does so in one place, and would make a hole of it."""
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


def _shape(cell: Ints, person: Ints, place: Floats, height: Floats) -> GroundShape | None:
    """The cells' heights against a plane, by stretches of people in cells: reweighted least squares on cells and people.

    Args:
        cell: (S,) of each stretch.
        person: (S,) 0 to P - 1.
        place: (S, 2) metres.
        height: (S,) of the middle, metres.
    """
    known, count = np.unique(cell, return_counts=True)
    known = known[count >= LEAST_STRETCHES]
    use = np.isin(cell, known)
    if len(known) < LEAST_CELLS:
        return None
    cell, person, place, height = np.searchsorted(known, cell[use]), person[use], place[use], height[use]
    n_cells, n_people = len(known), int(person.max()) + 1
    middle = np.column_stack([np.bincount(cell, column) / np.bincount(cell) for column in place.T])
    centred = middle - middle.mean(axis=0)
    design = np.zeros((len(cell), n_cells + n_people))
    design[np.arange(len(cell)), cell] = 1.0
    design[np.arange(len(cell)), n_cells + person] = 1.0
    weight = np.ones(len(cell))
    for _ in range(ROUNDS):
        # People's own heights are held together a little, which also holds what cells and people have in common.
        normal = (design * weight[:, None]).T @ design + np.diag([1e-6] * n_cells + [1e-2] * n_people)
        inverse = np.linalg.inv(normal)
        miss = height - design @ (inverse @ (design.T @ (weight * height)))
        scale = max(1.4826 * float(np.median(np.abs(miss))), 0.01)
        weight = 1.0 / (1.0 + (miss / (LOSS * scale)) ** 2)
    solved = (inverse @ (design.T @ (weight * height)))[:n_cells]
    # Robust variance of the residuals, by the weights that they got (Huber 1981).
    variance = float((weight**2 * miss**2).sum() / max(weight.sum() - n_cells - n_people, 1.0))
    plane = np.column_stack([np.ones(n_cells), centred])
    rest = np.eye(n_cells) - plane @ np.linalg.pinv(plane)
    covariance = rest @ inverse[:n_cells, :n_cells] @ rest.T * variance * EXCESS
    off = rest @ solved
    bottom, top = int(off.argmin()), int(off.argmax())
    between = np.zeros(n_cells)
    between[top], between[bottom] = 1.0, -1.0
    sigma = float(np.sqrt(max(between @ covariance @ between, 1e-12)))
    free = n_cells - 3
    square = float(off @ np.linalg.pinv(covariance, rcond=1e-8, hermitian=True) @ off)
    return GroundShape(
        float(off[top] - off[bottom]), sigma, (float(middle[bottom, 0]), float(middle[bottom, 1])),
        (float(middle[top, 0]), float(middle[top, 1])), (square - free) / float(np.sqrt(2.0 * free)),
    )  # fmt: skip
