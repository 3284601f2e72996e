"""Evidence of people on the cameras' poses, summed in clusters: one person for some seconds.

Errors of neighbouring boxes of a person are alike (gait, posture, occlusion), so that the boxes are summed to one *score*, and
only scores are taken to be independent of each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Columns, Floats, Ints
from passerby.geometry.groups import group_sums
from passerby.people.held_cameras import FittedPeople
from passerby.people.sightings import Sightings

STRETCH_S = 6.0
"""Length of a cluster of one person, seconds. With stretches of 3, 6, 10 and 20 s the squared errors of a minute's pose were
1.7, 1.33, 1.30 and 1.1 times the stated variance; longer ones leave too few clusters."""


@dataclass(frozen=True, eq=False)
class Scores(Columns):
    """K clusters, ascending in time, about poses of C cameras: 6 parameters each, as in `BodyEquations.by_camera`."""

    start_s: Floats
    """(K,) time at which the stretch begins, seconds."""
    gradient: Floats
    """(K, 6 C) gradient of half the squared residuals, downhill: the direction in which the cluster moves the cameras."""
    information: Floats
    """(K, 6 C, 6 C) information on the cameras, bodies eliminated."""
    counts: Ints
    """(K, C) sightings by each camera."""

    def __len__(self) -> int:
        return len(self.start_s)

    def between(self, from_s: float, until_s: float) -> Scores:
        """Return the clusters that begin at times in [from, until)."""
        low, high = np.searchsorted(self.start_s, [from_s, until_s])
        return self.take(slice(int(low), int(high)))

    def at(self, shift: Floats) -> Floats:
        """Return the gradients (K, 6 C) after the cameras are shifted by (6 C,)."""
        return self.gradient - self.information @ shift


def cluster_scores(seen: Sightings, people: FittedPeople, stretch_s: float = STRETCH_S) -> Scores:
    """Compute the clusters of bodies that two cameras or more saw.

    Args:
        seen: the sightings.
        people: the bodies solved from them.
        stretch_s: length of a cluster, seconds; stretches begin at multiples of it.
    """
    n_cameras, n = len(seen.names), seen.n_blocks
    A, J, w = people.equations.by_body, people.by_camera, people.weight
    r = people.equations.residual
    JwA = np.einsum("nki,n,nkj->nij", J, w, A)
    by_camera = np.zeros((n, n_cameras, 6, 4))
    by_camera[seen.block, seen.camera] = JwA
    coupling = by_camera.reshape(n, 6 * n_cameras, 4)
    right = people.pull + group_sums(seen.block, np.einsum("nki,n,nk->ni", A, w, r), n)
    solved = np.linalg.solve(people.information, np.concatenate([right[:, :, None], coupling.transpose(0, 2, 1)], axis=2))
    pulls = np.zeros((n, n_cameras, 6))
    pulls[seen.block, seen.camera] = np.einsum("nki,n,nk->ni", J, w, r)
    gradient = pulls.reshape(n, 6 * n_cameras) - (coupling @ solved[:, :, :1])[:, :, 0]
    information = -coupling @ solved[:, :, 1:]
    blocks = information.reshape(n, n_cameras, 6, n_cameras, 6)
    blocks[seen.block, seen.camera, :, seen.camera, :] += np.einsum("nki,n,nkj->nij", J, w, J)
    counts = np.zeros((n, n_cameras), np.int64)
    counts[seen.block, seen.camera] = 1
    return _clustered(seen, gradient, information, counts, stretch_s)


def _clustered(seen: Sightings, gradient: Floats, information: Floats, counts: Ints, stretch_s: float) -> Scores:
    """Sum over the stretches of each person. Bodies that only one camera saw are left out: they do not constrain the others."""
    use = np.flatnonzero(counts.sum(axis=1) > 1)
    step = np.floor(seen.block_seconds[use] / stretch_s + 1e-9).astype(np.int64)
    key, cluster = np.unique(np.column_stack([step, seen.block_identity[use]]), axis=0, return_inverse=True)
    cluster, k = cluster.ravel(), len(key)
    order = np.argsort(cluster, kind="stable")
    first = np.searchsorted(cluster[order], np.arange(k))

    def total(values: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return sums by cluster."""
        return np.add.reduceat(values[use][order], first, axis=0) if k else values[:0]

    return Scores(key[:, 0] * stretch_s, total(gradient), total(information), total(counts))  # type: ignore[arg-type]
