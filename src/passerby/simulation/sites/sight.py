"""Which ground each camera of a site sees: within a range, inside the image, and not through walls.

The ground is a raster of `CELL_M`. A camera looks only at the cells around it, and is compared only with cameras whose cells
it can share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera
from passerby.simulation.lenses import before_fold
from passerby.simulation.sites.plan import SitePlan

CELL_M = 0.5
RANGE_M = 24.0
"""People farther away are not detected: they are about 60 pixels high there."""
STANDING_M = 1.7
"""A cell is seen where a person of this height is in the image as a whole."""
RAY_STEP_M = 0.25
SIDE = 0.25
"""People whose feet and head are farther outside the image than this share of its width are not in it at all."""


@dataclass(frozen=True, eq=False)
class Sight:
    """The cells around one camera."""

    floor: int
    corner: tuple[int, int]
    """Of the window: its first cell's numbers along x and y."""
    in_view: Bools
    """(X, Y) cells in range, to which no wall bars the view, on which a part of a person may be in the image."""
    seen: Bools
    """(X, Y) those of them on which a standing person is whole in the image."""

    def lets_see(self, xy: Floats) -> Bools:
        """(...) whether a part of a person at places (..., 2) of this floor may be in the image."""
        cell = np.floor(np.asarray(xy) / CELL_M).astype(np.int64) - self.corner
        inside = np.asarray(((cell >= 0) & (cell < self.in_view.shape)).all(axis=-1))
        cell = np.where(inside[..., None], cell, 0)
        return np.asarray(inside & self.in_view[cell[..., 0], cell[..., 1]])

    @property
    def cells(self) -> Ints:
        """(N, 2) numbers of the cells that are seen."""
        return np.argwhere(self.seen) + self.corner


def sight_of(camera: Camera, plan: SitePlan, index: int, free: Sequence[tuple[float, float, float, float]]) -> Sight:
    """What one camera sees.

    Args:
        camera: with its pose.
        plan: of the site.
        index: the camera's number.
        free: where the camera's floor is open (`SitePlan.free`).
    """
    mount = plan.mounts[index]
    reach = int(np.ceil(RANGE_M / CELL_M))
    centre = np.floor(np.array(mount.ground) / CELL_M).astype(np.int64)
    corner = centre - reach
    size = 2 * reach + 1
    is_open = np.zeros((size, size), dtype=np.bool_)
    for x_low, y_low, x_high, y_high in free:
        low = np.clip(np.floor(np.array([x_low, y_low]) / CELL_M).astype(np.int64) - corner, 0, size)
        high = np.clip(np.ceil(np.array([x_high, y_high]) / CELL_M).astype(np.int64) - corner, 0, size)
        is_open[low[0] : high[0], low[1] : high[1]] = True
    cells = np.argwhere(is_open)
    ground: Floats = np.asarray((cells + corner + 0.5) * CELL_M, dtype=np.float64)
    away = ground - mount.ground
    distance = np.hypot(away[:, 0], away[:, 1])
    near = np.flatnonzero(distance <= RANGE_M)
    partly, whole = _in_image(camera, ground[near], plan.floor_z_m[mount.floor])
    near, whole = near[partly], whole[partly]
    cells, away, distance = cells[near], away[near], distance[near]
    steps = np.arange(RAY_STEP_M, RANGE_M, RAY_STEP_M)
    along = np.minimum(steps, distance[:, None])[..., None] / np.maximum(distance, 1e-9)[:, None, None]
    on_way = np.floor((mount.ground + along * away[:, None]) / CELL_M).astype(np.int64) - corner
    clear = is_open[on_way[..., 0], on_way[..., 1]].all(axis=1)
    cells, whole = cells[clear], whole[clear]
    in_view, seen = np.zeros_like(is_open), np.zeros_like(is_open)
    in_view[cells[:, 0], cells[:, 1]] = True
    seen[cells[whole, 0], cells[whole, 1]] = True
    return Sight(mount.floor, (int(corner[0]), int(corner[1])), in_view, seen)


def _in_image(camera: Camera, ground: Floats, floor_z_m: float) -> tuple[Bools, Bools]:
    """(N,) where a part of a standing person may be in the image, and (N,) where the whole of one is."""
    assert camera.pose is not None
    size = np.array(camera.lens.size)
    inside = []
    for height in (0.0, STANDING_M):
        points = np.column_stack([ground, np.full(len(ground), floor_z_m + height)])
        own = points @ camera.pose.R_cw.T + camera.pose.t_cw
        front = (own[:, 2] > 0.3) & before_fold(camera.lens, own)
        pixel = camera.lens.project_rays(np.where(front[:, None], own, np.array([0.0, 0.0, 1.0])))
        beside = front & (pixel[:, 0] > -SIDE * size[0]) & (pixel[:, 0] < (1 + SIDE) * size[0])
        inside.append((beside, front & ((pixel > 0) & (pixel < size)).all(axis=1)))
    (foot_near, foot_in), (head_near, head_in) = inside
    return foot_near | head_near, foot_in & head_in


def shared_ground(sights: Sequence[Sight]) -> dict[tuple[int, int], float]:
    """Pairs of cameras that see ground in common: square metres, by numbers a < b."""
    owners: dict[tuple[int, int, int], list[int]] = {}
    for index, sight in enumerate(sights):
        for x, y in sight.cells.tolist():
            owners.setdefault((sight.floor, x, y), []).append(index)
    found: dict[tuple[int, int], int] = {}
    for cameras in owners.values():
        for k, a in enumerate(cameras):
            for b in cameras[k + 1 :]:
                found[a, b] = found.get((a, b), 0) + 1
    return {pair: count * CELL_M**2 for pair, count in sorted(found.items())}
