"""Blind hostile cases: people who do not stand, walk or look as people are taken to, and ground that is not what it seems."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Boxes
from passerby.simulation.body import BodyState
from passerby.simulation.motion import STEP_S, Motion
from reliability.staging import HandedIn, Mask, MovePeople, aimed, edges_of, joined, raised, staged, still, walking

Build = Callable[[int], HandedIn]
FURTHER = 1000
"""People of a second scene are numbered on from here."""
OTHERS = 700_000
"""From a scene's seed to that of the people of a second scene."""


def striding(motion: Motion, xy: Floats, heights: Floats) -> Motion:
    """People who walk upright on ways (K, P, 2), and are there from the start."""
    return walking(still(motion, xy[0]), xy, heights)


def carried(motion: Motion, xy: Floats, **postures: Floats | float) -> Motion:
    """People who are carried along ways (K, P, 2) without a step of their own."""
    moved = still(motion, xy[0])
    velocity = np.gradient(xy, STEP_S, axis=0)
    heading = np.unwrap(np.arctan2(velocity[..., 1], velocity[..., 0]), axis=0)
    return replace(moved, state=posed(replace(moved.state, xy=xy, heading=heading), **postures))


def posed(state: BodyState, **postures: Floats | float) -> BodyState:
    """Other postures, at all times or (K, P)."""
    shape = state.speed.shape
    columns: dict[str, Any] = {name: np.broadcast_to(np.asarray(value, float), shape) for name, value in postures.items()}
    return replace(state, **columns)


def sorted_out(one: Motion, other: Motion, second: Mask) -> Motion:
    """The first motion, but people (P,) of the second move as in the other."""

    def chosen(name: str) -> Floats:
        mine, theirs = getattr(one.state, name), getattr(other.state, name)
        return np.asarray(np.where(second.reshape(1, -1, *(1,) * (mine.ndim - 2)), theirs, mine))

    state = BodyState(**{item.name: chosen(item.name) for item in fields(BodyState)})
    return Motion(one.times, state, np.where(second, other.present_from, one.present_from))


def clocks(seed: int, cameras: int) -> tuple[float, ...]:
    """Offsets of up to a second, the first of which is 0."""
    drawn = np.random.default_rng((seed, 401)).uniform(-1, 1, cameras)
    return (0.0, *drawn[1:].tolist())


def together(scene: HandedIn, others: HandedIn, cameras: tuple[str, ...] | None = None) -> HandedIn:
    """People of a second scene of the same cameras, in the views of all cameras or of some."""
    for name in scene.lenses.names if cameras is None else cameras:
        second, who = others.boxes[name], others.who[name]
        second = replace(second, identity=np.where(second.identity < 0, -1, second.identity + FURTHER))
        boxes, order = joined(scene.boxes[name], second)
        known = np.concatenate([scene.who[name], np.where(who < 0, -1, who + FURTHER)])[order]
        scene = scene.with_boxes(name, boxes, known)
    return scene


@dataclass(frozen=True, eq=False)
class Watched:
    """A scene and how its people moved."""

    scene: HandedIn
    motion: Motion
    heights: Floats
    offsets: tuple[float, ...]

    def people(self, name: str) -> tuple[Floats, Floats, Floats]:
        """The place (N, 2), the heading (N,) and the height (N,) of whom each box of a camera shows; anybody's for nobody."""
        assert isinstance(self.scene.fps, float)
        who = np.maximum(self.scene.who[name] - 1, 0)
        offset = self.offsets[self.scene.lenses.names.index(name)]
        state, _ = self.motion.at((self.scene.boxes[name].frame - 1) / self.scene.fps + offset)
        rows = np.arange(len(who))
        return state.xy[rows, who], state.heading[rows, who], self.heights[who]


def watched(seed: int, *, given: bool, cameras: int, move: MovePeople | None = None, **wanted: Any) -> Watched:
    """A staged scene with its motion."""
    noted: list[tuple[Motion, Floats]] = []

    def note(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        moved = motion if move is None else move(motion, heights, rng)
        noted.append((moved, heights))
        return moved

    offsets = (0.0,) * cameras if given else clocks(seed, cameras)
    scene = staged(seed, given=given, cameras=cameras, people_move=note, clock_offsets=offsets, **wanted)
    return Watched(scene, *noted[0], offsets)


def hull(camera: Camera, points: Floats) -> Floats:
    """(N, 4) left, top, right, bottom of points (N, M, 3) in a picture; NaN where one is behind the camera."""
    pixels = camera.project(points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)


def ring(xy: Floats, z: Floats, radius: float) -> Floats:
    """(N, 8, 3) level circles about places (N, 2) at heights (N,)."""
    angle = np.arange(8) * np.pi / 4
    around = xy[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate([around, np.broadcast_to(z[:, None, None], (len(z), 8, 1))], axis=-1)


def with_edges(scene: HandedIn, name: str, edges: Floats, rows: Mask) -> HandedIn:
    """Other boxes (N, 4) in the rows (N,), clipped at the picture's border; what is left of too few pixels is not found."""
    boxes, limits = scene.boxes[name], np.tile(np.array(scene.lenses[name].lens.size, float), 2)
    rows = rows & np.asarray(np.isfinite(edges).all(axis=1))
    shown = np.where(rows[:, None], np.clip(np.where(rows[:, None], edges, 0.0), 0.0, limits), edges_of(boxes))
    size = shown[:, 2:] - shown[:, :2]
    found = np.asarray((size > 2.0).all(axis=1))
    ltwh = np.concatenate([shown[:, :2], np.where(found[:, None], size, 1.0)], axis=1)
    return scene.with_boxes(name, replace(boxes, ltwh=ltwh)).kept(name, found)


def grown(scene: HandedIn, name: str, points: Floats, rows: Mask) -> HandedIn:
    """Boxes in the rows (N,) that take in points (N, M, 3) as well."""
    own, more = edges_of(scene.boxes[name]), hull(scene.lenses[name], points)
    edges = np.concatenate([np.minimum(own[:, :2], more[:, :2]), np.maximum(own[:, 2:], more[:, 2:])], axis=1)
    return with_edges(scene, name, edges, rows & (scene.who[name] > 0))


def _one_way(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    n = len(heights)
    start = -30.0 + 40.0 * (np.arange(n) + rng.uniform(0.1, 0.9, n)) / n
    lane = np.array([-5.0, -1.5, 2.0, 5.0])[rng.permutation(n) % 4]
    x = start + 0.75 * motion.times[:, None]
    return carried(motion, np.stack([x, np.broadcast_to(lane, x.shape)], axis=-1))


def walkway(seed: int) -> HandedIn:
    """Moving walkways side by side carry everybody one way at one speed: a clock's offset looks like a shift."""
    return staged(seed, given=False, preset="construction", people=12, seconds=40.0, people_move=_one_way)


def _escalators(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    n = len(heights)
    riding = np.arange(n) >= n - 6
    up = np.arange(n) % 2 == 0
    start = -14.0 + 3.5 * ((np.arange(n) - (n - 6)) // 2) + rng.uniform(-0.8, 0.8, n)
    along = start + 0.65 * motion.times[:, None]
    x = np.where(up, along, -along)
    y = np.where(up, 9.5, 11.5) + rng.uniform(-0.2, 0.2, n)
    rides = striding(motion, np.stack([x, np.broadcast_to(y, x.shape)], axis=-1), heights)
    on_floor = walking(motion, motion.state.xy * (1.0, 0.75) - (0.0, 3.3), heights)
    return sorted_out(on_floor, raised(rides, lambda xy: np.clip(0.577 * (xy[..., 0] + 3.0), 0.0, 3.2)), riding)


def escalator(seed: int) -> HandedIn:
    """Six of ten people ride up and down two escalators that rise the same way; the others walk on the floor."""
    return staged(seed, preset="construction", people=10, seconds=40.0, people_move=_escalators)


def wheelchairs(seed: int) -> HandedIn:
    """Wheelchair basketball: all players are seated."""

    def seated(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        return carried(motion, motion.state.xy, heading=motion.state.heading, crouch=0.7, seat=1.0, lean=0.2)

    return staged(seed, preset="basketball", people=10, seconds=40.0, people_move=seated)


def lissajous(
    motion: Motion, rng: np.random.Generator, n: int, size: tuple[float, float], periods: tuple[float, float]
) -> Floats:
    """(K, P, 2) smooth ways about an area of half extents, each with periods and phases of its own, seconds."""
    period, phase = rng.uniform(*periods, (n, 2)), rng.uniform(0, 2 * np.pi, (n, 2))
    return np.asarray(np.array(size) * np.sin(2 * np.pi * motion.times[:, None, None] / period + phase))


def scooters(seed: int) -> HandedIn:
    """Everybody rides a scooter: upright, without steps, at up to 5 m/s."""

    def ride(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        return carried(motion, lissajous(motion, rng, len(heights), (8.0, 10.0), (16.0, 24.0)), jump=0.12)

    return staged(seed, given=False, preset="construction", cameras=5, people=8, people_move=ride)


def skaters(seed: int) -> HandedIn:
    """All skate counter-clockwise about the middle of a rink, and lean inwards by 25 degrees."""

    def circle(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        radius, speed, phase = rng.uniform(3.5, 6.5, n), rng.uniform(3.5, 5.5, n), rng.uniform(0, 2 * np.pi, n)
        angle = speed / radius * motion.times[:, None] + phase
        return carried(motion, radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))

    known = watched(seed, given=True, cameras=4, move=circle, preset="basketball", people=6, seconds=40.0)
    scene, lean = known.scene, np.radians(25.0)
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 402, index))
        xy, _, height = known.people(name)
        inwards = -xy / np.linalg.norm(xy, axis=1, keepdims=True)
        parts = [
            ring(xy + (share * height * np.sin(lean))[:, None] * inwards, share * height * np.cos(lean), radius)
            for share, radius in ((0.0, 0.15), (0.5, 0.2), (0.8, 0.22), (1.0, 0.08))
        ]
        edges = hull(scene.lenses[name], np.concatenate(parts, axis=1))
        edges = edges + 0.02 * (edges[:, 3:] - edges[:, 1:2]) * rng.standard_normal(edges.shape)
        scene = with_edges(scene, name, edges, scene.who[name] > 0)
    return scene


def _waltz(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    half = len(heights) // 2
    time, phase = motion.times[:, None], rng.uniform(0, 2 * np.pi, (2, half))
    round_floor = 2 * np.pi * (time / 24.0 + np.arange(half) / half) + 0.2 * np.sin(2 * np.pi * time / 9.0 + phase[0])
    reach = 1.0 + 0.12 * np.sin(2 * np.pi * time / 7.0 + phase[1])
    middle = reach[..., None] * np.stack([2.4 * np.cos(round_floor), 3.8 * np.sin(round_floor)], axis=-1)
    turn = 2 * np.pi * 0.45 * time + phase[0]
    aside = 0.28 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return striding(motion, np.stack([middle + aside, middle - aside], axis=2).reshape(len(time), 2 * half, 2), heights)


def dancers(seed: int) -> HandedIn:
    """Four couples waltz round the floor; mostly a couple is found as one person."""
    scene = staged(seed, given=False, people=8, seconds=45.0, people_move=_waltz)
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 403, index))
        boxes, who, edges = scene.boxes[name], scene.who[name], edges_of(scene.boxes[name])
        kept = np.ones(len(boxes), dtype=np.bool_)
        row = {(frame, person): k for k, (frame, person) in enumerate(zip(boxes.frame.tolist(), who.tolist(), strict=True))}
        for (frame, person), k in row.items():
            other = row.get((frame, person + 1))
            if person > 0 and person % 2 == 1 and other is not None and rng.uniform() < 0.7:
                edges[k] = (*np.minimum(edges[k, :2], edges[other, :2]), *np.maximum(edges[k, 2:], edges[other, 2:]))
                kept[other] = False
        both = replace(boxes, ltwh=np.concatenate([edges[:, :2], edges[:, 2:] - edges[:, :2]], axis=1))
        scene = scene.with_boxes(name, both).kept(name, kept)
    return scene


def _serpentine(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    corners = np.array([(-12.0, -1.8), (2.4, -1.8), (2.4, 0.0), (-2.4, 0.0), (-2.4, 1.8), (12.0, 1.8)])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    beat = motion.times / 4.0
    steps: Floats = np.asarray(np.floor(beat) + np.clip(4.0 * (beat - np.floor(beat)), 0.0, 1.0))
    place = 19.0 + 0.75 * (steps[:, None] - np.arange(len(heights)))

    def on_way(along: Floats) -> Floats:
        return np.asarray(np.stack([np.interp(along, at, corners[:, axis]) for axis in range(2)], axis=-1))

    moved = striding(motion, on_way(place) + rng.uniform(-0.05, 0.05, (1, len(heights), 2)), heights)
    ahead = on_way(place + 0.3) - on_way(place - 0.3)
    return replace(moved, state=posed(moved.state, heading=np.unwrap(np.arctan2(ahead[..., 1], ahead[..., 0]), axis=0)))


def queue(seed: int) -> HandedIn:
    """A queue in three rows moves up by one place every four seconds, all at once: four seconds later it looks alike."""
    return staged(seed, given=False, cameras=3, people=12, seconds=40.0, people_move=_serpentine, person_height_sd_m=0.04)


def _beats(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    sides = len(heights) // 2
    time, angle = motion.times, np.arange(sides) * 2 * np.pi / sides
    ways = []
    for distance, reach, period in ((3.0, 1.8, 10.0), (5.5, 3.0, 16.0)):
        aside = reach * np.sin(2 * np.pi * time / period + rng.uniform(0, 2 * np.pi))
        c, s = np.cos(angle), np.sin(angle)
        ways.append(np.stack([distance * c - aside[:, None] * s, distance * s + aside[:, None] * c], axis=-1))
    xy = np.concatenate(ways, axis=1)
    sway = rng.uniform(0, 2 * np.pi, xy.shape[1:])
    return striding(motion, xy + 0.03 * np.sin(2 * np.pi * time[:, None, None] / 7.0 + sway), heights)


def guards(seed: int) -> HandedIn:
    """Eight guards pace up and down on four sides of a square in step: a quarter turn looks alike."""
    return staged(seed, given=False, preset="basketball", cameras=5, people=8, seconds=40.0, people_move=_beats,
                  person_height_sd_m=0.02)  # fmt: skip


def carousel(seed: int) -> HandedIn:
    """A platform turns evenly with everybody on it: a clock's offset looks like a turn about its middle."""

    def turning(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        radius, phase = rng.uniform(1.0, 3.2, n), rng.uniform(0, 2 * np.pi, n)
        angle = 2 * np.pi * motion.times[:, None] / 20.0 + phase
        return carried(motion, radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))

    return staged(seed, given=False, people=7, seconds=45.0, people_move=turning)


def loop(seed: int) -> HandedIn:
    """One person walks round an oval in nine seconds, again and again: half a round later it is the same, turned about."""

    def oval(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        angle = 2 * np.pi * motion.times[:, None] / 9.0 + rng.uniform(0, 2 * np.pi)
        return striding(motion, np.stack([2.6 * np.cos(angle), 1.6 * np.sin(angle)], axis=-1), heights)

    return staged(seed, given=False, cameras=3, people=1, seconds=60.0, tracklet_seconds=0.0, people_move=oval)


def crocodile(seed: int) -> HandedIn:
    """All walk one behind another on the same winding way, 0.9 s apart."""

    def follow(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        time = motion.times[:, None] - 0.9 * np.arange(len(heights))
        first, second = rng.uniform(0, 2 * np.pi, 2)
        x, y = 2.6 * np.sin(2 * np.pi * time / 17.0 + first), 4.0 * np.sin(2 * np.pi * time / 25.0 + second)
        return striding(motion, np.stack([x, y], axis=-1), heights)

    return staged(seed, given=False, people=9, seconds=50.0, people_move=follow)


def balcony(seed: int) -> HandedIn:
    """Two of five cameras see more people on a balcony than on the floor; the others see the floor only."""
    wanted: dict[str, Any] = {"given": False, "preset": "basketball", "cameras": 5, "seconds": 40.0,
                              "clock_offsets": clocks(seed, 5)}  # fmt: skip
    floor = staged(seed, people=4, **wanted)

    def above(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        xy = lissajous(motion, rng, len(heights), (6.5, 0.9), (25.0, 50.0)) + (0.0, 12.0)
        return raised(striding(motion, xy, heights), lambda xy: np.full(xy.shape[:-1], 2.8))

    up = staged(seed + OTHERS, people=7, rig=lambda *_: floor.truth, people_move=above, **wanted)
    return together(floor, up, ("C1", "C2"))


def glass(seed: int) -> HandedIn:
    """Two cameras see people in other rooms through glass, each in a room of its own; three people walk in the common room."""
    wanted: dict[str, Any] = {"given": False, "seconds": 45.0, "clock_offsets": clocks(seed, 4)}
    scene = staged(seed, people=3, **wanted)
    common = scene.truth
    for index, name in enumerate(("C1", "C3")):
        pose = common[name].pose
        assert pose is not None
        ahead = pose.R_cw[2, :2] / np.linalg.norm(pose.R_cw[2, :2])

        def beyond(motion: Motion, heights: Floats, _: np.random.Generator, ahead: Floats = ahead) -> Motion:
            return walking(motion, motion.state.xy * 0.8 + 14.0 * ahead, heights)

        room = staged(seed + OTHERS + index, people=5, rig=lambda *_: common, people_move=beyond, **wanted)
        scene = together(scene, room, (name,))
    return scene


def shadows(seed: int) -> HandedIn:
    """In low sun shadows are found as people, beside those who cast them."""
    known = watched(seed, given=False, cameras=4, preset="basketball", people=6, seconds=40.0)
    scene = known.scene
    sun = np.random.default_rng((seed, 404)).uniform(0, 2 * np.pi)
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 405, index))
        boxes, size = scene.boxes[name], np.array(scene.lenses[name].lens.size, float)
        xy, _, height = known.people(name)
        ground = np.zeros(len(xy))
        cast = (1.3 * height)[:, None] * np.array([np.cos(sun), np.sin(sun)])
        parts = [ring(xy + share * cast, ground, 0.2) for share in (0.15, 0.5, 0.95)]
        edges = hull(scene.lenses[name], np.concatenate(parts, axis=1))
        edges = edges + 0.03 * (edges[:, 3:] - edges[:, 1:2]) * rng.standard_normal(edges.shape)
        shown = (scene.who[name] > 0) & (boxes.identity > 0) & (rng.uniform(size=len(xy)) < 0.8)
        shown &= np.isfinite(edges).all(axis=1) & (edges[:, :2] > 0).all(axis=1) & (edges[:, 2:] < size).all(axis=1)
        shown &= (edges[:, 2:] - edges[:, :2] > 4.0).all(axis=1)
        ltwh = np.concatenate([edges[:, :2], edges[:, 2:] - edges[:, :2]], axis=1)[shown]
        cast_boxes = Boxes(boxes.frame[shown], boxes.identity[shown] + FURTHER, ltwh, np.full(len(ltwh), 0.7))
        both, order = joined(boxes, cast_boxes)
        scene = scene.with_boxes(name, both, np.concatenate([scene.who[name], np.full(len(ltwh), -1)])[order])
    return scene


def school(seed: int) -> HandedIn:
    """Ten children of 1.2 m and two teachers, and nobody said so."""
    wanted: dict[str, Any] = {"given": False, "preset": "basketball", "seconds": 40.0, "clock_offsets": clocks(seed, 4)}
    teachers = staged(seed, people=2, **wanted)
    pupils = staged(seed + OTHERS, people=10, rig=lambda *_: teachers.truth, person_height_mean_m=1.2,
                    person_height_sd_m=0.07, **wanted)  # fmt: skip
    return together(teachers, pupils)


def stilts(seed: int) -> HandedIn:
    """Four of seven people walk on stilts and are 2.45 m tall."""
    wanted: dict[str, Any] = {"cameras": 3, "seconds": 30.0}
    ordinary = staged(seed, people=3, **wanted)
    tall = staged(seed + OTHERS, people=4, rig=lambda *_: ordinary.truth, person_height_mean_m=2.45,
                  person_height_sd_m=0.06, **wanted)  # fmt: skip
    return together(ordinary, tall)


def _slower(motion: Motion, heights: Floats) -> Motion:
    """The same ways, upright and at half the speed."""
    step = np.arange(len(motion.times))
    before, after = step // 2, (step + 1) // 2
    xy, heading = (0.5 * (values[before] + values[after]) for values in (motion.state.xy, motion.state.heading))
    moved = striding(motion, xy, heights)
    return replace(moved, state=posed(moved.state, heading=heading))


def stooped(seed: int) -> HandedIn:
    """Field workers who are bent down all the time."""

    def bent(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        moved = striding(motion, lissajous(motion, rng, n, (7.0, 9.0), (70.0, 120.0)), heights)
        return replace(moved, state=posed(moved.state, lean=rng.uniform(1.0, 1.25, n), crouch=rng.uniform(0.15, 0.3, n)))

    return staged(seed, given=False, preset="construction", people=9, seconds=60.0, people_move=bent)


def wading(seed: int) -> HandedIn:
    """Everybody wades slowly in water that is a metre deep: boxes end at its surface."""

    def slow(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        return _slower(motion, heights)

    known = watched(seed, given=True, cameras=4, move=slow, people=6, seconds=45.0)
    scene = known.scene
    for name in scene.lenses.names:
        xy, _, _ = known.people(name)
        surface = hull(scene.lenses[name], ring(xy, np.full(len(xy), 1.0), 0.2))[:, 3]
        edges = edges_of(scene.boxes[name])
        edges[:, 3] = np.minimum(edges[:, 3], surface)
        edges[:, 3] = np.maximum(edges[:, 3], edges[:, 1])
        scene = with_edges(scene, name, edges, scene.who[name] > 0)
    return scene


def wet_floor(seed: int) -> HandedIn:
    """One half of the floor is wet: boxes of those who walk there take in the reflection, down to the hips."""
    known = watched(seed, given=True, cameras=2, people=5, seconds=40.0)
    scene = known.scene
    for name in scene.lenses.names:
        xy, _, height = known.people(name)
        scene = grown(scene, name, ring(xy, -0.45 * height, 0.15), xy[:, 1] > 0)
    return scene


def umbrellas(seed: int) -> HandedIn:
    """It rains, and the boxes of everybody take in the umbrella."""

    def upright(motion: Motion, *_: object) -> Motion:
        return replace(motion, state=posed(motion.state, crouch=0.0, lean=0.0, seat=0.0))

    known = watched(seed, given=True, cameras=6, move=upright, preset="construction", people=7, seconds=30.0)
    scene = known.scene
    for name in scene.lenses.names:
        xy, _, height = known.people(name)
        canopy = np.concatenate([ring(xy, height, 0.5), ring(xy, height + 0.33, 0.02)], axis=1)
        scene = grown(scene, name, canopy, np.ones(len(xy), dtype=np.bool_))
    return scene


def porters(seed: int) -> HandedIn:
    """Porters carry crates on their heads one way, and come back without."""

    def to_and_fro(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        period, phase = rng.uniform(16.0, 24.0, n), rng.uniform(0, 1, n)
        cycle = np.mod(motion.times[:, None] / period + phase, 1.0)
        x = 7.0 * (4.0 * np.abs(cycle - 0.5) - 1.0)
        y = np.linspace(-8.0, 8.0, n) + 1.2 * np.sin(2 * np.pi * cycle)
        return striding(motion, np.stack([x, y], axis=-1), heights)

    known = watched(seed, given=True, cameras=4, move=to_and_fro, preset="construction", people=6, seconds=40.0)
    scene = known.scene
    for name in scene.lenses.names:
        xy, heading, height = known.people(name)
        crate = np.concatenate([ring(xy, height, 0.3), ring(xy, height + 0.5, 0.3)], axis=1)
        scene = grown(scene, name, crate, np.cos(heading) > 0)
    return scene


def grandstand(seed: int) -> HandedIn:
    """Ten spectators sit on steep terraces at one side; four players walk on the floor."""

    def seats(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        sitting = np.arange(n) >= 4
        row = np.maximum(np.arange(n) - 4, 0) // 2
        places = np.stack([rng.uniform(-6.0, 6.0, n), 5.0 + 0.9 * row], axis=-1)
        fidget = 0.06 * np.sin(2 * np.pi * motion.times[:, None, None] / rng.uniform(3, 8, (n, 2)) + rng.uniform(0, 6, (n, 2)))
        state = posed(still(motion, places).state, jump=0.5 * row, crouch=0.75, seat=1.0)
        state = replace(state, xy=state.xy + fidget, heading=np.full(state.speed.shape, -np.pi / 2))
        return sorted_out(motion, Motion(motion.times, state, np.full(n, -np.inf)), sitting)

    return staged(seed, preset="basketball", people=14, seconds=30.0, people_move=seats)


def hill(seed: int) -> HandedIn:
    """A round hill of 1.1 m, the top of which is in the middle."""

    def dome(xy: Floats) -> Floats:
        return np.asarray(0.4 - 0.006 * np.sum(xy**2, axis=-1))

    return staged(seed, preset="basketball", cameras=5, people=7, seconds=20.0,
                  people_move=lambda motion, *_: raised(motion, dome))  # fmt: skip


def round_mast(seed: int) -> HandedIn:
    """All walk to and fro on one arc about the mast of a camera: always at the same distance from it."""
    mast = np.array([5.5, -7.5])

    def arc(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        middle = np.arctan2(-mast[1], -mast[0])
        period, phase = rng.uniform(13.0, 22.0, n), rng.uniform(0, 2 * np.pi, n)
        angle = middle + 0.45 * np.sin(2 * np.pi * motion.times[:, None] / period + phase)
        radius = 8.0 + rng.uniform(-0.15, 0.15, n)
        return striding(motion, mast + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1), heights)

    def rig(cameras: Rig, _: np.random.Generator) -> Rig:
        return aimed(cameras, "C2", np.array([*mast, 4.0]), np.array([0.0, 0.0, 0.8]))

    return staged(seed, people=5, seconds=30.0, rig=rig, people_move=arc)


def pontoon(seed: int) -> HandedIn:
    """People on a pontoon that sways, heaves and rolls; the cameras stand on the shore."""

    def afloat(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        time, phase = motion.times[:, None], rng.uniform(0, 2 * np.pi, 4)
        heave = 0.2 * np.sin(2 * np.pi * time / 5.0 + phase[0])
        roll = np.radians(3.5) * np.sin(2 * np.pi * time / 6.5 + phase[1])
        sway = 0.4 * np.stack([np.sin(2 * np.pi * motion.times / period + angle) for period, angle in
                               ((7.5, phase[2]), (11.0, phase[3]))], axis=-1)  # fmt: skip
        state = replace(motion.state, jump=motion.state.jump + heave + np.tan(roll) * motion.state.xy[..., 0])
        return replace(motion, state=replace(state, xy=state.xy + sway[:, None]))

    return staged(seed, people=6, seconds=40.0, people_move=afloat)


CASES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "people-walkway": ("all stand on walkways that run one way at one speed, identities found", partial(walkway)),
        "people-escalator": ("six of ten people ride escalators, the others walk on the floor", partial(escalator)),
        "people-wheelchairs": ("wheelchair basketball: everybody is seated", partial(wheelchairs)),
        "people-scooters": ("everybody rides a scooter at up to 5 m/s, identities found", partial(scooters)),
        "people-skaters": ("skaters circle one way and lean inwards by 25 degrees", partial(skaters)),
        "people-dancers": ("couples waltz and are mostly found as one person, identities found", partial(dancers)),
        "people-queue": ("a queue moves up one place every four seconds, identities found", partial(queue)),
        "people-guards": ("guards pace in four-fold symmetry, identities found", partial(guards)),
        "people-carousel": ("all stand on a platform that turns evenly, identities found", partial(carousel)),
        "people-loop": ("one person walks the same oval in nine seconds, identities found", partial(loop)),
        "people-crocodile": ("all walk one behind another on one way, identities found", partial(crocodile)),
        "people-balcony": ("two of five cameras see more people on a balcony than on the floor, identities found",
                           partial(balcony)),
        "people-glass": ("two cameras see other rooms through glass, identities found", partial(glass)),
        "people-shadows": ("shadows are found as people, identities found", partial(shadows)),
        "people-school": ("ten children and two adults, taken for adults, identities found", partial(school)),
        "people-stilts": ("four of seven people walk on stilts", partial(stilts)),
        "people-stooped": ("field workers who are always bent down, identities found", partial(stooped)),
        "people-wading": ("everybody wades in water a metre deep", partial(wading)),
        "people-wet-floor": ("boxes take in reflections on one half of the floor", partial(wet_floor)),
        "people-umbrellas": ("boxes take in umbrellas", partial(umbrellas)),
        "people-porters": ("porters carry crates on their heads one way, and come back without", partial(porters)),
        "people-grandstand": ("ten of fourteen people sit on rising terraces", partial(grandstand)),
        "people-hill": ("a round hill of 1.1 m", partial(hill)),
        "people-round-mast": ("all walk on one arc about the mast of a camera", partial(round_mast)),
        "people-pontoon": ("people on a pontoon that sways, heaves and rolls", partial(pontoon)),
    }
)  # fmt: skip
