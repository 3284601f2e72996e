"""The people of one camera as tracks on the ground below it, sampled on a grid of time.

Before anything is known of the other cameras, one camera's own people give its vertical and its height
(`geometry.single_view`), and so a place on the ground to every foot. Positions and velocities are local straight-line fits to
the samples around each grid time, so that cameras of different frame rates and clocks become comparable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from passerby.association.sampling import interpolate_samples
from passerby.common.arrays import Floats, Ints
from passerby.geometry.single_view import Level
from passerby.people.sightings import Sightings

CELL_M = 1.0
"""Cells in which a camera has seen people: about a step, and what ground positions are off by."""
MIN_TRACK_S = 1.0
"""Shorter tracklets have no direction."""
FASTEST = 12.0
"""Metres per second: no person runs faster, so that it is a place near the horizon, or a tracklet that changes person."""
MAX_REACH_HEIGHTS = 25.0
"""Feet farther off than so many camera heights lie within 2.3 degrees of the horizon, where a tilt of one degree halves or
doubles the distance."""


@dataclass(frozen=True)
class Tolerance:
    """How far off a ground position may be: stride and box noise, and shares of the distance.

    The defaults hold for a camera levelled by its own people.
    """

    floor_m: float = 0.3
    along: float = 0.06
    """Along the ray: what is left of the level's tilt and height."""
    across: float = 0.025
    """Across the ray: what is left of its roll, and of the turn between two cameras."""
    foot_m: float = 0.0
    """Height by which a foot is off: it moves the place along the ray by so much for each camera height of distance."""


@dataclass(frozen=True, eq=False)
class GroundTracks:
    """Tracks on the ground of one camera: N samples of its tracklets at grid times, sorted by time.

    The frame is the camera's own, levelled: origin below the camera, z up, the view's heading along +y.
    """

    level: Level
    tolerance: Tolerance
    step: Ints
    """(N,) grid times: the camera's time is `step * STEP_S`."""
    tracklet: Ints
    """(N,) tracklet numbers."""
    position: NDArray[np.complex128]
    """(N,) x + iy, metres."""
    velocity: NDArray[np.complex128]
    """(N,) metres per second."""

    def __len__(self) -> int:
        return len(self.step)

    @cached_property
    def instants(self) -> tuple[Ints, Ints, Ints]:
        """(I,) the grid times at which people are seen, ascending, (I,) the first sample of each, and (I,) their number."""
        return np.unique(self.step, return_index=True, return_counts=True)

    @cached_property
    def _walked(self) -> Ints:
        """Keys of the cells in which people were seen, and of their neighbours, sorted."""
        around = np.array([x + 1j * y for x in (-CELL_M, 0, CELL_M) for y in (-CELL_M, 0, CELL_M)])
        return np.unique(_cells((self.position[:, None] + around).ravel()))

    def covers(self, position: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """(N,) whether the camera has seen people about there."""
        if not len(self):
            return np.zeros(len(position), dtype=bool)
        key = _cells(position)
        at = np.minimum(np.searchsorted(self._walked, key), len(self._walked) - 1)
        return np.asarray(self._walked[at] == key)

    @cached_property
    def sigma(self) -> tuple[Floats, Floats]:
        """(N,) how far off a position may be along its ray and (N,) across it, metres."""
        reach, t = np.abs(self.position), self.tolerance
        return t.floor_m + (t.along + t.foot_m / self.level.height) * reach, t.floor_m + t.across * reach


def _cells(position: NDArray[np.complex128]) -> Ints:
    """Keys of the cells of the ground that positions lie in."""
    x, y = (np.floor(part / CELL_M).astype(np.int64) for part in (position.real, position.imag))
    return np.asarray(x * 1_000_003 + y)


def ground_tracks(
    bodies: Sightings, level: Level, tolerance: Tolerance | None = None, *, shortest_s: float = MIN_TRACK_S
) -> GroundTracks:
    """Tracks of the bodies that belong to a tracklet (identity > -1).

    Args:
        bodies: one camera's people with their times.
        level: the camera's vertical and height.
        tolerance: how far off its ground positions may be.
        shortest_s: shorter tracklets are left out.
    """
    ground = level.ground_positions(bodies.bottom)
    use = np.isfinite(ground).all(axis=1) & (bodies.identity >= 0)
    use &= np.linalg.norm(np.nan_to_num(ground), axis=1) < MAX_REACH_HEIGHTS * level.height
    order = np.lexsort((bodies.seconds[use], bodies.identity[use]))
    tracklet, seconds = bodies.identity[use][order], bodies.seconds[use][order]
    place = (ground[use, 0] + 1j * ground[use, 1])[order]
    found = interpolate_samples(tracklet, seconds, place[:, None], shortest_s=shortest_s, two_suffice=True)
    position, velocity = found.value[:, 0], found.rate[:, 0]
    order = np.argsort(found.step, kind="stable")
    order = order[np.abs(velocity[order]) < FASTEST]
    return GroundTracks(
        level, tolerance or Tolerance(), found.step[order], found.tracklet[order], position[order], velocity[order]
    )
