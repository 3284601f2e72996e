"""Blind hostile cases: files that are not what their names say, clocks that do not count seconds, names of other people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.simulation.motion import Motion
from reliability.staging import HandedIn, joined, staged, walking

Build = Callable[[int], HandedIn]
NEW_TRACKS = 1000
"""A tracker numbers on from here after a break."""


def frames_of(seconds: float, fps: float) -> Ints:
    """The frame numbers of a recording, from 1."""
    return np.arange(1, round(seconds * fps) + 1)


def retimed(scene: HandedIn, name: str, shown: Ints, breaks: int = 0) -> HandedIn:
    """A file whose frame k + 1 shows what the camera saw in frame `shown[k]`; 0: nothing.

    Args:
        scene: of the recordings as they were.
        name: the camera.
        shown: (frames of the file,).
        breaks: after a jump of more frames than this the tracker starts new tracks; 0: names go on.
    """
    boxes = scene.boxes[name]
    part = np.cumsum(np.abs(np.diff(shown, prepend=shown[:1]) - 1) > breaks) if breaks else np.zeros_like(shown)
    rows = [np.flatnonzero(boxes.frame == frame) for frame in shown]
    place = np.repeat(np.arange(len(shown)), [len(some) for some in rows])
    row = np.concatenate(rows)
    identity = np.where(boxes.identity[row] < 0, -1, boxes.identity[row] + NEW_TRACKS * part[place])
    return scene.with_boxes(name, Boxes(place + 1, identity, boxes.ltwh[row], boxes.score[row]), scene.who[name][row])


def renamed(scene: HandedIn, name: str, identity: Ints) -> HandedIn:
    """Other names of a camera's boxes; who is twice in a frame is so in the larger box only."""
    boxes = scene.boxes[name]
    taken: set[tuple[int, int]] = set()
    kept = np.array(identity)
    for row in np.argsort(-boxes.ltwh[:, 3], kind="stable"):
        key = (int(boxes.frame[row]), int(kept[row]))
        if key[1] >= 0 and key in taken:
            kept[row] = -1
        taken.add(key)
    return scene.with_boxes(name, replace(boxes, identity=kept), scene.who[name])


def yesterday(seed: int, *, given: bool, cameras: tuple[str, ...], people: int, preset: str) -> HandedIn:
    """Yesterday's recordings of some cameras: the same places, other ways of the same people."""
    wanted: dict[str, Any] = {"given": given, "preset": preset, "people": people, "seconds": 40.0}
    today = staged(seed, **wanted)
    before = staged(seed + 500_000, rig=lambda *_: today.lenses, **wanted)
    for name in cameras:
        today = today.with_boxes(name, before.boxes[name], before.who[name])
    return today


def looped(seed: int) -> HandedIn:
    """One camera's file is a clip of 15 s, played four times over."""
    scene = staged(seed, seconds=60.0, people=5)
    return retimed(scene, "C3", np.tile(frames_of(15, 5), 4))


def glued(seed: int) -> HandedIn:
    """Two takes in each file; the cameras were stopped and started by hand, a few seconds apart."""
    scene = staged(seed, given=False, seconds=60.0, cameras=5, people=5)
    rng = np.random.default_rng((seed, 301))
    for name in scene.lenses.names:
        stop, start = round(5 * rng.uniform(22, 27)), round(5 * rng.uniform(31, 36))
        scene = retimed(scene, name, np.concatenate([np.arange(1, stop), np.arange(start, 301)]), breaks=5)
    return scene


def backwards(seed: int) -> HandedIn:
    """The frames of one camera in reverse order: images sorted by age, the newest first."""
    return retimed(staged(seed, preset="basketball", people=8, seconds=30.0), "C2", frames_of(30, 5)[::-1])


def uneven(seed: int) -> HandedIn:
    """Phones whose frame rate follows the light, each by itself; the frames are numbered as if it were constant."""
    scene = staged(seed, seconds=45.0, fps=10.0, cameras=3)
    rng, rates = np.random.default_rng((seed, 302)), {}
    for name in scene.lenses.names:
        phase, at, shown = rng.uniform(0, 2 * np.pi), 1.0, []
        while at < 450.5:
            shown.append(int(at))
            at += 2.0 + 0.7 * np.sin(2 * np.pi * at / 80.0 + phase)
        scene, rates[name] = retimed(scene, name, np.array(shown)), len(shown) / 45.0
    return replace(scene, fps=rates)


def stuck(seed: int) -> HandedIn:
    """Two encoders that repeat a picture for one to three seconds, again and again, and then catch up."""
    scene = staged(seed, seconds=40.0, preset="construction", people=9)
    for index, name in enumerate(("C1", "C4")):
        rng, shown, at = np.random.default_rng((seed, 303, index)), frames_of(40, 5), 0
        while (at := at + int(rng.integers(8, 20))) < len(shown):
            end = at + int(rng.integers(5, 16))
            shown[at:end] = shown[at]
            at = end
        scene = retimed(scene, name, shown)
    return scene


def nightfall(seed: int) -> HandedIn:
    """At dusk each camera drops to half its rate, some seconds apart; the frames are numbered on."""
    scene = staged(seed, given=False, seconds=50.0, fps=10.0, people=5)
    rng = np.random.default_rng((seed, 304))
    for name in scene.lenses.names:
        dusk = round(10 * rng.uniform(21, 26))
        scene = retimed(scene, name, np.concatenate([np.arange(1, dusk), np.arange(dusk, 501, 2)]))
    return scene


def set_back(seed: int) -> HandedIn:
    """The clock of one recorder, of two cameras, is set back by a second half-way: later frames overwrite earlier ones."""
    scene = staged(seed, seconds=40.0, cameras=5, people=7)
    for name in ("C2", "C5"):
        scene = retimed(scene, name, np.concatenate([np.arange(1, 96), np.arange(101, 201)]))
    return scene


def sawtooth(seed: int) -> HandedIn:
    """Clocks of two cameras that gain 6 % and are set every ten seconds, each at its own time."""
    scene = staged(seed, given=False, seconds=60.0, fps=10.0, people=4, cameras=4)
    rng = np.random.default_rng((seed, 305))
    for name in ("C2", "C3"):
        time = (frames_of(60, 10) - 1) / 10.0
        since = np.mod(time + rng.uniform(0, 10), 10.0)
        number = np.round(10 * (time + 0.06 * since)).astype(np.int64)
        shown = np.zeros(number.max() + 1, dtype=np.int64)
        shown[number] = frames_of(60, 10)  # of two frames of one number the later one stays
        scene = retimed(scene, name, shown)
    return scene


def from_zero(seed: int) -> HandedIn:
    """Two frames per second; numbered from 0 in two cameras, from 1 in the others."""
    scene = staged(seed, seconds=60.0, fps=2.0, preset="basketball", people=6)
    for name in ("C2", "C4"):
        boxes = scene.boxes[name]
        scene = scene.with_boxes(name, replace(boxes, frame=boxes.frame - 1), scene.who[name])
    return scene


def triggered(seed: int) -> HandedIn:
    """Each camera records only while somebody is in the middle of its picture, and a second longer; the pieces are joined."""
    scene = staged(seed, given=False, seconds=60.0, preset="construction", people=3)
    for name in scene.lenses.names:
        boxes, size = scene.boxes[name], np.array(scene.lenses[name].lens.size)
        aside = np.abs(boxes.ltwh[:, 0] + boxes.ltwh[:, 2] / 2 - size[0] / 2)
        seen = np.zeros(306, dtype=np.bool_)
        for frame in np.unique(boxes.frame[(aside < 0.17 * size[0]) & (boxes.identity > 0)]):
            seen[frame : frame + 5] = True
        scene = retimed(scene, name, np.flatnonzero(seen[:301]), breaks=5)
    return scene


def jerseys(seed: int) -> HandedIn:
    """People are named by the number on the jersey; two teams of five have the same numbers, the nearer one is read."""
    scene = staged(seed, preset="basketball", people=10, seconds=40.0)
    for name in scene.lenses.names:
        who = scene.boxes[name].identity
        scene = renamed(scene, name, np.where(who > 0, (who - 1) % 5 + 1, -1))
    return scene


def from_left(seed: int) -> HandedIn:
    """A detector without a tracker: in each frame people are numbered from left to right."""
    scene = staged(seed, people=3, cameras=3, seconds=45.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        order = np.lexsort([boxes.ltwh[:, 0], boxes.frame])
        _, first, count = np.unique(boxes.frame, return_index=True, return_counts=True)
        identity = np.zeros_like(boxes.frame)
        identity[order] = np.arange(len(order)) - np.repeat(first, count) + 1
        scene = scene.with_boxes(name, replace(boxes, identity=identity), scene.who[name])
    return scene


def _arm_in_arm(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
    xy, heading = np.array(motion.state.xy), motion.state.heading[:, 0]
    xy[:, 1] = xy[:, 0] + 0.7 * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    moved = walking(motion, xy, heights)
    entered = np.array(motion.present_from)
    entered[1] = entered[0]
    return replace(moved, present_from=entered)


def couple(seed: int) -> HandedIn:
    """Two of eight people are named: a couple, arm in arm, whom two cameras take for each other."""
    scene = staged(seed, people=8, seconds=40.0, people_move=_arm_in_arm)
    for name in scene.lenses.names:
        who = scene.boxes[name].identity
        shown = 3 - who if name in ("C2", "C3") else who
        scene = renamed(scene, name, np.where((who == 1) | (who == 2), shown, -1))
    return scene


def uniforms(seed: int) -> HandedIn:
    """Two of five wear a uniform; in each view they take each other's name every few seconds, or not."""
    scene = staged(seed, preset="construction", people=5, seconds=50.0, cameras=5)
    for index, name in enumerate(scene.lenses.names):
        boxes, rng = scene.boxes[name], np.random.default_rng((seed, 306, index))
        mistaken = (rng.uniform(size=20) < 0.5)[boxes.frame // 20] & np.isin(boxes.identity, (1, 2))
        scene = renamed(scene, name, np.where(mistaken, 3 - boxes.identity, boxes.identity))
    return scene


def late_tags(seed: int) -> HandedIn:
    """Names come from radio tags, 1.6 s late: each goes to the box nearest to where its owner was."""
    scene = staged(seed, people=6, seconds=40.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        feet = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] * (0.5, 1.0)
        identity = np.full(len(boxes), -1)
        for frame in np.unique(boxes.frame):
            now = np.flatnonzero(boxes.frame == frame)
            then = np.flatnonzero((boxes.frame == frame - 8) & (boxes.identity > 0))
            apart = np.linalg.norm(feet[now][:, None] - feet[then][None], axis=-1)
            for _ in range(min(apart.shape)):
                box, tag = np.unravel_index(np.argmin(apart), apart.shape)
                identity[now[box]] = boxes.identity[then[tag]]
                apart[box, :] = apart[:, tag] = np.inf
        scene = scene.with_boxes(name, replace(boxes, identity=identity), scene.who[name])
    return scene


def all_too_fast(seed: int) -> HandedIn:
    """The scene file says 25 frames per second of all cameras; they have 10."""
    return replace(staged(seed, given=False, seconds=40.0, fps=10.0, cameras=3, people=5), fps=25.0)


def _distance(rig: Rig, first: str, second: str) -> float:
    """Between two cameras, metres."""
    one, other = rig[first].pose, rig[second].pose
    assert one is not None
    assert other is not None
    return float(np.linalg.norm(one.centre - other.centre))


def copied_check(seed: int) -> HandedIn:
    """A mean height 9 % too tall, and a check that was not measured but copied from the first result."""
    scene = staged(seed, people=5, seconds=40.0)
    stated = 1.09 * _distance(scene.truth, "C1", "C3")
    checks = [{"between": ["C1", "C3"], "metres": round(stated, 2), "sd_m": 0.05}]
    return scene.with_tables(scale={"person_height_m": 1.875, "person_height_mean_sd_m": 0.03, "checks": checks})


def in_yards(seed: int) -> HandedIn:
    """Distances between cameras, measured in yards and stated in metres."""
    scene = staged(seed, given=False, preset="basketball", people=8, seconds=40.0)
    pairs = (("C1", "C2"), ("C2", "C3"), ("C3", "C4"))
    lengths = [{"between": list(pair), "metres": round(_distance(scene.truth, *pair) / 0.9144, 2)} for pair in pairs]
    return scene.with_tables(scale={"distances": lengths})


def wrong_order(seed: int) -> HandedIn:
    """Distances between cameras, measured clockwise and written down the other way about, from the wrong camera."""
    scene = staged(seed, cameras=6, people=7)
    names = scene.lenses.names
    pairs = list(zip(names, names[1:] + names[:1], strict=True))
    measured = [round(_distance(scene.truth, *pair), 2) for pair in pairs]
    lengths = [
        {"between": list(pair), "metres": metres} for pair, metres in zip(pairs, measured[2::-1] + measured[:2:-1], strict=True)
    ]
    return scene.with_tables(scale={"distances": lengths})


def wrong_person(seed: int) -> HandedIn:
    """The height of the tallest, stated of the shortest."""
    known: list[Floats] = []

    def note(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        known.append(heights)
        return motion

    scene = staged(seed, people=6, preset="construction", seconds=40.0, people_move=note)
    heights = known[0]
    stated = {"identity": int(np.argmin(heights)) + 1, "height_m": round(float(heights.max()), 2)}
    return scene.with_tables(scale={"people": [stated]})


def replugged(seed: int) -> HandedIn:
    """The cables of two cameras were exchanged at the recorder half-way."""
    scene = staged(seed, given=False, seconds=50.0, people=6, clock_offsets=(0.0, 0.4, 0.4, -0.6))
    spoilt = scene
    for name, other in (("C2", "C3"), ("C3", "C2")):
        before, after = scene.boxes[name].frame <= 125, scene.boxes[other].frame > 125
        second = scene.boxes[other].take(after)
        second = replace(second, identity=np.where(second.identity > 0, second.identity + NEW_TRACKS, -1))
        boxes, order = joined(scene.boxes[name].take(before), second)
        who = np.concatenate([scene.who[name][before], scene.who[other][after]])[order]
        spoilt = spoilt.with_boxes(name, boxes, who)
    crossed = {"C2": scene.truth["C3"].pose, "C3": scene.truth["C2"].pose}
    later = Rig(tuple(replace(camera, pose=crossed.get(camera.name, camera.pose)) for camera in scene.truth))
    return replace(spoilt, later=later)


def multiplexed(seed: int) -> HandedIn:
    """A multiplexer out of step: every fourth frame of one camera's file shows its neighbour's picture."""
    scene = staged(seed, seconds=30.0, people=6)
    own, foreign = scene.boxes["C2"].frame % 4 != 0, scene.boxes["C3"].frame % 4 == 0
    boxes, order = joined(scene.boxes["C2"].take(own), scene.boxes["C3"].take(foreign))
    return scene.with_boxes("C2", boxes, np.concatenate([scene.who["C2"][own], scene.who["C3"][foreign]])[order])


def _pointed(scene: HandedIn, name: str, person: int) -> dict[str, Any]:
    """A pixel on a person at a time when nobody else's box holds it."""
    boxes = scene.boxes[name]
    middle = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2
    mine = np.flatnonzero((scene.who[name] == person) & (boxes.identity > 0))
    for row in mine[len(mine) // 3 :]:
        there = boxes.frame == boxes.frame[row]
        low, high = boxes.ltwh[there, :2], boxes.ltwh[there, :2] + boxes.ltwh[there, 2:]
        if ((low <= middle[row]) & (middle[row] <= high)).all(axis=1).sum() == 1:
            break
    return {"camera": name, "frame": int(boxes.frame[row]), "at": [round(float(value), 1) for value in middle[row]]}


def wrongly_same(seed: int) -> HandedIn:
    """Three corrections by hand, each of which says that two different people are one, in a ring."""
    scene = staged(seed, given=False, seconds=30.0, people=5, tracklet_seconds=0.0)
    pairs = [[_pointed(scene, "C1", one), _pointed(scene, "C2", other)] for one, other in ((1, 2), (2, 3), (3, 1))]
    return scene.with_tables(association={"mode": "combined", "same": [{"boxes": pair} for pair in pairs]})


CASES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "files-yesterday": ("one camera's file is of the day before, identities found",
                            partial(yesterday, given=False, cameras=("C2",), people=6, preset="terrace")),
        "files-yesterday-half": ("two of four cameras' files are of the day before, people numbered alike",
                                 partial(yesterday, given=True, cameras=("C3", "C4"), people=8, preset="construction")),
        "files-looped": ("one file is a clip of 15 s, four times over", partial(looped)),
        "files-glued": ("two takes in each file, stopped and started some seconds apart, identities found", partial(glued)),
        "files-backwards": ("one camera's frames in reverse order", partial(backwards)),
        "files-uneven": ("frame rates that follow the light, taken for constant", partial(uneven)),
        "files-stuck": ("two encoders that repeat pictures for seconds", partial(stuck)),
        "files-nightfall": ("cameras drop to half their rate at dusk, identities found", partial(nightfall)),
        "files-set-back": ("the clock of two of five cameras set back by a second half-way", partial(set_back)),
        "files-sawtooth": ("clocks that gain 6 % and are set every ten seconds, identities found", partial(sawtooth)),
        "files-from-zero": ("two frames per second, numbered from 0 in two cameras", partial(from_zero)),
        "files-triggered": ("cameras that record only what is in their middle, identities found", partial(triggered)),
        "files-jerseys": ("names by jersey numbers, which two teams share", partial(jerseys)),
        "files-from-left": ("people numbered from left to right in each frame", partial(from_left)),
        "files-couple": ("only a couple is named, and two cameras take them for each other", partial(couple)),
        "files-uniforms": ("two people in uniform, confused for seconds in all views", partial(uniforms)),
        "files-late-tags": ("names from radio tags that are 1.6 s late", partial(late_tags)),
        "files-all-too-fast": ("25 frames per second stated for 10 in all cameras", partial(all_too_fast)),
        "files-copied-check": ("people stated 9 % too tall, and a check copied from that result", partial(copied_check)),
        "files-in-yards": ("distances between cameras in yards", partial(in_yards)),
        "files-wrong-order": ("distances between cameras in the wrong order", partial(wrong_order)),
        "files-wrong-person": ("the height of the tallest stated of the shortest", partial(wrong_person)),
        "files-replugged": ("two cameras' cables exchanged half-way, identities found", partial(replugged)),
        "files-multiplexed": ("every fourth frame of one file shows another camera's picture", partial(multiplexed)),
        "files-wrongly-same": ("corrections by hand that join different people", partial(wrongly_same)),
    }
)  # fmt: skip
