"""Removal of sightings of a person that no registered pair of cameras joins to the person's other sightings.

Identities hold over time, so that one wrong join makes two people one. With many cameras, where each shares ground with a few,
such a person is usually in two places at one time, seen by cameras that are not registered with each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from passerby.common.arrays import Bools, Ints
from passerby.core.observations import CameraObservations, Observations


def joined_sightings(observations: Observations, pairs: Iterable[tuple[str, str]]) -> Observations:
    """Keep, for each person at each time step, the largest set of sightings that pairs of cameras join.

    Args:
        observations: people with identities at common time steps.
        pairs: names of two cameras that may see one person at one time, in any order. The sightings of three cameras are joined
            where two of the three pairs are among these.
    """
    names = list(observations.cameras)
    number = {name: c for c, name in enumerate(names)}
    joined = np.eye(len(names), dtype=bool)
    for one, other in pairs:
        if one in number and other in number:
            joined[number[one], number[other]] = joined[number[other], number[one]] = True
    parts = [part for name in names for part in (observations[name].boxes, observations[name].keypoints)]
    camera = np.repeat(np.repeat(np.arange(len(names)), 2), [len(part) for part in parts])
    frame, identity = (np.concatenate([getattr(part, column) for part in parts]) for column in ("frame", "identity"))
    kept = np.split(_kept(camera, frame, identity, joined), np.cumsum([len(part) for part in parts])[:-1])
    cameras = {}
    for c, name in enumerate(names):
        boxes, keypoints = observations[name].boxes, observations[name].keypoints
        cameras[name] = CameraObservations(boxes.take(kept[2 * c]), keypoints.take(kept[2 * c + 1]), observations[name].wands)
    return replace(observations, cameras=cameras)


def _kept(camera: Ints, frame: Ints, identity: Ints, joined: Bools) -> Bools:
    """Return a mask (N,) of the sightings to keep; `joined` (C, C) is symmetric, and true on its diagonal."""
    n = len(camera)
    if n == 0:
        return np.zeros(0, bool)
    order = np.lexsort((camera, frame, identity))
    same = (np.diff(identity[order]) == 0) & (np.diff(frame[order]) == 0)
    person_instant = np.concatenate([[0], np.cumsum(~same)])
    c = camera[order]
    first, second, step = [], [], 1
    while step < n and (near := np.flatnonzero(person_instant[step:] == person_instant[:-step])).size:
        near = near[joined[c[near], c[near + step]]]
        first.append(near)
        second.append(near + step)
        step += 1
    i = np.concatenate(first) if first else np.zeros(0, np.int64)
    j = np.concatenate(second) if second else np.zeros(0, np.int64)
    _, group = connected_components(csr_array((np.ones(len(i), np.int8), (i, j)), shape=(n, n)), directed=False)
    size = np.bincount(group)[group]
    largest = np.lexsort((group, -size, person_instant))
    leading = np.flatnonzero(np.diff(person_instant[largest], prepend=-1))
    best = group[largest[leading]]
    out = np.zeros(n, bool)
    out[order] = group == best[person_instant]
    return out
