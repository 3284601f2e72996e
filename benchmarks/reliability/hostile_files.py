"""Hostile recordings: clocks, frames, identities and detections that are not what they are said to be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from passerby.core.observations import Boxes
from passerby.simulation import SimulationOptions, simulate
from reliability.staging import HandedIn, joined, staged, walked_places

Build = Callable[[int], HandedIn]
SEARCH = {"association": {"mode": "given", "max_offset_s": 5.0}}


def drifting(seed: int, *, rate: float, given: bool, seconds: float = 60.0, search: bool = False) -> HandedIn:
    """A clock that runs too fast by a share: its frames are numbered at another rate than stated."""
    rates = (5.0, 5.0 * (1 + rate), 5.0, 5.0)
    scene = staged(seed, given=given, seconds=seconds, camera_fps=rates, people=5)
    scene = replace(scene, fps=5.0)
    return replace(scene, tables=SEARCH) if search else scene


def wrong_rate(seed: int, *, given: bool) -> HandedIn:
    """25 frames per second stated for 30 in one camera."""
    return drifting(seed, rate=0.2, given=given, seconds=30.0)


def frames_lost(seed: int, *, share: float = 0.0, burst_s: float = 0.0, given: bool = True, search: bool = False) -> HandedIn:
    """A recorder that loses frames of one camera, and numbers those it keeps one after another."""
    scene = staged(seed, given=given, clock_offsets=0.0)
    boxes = scene.boxes["C2"]
    rng = np.random.default_rng((seed, 9))
    last = int(boxes.frame.max())
    lost = rng.uniform(size=last + 1) < share
    middle = last // 2
    lost[middle : middle + round(5 * burst_s)] = True
    number = np.cumsum(~lost[1:], dtype=np.int64)
    keep = ~lost[boxes.frame]
    renamed = Boxes(number[boxes.frame[keep] - 1], boxes.identity[keep], boxes.ltwh[keep], boxes.score[keep])
    scene = scene.with_boxes("C2", renamed, scene.who["C2"][keep])
    return replace(scene, tables=SEARCH) if search else scene


def cut_short(seed: int, *, given: bool) -> HandedIn:
    """A camera that stopped recording half-way."""
    scene = staged(seed, given=given)
    return scene.kept("C2", scene.boxes["C2"].frame <= 75)


def too_late(seed: int, *, given: bool) -> HandedIn:
    """A recording that began four seconds late; with identities given nobody searches for it."""
    return staged(seed, given=given, clock_offsets=(0.0, 4.0, 0.0, 0.0))


def names_shuffled(seed: int, *, how: str) -> HandedIn:
    """Given identities that are wrong: anew in each frame, or one permutation for each camera, or for one."""
    scene = staged(seed)
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 11, index))
        boxes = scene.boxes[name]
        identity = boxes.identity.copy()
        if how == "frames":
            for frame in np.unique(boxes.frame):
                rows = np.flatnonzero((boxes.frame == frame) & (identity > 0))
                identity[rows] = rng.permutation(6)[: len(rows)] + 1
        elif how == "cameras" or name == "C2":
            turn = np.roll(np.arange(6), index + 1) if how == "cameras" else np.array([1, 0, 2, 3, 4, 5])
            if how == "half":
                turn = np.array([1, 2, 0, 3, 4, 5])
            identity = np.where(identity > 0, turn[np.maximum(identity - 1, 0)] + 1, identity)
        scene = scene.with_boxes(name, replace(boxes, identity=identity))
    return scene


def numbers_mistaken(seed: int) -> HandedIn:
    """Each camera's own tracklet numbers, handed in as identities."""
    return staged(seed, given=False, clock_offsets=0.0).with_tables(association={"mode": "given"})


def phantoms(seed: int, *, share: float, given: bool, named: bool = False) -> HandedIn:
    """So many false boxes to each true one; named: under the identities of people who are not in the view."""
    scene = staged(seed, given=given, false_boxes=share)
    if not named:
        return scene
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 13, index))
        boxes = scene.boxes[name]
        identity = boxes.identity.copy()
        for frame in np.unique(boxes.frame):
            rows = np.flatnonzero(boxes.frame == frame)
            free = np.setdiff1d(np.arange(1, 7), identity[rows])
            unnamed = rows[identity[rows] < 0]
            chosen = rng.permutation(free)[: len(unnamed)]
            identity[unnamed[: len(chosen)]] = chosen
        scene = scene.with_boxes(name, replace(boxes, identity=identity))
    return scene


def ghosts(seed: int) -> HandedIn:
    """False boxes that are tracked: each camera has as many wandering ghosts as people."""
    scene, other = staged(seed, given=False), staged(seed + 700_000, given=False)
    for name in scene.lenses.names:
        own, second = scene.boxes[name], other.boxes[name]
        identity = np.where(second.identity > 0, second.identity + 1000, -1)
        boxes, order = joined(own, replace(second, identity=identity))
        scene = scene.with_boxes(name, boxes, np.concatenate([scene.who[name], np.full(len(second), -1)])[order])
    return scene


def no_overlap(seed: int, *, given: bool) -> HandedIn:
    """Two pairs of cameras about two places, 250 m apart."""
    options = SimulationOptions(seed=seed, cameras=4, people=10, seconds=30.0, box_noise=0.02, missing=0.05, groups=(2, 2),
                                false_boxes=0.03, unrelated_ids=not given)  # fmt: skip
    scene = simulate(options)
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    who = {name: np.asarray(ids) for name, ids in scene.true_identities.items()}
    tables = {"association": {"mode": "given" if given else "combined"}}
    return HandedIn(scene.rig, boxes, scene.rig, 5.0, tables, who=who, walked=walked_places(scene))


def weak_bridge(seed: int, *, given: bool, instants: int) -> HandedIn:
    """Two pairs of cameras that share one person for a moment: C1, C2 see people 1 to 4, C3, C4 people 5 to 8."""
    scene = staged(seed, given=given, people=8, false_boxes=0.0)
    for name in scene.lenses.names:
        who, frame = scene.who[name], scene.boxes[name].frame
        own = (who <= 4) if name in ("C1", "C2") else (who > 4)
        if name in ("C2", "C3"):
            own |= (who == 4) & (frame > 60) & (frame <= 60 + instants)
        scene = scene.kept(name, own)
    return scene


FILES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "apart-given": ("two pairs of cameras without common ground", partial(no_overlap, given=True)),
        "apart-found": ("the same, identities found", partial(no_overlap, given=False)),
        "bridge-given": ("two pairs joined by one person for three seconds", partial(weak_bridge, given=True, instants=15)),
        "bridge-found": ("the same, identities found", partial(weak_bridge, given=False, instants=15)),
        "bridge-brief": ("two pairs joined by one person for two seconds", partial(weak_bridge, given=True, instants=10)),
        "drift-0.1": ("a clock 0.1 % too fast", partial(drifting, rate=0.001, given=True)),
        "drift-1": ("a clock 1 % too fast, identities given", partial(drifting, rate=0.01, given=True)),
        "drift-1-found": ("the same, identities found", partial(drifting, rate=0.01, given=False)),
        "drift-4": ("a clock 4 % too fast (25 for 24), identities given", partial(drifting, rate=0.04, given=True)),
        "drift-4-clocks": ("the same, clocks searched for", partial(drifting, rate=0.04, given=True, search=True)),
        "drift-4-found": ("the same, identities found", partial(drifting, rate=0.04, given=False)),
        "rate-given": ("25 frames per second stated for 30", partial(wrong_rate, given=True)),
        "rate-found": ("the same, identities found", partial(wrong_rate, given=False)),
        "frames-lost": ("5 % of the frames lost, the rest numbered on", partial(frames_lost, share=0.05)),
        "frames-lost-found": ("the same, identities found", partial(frames_lost, share=0.05, given=False)),
        "burst-lost": ("two seconds lost half-way, the rest numbered on", partial(frames_lost, burst_s=2.0)),
        "burst-lost-clocks": ("the same, clocks searched for", partial(frames_lost, burst_s=2.0, search=True)),
        "burst-lost-found": ("the same, identities found", partial(frames_lost, burst_s=2.0, given=False)),
        "cut-short": ("a camera that stopped half-way", partial(cut_short, given=True)),
        "cut-short-found": ("the same, identities found", partial(cut_short, given=False)),
        "four-seconds-late": ("a video four seconds late, identities given", partial(too_late, given=True)),
        "four-seconds-found": ("the same, identities found", partial(too_late, given=False)),
        "names-by-frame": ("identities shuffled anew in each frame", partial(names_shuffled, how="frames")),
        "names-by-camera": ("identities shuffled in each camera alike at all times", partial(names_shuffled, how="cameras")),
        "names-two": ("two people exchanged in one camera", partial(names_shuffled, how="two")),
        "names-half": ("half of the people exchanged in one camera", partial(names_shuffled, how="half")),
        "numbers-mistaken": ("tracklet numbers handed in as identities", partial(numbers_mistaken)),
        "phantoms-given": ("60 % false detections, unnamed", partial(phantoms, share=1.5, given=True)),
        "phantoms-named": ("60 % false detections under people's names", partial(phantoms, share=1.5, given=True, named=True)),
        "phantoms-found": ("60 % false detections, identities found", partial(phantoms, share=1.5, given=False)),
        "ghosts": ("as many tracked ghosts as people in every view", partial(ghosts)),
        "noise-20": ("boxes off by 20 % of their height", partial(staged, box_noise=0.2)),
        "noise-20-found": ("the same, identities found", partial(staged, box_noise=0.2, given=False)),
        "names-30": ("30 % of the identities wrong at each instant", partial(staged, identity_swaps=0.3)),
    }
)  # fmt: skip
