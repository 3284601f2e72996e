"""Scenes that several tests share."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np

from passerby.core.observations import Boxes
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.scene import Filmed, film, remove_faults


@cache
def scene(**changes: object) -> SimulatedScene:
    """A ten-second scene, simulated once per session and set of options."""
    return simulate(SimulationOptions(**{"seconds": 10.0, "seed": 1, **changes}))  # type: ignore[arg-type]


@lru_cache(maxsize=16)
def _views(options: SimulationOptions) -> Filmed:
    """Most of the time of a simulation."""
    return film(options)


def from_shared_views(options: SimulationOptions) -> SimulatedScene:
    """As `simulate`; scenes that differ in their faults only are made of the same views.

    For tests of what takes scenes. A test that a fault changes nothing else needs `simulate`.
    """
    return simulate(options, _views(remove_faults(options)))


@cache
def faulty_scene(**changes: object) -> SimulatedScene:
    """As `scene`, from shared views."""
    return from_shared_views(SimulationOptions(**{"seconds": 10.0, "seed": 1, **changes}))  # type: ignore[arg-type]


def table(boxes: Boxes, frames: int, people: int) -> np.ndarray:
    """(T, P, 4) left, top, right, bottom; NaN where a person has no box."""
    edges = np.full((frames, people, 4), np.nan)
    known = boxes.take(boxes.identity > 0)
    edges[known.frame - 1, known.identity - 1] = np.hstack([known.ltwh[:, :2], known.ltwh[:, :2] + known.ltwh[:, 2:]])
    return edges


def edges_of(simulated: SimulatedScene, camera: str) -> np.ndarray:
    return table(simulated.observations[camera].boxes, len(simulated.frames), len(simulated.identities))
