"""The people of one camera as tracks on the ground below it, sampled on a time grid.

Before anything is known of the other cameras, one camera's own people give its vertical and its height
(`geometry.single_view`), and from these the ground position of every foot. Positions and velocities are local straight-line
fits to the samples around each grid time, so that cameras of different frame rates and clocks become comparable.
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
"""Size of the cells in which a camera has seen people, metres: about a step, and the error of ground positions."""
MIN_TRACK_S = 1.0
"""Least length of a tracklet, seconds: shorter ones have no direction."""
FASTEST = 12.0
"""Metres per second. No person runs faster: it is a position near the horizon, or a tracklet that changes person."""
MAX_REACH_HEIGHTS = 25.0
"""Largest distance of feet, in camera heights. Feet farther away are within 2.3 degrees of the horizon, where a tilt of one
degree halves or doubles the distance."""


@dataclass(frozen=True)
class Tolerance:
    """Tolerances of a ground position: stride and box noise, and shares of the distance.

    The defaults hold for a camera levelled by its own people.
    """

    floor_m: float = 0.3
    along: float = 0.06
    """Share along the ray: remaining errors of the level's tilt and height."""
    across: float = 0.025
    """Share across the ray: remaining errors of the level's roll, and of the turn between two cameras."""
    foot_m: float = 0.0
    """Error of a foot's height, metres: it moves the position along the ray by this for each camera height of distance."""


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
        """(I,) grid times at which people are seen, ascending; (I,) first sample of each; (I,) number of samples of each."""
        return np.unique(self.step, return_index=True, return_counts=True)

    @cached_property
    def _walked(self) -> Ints:
        """Keys of the cells in which people were seen, and of their neighbours, sorted."""
        around = np.array([x + 1j * y for x in (-CELL_M, 0, CELL_M) for y in (-CELL_M, 0, CELL_M)])
        return np.unique(_cells((self.position[:, None] + around).ravel()))

    def covers(self, position: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Check (N,) whether the camera has seen people near each position."""
        if not len(self):
            return np.zeros(len(position), dtype=bool)
        key = _cells(position)
        at = np.minimum(np.searchsorted(self._walked, key), len(self._walked) - 1)
        return np.asarray(self._walked[at] == key)

    @cached_property
    def sigma(self) -> tuple[Floats, Floats]:
        """(N,) tolerances of the positions along their rays, and (N,) across them, metres."""
        reach, t = np.abs(self.position), self.tolerance
        return t.floor_m + (t.along + t.foot_m / self.level.height) * reach, t.floor_m + t.across * reach


def _cells(position: NDArray[np.complex128]) -> Ints:
    """Return the keys of the ground cells that contain positions."""
    x, y = (np.floor(part / CELL_M).astype(np.int64) for part in (position.real, position.imag))
    return np.asarray(x * 1_000_003 + y)


def ground_tracks(
    bodies: Sightings, level: Level, tolerance: Tolerance | None = None, *, shortest_s: float = MIN_TRACK_S
) -> GroundTracks:
    """Compute the ground tracks of the bodies that belong to a tracklet (identity > -1).

    Args:
        bodies: one camera's people with their times.
        level: the camera's vertical and height.
        tolerance: tolerances of its ground positions.
        shortest_s: shorter tracklets are left out, seconds.
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
