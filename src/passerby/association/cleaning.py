"""Identities of single boxes, from a calibrated rig.

Tracklets are joined as wholes, but a box of a tracklet may show another person for a moment, and single detections belong to no
tracklet. At each instant the sightings of one person must meet in one position. Sightings that do not are assigned to the
person that they fit, or to none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Clock
from passerby.geometry.groups import least_of_groups
from passerby.geometry.ray_consensus import misses_by_instant, reassign_outliers, vote_points
from passerby.people.sightings import Sightings, poses_of

MEETING_SHARE, MEETING_FLOOR_PX = 0.15, 3.0
"""Largest distance between a sighting and the projection of its person's middle, as a share of its extent (half a box's width)
plus pixels, at which the sighting agrees."""
RIVAL, RIVAL_OF_TRACKED = 3.0, 1.0
"""A detection is assigned to a person only where all other people are at least this factor farther away; a sighting stays with
its own person unless another person is nearer."""


def reassign_detections(
    rig: Rig,
    bodies: Sequence[Sightings],
    person: Sequence[Ints],
    clocks: Mapping[str, Clock],
    grid: Clock,
    person_height_m: float,
) -> list[Ints]:
    """Determine the person of each body, camera by camera.

    Args:
        rig: calibrated; people of a camera without a pose are unchanged.
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
    parts = [
        _middles(rig.cameras[c], number, bodies[c].take(on), person[c][on], at)
        for number, (c, (on, at)) in enumerate(zip(posed, rows, strict=True))
    ]
    new = _settled(Sightings.joined(parts), *poses_of(rig, tuple(rig.names[c] for c in posed)), person_height_m)
    out = [column.copy() for column in person]
    start = 0
    for c, (on, _) in zip(posed, rows, strict=True):
        out[c][on] = new[start : start + len(on)]
        start += len(on)
    return out


def _middles(camera: Camera, number: int, seen: Sightings, person: Ints, step: Ints) -> Sightings:
    """Return the middles of one camera's people at common time steps."""
    ray = seen.top + seen.bottom
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return Sightings(
        np.full(len(seen), number), step, person, middle=ray, middle_tangent=camera.lens.tangents(ray), extent_px=seen.extent_px
    )


def _by_blocks(s: Sightings) -> tuple[Sightings, Sightings]:
    """Number the blocks, and return the first sighting of each too. A sighting without a person is a block of its own."""
    key = np.where(s.identity > UNKNOWN, s.identity, -2 - np.arange(len(s)))
    low = s.step.min(initial=0)
    span = int(s.step.max(initial=0) - low) + 1
    _, first, block = np.unique(key * span + (s.step - low), return_index=True, return_inverse=True)
    return replace(s, block=block.ravel()), s.take(first)


def _settled(s: Sightings, R: Floats, centre: Floats, person_height_m: float) -> Ints:
    """Determine the person (M,) of each sighting, by cameras with rotations (C, 3, 3) and centres (C, 3)."""
    s, blocks = _by_blocks(s)
    tolerance_px = MEETING_FLOOR_PX + MEETING_SHARE * s.extent_px
    consensus = vote_points(
        s.camera, s.block, s.middle, s.middle_tangent, tolerance_px, len(blocks), R, centre,
        height=(0.5 * person_height_m, 0.2 * person_height_m),
    )  # fmt: skip
    found = reassign_outliers(
        consensus, s.camera, s.block, s.step, blocks.step, s.middle, s.middle_tangent, tolerance_px, R, centre
    )
    for taken, times in ((found == s.block, RIVAL_OF_TRACKED), (found != s.block, RIVAL)):
        rows = np.flatnonzero((found >= 0) & taken)
        misses = misses_by_instant(
            consensus.points, blocks.step, s.camera[rows], s.step[rows], s.middle[rows], s.middle_tangent[rows], R, centre
        )
        found[rows[_has_rival(misses, found[rows], times)]] = -1
    person = np.where(found >= 0, blocks.identity[found], UNKNOWN)
    # A person that only one camera sees keeps the identity: no other camera contradicts it.
    met = ~np.isnan(consensus.points[:, 0])
    alone = (found < 0) & ~met[s.block] & (np.bincount(s.block, minlength=len(blocks))[s.block] == 1)
    return np.where(alone, s.identity, person)


def _has_rival(misses: Iterable[tuple[Ints, Ints, Floats]], found: Ints, times: float) -> Bools:
    """Check (K,) whether another person of a row's instant is less than `times` as far from the row as its own person.

    Args:
        misses: from `misses_by_instant`.
        found: (K,) block to which each row is assigned.
        times: factor on the distance to the row's own person.
    """
    best, rival = np.full(len(found), np.inf), np.zeros(len(found), dtype=bool)
    for which, candidate, miss in misses:
        own = candidate == found[which]
        best[which[own]] = miss[own]
        rival[which[~own & (miss < times * best[which])]] = True
    return rival


def _on_instants(bodies: Sightings, clock: Clock, grid: Clock) -> tuple[Ints, Ints]:
    """Return the rows of the frames that are nearest to an instant, and their instants."""
    frames = np.unique(bodies.step)
    at = grid.frames(clock.seconds(frames))
    instant = np.round(at).astype(np.int64)
    place = np.searchsorted(frames, bodies.step)
    rows = np.flatnonzero(np.isin(place, least_of_groups(instant, np.abs(at - instant))))
    return rows, instant[place[rows]]
