"""Box by box: who is who where a calibrated rig can tell.

Tracklets are joined as wholes, but a box of a tracklet may show somebody else for a moment, and single detections belong to no
tracklet. At each instant the sightings of one person must meet in one place; those that do not are given to the person whom
they show, or to nobody.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from passerby.association.bodies import Bodies
from passerby.cameras import Camera, Rig
from passerby.observations import UNKNOWN, Clock
from passerby.solver.consensus import adopt, agree, ray_misses

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MEETING_SHARE, MEETING_FLOOR_PX = 0.15, 3.0
"""A sighting agrees when the middle of its person projects within so much of its extent: half a box's breadth."""

RIVAL, RIVAL_OF_TRACKED = 3.0, 1.0
"""A detection goes to somebody only where everybody else is so many times farther off; one of a tracklet stays with its person
unless somebody else is nearer."""


def clean(
    rig: Rig, bodies: Sequence[Bodies], person: Sequence[Ints], clocks: Mapping[str, Clock], grid: Clock, body_m: float
) -> list[Ints]:
    """The person of each body, camera by camera.

    Args:
        rig: calibrated; a camera without a pose keeps what it has.
        bodies: people of each camera.
        person: (N,) for each camera, the person of each body, or -1.
        clocks: each camera's clock.
        grid: the clock of the common instants.
        body_m: typical standing height, metres.
    """
    posed = [(c, camera) for c, camera in enumerate(rig) if camera.pose is not None]
    if len(posed) < 2:
        return list(person)
    rows = [_on_instants(bodies[c], clocks[camera.name], grid) for c, camera in posed]
    index = np.concatenate([np.full(len(on), k) for k, (on, _) in enumerate(rows)])
    instant = np.concatenate([at for _, at in rows])
    who = np.concatenate([person[c][on] for (c, _), (on, _) in zip(posed, rows, strict=True)])
    parts = [bodies[c].take(on) for (c, _), (on, _) in zip(posed, rows, strict=True)]
    ray, tangent, extent = (
        np.concatenate(columns)
        for columns in zip(*(_middles(p, cam) for p, (_, cam) in zip(parts, posed, strict=True)), strict=True)
    )
    block, n_blocks, block_instant, block_person = _blocks(instant, who)
    R = np.array([camera.pose.R_cw for _, camera in posed if camera.pose is not None])
    centre = np.array([camera.pose.centre for _, camera in posed if camera.pose is not None])
    tolerance = MEETING_FLOOR_PX + MEETING_SHARE * extent
    consensus = agree(index, block, ray, tangent, tolerance, n_blocks, R, centre, height=(0.5 * body_m, 0.2 * body_m))
    found = adopt(consensus, index, block, instant, block_instant, ray, tangent, tolerance, R, centre)
    for taken, rival in ((found != block, RIVAL), (found == block, RIVAL_OF_TRACKED)):
        of = np.flatnonzero((found >= 0) & taken)
        doubtful = _has_rival(consensus.points, block_instant, found, instant, of, index, ray, tangent, R, centre, rival)
        found[of[doubtful]] = -1
    met = ~np.isnan(consensus.points[:, 0])
    # Nobody contradicts a person whom one camera alone sees.
    alone = (found < 0) & ~met[block] & (who > UNKNOWN) & (np.bincount(block, minlength=n_blocks)[block] == 1)
    new = np.where(found >= 0, block_person[found], np.where(alone, who, UNKNOWN))
    out = [column.copy() for column in person]
    start = 0
    for (c, _), (on, _) in zip(posed, rows, strict=True):
        out[c][on] = new[start : start + len(on)]
        start += len(on)
    return out


def _has_rival(
    points: Floats, block_instant: Ints, found: Ints, instant: Ints, rows: Ints, index: Ints, ray: Floats, tangent: Floats,
    R: Floats, centre: Floats, rival: float,
) -> NDArray[np.bool_]:  # fmt: skip
    """Which rows show another person of their instant nearly as well as the one who took them."""
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    by_instant = known[np.argsort(block_instant[known], kind="stable")]
    first = np.searchsorted(block_instant[by_instant], instant[rows])
    count = np.searchsorted(block_instant[by_instant], instant[rows], side="right") - first
    which = np.repeat(np.arange(len(rows)), count)
    candidate = by_instant[np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(which))]
    row = rows[which]
    miss = ray_misses(points[candidate], index[row], ray[row], tangent[row], R, centre)
    own = candidate == found[row]
    best = np.full(len(rows), np.inf)
    best[which[own]] = miss[own]
    return np.bincount(which[~own & (miss < rival * best[which])], minlength=len(rows)) > 0


def _on_instants(bodies: Bodies, clock: Clock, grid: Clock) -> tuple[Ints, Ints]:
    """Rows of the frames that are nearest to an instant, and the instants."""
    frames = np.unique(bodies.frame)
    at = grid.frames(clock.seconds(frames))
    instant = np.round(at).astype(np.int64)
    order = np.lexsort((np.abs(at - instant), instant))
    _, first = np.unique(instant[order], return_index=True)
    nearest = order[first]
    place = np.searchsorted(frames, bodies.frame)
    rows = np.flatnonzero(np.isin(place, nearest))
    return rows, instant[place[rows]]


def _middles(bodies: Bodies, camera: Camera) -> tuple[Floats, Floats, Floats]:
    """Rays (N, 3), tangents (N, 2, 3) and extents (N,) of the bodies' middles."""
    ray = bodies.top + bodies.bottom
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return ray, camera.lens.tangents(ray), bodies.extent_px


def _blocks(instant: Ints, who: Ints) -> tuple[Ints, int, Ints, Ints]:
    """Person-instants: (M,) block of each row, their number, and the instant and the person of each.

    A row of nobody is a block of its own.
    """
    n = len(instant)
    key = np.where(who > UNKNOWN, who, -2 - np.arange(n))
    low = instant.min(initial=0)
    span = int(instant.max(initial=0) - low) + 1
    blocks, first, block = np.unique(key * span + (instant - low), return_index=True, return_inverse=True)
    return block.ravel(), len(blocks), instant[first], who[first]
