"""Two groups of cameras registered by people who pass from one to the other, as through a door.

Each group is a rig of its own: scale and vertical are known, and what is missing is a turn, a shift and a lag of the clocks.
Where a track of one group ends, one of the other begins at about that time and place, seen by both for a moment or by neither.
A door is one place in either world: first come pairs of squares of ground in which more ends are near in time, at one lag, than
at others. There every two ends propose a shift for each turn, and every person has one vote. Chance is what the same ends reach
when one group walks backwards (surrogate data: Theiler et al., Physica D 1992), or with other lags: where people come and go in
crowds, as with trains, ends of different people are near in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from passerby.association.ground.pair_matching import GroundMotion
from passerby.common.arrays import Bools, Columns, Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.synchronisation import clocks_of
from passerby.geometry.groups import expanded_ranges, least_of_groups
from passerby.people.body_centres import PeopleRays, identified_body_centres

Complexes = NDArray[np.complex128]

GAP_S, SHORTEST_S = 2.0, 1.5
"""A person who is not seen for longer begins another track; shorter tracks are left out."""
WINDOW_S = 1.0
"""Part of a track by which the place and the velocity of its end are fitted."""
APART_S = 3.0
"""Two ends of one passage are no farther apart in time: what both groups see of it, or neither."""
LAG_STEP_S, TURNS, CELL_M = 0.5, 90, 1.0
"""Grid of the search."""
HALF_SQUARE_M, MOST_PLACES = 4.0, 64
"""Squares of ground have twice this side, and overlap by it: ends of tracks of people who pass a door are within 8 m. How many
pairs of squares, each at one lag, are searched for the turn."""
CELLS = 2 * int(np.ceil(2 * HALF_SQUARE_M * np.sqrt(2.0) / CELL_M))
"""On each axis, of the shifts between two squares."""
NUMBERS = 1 << 15
"""A square's number is this times its number on the x axis and that on the y axis: 130 km of ground."""
PLACE_SD_M, SPEED_SD_M_S = 0.3, 0.6
"""One standard deviation of a place by a track, and of how a person's velocity changes after its end: people turn in doors."""
MOST_SQUARE = 9.0
"""Squared miss, in standard deviations, from which an end belongs to another person."""
OTHER_LAGS_S = 20.0
"""Lags up to so much beyond those that are possible are tried as well, to know what chance reaches."""
DAMPING = (1.0, 1e-6, 1e-6, 1.0)
"""Added to the information on the steps of turn, shift and lag: people who all stand on one spot, or never walk, tell less."""
STARTS, STEPS = 18, 12
"""Turns from which the motion about the place found is fitted, and steps of each fit."""
CLEAR, FEWEST = 1.5, 12
"""Votes from which groups are joined: so many times those that chance reaches, and people. Simulated airports (seeds 801, 804,
806, 811 of 25 cameras, 820 of 100): 1.7 to 3 times at 18 doors, 1.3 times at most for pairs of groups that share no ground and
have so many."""


@dataclass(frozen=True, eq=False)
class TrackEnds(Columns):
    """E ends of the tracks of a group's people."""

    sense: Floats
    """(E,) 1 where a person disappears, -1 where one appears."""
    time_s: Floats
    """(E,) by the group's clock."""
    place: Complexes
    """(E,) x + iy in the group's world, metres."""
    velocity: Complexes
    """(E,) metres per second."""
    seen_by: Bools
    """(E, C) by which cameras of the group, near the end."""

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def by_time(self) -> TrackEnds:
        """In the order of time."""
        return self.take(np.argsort(self.time_s, kind="stable"))

    @property
    def backwards(self) -> TrackEnds:
        """The same people, walking backwards."""
        last = float(self.time_s.max(initial=0.0) + self.time_s.min(initial=0.0))
        return TrackEnds(-self.sense, last - self.time_s, self.place, -self.velocity, self.seen_by)


@dataclass(frozen=True, eq=False)
class Passage:
    """Two groups registered by the people who pass from one to the other."""

    motion: GroundMotion
    """From the first group's ground and clock to the second one's; `turn` has the length 1."""
    place: complex
    """Where people pass, in the first group's world, metres."""
    votes: int
    """People who pass there."""
    by_chance: int
    """Votes that chance reaches."""
    cameras: Ints
    """(C, C') times that one of them is seen by each camera of the first and each of the second group."""
    turn_known: bool = False
    """Whether what both groups see at one time determines the turn: ends of tracks alone are off by up to 30 degrees."""

    @property
    def needed(self) -> int:
        """Votes that are clear of chance."""
        return max(int(np.floor(CLEAR * self.by_chance)) + 1, FEWEST)

    @property
    def clear(self) -> bool:
        """Whether more people pass than by chance."""
        return self.votes >= self.needed


def find_track_ends(rig: Rig, instants: Observations, person_height_m: float) -> TrackEnds:
    """The ends of the tracks of a rig's people.

    Args:
        rig: world z up, ground at z = 0.
        instants: people with identities at common instants.
        person_height_m: typical standing height.
    """
    rays = PeopleRays.of(rig, identified_body_centres(rig, instants))
    people = rays.triangulated(person_height_m, np.ones(len(rays.camera), dtype=bool))
    clock = clocks_of(instants, rig.names)[rig.names[0]]
    seen_by = np.zeros((len(people), len(rig)), dtype=bool)
    seen_by[rays.person, rays.camera] = True
    seconds = clock.seconds(people.instant)
    order = np.lexsort((seconds, people.identity))
    identity, seconds, seen_by = people.identity[order], seconds[order], seen_by[order]
    place = people.place[order, 0] + 1j * people.place[order, 1]
    new = np.flatnonzero((np.diff(identity, prepend=-1) != 0) | (np.diff(seconds, prepend=0.0) > GAP_S))
    senses, times, places, velocities, cameras = [], [], [], [], []
    for begin, end in pairwise([*new.tolist(), len(identity)]):
        end -= 1
        if seconds[end] - seconds[begin] < SHORTEST_S:
            continue
        for sense, at in ((-1.0, begin), (1.0, end)):
            near = np.arange(begin, end + 1)
            near = near[np.abs(seconds[near] - seconds[at]) <= WINDOW_S]
            if len(near) < 3:
                continue
            since = seconds[near] - seconds[at]
            (velocity_x, x), (velocity_y, y) = (np.polyfit(since, part, 1) for part in (place[near].real, place[near].imag))
            senses.append(sense)
            times.append(seconds[at])
            places.append(complex(x, y))
            velocities.append(complex(velocity_x, velocity_y))
            cameras.append(seen_by[near].any(axis=0))
    return TrackEnds(
        np.array(senses), np.array(times), np.array(places, dtype=np.complex128), np.array(velocities, dtype=np.complex128),
        np.array(cameras, dtype=bool).reshape(-1, len(rig)),
    )  # fmt: skip


def register_by_passages(a: TrackEnds, b: TrackEnds, lags_s: tuple[float, float]) -> Passage | None:
    """Where people pass between two groups; None where no two ends are near in time.

    Args:
        a: ends of the first group's tracks.
        b: of the second one's.
        lags_s: from the least to the largest by which the second group's clock may show more.
    """
    b = b.by_time
    steps, beyond = int(np.ceil((lags_s[1] - lags_s[0]) / LAG_STEP_S)), int(OTHER_LAGS_S / LAG_STEP_S)
    lag_s: Floats = lags_s[0] + LAG_STEP_S * np.arange(-beyond, steps + beyond + 1, dtype=np.float64)
    possible = np.arange(len(lag_s))[beyond : beyond + steps + 1]
    places = _find_places(a, b, lag_s)
    most = _count_most_votes(a, b, places.densest(possible))
    if not most.votes:
        return None
    backwards, there = b.backwards.by_time, most.place
    others = np.flatnonzero(np.abs(lag_s - there.lag_s) >= 2 * APART_S)
    by_chance = max(
        _count_most_votes(a, backwards, [replace(there, lag_s=one) for one in lag_s[possible].tolist()]).votes,
        _count_most_votes(a, b, [replace(there, lag_s=one) for one in lag_s[others].tolist()]).votes,
        _count_most_votes(a, b, places.densest(others)).votes,
    )
    i, j, here, shift = _voters(a, b, most)
    found = Passage(
        GroundMotion(most.turn, shift, most.place.lag_s), here, most.votes, by_chance,
        a.seen_by[i].astype(np.int64).T @ b.seen_by[j].astype(np.int64),
    )  # fmt: skip
    if not found.clear:
        return found
    fits = [_fit(a, b, found, turn) for turn in np.exp(2j * np.pi * np.arange(STARTS) / STARTS).tolist()]
    best = max((fit for fit in fits if fit is not None), key=lambda fit: fit.gain, default=None)
    return found if best is None else replace(found, motion=best.motion)


@dataclass(frozen=True)
class _Place:
    """A square of ground in either world, in which people may pass, at one lag."""

    here: complex
    """Middles of the squares."""
    there: complex
    lag_s: float


@dataclass(frozen=True, eq=False)
class _Places:
    """Pairs of squares with ends that are near in time; a row for each lag."""

    square: Ints
    """(K, 2) numbers of the squares."""
    lag: Ints
    """(K,) number of the lag,"""
    lag_s: Floats
    """(L,) and all lags."""
    beyond: Floats
    """(K,) pairs of ends beyond the mean of all lags, by the standard deviation of chance."""

    def densest(self, lags: Ints) -> list[_Place]:
        """Those with most pairs beyond chance at some of the lags."""
        rows = np.flatnonzero(np.isin(self.lag, lags))
        rows = rows[np.argsort(-self.beyond[rows], kind="stable")[:MOST_PLACES]]
        x, y = np.divmod(self.square[rows], NUMBERS)
        here, there = (HALF_SQUARE_M * (x + 1j * y - (1 + 1j) * (NUMBERS // 2))).T.tolist()
        return [_Place(*one) for one in zip(here, there, self.lag_s[self.lag[rows]].tolist(), strict=True)]


def _find_places(a: TrackEnds, b: TrackEnds, lag_s: Floats) -> _Places:
    """In which squares ends are near in time at each lag."""
    found = []
    for number, one in enumerate(lag_s.tolist()):
        i, j, later = _pairs(a, b, one)
        here, there = (_squares(at) for at in _meeting(a, b, i, j, later))
        both = NUMBERS**2 * here[:, :, None] + there[:, None, :]
        pair, count = np.unique(both, return_counts=True)
        found.append(np.column_stack([pair, np.full(len(pair), number), count]))
    pair, lag, count = np.concatenate(found).T
    _, which = np.unique(pair, return_inverse=True)
    mean = np.bincount(which, count)[which] / len(lag_s)
    return _Places(np.column_stack(np.divmod(pair, NUMBERS**2)), lag, lag_s, (count - mean) / np.sqrt(mean + 1.0))


def _squares(at: Complexes) -> Ints:
    """(K, 4) the numbers of the four squares that have each place."""
    x, y = (np.floor(part / HALF_SQUARE_M).astype(np.int64) + NUMBERS // 2 for part in (at.real, at.imag))
    return np.column_stack([NUMBERS * (x + right) + y + up for right in (0, 1) for up in (0, 1)])


@dataclass(frozen=True)
class _Votes:
    """The turn and the shift of a place for which most people of one group meet one of the other."""

    votes: int
    place: _Place
    turn: complex
    shift: complex
    """Of the middle of the first square, turned, to that of the second."""


def _count_most_votes(a: TrackEnds, b: TrackEnds, places: Sequence[_Place]) -> _Votes:
    """The most votes of any place."""
    none = _Votes(0, _Place(0.0, 0.0, 0.0), 1.0, 0.0)
    return max((_count_votes(a, b, place) for place in places), key=lambda one: one.votes, default=none)


def _count_votes(a: TrackEnds, b: TrackEnds, place: _Place) -> _Votes:
    """The votes at one place."""
    i, _, here, there = _near(a, b, place)
    turns = np.exp(2j * np.pi * np.arange(TURNS) / TURNS)
    shift = (there - place.there) - turns[:, None] * (here - place.here)
    x, y = (np.floor(part / CELL_M).astype(np.int64) + CELLS // 2 for part in (shift.real, shift.imag))
    cell = (np.arange(TURNS)[:, None] * CELLS + x) * CELLS + y
    voter = np.unique(cell * len(a) + i)
    votes = np.bincount(voter // len(a), minlength=TURNS * CELLS * CELLS).reshape(TURNS, CELLS, CELLS)
    square = votes[:, :-1] + votes[:, 1:]
    square = square[:, :, :-1] + square[:, :, 1:]
    turn, *corner = np.unravel_index(int(square.argmax()), square.shape)
    right, up = (CELL_M * (int(at) + 1 - CELLS // 2) for at in corner)
    return _Votes(int(square.max()), place, complex(turns[turn]), complex(right, up))


def _pairs(a: TrackEnds, b: TrackEnds, lag_s: float) -> tuple[Ints, Ints, Floats]:
    """Ends of opposite senses that are near in time: rows of `a`, rows of `b`, and how much later b's are, seconds.

    Those of `b` are in the order of their times.
    """
    low, high = (np.searchsorted(b.time_s, a.time_s + lag_s + apart) for apart in (-APART_S, APART_S))
    i, j = expanded_ranges(low, high - low)
    opposite = a.sense[i] == -b.sense[j]
    i, j = i[opposite], j[opposite]
    return i, j, b.time_s[j] - a.time_s[i] - lag_s


def _near(a: TrackEnds, b: TrackEnds, place: _Place) -> tuple[Ints, Ints, Complexes, Complexes]:
    """Rows of `a` and of `b` that meet in the squares of a place, and where, in either world."""
    i, j, later = _pairs(a, b, place.lag_s)
    here, there = _meeting(a, b, i, j, later)
    near = (_farther(here, place.here) < HALF_SQUARE_M) & (_farther(there, place.there) < HALF_SQUARE_M)
    return i[near], j[near], here[near], there[near]


def _farther(at: Complexes, middle: complex) -> Floats:
    """The larger distance along x or y."""
    return np.maximum(np.abs((at - middle).real), np.abs((at - middle).imag))


def _voters(a: TrackEnds, b: TrackEnds, most: _Votes) -> tuple[Ints, Ints, complex, complex]:
    """Rows of `a` and of `b` that vote, where they are in the first world, and the shift from it to the second one."""
    i, j, here, there = _near(a, b, most.place)
    shift = (there - most.place.there) - most.turn * (here - most.place.here)
    near = _farther(shift, most.shift) <= CELL_M
    at = _median(here[near])
    return i[near], j[near], at, _median(there[near]) - most.turn * at


def _meeting(a: TrackEnds, b: TrackEnds, i: Ints, j: Ints, later: Floats) -> tuple[Complexes, Complexes]:
    """Where pairs of ends are halfway between their times."""
    return a.place[i] + a.velocity[i] * (later / 2), b.place[j] - b.velocity[j] * (later / 2)


def _median(places: Complexes) -> complex:
    return complex(np.median(places.real), np.median(places.imag))


@dataclass(frozen=True, eq=False)
class _Fit:
    motion: GroundMotion
    gain: float
    """How much better the passages fit than ends of other people would, nats."""


def _fit(a: TrackEnds, b: TrackEnds, found: Passage, turn: complex) -> _Fit | None:
    """The motion about a place that the passages fit best, from a first turn: robust Gauss-Newton steps."""
    there = found.motion.turn * found.place + found.motion.shift
    motion = GroundMotion(turn, there - turn * found.place, found.motion.lag_s)
    for step in range(STEPS):
        miss, at, velocity, sd = _matched(a, b, motion, 4.0 if step < STEPS // 4 else 1.0)
        if len(miss) < FEWEST // 2:
            return None
        weight = (1.0 / (1.0 + np.abs(miss / sd) ** 2) / sd**2).ravel()
        by_turn, ones = (1j * motion.turn * at).ravel(), np.ones(miss.size)
        x = np.column_stack([by_turn.real, ones, 0 * ones, -velocity.real.ravel()])
        y = np.column_stack([by_turn.imag, 0 * ones, ones, -velocity.imag.ravel()])
        normal = x.T @ (x * weight[:, None]) + y.T @ (y * weight[:, None]) + np.diag(DAMPING)
        gradient = (x * weight[:, None]).T @ miss.real.ravel() + (y * weight[:, None]).T @ miss.imag.ravel()
        turned, *shifted, later = (-np.linalg.solve(normal, gradient)).tolist()
        motion = GroundMotion(motion.turn * np.exp(1j * turned), motion.shift + complex(*shifted), motion.lag_s + later)
    miss, _, _, sd = _matched(a, b, motion, 1.0)
    square = np.mean(np.abs(miss / sd) ** 2, axis=1)
    return _Fit(motion, float(np.log((1 + MOST_SQUARE) / (1 + square)).sum()))


def _matched(a: TrackEnds, b: TrackEnds, motion: GroundMotion, wider: float) -> tuple[Complexes, Complexes, Complexes, Floats]:
    """Each end of `a` with the end of `b` that fits it best, where one does.

    Returns:
        At five times around each meeting, (K, 5) each: by how much they miss each other, metres; the place by `a`; the velocity
        by `b`; and the standard deviation of the miss.
    """
    i, j, later = _pairs(a, b, motion.lag_s)
    here, there = _meeting(a, b, i, j, later)
    near = np.abs(motion.turn * here + motion.shift - there) < 2 * MOST_SQUARE * PLACE_SD_M
    i, j, later = i[near], j[near], later[near]
    # Seconds from the end of a's track, and from that of b's, of five times about the middle.
    around = np.maximum(0.5, np.abs(later) / 2)[:, None] * np.linspace(-1.0, 1.0, 5)
    from_a, from_b = later[:, None] / 2 + around, around - later[:, None] / 2
    at = a.place[i, None] + a.velocity[i, None] * from_a
    miss = motion.turn * at + motion.shift - b.place[j, None] - b.velocity[j, None] * from_b
    sd = np.sqrt(
        PLACE_SD_M**2
        + sum(
            (SPEED_SD_M_S * np.maximum(beyond, 0.0)) ** 2
            for sense, since in ((a.sense[i, None], from_a), (b.sense[j, None], from_b))
            for beyond in (sense * since, -sense * since - WINDOW_S)
        )
    )
    square = np.mean(np.abs(miss / sd) ** 2, axis=1)
    best = least_of_groups(i, square)
    best = best[square[best] < wider * MOST_SQUARE]
    velocity = np.broadcast_to(b.velocity[j, None], miss.shape)
    return miss[best], at[best], velocity[best], sd[best]
