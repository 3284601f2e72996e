"""Boxes of people whose ways over the ground are given."""

import numpy as np

from passerby.core.observations import Boxes, CameraObservations, Observations


def boxes_of(rig, walks, rng, noise=0.01):
    """Boxes of people who walk as given: identity -> ((T, 2) ground positions in metres, height in metres)."""
    corners = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.25, 0.25) for z in (0, 1)])
    seen = {}
    for camera in rig:
        columns = []
        for identity, (path, height) in walks.items():
            bodies = np.column_stack([path, np.zeros(len(path))])[:, None] + corners * [1, 1, height]
            pixels = camera.project(bodies.reshape(-1, 3)).reshape(len(path), 8, 2)
            low, high = pixels.min(axis=1), pixels.max(axis=1)
            inside = np.isfinite(low).all(axis=1) & (low > 0).all(axis=1) & (high < camera.lens.size).all(axis=1)
            edges = np.column_stack([low, high])[inside]
            edges += noise * (edges[:, 3:] - edges[:, 1:2]) * rng.standard_normal(edges.shape)
            frames = np.flatnonzero(inside) + 1
            columns.append(np.column_stack([frames, np.full(len(frames), identity), edges[:, :2], edges[:, 2:] - edges[:, :2]]))
        table = np.concatenate(columns)
        table = table[np.lexsort((table[:, 1], table[:, 0]))]
        seen[camera.name] = CameraObservations(Boxes(table[:, 0], table[:, 1], table[:, 2:], np.ones(len(table))))
    return Observations(seen, 5.0)
