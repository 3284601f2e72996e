"""Registration of two groups of cameras by people who pass from one to the other, as through a door.

Each group is a rig of its own: scale and vertical are known. The turn, the shift and the lag of the clocks are unknown. Where a
track of one group ends, one of the other begins at about that time and place; both groups or neither see the person for a
moment. A door is one place in either world. First, pairs of squares of ground are found in which more ends are near in time at
one lag than at other lags. There every two ends propose a shift for each turn, and every person has one vote. The number of
votes by chance is measured with one group walking backwards (surrogate data: Theiler et al., Physica D 1992), and at other
lags: where people come and go in crowds, as with trains, ends of different people are near in time.
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
"""Longest time without sightings within a track, and shortest track that is used, seconds."""
WINDOW_S = 1.0
"""Length of the part of a track, seconds, to which the position and the velocity of its end are fitted."""
APART_S = 3.0
"""Largest time between two ends of one passage, seconds: the time that both groups, or neither, see the person."""
LAG_STEP_S, TURNS, CELL_M = 0.5, 90, 1.0
"""Grid of the search."""
HALF_SQUARE_M, MOST_PLACES = 4.0, 64
"""Squares of ground have twice this side, and overlap by it: ends of tracks of people who pass a door are within 8 m. The
second is the number of pairs of squares, each at one lag, that are searched for the turn."""
CELLS = 2 * int(np.ceil(2 * HALF_SQUARE_M * np.sqrt(2.0) / CELL_M))
"""Number of cells on each axis for the shifts between two squares."""
NUMBERS = 1 << 15
"""A square's number is this times its number on the x axis plus that on the y axis: 130 km of ground."""
PLACE_SD_M, SPEED_SD_M_S = 0.3, 0.6
"""Standard deviations of a track's position, and of the change of a person's velocity after its end: people turn in doors."""
MOST_SQUARE = 9.0
"""Squared distance, in standard deviations, from which an end belongs to another person."""
OTHER_LAGS_S = 20.0
"""Impossible lags are tried up to this far beyond the possible ones, seconds, to measure the votes by chance."""
DAMPING = (1.0, 1e-6, 1e-6, 1.0)
"""Added to the information on the steps of turn, shift and lag, for people who all stand on one spot or never walk."""
STARTS, STEPS = 18, 12
"""Number of turns from which the motion about the found place is fitted, and steps of each fit."""
CLEAR, FEWEST = 1.5, 12
"""Groups are joined from this multiple of the votes by chance, and from this number of people. Simulated airports (seeds 801,
804, 806, 811 of 25 cameras, 820 of 100): 1.7 to 3 times at 18 doors, and 1.3 times at most for pairs of groups that share no
ground and have as many people."""


@dataclass(frozen=True, eq=False)
class TrackEnds(Columns):
    """E ends of the tracks of a group's people."""

    sense: Floats
    """(E,) 1 where a person disappears, -1 where one appears."""
    time_s: Floats
    """(E,) time by the group's clock."""
    place: Complexes
    """(E,) x + iy in the group's world, metres."""
    velocity: Complexes
    """(E,) metres per second."""
    seen_by: Bools
    """(E, C) whether each camera of the group sees the person near the end."""

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def by_time(self) -> TrackEnds:
        """The same ends in the order of time."""
        return self.take(np.argsort(self.time_s, kind="stable"))

    @property
    def backwards(self) -> TrackEnds:
        """The same people, walking backwards."""
        last = float(self.time_s.max(initial=0.0) + self.time_s.min(initial=0.0))
        return TrackEnds(-self.sense, last - self.time_s, self.place, -self.velocity, self.seen_by)


@dataclass(frozen=True, eq=False)
class Passage:
    """Registration of two groups by the people who pass from one to the other."""

    motion: GroundMotion
    """Motion from the first group's ground and clock to the second one's; `turn` has the length 1."""
    place: complex
    """Position at which people pass, in the first group's world, metres."""
    votes: int
    """Number of people who pass there."""
    by_chance: int
    """Number of votes that occur by chance."""
    cameras: Ints
    """(C, C') number of passages seen by each camera of the first and each camera of the second group."""
    turn_known: bool = False
    """Whether the turn is determined by people seen by both groups at one time. With ends of tracks alone it has errors of up
    to 30 degrees."""

    @property
    def needed(self) -> int:
        """Number of votes that are significant."""
        return max(int(np.floor(CLEAR * self.by_chance)) + 1, FEWEST)

    @property
    def clear(self) -> bool:
        """Whether significantly more people pass than by chance."""
        return self.votes >= self.needed


def find_track_ends(rig: Rig, instants: Observations, person_height_m: float) -> TrackEnds:
    """Find the ends of the tracks of a rig's people.

    Args:
        rig: world z up, ground at z = 0.
        instants: people with identities at common instants.
        person_height_m: typical standing height, metres.
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
    """Register two groups by the place where people pass between them; return None where no two ends are near in time.

    Args:
        a: ends of the first group's tracks.
        b: ends of the second group's tracks.
        lags_s: smallest and largest possible time of the second group's clock minus that of the first, seconds.
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
    """A square of ground in each of the two worlds, in which people may pass, at one lag."""

    here: complex
    """Middle of the square in the first world; `there` is the middle in the second one."""
    there: complex
    lag_s: float


@dataclass(frozen=True, eq=False)
class _Places:
    """Pairs of squares with ends that are near in time; a row for each pair and lag."""

    square: Ints
    """(K, 2) numbers of the squares."""
    lag: Ints
    """(K,) number of the lag."""
    lag_s: Floats
    """(L,) all lags, seconds."""
    beyond: Floats
    """(K,) number of pairs of ends above the mean over all lags, in standard deviations of chance."""

    def densest(self, lags: Ints) -> list[_Place]:
        """Return the places with most pairs above chance at the given lags."""
        rows = np.flatnonzero(np.isin(self.lag, lags))
        rows = rows[np.argsort(-self.beyond[rows], kind="stable")[:MOST_PLACES]]
        x, y = np.divmod(self.square[rows], NUMBERS)
        here, there = (HALF_SQUARE_M * (x + 1j * y - (1 + 1j) * (NUMBERS // 2))).T.tolist()
        return [_Place(*one) for one in zip(here, there, self.lag_s[self.lag[rows]].tolist(), strict=True)]


def _find_places(a: TrackEnds, b: TrackEnds, lag_s: Floats) -> _Places:
    """Find the squares in which ends are near in time, for each lag."""
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
    """Return the numbers (K, 4) of the four squares that contain each position."""
    x, y = (np.floor(part / HALF_SQUARE_M).astype(np.int64) + NUMBERS // 2 for part in (at.real, at.imag))
    return np.column_stack([NUMBERS * (x + right) + y + up for right in (0, 1) for up in (0, 1)])


@dataclass(frozen=True)
class _Votes:
    """Turn and shift at a place for which most people of one group meet a person of the other."""

    votes: int
    place: _Place
    turn: complex
    shift: complex
    """Shift from the turned middle of the first square to the middle of the second."""


def _count_most_votes(a: TrackEnds, b: TrackEnds, places: Sequence[_Place]) -> _Votes:
    """Return the votes of the place that has most."""
    none = _Votes(0, _Place(0.0, 0.0, 0.0), 1.0, 0.0)
    return max((_count_votes(a, b, place) for place in places), key=lambda one: one.votes, default=none)


def _count_votes(a: TrackEnds, b: TrackEnds, place: _Place) -> _Votes:
    """Find the turn and shift with most votes at one place."""
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
    """Find ends of opposite senses that are near in time: rows of `a`, rows of `b`, and the delays of b's ends, seconds.

    The ends of `b` have to be in the order of their times.
    """
    low, high = (np.searchsorted(b.time_s, a.time_s + lag_s + apart) for apart in (-APART_S, APART_S))
    i, j = expanded_ranges(low, high - low)
    opposite = a.sense[i] == -b.sense[j]
    i, j = i[opposite], j[opposite]
    return i, j, b.time_s[j] - a.time_s[i] - lag_s


def _near(a: TrackEnds, b: TrackEnds, place: _Place) -> tuple[Ints, Ints, Complexes, Complexes]:
    """Return the rows of `a` and of `b` that meet in the squares of a place, and their positions in both worlds."""
    i, j, later = _pairs(a, b, place.lag_s)
    here, there = _meeting(a, b, i, j, later)
    near = (_farther(here, place.here) < HALF_SQUARE_M) & (_farther(there, place.there) < HALF_SQUARE_M)
    return i[near], j[near], here[near], there[near]


def _farther(at: Complexes, middle: complex) -> Floats:
    """Return the larger of the distances along x and y."""
    return np.maximum(np.abs((at - middle).real), np.abs((at - middle).imag))


def _voters(a: TrackEnds, b: TrackEnds, most: _Votes) -> tuple[Ints, Ints, complex, complex]:
    """Return the rows of `a` and `b` that vote, their median position in the first world, and the shift to the second world."""
    i, j, here, there = _near(a, b, most.place)
    shift = (there - most.place.there) - most.turn * (here - most.place.here)
    near = _farther(shift, most.shift) <= CELL_M
    at = _median(here[near])
    return i[near], j[near], at, _median(there[near]) - most.turn * at


def _meeting(a: TrackEnds, b: TrackEnds, i: Ints, j: Ints, later: Floats) -> tuple[Complexes, Complexes]:
    """Return the positions of pairs of ends halfway between their times, in both worlds."""
    return a.place[i] + a.velocity[i] * (later / 2), b.place[j] - b.velocity[j] * (later / 2)


def _median(places: Complexes) -> complex:
    return complex(np.median(places.real), np.median(places.imag))


@dataclass(frozen=True, eq=False)
class _Fit:
    motion: GroundMotion
    gain: float
    """Log-likelihood of the passages relative to that of ends of other people, nats."""


def _fit(a: TrackEnds, b: TrackEnds, found: Passage, turn: complex) -> _Fit | None:
    """Fit the motion about a place to the passages, from a first turn, by robust Gauss-Newton steps."""
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
    """Match each end of `a` with the end of `b` that fits it best, where one fits.

    Returns:
        At five times around each meeting, (K, 5) each: the difference of both, metres; the position by `a`; the velocity by
        `b`; and the standard deviation of the difference.
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
