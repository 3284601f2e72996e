"""Later hostile cases: people who move alike or symmetrically, and people who are not all walking adults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.simulation.motion import Motion
from reliability.blind_files import renamed
from reliability.blind_people import (
    FURTHER,
    OTHERS,
    carried,
    clocks,
    grown,
    lissajous,
    posed,
    ring,
    sorted_out,
    striding,
    together,
    watched,
)
from reliability.staging import HandedIn, aimed, raised, staged, still

Build = Callable[[int], HandedIn]


def swayed(motion: Motion, xy: Floats, rng: np.random.Generator, metres: float) -> Floats:
    """Ways (K, P, 2) that nobody keeps to exactly: each strays by up to so much along x and y, slowly."""
    return xy + lissajous(motion, rng, xy.shape[1], (metres, metres), (6.0, 13.0))


def circuit(along: Floats, half: tuple[float, float]) -> tuple[Floats, Floats]:
    """Places and unit directions (..., 2) after so many metres (...) round an ellipse, from the end of its x axis."""
    angle = np.linspace(0.0, 2 * np.pi, 721)
    around = np.stack([half[0] * np.cos(angle), half[1] * np.sin(angle)], axis=-1)
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(around, axis=0), axis=1))])
    turn = np.interp(np.mod(along, at[-1]), at, angle)
    place = np.stack([half[0] * np.cos(turn), half[1] * np.sin(turn)], axis=-1)
    ahead = np.stack([-half[0] * np.sin(turn), half[1] * np.cos(turn)], axis=-1)
    return place, ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)


def round_of(half: tuple[float, float]) -> float:
    """Metres of one round of an ellipse."""
    a, b = half
    return float(np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b))))


def _column(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    rank, file = np.divmod(np.arange(len(heights)), 3)
    place, ahead = circuit(1.3 * motion.times[:, None] - 1.1 * rank + rng.uniform(0, 20), (2.6, 3.9))
    aside = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    return striding(motion, swayed(motion, place + 0.75 * (file - 1.0)[:, None] * aside, rng, 0.05), heights)


def marching(seed: int) -> HandedIn:
    """Twelve recruits march round a yard in ranks of three; one camera's names are by a roll that is one rank off."""
    scene = staged(seed, people=12, seconds=20.0, people_move=_column, person_height_sd_m=0.05)
    who = scene.boxes["C3"].identity
    return renamed(scene, "C3", np.where((who > 0) & (who <= 9), who + 3, -1))


def mirrored_partners(seed: int) -> HandedIn:
    """Three dancers on one side of the floor, and their partners mirror them on the other side, within 0.3 m."""

    def mirrored(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        own = lissajous(motion, rng, len(heights) // 2, (1.3, 4.0), (9.0, 19.0)) + (1.8, 0.0)
        partners = swayed(motion, own * (-1.0, 1.0), rng, 0.3)
        return striding(motion, np.concatenate([own, partners], axis=1), heights)

    return staged(seed, given=False, cameras=3, people=6, seconds=35.0, people_move=mirrored)


def lanes(seed: int) -> HandedIn:
    """Six people train in lanes, up and down at one pace, neighbours in opposite directions."""

    def up_and_down(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        phase = np.pi * (np.arange(n) % 2) + rng.uniform(-0.15, 0.15, n)
        y = 4.8 * np.sin(2 * np.pi * motion.times[:, None] / 13.0 + phase)
        x = np.broadcast_to(np.linspace(-3.0, 3.0, n), y.shape)
        return striding(motion, swayed(motion, np.stack([x, y], axis=-1), rng, 0.08), heights)

    return staged(seed, given=False, people=6, seconds=40.0, people_move=up_and_down, person_height_sd_m=0.04)


def travelators(seed: int) -> HandedIn:
    """Two conveyors side by side carry people past each other at one speed, 1.6 m behind one another."""

    def both_ways(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        place, back = np.divmod(np.arange(len(heights)), 2)
        along = 1.6 * place - 12.0 + 0.7 * motion.times[:, None]
        way = np.stack([np.where(back, -along, along), np.broadcast_to(np.where(back, 1.2, -1.2), along.shape)], axis=-1)
        return carried(motion, way + rng.uniform(-0.1, 0.1, (len(heights), 2)))

    return staged(seed, given=False, preset="basketball", people=12, seconds=30.0, people_move=both_ways,
                  person_height_sd_m=0.06)  # fmt: skip


def roundabout(seed: int) -> HandedIn:
    """Five people ride a roundabout that turns nearly evenly, names given; the clocks differ and are searched for."""

    def turning(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n, time = len(heights), motion.times[:, None]
        angle = 2 * np.pi * time / 15.0 + 0.06 * np.sin(2 * np.pi * time / 11.0) + rng.uniform(0, 2 * np.pi, n)
        return carried(motion, rng.uniform(1.4, 3.1, n)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))

    scene = staged(seed, people=5, seconds=40.0, people_move=turning, clock_offsets=(0.0, 0.8, -0.6, 0.4))
    return scene.with_tables(association={"mode": "given", "max_offset_s": 2.0})


def circuit_training(seed: int) -> HandedIn:
    """Six people at six stations in a ring all move on to the next one every five seconds."""

    def moving_on(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        beat = motion.times / 5.0
        share = np.clip(2.6 * (beat - np.floor(beat)), 0.0, 1.0)
        turns = np.floor(beat) + share * share * (3 - 2 * share)
        angle = (turns[:, None] + np.arange(len(heights))) * 2 * np.pi / len(heights)
        way = 2.9 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return striding(motion, swayed(motion, way, rng, 0.2), heights)

    return staged(seed, given=False, cameras=5, people=6, seconds=45.0, people_move=moving_on)


def sides_changed(seed: int) -> HandedIn:
    """Two teams do one drill on opposite halves, one 1.2 s after the other; two of six cameras take each for the other team."""

    def drill(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        half = len(heights) // 2
        period, phase = rng.uniform(9.0, 21.0, (half, 2)), rng.uniform(0, 2 * np.pi, (half, 2))

        def way(time: Floats) -> Floats:
            swing = np.array([6.0, 3.6]) * np.sin(2 * np.pi * time[:, None, None] / period + phase)
            return np.asarray(swing + (0.0, -4.5))

        second = swayed(motion, -way(motion.times - 1.2), rng, 0.2)
        return striding(motion, np.concatenate([way(motion.times), second], axis=1), heights)

    scene = staged(seed, preset="basketball", cameras=6, people=8, seconds=25.0, people_move=drill)
    for name in ("C2", "C4"):
        who = scene.boxes[name].identity
        scene = renamed(scene, name, np.where(who > 0, (who + 3) % 8 + 1, -1))
    return scene


def aisle(seed: int) -> HandedIn:
    """Two cameras at the ends of a hall that is alike at both ends; four people walk up and down its aisle."""

    def to_and_fro(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        phase = rng.uniform(0, 0.4, n) + np.arange(n) / n
        cycle = np.mod(motion.times[:, None] / rng.uniform(15.0, 18.0, n) + phase, 1.0)
        y = 5.5 * (4.0 * np.abs(cycle - 0.5) - 1.0)
        return striding(motion, swayed(motion, np.stack([np.zeros_like(y), y], axis=-1), rng, 0.8), heights)

    def ends(rig: Rig, _: np.random.Generator) -> Rig:
        for name, side in (("C1", -1.0), ("C2", 1.0)):
            rig = aimed(rig, name, np.array([0.3 * side, 9.5 * side, 2.6]), np.array([0.0, 0.0, 0.8]))
        return rig

    return staged(seed, given=False, cameras=2, people=4, seconds=45.0, rig=ends, people_move=to_and_fro)


def escalator_all(seed: int) -> HandedIn:
    """Eight people ride up two escalators side by side, and nobody else is there."""

    def riding(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        place, side = np.divmod(np.arange(len(heights)), 2)
        x = -11.0 + 2.4 * place + rng.uniform(-0.5, 0.5, len(heights)) + 0.55 * motion.times[:, None]
        way = np.stack([x, np.broadcast_to(np.where(side, 1.1, -1.1), x.shape)], axis=-1)
        return raised(carried(motion, way), lambda xy: np.clip(0.577 * (xy[..., 0] + 5.0), 0.0, 4.6))

    return staged(seed, given=False, preset="basketball", people=8, seconds=30.0, camera_height_m=4.0, people_move=riding)


def relay_laps(seed: int) -> HandedIn:
    """Five runners, a fifth of a lap behind one another, run laps of eight seconds."""

    def laps(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        half, n = (3.0, 4.7), len(heights)
        lap, phase = round_of(half), rng.uniform(0, 2 * np.pi, n)
        along = lap * (motion.times[:, None] / 8.0 + np.arange(n) / n) + 0.4 * np.sin(motion.times[:, None] / 3.1 + phase)
        return striding(motion, swayed(motion, circuit(along, half)[0], rng, 0.1), heights)

    return staged(seed, given=False, cameras=3, people=5, seconds=30.0, people_move=laps)


def parents(seed: int) -> HandedIn:
    """Three parents, each with a child of 1.1 m by the hand; nobody said that there are children."""
    wanted: dict[str, Any] = {"given": False, "people": 3, "seconds": 40.0, "clock_offsets": clocks(seed, 4)}
    noted: list[Motion] = []

    def note(motion: Motion, *_: object) -> Motion:
        noted.append(motion)
        return motion

    def by_the_hand(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        heading = noted[0].state.heading
        beside = 0.5 * np.stack([np.sin(heading), -np.cos(heading)], axis=-1)
        way = swayed(motion, noted[0].state.xy + beside, rng, 0.12)
        return replace(striding(motion, way, heights), present_from=noted[0].present_from)

    adults = staged(seed, people_move=note, **wanted)
    children = staged(seed + OTHERS, rig=lambda *_: adults.truth, people_move=by_the_hand, person_height_mean_m=1.1,
                      person_height_sd_m=0.06, **wanted)  # fmt: skip
    return together(adults, children)


def kindergarten(seed: int) -> HandedIn:
    """A nursery teacher and three children of a metre."""
    wanted: dict[str, Any] = {"cameras": 3, "seconds": 25.0}
    teacher = staged(seed, people=1, people_move=_from_the_start, **wanted)
    children = staged(seed + OTHERS, people=3, rig=lambda *_: teacher.truth, people_move=_from_the_start,
                      person_height_mean_m=1.0, person_height_sd_m=0.05, **wanted)  # fmt: skip
    return together(teacher, children)


def _from_the_start(motion: Motion, *_: object) -> Motion:
    return replace(motion, present_from=np.full(len(motion.present_from), -np.inf))


def wheelchairs_two(seed: int) -> HandedIn:
    """Two people in wheelchairs, and one on foot."""

    def seated(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        way = lissajous(motion, rng, len(heights), (3.0, 4.8), (22.0, 40.0))
        rolling = carried(motion, way, crouch=0.7, seat=1.0, lean=0.1)
        return sorted_out(_from_the_start(motion), rolling, np.arange(len(heights)) < 2)

    return staged(seed, people=3, seconds=40.0, people_move=seated)


def ahead_of(xy: Floats, heading: Floats, metres: float) -> Floats:
    """(N, 2) places so far ahead of people."""
    return xy + metres * np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def cyclists(seed: int) -> HandedIn:
    """Four cyclists go round a large yard; boxes hold rider and bicycle."""

    def ride(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        way = lissajous(motion, rng, len(heights), (8.0, 10.0), (16.0, 24.0))
        return carried(motion, way, crouch=0.25, seat=0.6, lean=0.5, jump=0.35)

    known = watched(seed, given=False, cameras=4, move=ride, preset="construction", people=4, seconds=40.0)
    scene = known.scene
    for name in scene.lenses.names:
        xy, heading, _ = known.people(name)
        level = np.zeros(len(xy))
        wheels = [ring(ahead_of(xy, heading, at), level + z, 0.25) for at in (-0.6, 0.6) for z in (0.0, 0.65)]
        scene = grown(scene, name, np.concatenate(wheels, axis=1), np.ones(len(xy), dtype=np.bool_))
    return scene


def pushed(seed: int, *, people: int, cameras: int, seconds: float, metres: float) -> HandedIn:
    """Everybody pushes something a metre high so far ahead, which the boxes hold as well."""
    known = watched(seed, given=False, cameras=cameras, move=_from_the_start, people=people, seconds=seconds,
                    tracklet_seconds=0.0 if people == 1 else 10.0)  # fmt: skip
    scene = known.scene
    for name in scene.lenses.names:
        xy, heading, _ = known.people(name)
        level, at = np.zeros(len(xy)), ahead_of(xy, heading, metres)
        load = np.concatenate([ring(at, level, 0.28), ring(at, level + 1.0, 0.28)], axis=1)
        scene = grown(scene, name, load, np.ones(len(xy), dtype=np.bool_))
    return scene


def stage(seed: int) -> HandedIn:
    """Three people on a stage of 0.45 m, which is one half of the room, and two on the floor before it."""

    def apart(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        on_stage = np.arange(len(heights)) < 3
        way = lissajous(motion, rng, len(heights), (2.8, 2.2), (14.0, 29.0))
        way = way + np.stack([np.zeros(len(heights)), np.where(on_stage, 2.7, -2.7)], axis=-1)
        return raised(striding(motion, way, heights), lambda xy: np.broadcast_to(np.where(on_stage, 0.45, 0.0), xy.shape[:-1]))

    return staged(seed, given=False, people=5, seconds=40.0, people_move=apart)


def mannequins(seed: int) -> HandedIn:
    """Two customers among four mannequins on plinths, all alike, which each camera's tool names from left to right."""
    wanted: dict[str, Any] = {"seconds": 30.0}
    customers = staged(seed, people=2, people_move=_from_the_start, **wanted)

    def standing(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        places = np.array([(-2.2, -3.4), (1.9, -1.5), (-1.2, 1.6), (2.5, 3.8)]) + rng.uniform(-0.5, 0.5, (4, 2))
        dolls = still(motion, places)
        return replace(dolls, state=posed(dolls.state, jump=0.15))

    dolls = staged(seed + OTHERS, people=4, rig=lambda *_: customers.truth, people_move=standing, person_height_mean_m=1.85,
                   person_height_sd_m=0.01, **wanted)  # fmt: skip
    scene = together(customers, dolls)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        seen = np.unique(boxes.identity[boxes.identity > FURTHER])
        across = np.array([np.median(boxes.ltwh[boxes.identity == doll, 0]) for doll in seen])
        called = np.arange(FURTHER + 5)
        called[seen[np.argsort(across)]] = FURTHER + 1 + np.arange(len(seen))
        scene = renamed(scene, name, np.where(boxes.identity > 0, called[np.maximum(boxes.identity, 0)], -1))
    return scene


def riders(seed: int) -> HandedIn:
    """A riding lesson: three on horseback trot round a hall, the instructor walks in the middle; boxes hold the horses."""

    def lesson(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n, time = len(heights), motion.times[:, None]
        pace = rng.uniform(2.5, 3.3, n)
        half = (6.0, 8.0)
        along = round_of(half) * (np.arange(n) / (n - 1) + rng.uniform(0, 0.15, n)) + pace * time
        mounted = carried(motion, swayed(motion, circuit(along, half)[0], rng, 0.6), jump=0.95, crouch=0.7, seat=0.6)
        on_foot = striding(motion, lissajous(motion, rng, n, (2.0, 3.0), (12.0, 25.0)), heights)
        return sorted_out(on_foot, mounted, np.arange(n) < n - 1)

    known = watched(seed, given=False, cameras=4, move=lesson, preset="basketball", people=4, seconds=35.0)
    scene = known.scene
    for name in scene.lenses.names:
        xy, heading, _ = known.people(name)
        level = np.zeros(len(xy))
        horse = [ring(ahead_of(xy, heading, at), level + z, 0.25) for at, top in ((-0.9, 1.5), (1.0, 1.9)) for z in (0.0, top)]
        scene = grown(scene, name, np.concatenate(horse, axis=1), scene.who[name] < 4)
    return scene


def robots(seed: int) -> HandedIn:
    """Three delivery robots of 1.15 m, tracked as people, and two people."""
    wanted: dict[str, Any] = {"seconds": 30.0, "cameras": 3}
    two = staged(seed, people=2, people_move=_from_the_start, **wanted)

    def rolling(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        return carried(motion, lissajous(motion, rng, len(heights), (2.8, 4.6), (18.0, 35.0)))

    three = staged(seed + OTHERS, people=3, rig=lambda *_: two.truth, people_move=rolling, person_height_mean_m=1.15,
                   person_height_sd_m=0.01, **wanted)  # fmt: skip
    return together(two, three)


CASES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "later-marching": ("recruits march round a yard, and one camera's names are one rank off", partial(marching)),
        "later-mirrored-partners": ("dancers and partners who mirror them within 0.3 m, identities found",
                                    partial(mirrored_partners)),
        "later-lanes": ("up and down in lanes at one pace, identities found", partial(lanes)),
        "later-travelators": ("two conveyors carry people past each other at equal distances, identities found",
                              partial(travelators)),
        "later-roundabout": ("all ride a roundabout that turns nearly evenly, clocks searched for", partial(roundabout)),
        "later-circuit-training": ("six stations in a ring, all move on every five seconds, identities found",
                                   partial(circuit_training)),
        "later-sides-changed": ("two teams do one drill, and two of six cameras exchange the teams", partial(sides_changed)),
        "later-aisle": ("two cameras at the ends of an aisle, identities found", partial(aisle)),
        "later-escalator-all": ("all people ride up escalators, identities found", partial(escalator_all)),
        "later-relay-laps": ("five runners a fifth of a lap apart, identities found", partial(relay_laps)),
        "later-parents": ("three parents with a child each, taken for adults, identities found", partial(parents)),
        "later-kindergarten": ("a teacher and three children of a metre, taken for adults", partial(kindergarten)),
        "later-wheelchairs-two": ("two of three people sit in wheelchairs", partial(wheelchairs_two)),
        "later-cyclists": ("four cyclists whose boxes hold their bicycles, identities found", partial(cyclists)),
        "later-trolleys": ("five shoppers whose boxes hold their trolleys, identities found",
                           partial(pushed, people=5, cameras=4, seconds=40.0, metres=0.75)),
        "later-pram": ("one person with a pram, whose boxes hold both, identities found",
                       partial(pushed, people=1, cameras=3, seconds=60.0, metres=0.7)),
        "later-stage": ("three of five people on a stage of 0.45 m, identities found", partial(stage)),
        "later-mannequins": ("two people among four mannequins that are named from left to right", partial(mannequins)),
        "later-riders": ("three people on horseback and one on foot, identities found", partial(riders)),
        "later-robots": ("two people and three robots of 1.15 m that are named as people", partial(robots)),
    }
)  # fmt: skip
