"""Which cameras of a rig may share people: those that see ground in common, by their poses.

Walls are not known, so that a neighbour may turn out to share no people. The work grows with the cameras, not with their pairs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.stature import PERSON_HEIGHT_M

CELL_M = 1.0
RANGE_M = 40.0
LEAST_PX = 25.0
"""Height in the image below which no person is detected."""
SAME_RAY = 1e-3
"""Beyond its border a distorted lens folds over: a pixel whose ray is another one than the point's shows something else."""
LEAST_SHARED = 5
"""Cells that neighbours have in common: on less ground almost no person walks."""
SAME_FLOOR_M = 1.5
"""Two cameras whose ground differs by more in height stand on different floors."""
MOST_NEIGHBOURS = 12
"""Of each camera, those with most ground in common; as many as a calibration registers a camera with."""

Pairs = frozenset[tuple[int, int]]
"""Places of two cameras in a rig, a < b."""


def neighbours_by_rig(rig: Rig, ground_m: Mapping[str, float]) -> Pairs:
    """Pairs of cameras that share ground.

    Args:
        rig: cameras with poses.
        ground_m: height of the ground at each camera, metres; a camera that is not in it has no neighbours.
    """
    owners: dict[tuple[int, int], list[int]] = {}
    for number, camera in enumerate(rig):
        if camera.name in ground_m:
            for x, y in _cells_seen(camera, ground_m[camera.name]).tolist():
                owners.setdefault((x, y), []).append(number)
    height = [ground_m.get(name, np.nan) for name in rig.names]
    shared: list[dict[int, int]] = [{} for _ in height]
    for cameras in owners.values():
        for a in cameras:
            for b in cameras:
                if a != b and abs(height[a] - height[b]) <= SAME_FLOOR_M:
                    shared[a][b] = shared[a].get(b, 0) + 1
    found = set()
    for a, counts in enumerate(shared):
        enough = [b for b, count in counts.items() if count >= LEAST_SHARED]
        for b in sorted(enough, key=lambda b: (-counts[b], b))[:MOST_NEIGHBOURS]:
            found.add((min(a, b), max(a, b)))
    return frozenset(found)


def connected(pairs: Pairs, n: int) -> list[list[int]]:
    """The cameras 0 to n - 1 in sets that pairs tie together, each ascending; cameras without a neighbour are in none."""
    beside: list[list[int]] = [[] for _ in range(n)]
    for a, b in sorted(pairs):
        beside[a].append(b)
        beside[b].append(a)
    found, seen = [], set[int]()
    for start in range(n):
        if start in seen or not beside[start]:
            continue
        seen.add(start)
        part = [start]
        for camera in part:
            part += [new for new in beside[camera] if new not in seen]
            seen.update(beside[camera])
        found.append(sorted(part))
    return found


def _cells_seen(camera: Camera, ground_m: float) -> Ints:
    """(N, 2) numbers of the cells of ground on which a standing person is whole in the image, and tall enough."""
    assert camera.pose is not None
    middle = np.floor(camera.pose.centre[:2] / CELL_M)
    reach = np.arange(-RANGE_M // CELL_M, RANGE_M // CELL_M + 1)
    cells = middle + np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
    place = (cells + 0.5) * CELL_M
    away = np.linalg.norm(place - camera.pose.centre[:2], axis=1)
    cells, place = cells[away <= RANGE_M], place[away <= RANGE_M]
    ends = [_shown(camera, np.column_stack([place, np.full(len(place), ground_m + up)])) for up in (0.0, PERSON_HEIGHT_M)]
    # NaN where an end is not in the image, which is not tall enough either.
    tall = np.linalg.norm(ends[0] - ends[1], axis=1) >= LEAST_PX
    return np.asarray(cells[tall], dtype=np.int64)


def _shown(camera: Camera, points: Floats) -> Floats:
    """(N, 2) pixels of points (N, 3) of the world; NaN where they are not in the image."""
    assert camera.pose is not None
    own = points @ camera.pose.R_cw.T + camera.pose.t_cw
    pixel = camera.lens.project_rays(own)
    inside = ((pixel >= 0) & (pixel <= np.array(camera.lens.size))).all(axis=1)
    ray = np.full_like(own, np.nan)
    ray[inside] = camera.lens.bearings(pixel[inside])
    with np.errstate(invalid="ignore"):
        same = np.linalg.norm(ray - own / np.linalg.norm(own, axis=1, keepdims=True), axis=1) < SAME_RAY
    return np.where((inside & same)[:, None], pixel, np.nan)
