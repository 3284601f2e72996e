"""Who was seen where and when, from the tracks: what the timeline and the counts are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.observations import CameraObservations, Clock, Floats, Ints
from passerby.report.contents import Contents
from passerby.sharing import Shared, person_instants


@dataclass(frozen=True, eq=False)
class Spells:
    """Stretches of time in which a camera saw a person without a longer break; N of them, by camera, then by beginning."""

    camera: Ints
    """(N,) place in the rig."""
    identity: Ints
    """(N,)"""
    begin: Floats
    """(N,) seconds where `in_seconds`, else frames."""
    end: Floats
    """(N,) after `begin`."""
    in_seconds: bool

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def people(self) -> Ints:
        """The identities, each once."""
        return np.asarray(np.unique(self.identity), dtype=np.int64)

    @property
    def span(self) -> tuple[float, float]:
        """When the first begins and the last ends; zeros where there is none."""
        return (float(self.begin.min()), float(self.end.max())) if len(self) else (0.0, 0.0)


BREAK_STEPS = 3.5
"""A person who is missed in this many samples in a row is not seen without a break: a detector misses one or two."""


def spells_of(contents: Contents) -> Spells:
    """The stretches, with breaks of a few samples closed."""
    timed = bool(contents.clocks) or contents.observations.fps is not None
    parts = []
    for place, name in enumerate(contents.rig.names):
        rows = person_instants(contents.observations[name])
        if len(rows):
            parts.append(_of_camera(place, rows, _clock(contents, name)))
    table = np.concatenate(parts) if parts else np.zeros((0, 4))
    return Spells(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3], timed)


def merged(spells: Spells, most: int) -> Spells:
    """At most about `most` stretches: the shortest breaks are closed first; nobody and no camera is lost."""
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
    return _sorted(table, spells.in_seconds)


def lanes_of(begin: Floats, end: Floats) -> Ints:
    """(N,) lanes for stretches that are sorted by their beginning, so that no two overlap in one (greedy, the lowest first)."""
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


def people_seen(seen: CameraObservations) -> int:
    """How many known people a camera saw."""
    return len(np.unique(person_instants(seen)[:, 1]))


def shared_between(contents: Contents) -> Mapping[tuple[str, str], Shared]:
    """For every two cameras, by their order in the rig, the people that both saw, and their instants.

    With clocks, samples within half a step of the slower camera's are one instant.
    """
    names = contents.rig.names
    instants = {name: _ticks(contents, name) for name in names}
    found = {}
    for index, first in enumerate(names):
        for second in names[index + 1 :]:
            found[first, second] = _shared(instants[first], instants[second])
    return found


def _shared(first: tuple[Floats, Ints], second: tuple[Floats, Ints]) -> Shared:
    """What two cameras have in common, from (times, identities) of each."""
    (time_a, who_a), (time_b, who_b) = first, second
    if not len(time_a) or not len(time_b):
        return Shared(0, 0)
    step = max(_step(time_a, who_a), _step(time_b, who_b))
    sightings, people = 0, 0
    for identity in np.intersect1d(who_a, who_b):
        a, b = np.sort(time_a[who_a == identity]), np.sort(time_b[who_b == identity])
        near = np.searchsorted(b, a)
        distance = np.minimum(np.abs(a - b[np.clip(near - 1, 0, len(b) - 1)]), np.abs(a - b[np.clip(near, 0, len(b) - 1)]))
        both = int(np.count_nonzero(distance <= step / 2))
        sightings, people = sightings + both, people + (both > 0)
    return Shared(people, sightings)


def _ticks(contents: Contents, name: str) -> tuple[Floats, Ints]:
    """Times and identities of a camera's sightings."""
    rows = person_instants(contents.observations[name])
    return _clock(contents, name).seconds(rows[:, 0].astype(np.float64)), rows[:, 1]


def _step(time: Floats, who: Ints) -> float:
    """The usual step between two samples of one person; of frames without a clock at most 1."""
    order = np.lexsort((time, who))
    steps = np.diff(time[order])[np.diff(who[order]) == 0]
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0


def _clock(contents: Contents, name: str) -> Clock:
    """A camera's clock; frames count as seconds where no frame rate is known."""
    return contents.clocks.get(name) or Clock(contents.observations.fps or 1.0)


def _of_camera(place: int, rows: Ints, clock: Clock) -> Floats:
    """(N, 4) camera, identity, begin, end of one camera's stretches."""
    rows = rows[np.lexsort((rows[:, 0], rows[:, 1]))]
    time, who = clock.seconds(rows[:, 0].astype(np.float64)), rows[:, 1]
    step = _step(time, who) or 1.0 / clock.fps
    starts = np.flatnonzero(np.r_[True, (np.diff(who) != 0) | (np.diff(time) > BREAK_STEPS * step)])
    ends = np.r_[starts[1:], len(rows)] - 1
    table = np.column_stack([np.full(len(starts), place), who[starts], time[starts], time[ends] + step])
    return np.asarray(table[np.argsort(table[:, 2], kind="stable")], dtype=np.float64)


def _sorted(table: Floats, in_seconds: bool) -> Spells:
    """Stretches from a table, by camera, then by beginning."""
    table = table[np.lexsort((table[:, 1], table[:, 2], table[:, 0]))]
    return Spells(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3], in_seconds)
