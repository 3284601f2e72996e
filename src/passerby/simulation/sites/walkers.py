"""People with destinations on a site: they walk through doors and over stairs, and stay at each destination for a while.

A person is stored as a polyline in time. Bodies are computed only for the times that a camera needs. Therefore memory does not
depend on the recording's frame rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import InputError
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.simulation.body import BodyState, stride_length
from passerby.simulation.lenses import TYPICAL
from passerby.simulation.options import MAX_CLOCK_OFFSET_S, SimulationOptions
from passerby.simulation.sites.plan import Link, SitePlan

SETTLING_S = 60.0
"""Time that people walk before the recording, so that no person is still at the initial place."""
PAD_S = MAX_CLOCK_OFFSET_S + 2.0
SPEED_MS, SPEED_SD_MS, LEG_SPREAD = (0.8, 1.8), 0.2, 0.1
"""Range and standard deviation of a person's average speed (mean 1.3), and its variation from leg to leg, as a share."""
MEAN_SPEED_MS = 1.3
MARGIN_M = 0.6
"""Minimum distance of stops from walls."""
STAY_S, STAYS = (3.0, 40.0), (1, 4)
"""Range of the length of a stop, and of the number of stops at a destination (below the upper limit)."""
OTHER_FLOOR = 0.3
"""Share of the destinations on a neighbouring floor."""
CORRIDOR_SHARE = 0.3
"""Share of the destinations in a corridor: shops, seats, people who wait."""
CORNER_S = (-0.4, -0.2, 0.0, 0.2, 0.4)
"""Seconds from a time at which the polyline is sampled. A place is the mean of the samples, so no person turns on the spot."""
NOWHERE = -1
"""The floor of a person on stairs."""
SPAN_S = 1e5
"""Shift between the times of two people in the list of all knots; longer than any recording."""
SITES = ("airport",)
"""Presets that are sites."""
LEAST_CAMERAS, MOST_CAMERAS = 8, 1000
PEOPLE_PER_CAMERA = 2
"""Number of people per camera. Several cameras see each person, so each camera sees three to five people at a time."""
MOST_PER_CAMERA = 10


@dataclass(frozen=True, eq=False)
class Walkers:
    """P people as polylines, one after the other in the arrays of K knots."""

    heights: Floats
    """(P,) standing heights, metres."""
    first: Ints
    """(P + 1,) index of each person's first knot; the last entry is K."""
    times: Floats
    """(K,) times of the knots, seconds."""
    xy: Floats
    """(K, 2) positions of the knots, metres."""
    floor: Ints
    """(K,) floor of the segment that begins at a knot; -1 on stairs."""
    heading: Floats
    """(K,) heading in that segment, radians; a person who stands keeps the heading of the last move."""
    speed: Floats
    """(K,) speed in that segment, metres per second."""
    phase: Floats
    """(K,) number of gait cycles before the knot."""

    def __len__(self) -> int:
        """Return the number of people."""
        return len(self.heights)

    def places(self, people: Ints, times: Floats) -> tuple[Floats, Ints]:
        """Return places (T, P, 2), metres, and floors (T, P), -1 on stairs, of people (P,), numbers from 0, at times (T,)."""
        knot, xy = self._interpolate_polyline(people, times[:, None])
        return xy, self.floor[knot]

    def state(self, people: Ints, times: Floats) -> tuple[BodyState, Ints]:
        """Return the bodies of people (P,) at times (T,), and their floors (T, P), -1 on stairs."""
        taps = times[:, None, None] + np.array(CORNER_S)
        knot, xy = self._interpolate_polyline(people[:, None], taps)
        moving = self.speed[knot]
        turn = np.exp(1j * self.heading[knot]).mean(axis=-1)
        middle, _ = self._interpolate_polyline(people, times[:, None])
        own = self.phase[middle] + (times[:, None] - self.times[middle]) * self._cadence(middle, people)
        shape = own.shape
        zero = np.zeros(shape)
        body = BodyState(
            xy=xy.mean(axis=-2), heading=np.angle(turn), speed=moving.mean(axis=-1), phase=own, jump=zero, crouch=zero,
            lean=zero, seat=zero, raised_left=zero, raised_right=zero, carry=zero,
        )  # fmt: skip
        return body, self.floor[middle]

    @cached_property
    def _keys(self) -> Floats:
        """(K,) times of the knots, shifted by `SPAN_S` per person so that they ascend over all people."""
        return self.times + SPAN_S * np.repeat(np.arange(len(self)), np.diff(self.first))

    def _cadence(self, knot: Ints, people: Ints) -> Floats:
        return _cycles_per_second(self.speed[knot], self.heights[people])

    def _interpolate_polyline(self, people: Ints, times: Floats) -> tuple[Ints, Floats]:
        """Return the knot at or before each time (...), and the place (..., 2); people and times are broadcast."""
        knot = np.searchsorted(self._keys, times + SPAN_S * people, side="right") - 1
        knot = np.clip(knot, self.first[people], self.first[people + 1] - 2)
        share = (times - self.times[knot]) / np.maximum(self.times[knot + 1] - self.times[knot], 1e-9)
        share = np.clip(share, 0.0, 1.0)[..., None]
        return knot, (1 - share) * self.xy[knot] + share * self.xy[knot + 1]


def walk(plan: SitePlan, options: SiteOptions) -> Walkers:
    """Simulate all people of a site, from before the first to after the last time that any camera's clock shows."""
    zones = _Zones.of(plan)
    until = options.seconds + PAD_S
    paths = [_path(plan, zones, until, options.rng(1, person)) for person in range(options.n_people)]
    normal = np.clip(options.rng(2).standard_normal(options.n_people), -2.5, 2.5)
    heights = options.person_height_mean_m + options.person_height_sd_m * normal
    return _walkers(paths, heights)


@dataclass(frozen=True, eq=False)
class _Zones:
    """The part of the plan that a person's routes need."""

    by_floor: dict[int, dict[str, list[int]]]
    links: dict[int, list[Link]]
    area_m2: Floats

    @classmethod
    def of(cls, plan: SitePlan) -> _Zones:
        by_floor: dict[int, dict[str, list[int]]] = {}
        links: dict[int, list[Link]] = {}
        for index, zone in enumerate(plan.zones):
            by_floor.setdefault(zone.floor, {}).setdefault(zone.kind, []).append(index)
        for link in plan.links:
            for number in link.zones:
                links.setdefault(number, []).append(link)
        return cls(by_floor, links, np.array([zone.area_m2 for zone in plan.zones]))

    def destination(self, here: int, floor: int, rng: np.random.Generator) -> int:
        """Draw the next zone to visit, on this floor or a neighbouring one."""
        if rng.uniform() < OTHER_FLOOR:
            floor += int(rng.choice((-1, 1)))
            floor = floor if floor in self.by_floor else min(max(floor, 0), max(self.by_floor))
        kinds = self.by_floor[floor]
        kind = "corridor" if rng.uniform() < CORRIDOR_SHARE or "hall" not in kinds else "hall"
        return int(rng.choice(kinds[kind]))

    def route(self, start: int, goal: int, rng: np.random.Generator) -> list[Link]:
        """Return the links of the route with the fewest links; among equal routes the choice is random."""
        reached: dict[int, list[Link]] = {start: []}
        waiting = [start]
        for zone in waiting:
            if zone == goal:
                break
            own = self.links.get(zone, [])
            for k in rng.permutation(len(own)).tolist():
                link = own[k]
                other = link.zones[1] if link.zones[0] == zone else link.zones[0]
                if other not in reached:
                    reached[other] = [*reached[zone], link]
                    waiting.append(other)
        return reached[goal]


class _Path:
    """A polyline that grows."""

    def __init__(self, at: Floats, floor: int, start_s: float) -> None:
        self.times, self.xy, self.floors = [start_s], [at], [floor]

    def go(self, to: Floats, floor: int, speed: float) -> None:
        """Walk straight to a place."""
        distance = float(np.hypot(*(to - self.xy[-1])))
        if distance > 1e-6:
            self.wait(distance / speed, floor, to)

    def wait(self, seconds: float, floor: int, to: Floats | None = None) -> None:
        """Spend time at the current place, or on the way to another place."""
        self.floors[-1] = floor
        self.times.append(self.times[-1] + seconds)
        self.xy.append(self.xy[-1] if to is None else to)
        self.floors.append(floor)


def _path(plan: SitePlan, zones: _Zones, until: float, rng: np.random.Generator) -> _Path:
    """Draw the trips of one person until a time."""
    here = int(rng.choice(len(plan.zones), p=zones.area_m2 / zones.area_m2.sum()))
    own = float(np.clip(rng.normal(MEAN_SPEED_MS, SPEED_SD_MS), *SPEED_MS))
    path = _Path(_draw_inside(plan, here, rng), plan.zones[here].floor, -PAD_S - SETTLING_S)
    while path.times[-1] < until:
        goal = zones.destination(here, plan.zones[here].floor, rng)
        for link in zones.route(here, goal, rng):
            side = 0 if link.zones[0] == here else 1
            share, floor = rng.uniform(0.15, 0.85), plan.zones[here].floor
            leave, enter = ((1 - share) * link.ends[end][0] + share * link.ends[end][1] for end in (side, 1 - side))
            speed = own * float(rng.uniform(1 - LEG_SPREAD, 1 + LEG_SPREAD))
            path.go(leave, floor, speed)
            if link.seconds > 0:
                path.wait(link.seconds, NOWHERE, enter)
            else:
                path.go(enter, floor, speed)
            here = link.zones[1 - side]
        for _ in range(int(rng.integers(*STAYS))):
            speed = own * float(rng.uniform(1 - LEG_SPREAD, 1 + LEG_SPREAD))
            path.go(_draw_inside(plan, here, rng), plan.zones[here].floor, speed)
            path.wait(float(rng.uniform(*STAY_S)), plan.zones[here].floor)
    return path


def _draw_inside(plan: SitePlan, zone: int, rng: np.random.Generator) -> Floats:
    low, high = np.array(plan.zones[zone].low) + MARGIN_M, np.array(plan.zones[zone].high) - MARGIN_M
    return np.asarray(rng.uniform(low, high))


def _walkers(paths: Sequence[_Path], heights: Floats) -> Walkers:
    first = np.concatenate([[0], np.cumsum([len(path.times) for path in paths])]).astype(np.int64)
    times, xy = np.concatenate([path.times for path in paths]), np.concatenate([path.xy for path in paths])
    floor = np.concatenate([path.floors for path in paths]).astype(np.int64)
    last: Bools = np.zeros(len(times), dtype=np.bool_)
    last[first[1:] - 1] = True
    step = np.diff(xy, axis=0, append=xy[-1:])
    seconds = np.diff(times, append=times[-1] + 1.0)
    length = np.hypot(step[:, 0], step[:, 1])
    moves = (length > 1e-9) & ~last
    speed = np.where(moves, length / np.where(moves, seconds, 1.0), 0.0)
    # A person who stands has the heading of the last segment with a move; before the first move, zero.
    latest = np.maximum.accumulate(np.where(moves | np.isin(np.arange(len(times)), first[:-1]), np.arange(len(times)), 0))
    heading = np.where(moves, np.arctan2(step[:, 1], step[:, 0]), 0.0)[latest]
    cycles = np.where(last, 0.0, seconds * _cycles_per_second(speed, np.repeat(heights, np.diff(first))))
    phase = np.concatenate([[0.0], np.cumsum(cycles)[:-1]])
    return Walkers(heights, first, times, xy, floor, heading, speed, phase)


def _cycles_per_second(speed: Floats, heights: Floats) -> Floats:
    stride = stride_length(speed, heights)
    return np.asarray(np.where(speed > 0.05, speed / np.maximum(stride, 1e-9), 0.0))


@dataclass(frozen=True)
class SiteOptions:
    """Options of `simulate_site`; they mean the same as those of `SimulationOptions`. Raises `InputError` for bad values.

    Each camera always has tracklet numbers of its own as identities.
    """

    preset: str = "airport"
    seed: int = 0
    cameras: int = 24
    people: int | None = None
    """Number of people; None: `PEOPLE_PER_CAMERA` for each camera."""
    seconds: float = 600.0
    fps: float = 5.0
    camera_height_m: float = 3.5
    person_height_mean_m: float = PERSON_HEIGHT_M
    person_height_sd_m: float = PERSON_HEIGHT_SD_M
    occlusion: bool = True
    box_noise: float = 0.0
    corner_noise_px: float = 0.0
    box_slack: float = 0.0
    missing: float = 0.0
    false_boxes: float = 0.0
    identity_swaps: float = 0.0
    clock_offsets: float = 5.0
    """Each camera but the first gets a constant offset drawn from plus or minus this number of seconds."""
    tracklet_seconds: float = 0.0
    embeddings: str = "none"
    lenses: str = TYPICAL

    def __post_init__(self) -> None:
        if self.preset not in SITES:
            raise InputError(f"preset {self.preset!r} is no site: choose one of {', '.join(SITES)}")
        _check_count("cameras", self.cameras, LEAST_CAMERAS, MOST_CAMERAS)
        _check_count("people", self.n_people, self.cameras // 2, MOST_PER_CAMERA * self.cameras)
        if not isinstance(self.clock_offsets, int | float):
            raise InputError("clock_offsets of a site is a single largest offset, not one per camera: give one number")
        if not 2.0 <= self.camera_height_m <= 10.0:
            raise InputError(f"camera_height_m = {self.camera_height_m} is out of range: give a value from 2 to 10")
        _ = self.faults  # `SimulationOptions` checks all other options.

    @property
    def n_people(self) -> int:
        """Number of people."""
        return PEOPLE_PER_CAMERA * self.cameras if self.people is None else self.people

    @property
    def n_frames(self) -> int:
        """Number of time steps, at least one."""
        return self.faults.n_frames

    @property
    def faults(self) -> SimulationOptions:
        """The options of a scene with the same recording and the same faults."""
        return SimulationOptions(
            seed=self.seed, seconds=self.seconds, fps=self.fps, occlusion=self.occlusion, box_noise=self.box_noise,
            corner_noise_px=self.corner_noise_px, box_slack=self.box_slack, missing=self.missing, false_boxes=self.false_boxes,
            identity_swaps=self.identity_swaps, clock_offsets=self.clock_offsets, unrelated_ids=True,
            tracklet_seconds=self.tracklet_seconds, embeddings=self.embeddings, lenses=self.lenses,
            person_height_mean_m=self.person_height_mean_m, person_height_sd_m=self.person_height_sd_m,
        )  # fmt: skip

    def rng(self, *purpose: int) -> np.random.Generator:
        """Return the generator of a purpose, and of one camera or person; no draw depends on the number of others."""
        return np.random.default_rng((self.seed, 9, *purpose))


def _check_count(name: str, value: int, low: int, high: int) -> None:
    if value != int(value) or not low <= value <= high:
        raise InputError(f"{name} = {value} is out of range: give a whole number from {low} to {high}")
