"""Joining of the tracklets of all cameras to people by correlation clustering.

Every two tracklets have a weight: the evidence for one person minus that for two. The clustering with the largest sum of
weights within groups is approximated by joining repeatedly the two groups with the largest summed weight, while it is above
zero (greedy additive edge contraction: Keuper et al., *Efficient Decomposition of Image and Mesh Graphs by Lifted Multicuts*,
ICCV 2015). Constraints, such as that two tracklets of one camera at one time are two people, are expressed by the weights.
"""

from __future__ import annotations

import heapq

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import expanded_ranges


def cluster_tracklets(n: int, first: Ints, second: Ints, weight: Floats) -> Ints:
    """Join n tracklets to groups.

    Args:
        n: number of tracklets.
        first: (E,) one end of each edge.
        second: (E,) the other end.
        weight: (E,) above 0 for one person, below for two. Weights of repeated edges are added.

    Returns:
        (n,) group of each tracklet, numbered from 0 in the order of their first members.
    """
    low, high = np.minimum(first, second), np.maximum(first, second)
    apart = low != high
    key, which = np.unique(low[apart] * n + high[apart], return_inverse=True)
    total = np.bincount(which, weight[apart], len(key))
    near: list[dict[int, float]] = [{} for _ in range(n)]
    queue: list[tuple[float, int, int]] = []
    for i, j, w in zip((key // n).tolist(), (key % n).tolist(), total.tolist(), strict=True):
        near[i][j] = near[j][i] = w
        if w > 0:
            queue.append((-w, i, j))
    heapq.heapify(queue)
    parent = list(range(n))
    while queue:
        negative, i, j = heapq.heappop(queue)
        if near[i].get(j) != -negative:
            continue  # one of the two has been joined with another since
        if len(near[i]) < len(near[j]):
            i, j = j, i
        parent[j] = i
        del near[i][j]
        for k, w in near[j].items():
            if k == i:
                continue
            del near[k][j]
            new = near[i].get(k, 0.0) + w
            near[i][k] = near[k][i] = new
            if new > 0:
                heapq.heappush(queue, (-new, min(i, k), max(i, k)))
        near[j] = {}
    return _numbered(parent)


def _numbered(parent: list[int]) -> Ints:
    roots = []
    for i in range(len(parent)):
        root = i
        while parent[root] != root:
            root = parent[root]
        roots.append(root)
    _, first, which = np.unique(roots, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[which.ravel()], dtype=np.int64)


def find_overlaps(start: Floats, end: Floats, slack: float) -> tuple[Ints, Ints]:
    """Find pairs (i < j) of intervals of one camera that overlap by more than `slack` (seconds)."""
    order = np.argsort(start, kind="stable")
    start, end = start[order], end[order]
    # For each interval, in the order of starts: the later ones that begin before it ends.
    place = np.arange(len(order))
    count = np.maximum(np.searchsorted(start, end - slack) - place - 1, 0)
    i, j = expanded_ranges(place + 1, count)
    long = end[j] - start[j] > slack
    i, j = order[i[long]], order[j[long]]
    return np.minimum(i, j), np.maximum(i, j)
