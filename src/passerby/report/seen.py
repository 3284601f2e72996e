"""Cameras and times at which people were seen, from the tracks: input of the timeline, the counts, and a large site's zones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.colours import camera_colour
from passerby.core.observations import UNKNOWN, Clock
from passerby.core.overlap import Shared
from passerby.report.contents import Contents

EMBEDDED_CAMERAS = 50
"""Most cameras of a report in one file: fifty pictures of 100 kB each and plotly's code are 10 MB."""
ZONE_CAMERAS = 16
"""Most cameras of a zone that is not stated: this many names are readable in a part of the map."""
MOST_NEIGHBOURS = 16
"""Most other cameras whose people are drawn into a camera's picture: an overlap of more cameras is rare on a site."""


@dataclass(frozen=True, eq=False)
class Spells:
    """N stretches of time in which a camera saw a person without a longer break, sorted by camera, then by beginning."""

    camera: Ints
    """(N,) position of the camera in the rig."""
    identity: Ints
    """(N,)"""
    begin: Floats
    """(N,) seconds if `in_seconds`, otherwise frames."""
    end: Floats
    """(N,) after `begin`, in the same unit."""
    in_seconds: bool

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def people(self) -> Ints:
        """The identities, each once."""
        return np.asarray(np.unique(self.identity), dtype=np.int64)

    @property
    def span(self) -> tuple[float, float]:
        """Earliest beginning and latest end; zeros without stretches."""
        return (float(self.begin.min()), float(self.end.max())) if len(self) else (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Seen:
    """Stretches and counts of the people seen, computed once for the whole page."""

    spells: Spells
    people: Mapping[str, int]
    """By camera, number of known people that it saw."""
    shared: Mapping[tuple[str, str], Shared]
    """By pair of cameras, in the order of the rig, the people that both saw at the same time. Pairs without a common person are
    not in it."""


BREAK_STEPS = 3.5
"""Longest gap within a stretch, in steps between samples: a detector misses a person in one or two consecutive samples."""


def find_seen(contents: Contents) -> Seen:
    """Collect the stretches of time in which each camera saw each person, and count the people seen and shared.

    Breaks of a few samples are closed. Two samples are at the same time if they are within half a step of the slower camera.
    """
    appearance = {name: _looks(contents, name) for name in contents.rig.names}
    timed = bool(contents.clocks) or contents.observations.fps is not None
    parts = [_stretches(place, look) for place, look in enumerate(appearance.values()) if len(look.who)]
    people = {name: len(np.unique(look.who)) for name, look in appearance.items()}
    return Seen(_sort_spells(np.concatenate(parts) if parts else np.zeros((0, 4)), timed), people, _share_by_pair(appearance))


def merge_spells(spells: Spells, most: int) -> Spells:
    """Merge stretches until about `most` are left: the shortest breaks are closed first; no person and no camera is lost."""
    if len(spells) <= most:
        return spells
    order = np.lexsort((spells.begin, spells.identity, spells.camera))
    camera, identity, begin, end = (column[order] for column in (spells.camera, spells.identity, spells.begin, spells.end))
    same = (camera[1:] == camera[:-1]) & (identity[1:] == identity[:-1])
    breaks = np.where(same, begin[1:] - end[:-1], np.inf)
    shortest = np.argsort(breaks, kind="stable")[: len(spells) - most]
    closed = np.zeros(len(spells), dtype=bool)
    closed[1 + shortest[np.isfinite(breaks[shortest])]] = True
    first = np.flatnonzero(~closed)
    ends = np.maximum.reduceat(end, first)
    table = np.column_stack([camera[first], identity[first], begin[first], ends])
    return _sort_spells(table, spells.in_seconds)


def lanes_of(begin: Floats, end: Floats) -> Ints:
    """Assign lanes (N,) to stretches sorted by beginning, without overlaps in a lane (greedy, the lowest free lane first)."""
    free: list[float] = []
    lanes = np.zeros(len(begin), dtype=np.int64)
    for row, (start, stop) in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
        lane = next((number for number, until in enumerate(free) if until <= start), len(free))
        if lane == len(free):
            free.append(stop)
        else:
            free[lane] = stop
        lanes[row] = lane
    return lanes


@dataclass(frozen=True, eq=False)
class _Looks:
    """N sightings of known people by one camera, sorted by person, then by time."""

    who: Ints
    """(N,) identities."""
    time: Floats
    """(N,) seconds, or frames if no frame rate is known."""
    step: float
    """Median time between two consecutive sightings of a person."""


def _looks(contents: Contents, name: str) -> _Looks:
    """Return the sightings of a camera; a person with a box and joints in one frame is one sighting."""
    seen, clock = contents.observations[name], contents.clocks.get(name) or Clock(contents.observations.fps or 1.0)
    frame = np.concatenate([seen.boxes.frame, seen.keypoints.frame])
    who = np.concatenate([seen.boxes.identity, seen.keypoints.identity])
    known = who > UNKNOWN
    order = np.lexsort((frame[known], who[known]))
    frame, who = frame[known][order], who[known][order]
    first = np.r_[True, (np.diff(frame) != 0) | (np.diff(who) != 0)] if len(who) else np.zeros(0, dtype=bool)
    frame, who = frame[first], who[first]
    time = clock.seconds(frame.astype(np.float64))
    steps = np.diff(time)[np.diff(who) == 0]
    return _Looks(who, time, float(np.median(steps)) if len(steps) else 1.0 / clock.fps)


def _stretches(place: int, look: _Looks) -> Floats:
    """Return (N, 4) camera, identity, begin, end of one camera's stretches."""
    starts = np.flatnonzero(np.r_[True, (np.diff(look.who) != 0) | (np.diff(look.time) > BREAK_STEPS * look.step)])
    ends = np.r_[starts[1:], len(look.who)] - 1
    columns = [np.full(len(starts), place), look.who[starts], look.time[starts], look.time[ends] + look.step]
    return np.asarray(np.column_stack(columns), dtype=np.float64)


def _share_by_pair(appearance: Mapping[str, _Looks]) -> dict[tuple[str, str], Shared]:
    """Count what pairs of cameras share, only for pairs that saw a common person: these are few of a site's pairs."""
    everybody = (
        np.unique(np.concatenate([look.who for look in appearance.values()])) if appearance else np.zeros(0, dtype=np.int64)
    )
    times = [look.time for look in appearance.values() if len(look.time)]
    begin = min((float(time.min()) for time in times), default=0.0)
    # One time axis for all people: each person's times follow those of the previous person, after a gap larger than any step.
    pitch = 3.0 * (max((float(time.max()) for time in times), default=0.0) - begin) + 10.0
    axis = {name: np.searchsorted(everybody, look.who) * pitch + look.time - begin for name, look in appearance.items()}
    names, found = list(appearance), {}
    for one, other in _find_pairs([np.searchsorted(everybody, look.who) for look in appearance.values()]):
        first, second = names[one], names[other]
        step = max(appearance[first].step, appearance[second].step)
        found[first, second] = _measure_shared(axis[first], axis[second], step, appearance[first].who)
    return found


def _find_pairs(who: Sequence[Ints]) -> list[tuple[int, int]]:
    """Find the pairs of cameras that saw a common person, sorted; `who` has the person number of each sighting, by camera."""
    people = [np.unique(rows) for rows in who]
    if not people:
        return []
    ends = np.cumsum([0, *map(len, people)])
    columns = np.concatenate(people)
    seen = csr_array((np.ones(len(columns), np.int64), columns, ends), shape=(len(people), int(columns.max(initial=0)) + 1))
    one, other = (seen @ seen.T).nonzero()
    return sorted((a, b) for a, b in zip(one.tolist(), other.tolist(), strict=True) if a < b)


def _measure_shared(first: Floats, second: Floats, step: float, who: Ints) -> Shared:
    """Count what two cameras share, from their sorted sightings on the common axis; `who` has the identities of the first."""
    if not len(first) or not len(second):
        return Shared(0, 0)
    after = np.searchsorted(second, first)
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(second) - 1)
    both = np.minimum(np.abs(first - second[before]), np.abs(second[after] - first)) <= 0.5 * step + 1e-9
    return Shared(len(np.unique(who[both])), int(np.count_nonzero(both)))


def _sort_spells(table: Floats, in_seconds: bool) -> Spells:
    """Return stretches from a table (N, 4), sorted by camera, then by beginning."""
    table = table[np.lexsort((table[:, 1], table[:, 2], table[:, 0]))]
    return Spells(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3], in_seconds)


def is_site(contents: Contents) -> bool:
    """Check whether the report has more cameras than fit into one file."""
    return len(contents.rig) > EMBEDDED_CAMERAS


def zones_of(contents: Contents) -> dict[str, int]:
    """Return the zone of each camera, from 1, by name, in the rig's order.

    If the scene states groups of cameras ([sites] groups), a camera's zone is the first group that contains it. Otherwise the
    cameras are halved along the longer side of the map until no part has more than `ZONE_CAMERAS`; then cameras without a pose
    have no zone.
    """
    stated = _read_groups(contents)
    if stated:
        found: dict[str, int] = {}
        for number, group in enumerate(stated, start=1):
            for name in group:
                found.setdefault(name, number)
        return {name: found[name] for name in contents.rig.names if name in found}
    posed = contents.rig.posed()
    parts = _split_into_zones(np.array([camera.centre[:2] for camera in posed]).reshape(-1, 2), np.arange(len(posed)))
    zone = {posed.names[row]: number for number, rows in enumerate(parts, start=1) for row in rows.tolist()}
    return {name: zone[name] for name in contents.rig.names if name in zone}


def zone_colour(zone: int) -> str:
    """Return the colour `#rrggbb` of a zone; zones count from 1."""
    return camera_colour(zone - 1)


def neighbours_of(rig: Rig, seen: Seen) -> Mapping[str, list[str]]:
    """Return, by camera, the up to `MOST_NEIGHBOURS` cameras with poses that share most observations with it, most first."""
    posed = set(rig.posed().names)
    shared: dict[str, list[tuple[int, str]]] = {name: [] for name in rig.names}
    for (first, second), both in seen.shared.items():
        if both.sightings and first in posed and second in posed:
            shared[first].append((both.sightings, second))
            shared[second].append((both.sightings, first))
    return {
        name: [other for _, other in sorted(found, key=lambda one: -one[0])[:MOST_NEIGHBOURS]] for name, found in shared.items()
    }


def _read_groups(contents: Contents) -> Sequence[Sequence[str]]:
    """Return the groups of cameras that the scene file states; empty if it states none."""
    sites = contents.document.scene.sites
    return (sites.groups if sites is not None else None) or ()


def _split_into_zones(places: Floats, rows: Ints) -> list[Ints]:
    """Split rows of positions (N, 2) into parts of at most `ZONE_CAMERAS` neighbours."""
    if len(rows) <= ZONE_CAMERAS:
        return [rows] if len(rows) else []
    own = places[rows]
    axis = int(np.argmax(own.max(axis=0) - own.min(axis=0)))
    order = rows[np.argsort(own[:, axis], kind="stable")]
    return [*_split_into_zones(places, order[: len(order) // 2]), *_split_into_zones(places, order[len(order) // 2 :])]
