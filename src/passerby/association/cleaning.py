"""Box by box: identities where a calibrated rig determines them.

Tracklets are joined as wholes, but a box of a tracklet may show another person for a moment, and single detections belong to no
tracklet. At each instant the sightings of one person must meet in one place; those that do not are given to the person whom
they show, or to none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Clock
from passerby.geometry.groups import least_of_groups
from passerby.geometry.ray_consensus import Consensus, misses_by_instant, reassign_outliers, vote_points
from passerby.people.upright_rays import UprightRays

Mask = NDArray[np.bool_]

MEETING_SHARE, MEETING_FLOOR_PX = 0.15, 3.0
"""A sighting agrees when the middle of its person projects within so much of its extent: half a box's breadth."""
RIVAL, RIVAL_OF_TRACKED = 3.0, 1.0
"""A detection is assigned to a person only where all others are so many times farther away; one of a tracklet stays with
its person unless another person is nearer."""


@dataclass(frozen=True, eq=False)
class _Sightings:
    """M people at common instants, of all registered cameras."""

    camera: Ints
    """(M,) index among the registered."""
    instant: Ints
    person: Ints
    """(M,) or -1"""
    ray: Floats
    """(M, 3) to the middle, camera frame."""
    tangent: Floats
    extent_px: Floats
    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""

    @classmethod
    def of(
        cls, bodies: Sequence[UprightRays], person: Sequence[Ints], instant: Sequence[Ints], cameras: Sequence[Camera]
    ) -> _Sightings:
        """The people of the registered cameras, camera after camera."""
        camera = np.concatenate([np.full(len(seen), k) for k, seen in enumerate(bodies)])
        top, bottom = (np.concatenate([getattr(seen, name) for seen in bodies]) for name in ("top", "bottom"))
        ray = top + bottom
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        tangent = np.concatenate([own.lens.tangents(ray[camera == k]) for k, own in enumerate(cameras)])
        poses = [own.pose for own in cameras if own.pose is not None]
        return cls(
            camera, np.concatenate(instant), np.concatenate(person), ray, tangent,
            np.concatenate([seen.extent_px for seen in bodies]),
            np.array([pose.R_cw for pose in poses]), np.array([pose.centre for pose in poses]),
        )  # fmt: skip

    @property
    def tolerance_px(self) -> Floats:
        """(M,)"""
        return MEETING_FLOOR_PX + MEETING_SHARE * self.extent_px


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Person-instants; a sighting without an identity is one of its own."""

    of_row: Ints
    """(M,)"""
    instant: Ints
    """(N,)"""
    person: Ints

    @classmethod
    def of(cls, s: _Sightings) -> _Blocks:
        """The person-instants of M sightings."""
        key = np.where(s.person > UNKNOWN, s.person, -2 - np.arange(len(s.person)))
        low = s.instant.min(initial=0)
        span = int(s.instant.max(initial=0) - low) + 1
        _, first, block = np.unique(key * span + (s.instant - low), return_index=True, return_inverse=True)
        return cls(block.ravel(), s.instant[first], s.person[first])


def reassign_detections(
    rig: Rig,
    bodies: Sequence[UprightRays],
    person: Sequence[Ints],
    clocks: Mapping[str, Clock],
    grid: Clock,
    person_height_m: float,
) -> list[Ints]:
    """The person of each body, camera by camera.

    Args:
        rig: calibrated; a camera without a pose keeps what it has.
        bodies: people of each camera.
        person: (N,) for each camera, the person of each body, or -1.
        clocks: each camera's clock.
        grid: the clock of the common instants.
        person_height_m: typical standing height, metres.
    """
    posed = [c for c, camera in enumerate(rig) if camera.pose is not None]
    if len(posed) < 2:
        return list(person)
    rows = [_on_instants(bodies[c], clocks[rig.names[c]], grid) for c in posed]
    sightings = _Sightings.of(
        [bodies[c].take(on) for c, (on, _) in zip(posed, rows, strict=True)],
        [person[c][on] for c, (on, _) in zip(posed, rows, strict=True)],
        [at for _, at in rows], [rig.cameras[c] for c in posed],
    )  # fmt: skip
    new = _settled(sightings, person_height_m)
    out = [column.copy() for column in person]
    start = 0
    for c, (on, _) in zip(posed, rows, strict=True):
        out[c][on] = new[start : start + len(on)]
        start += len(on)
    return out


def _settled(s: _Sightings, person_height_m: float) -> Ints:
    """(M,) the person of each sighting."""
    blocks = _Blocks.of(s)
    n_blocks = len(blocks.instant)
    consensus = vote_points(
        s.camera,
        blocks.of_row,
        s.ray,
        s.tangent,
        s.tolerance_px,
        n_blocks,
        s.R,
        s.centre,
        height=(0.5 * person_height_m, 0.2 * person_height_m),
    )
    found = reassign_outliers(
        consensus, s.camera, blocks.of_row, s.instant, blocks.instant, s.ray, s.tangent, s.tolerance_px, s.R, s.centre
    )
    for taken, times in ((found == blocks.of_row, RIVAL_OF_TRACKED), (found != blocks.of_row, RIVAL)):
        rows = np.flatnonzero((found >= 0) & taken)
        found[rows[_has_rival(s, blocks, consensus, found, rows, times)]] = -1
    person = np.where(found >= 0, blocks.person[found], UNKNOWN)
    # No other camera contradicts a person whom one camera alone sees.
    met = ~np.isnan(consensus.points[:, 0])
    alone = (found < 0) & ~met[blocks.of_row] & (np.bincount(blocks.of_row, minlength=n_blocks)[blocks.of_row] == 1)
    return np.where(alone, s.person, person)


def _has_rival(s: _Sightings, blocks: _Blocks, consensus: Consensus, found: Ints, rows: Ints, times: float) -> Mask:
    """Which rows have another person of their instant less than `times` as far from them as the one who took them."""
    best, rival = np.full(len(rows), np.inf), np.zeros(len(rows), dtype=bool)
    for which, candidate, miss in misses_by_instant(
        consensus.points, blocks.instant, s.camera[rows], s.instant[rows], s.ray[rows], s.tangent[rows], s.R, s.centre
    ):
        own = candidate == found[rows[which]]
        best[which[own]] = miss[own]
        rival[which[~own & (miss < times * best[which])]] = True
    return rival


def _on_instants(bodies: UprightRays, clock: Clock, grid: Clock) -> tuple[Ints, Ints]:
    """Rows of the frames that are nearest to an instant, and the instants."""
    frames = np.unique(bodies.frame)
    at = grid.frames(clock.seconds(frames))
    instant = np.round(at).astype(np.int64)
    place = np.searchsorted(frames, bodies.frame)
    rows = np.flatnonzero(np.isin(place, least_of_groups(instant, np.abs(at - instant))))
    return rows, instant[place[rows]]
