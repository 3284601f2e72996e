"""Blind hostile cases: what scene files state wrongly, what detectors and trackers report, and two such faults at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Boxes
from passerby.simulation.motion import Motion
from reliability.staging import HandedIn, Mask, affine, edges_of, joined, raised, staged, turned, zoomed

Build = Callable[[int], HandedIn]
SMALLEST_PX = 3.0
"""What is left of a box that is cut is reported from this size on."""
NEW_TRACKS = 1000
"""Further tracks of a camera are numbered from here."""


def with_edges(scene: HandedIn, name: str, edges: Floats, region: Floats | None = None) -> HandedIn:
    """Boxes of other edges in one camera, clipped to its picture or to a region (4,) of it; what is outside is left out."""
    limits = np.array([0.0, 0.0, *scene.lenses[name].lens.size]) if region is None else region
    low, high = np.maximum(edges[:, :2], limits[:2]), np.minimum(edges[:, 2:], limits[2:])
    kept = (high - low >= SMALLEST_PX).all(axis=1)
    boxes = scene.boxes[name].take(kept)
    return scene.with_boxes(name, replace(boxes, ltwh=np.concatenate([low, high - low], axis=1)[kept]), scene.who[name][kept])


def cut_to(scene: HandedIn, name: str, *, share: float) -> HandedIn:
    """Boxes of the upper part of the body only; people whose heads are outside the picture have none."""
    scene = scene.kept(name, scene.boxes[name].ltwh[:, 1] > 2.0)
    edges = edges_of(scene.boxes[name])
    height = share * (edges[:, 3] - edges[:, 1])
    middle, half = (edges[:, 0] + edges[:, 2]) / 2, np.minimum((edges[:, 2] - edges[:, 0]) / 2, 0.45 * height)
    return with_edges(scene, name, np.stack([middle - half, edges[:, 1], middle + half, edges[:, 1] + height], axis=1))


def with_margin(scene: HandedIn, name: str, *, px: float) -> HandedIn:
    """Boxes that are larger by as many pixels on each side, near or far."""
    return with_edges(scene, name, edges_of(scene.boxes[name]) + px * np.array([-1.0, -1.0, 1.0, 1.0]))


def lagged(scene: HandedIn, name: str, *, weight: float) -> HandedIn:
    """Boxes that a tracker smooths over time: each is a mean of its predecessor and what is seen, by the weight of the new."""
    boxes = scene.boxes[name]
    ltwh = np.array(boxes.ltwh)
    for identity in np.unique(boxes.identity[boxes.identity > 0]):
        rows = np.flatnonzero(boxes.identity == identity)
        for before, row in pairwise(rows):
            if boxes.frame[row] - boxes.frame[before] <= 3:
                ltwh[row] = weight * ltwh[row] + (1 - weight) * ltwh[before]
    return scene.with_boxes(name, replace(boxes, ltwh=ltwh))


def coasted(scene: HandedIn, name: str, *, frames: int) -> HandedIn:
    """Tracks that go on as before for as many frames after their last box, as far as the picture reaches."""
    boxes, parts = scene.boxes[name], []
    size, ahead = np.array(scene.lenses[name].lens.size), np.arange(1, frames + 1)
    for identity in np.unique(boxes.identity[boxes.identity > 0]):
        rows = np.flatnonzero(boxes.identity == identity)[-6:]
        if len(rows) < 4:
            continue
        middle = boxes.ltwh[rows, :2] + boxes.ltwh[rows, 2:] / 2
        speed = (middle[-1] - middle[0]) / (boxes.frame[rows[-1]] - boxes.frame[rows[0]])
        ltwh = np.tile(boxes.ltwh[rows[-1]], (frames, 1))
        ltwh[:, :2] += ahead[:, None] * speed
        there = (ltwh[:, :2] + ltwh[:, 2:] / 2 > 0).all(axis=1) & (ltwh[:, :2] + ltwh[:, 2:] / 2 < size).all(axis=1)
        there &= boxes.frame[rows[-1]] + ahead <= boxes.frame.max()
        extra = Boxes(boxes.frame[rows[-1]] + ahead, np.full(frames, identity), ltwh, np.full(frames, 0.5))
        parts.append(extra.take(there))
    who = scene.who[name]
    for part in parts:
        boxes, order = joined(boxes, part)
        who = np.concatenate([who, np.full(len(part), -1)])[order]
    scene = scene.with_boxes(name, boxes, who)
    return with_edges(scene, name, edges_of(boxes))


def region_of(scene: HandedIn, name: str, shares: tuple[float, float, float, float]) -> HandedIn:
    """Boxes clipped to a region: left, top, right, bottom as shares of the picture."""
    region = np.array(shares) * np.tile(np.array(scene.lenses[name].lens.size), 2)
    return with_edges(scene, name, edges_of(scene.boxes[name]), region)


def distance(rig: Rig, first: str, second: str) -> float:
    """Between two cameras, metres."""
    one, other = rig[first].pose, rig[second].pose
    assert one is not None
    assert other is not None
    return float(np.linalg.norm(one.centre - other.centre))


def height_of(rig: Rig, name: str) -> float:
    """Of a camera above the ground, metres."""
    pose = rig[name].pose
    assert pose is not None
    return float(pose.centre[2])


def heads(seed: int) -> HandedIn:
    """A detector of heads in all cameras, taken for one of people."""
    scene = staged(seed, given=False, people=8, seconds=40.0)
    for name in scene.lenses.names:
        scene = cut_to(scene, name, share=0.14)
    return scene


def upper_bodies(seed: int) -> HandedIn:
    """Two of five cameras have a detector of upper bodies."""
    scene = staged(seed, preset="construction", cameras=5, people=9, seconds=35.0)
    for name in ("C2", "C4"):
        scene = cut_to(scene, name, share=0.52)
    return scene


def _shadow_tips(camera: Camera, edges: Floats, shadow: Floats) -> Floats:
    """(N, 2) pixels of the ends of shadows (3,) of people whose feet are at their boxes' lower edges; NaN where unseen."""
    pose = camera.pose
    assert pose is not None
    feet = np.stack([(edges[:, 0] + edges[:, 2]) / 2, edges[:, 3]], axis=1)
    rays = camera.lens.bearings(feet) @ pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(rays[:, 2] < -0.02, -pose.centre[2] / rays[:, 2], np.nan)
    tips = (pose.centre + far[:, None] * rays + shadow) @ pose.R_cw.T + pose.t_cw
    known = np.isfinite(tips).all(axis=1) & (tips[:, 2] > 0.5)
    return np.where(known[:, None], camera.lens.project_rays(np.where(known[:, None], tips, np.array([0.0, 0.0, 1.0]))), np.nan)


def low_sun(seed: int) -> HandedIn:
    """Half-way the sun comes out: boxes hold the shadows from then on, which all fall to one side of the court."""
    scene = staged(seed, given=False, preset="basketball", people=6, seconds=50.0)
    towards = np.random.default_rng((seed, 501)).uniform(0, 2 * np.pi)
    shadow = 1.6 * np.array([np.cos(towards), np.sin(towards), 0.0])
    for camera in scene.truth:
        boxes = scene.boxes[camera.name]
        edges = edges_of(boxes)
        tips = _shadow_tips(camera, edges, shadow)
        sunny = (boxes.frame > 125) & (scene.who[camera.name] > 0) & (edges[:, 3] < camera.lens.size[1] - 2.0)
        sunny &= np.isfinite(tips).all(axis=1)
        tips = np.where(sunny[:, None], tips, edges[:, 2:])
        longer = np.concatenate([np.minimum(edges[:, :2], tips), np.maximum(edges[:, 2:], tips)], axis=1)
        scene = with_edges(scene, camera.name, longer)
    return scene


def blocks(seed: int) -> HandedIn:
    """A detector that works on blocks of 32 pixels: each box is made of whole blocks."""
    scene = staged(seed, cameras=3, people=5, seconds=30.0)
    for name in scene.lenses.names:
        edges = edges_of(scene.boxes[name])
        whole = np.concatenate([np.floor(edges[:, :2] / 32), np.ceil(edges[:, 2:] / 32)], axis=1)
        scene = with_edges(scene, name, 32.0 * whole)
    return scene


def _grouped(edges: Floats, rows: Ints) -> list[Ints]:
    """Rows whose boxes overlap by two fifths of the smaller one, the tallest first in each group."""
    groups: list[tuple[Floats, list[int]]] = []
    for row in rows[np.argsort(edges[rows, 1] - edges[rows, 3], kind="stable")]:
        box, size = edges[row], edges[row, 2:] - edges[row, :2]
        for number, (union, members) in enumerate(groups):
            shared = np.maximum(np.minimum(union[2:], box[2:]) - np.maximum(union[:2], box[:2]), 0.0)
            if shared.prod() > 0.4 * min(size.prod(), (union[2:] - union[:2]).prod()):
                larger = np.concatenate([np.minimum(union[:2], box[:2]), np.maximum(union[2:], box[2:])])
                groups[number] = larger, [*members, int(row)]
                break
        else:
            groups.append((box, [int(row)]))
    return [np.array(members) for _, members in groups]


def groups_merged(seed: int) -> HandedIn:
    """Boxes that overlap are joined to one, under the name of the nearest of the group."""
    scene = staged(seed, preset="basketball", people=14, seconds=30.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        edges = edges_of(boxes)
        merged, kept = np.array(edges), np.ones(len(boxes), dtype=np.bool_)
        for frame in np.unique(boxes.frame):
            for group in _grouped(edges, np.flatnonzero((boxes.frame == frame) & (boxes.identity > 0))):
                merged[group[0]] = [*edges[group, :2].min(axis=0), *edges[group, 2:].max(axis=0)]
                kept[group[1:]] = False
        scene = with_edges(scene.kept(name, kept), name, merged[kept])
    return scene


def lagging(seed: int) -> HandedIn:
    """Two of six cameras have a tracker that smooths its boxes, which lag half a second and more behind."""
    scene = staged(seed, preset="construction", cameras=6, people=4, seconds=20.0)
    for name in ("C2", "C5"):
        scene = lagged(scene, name, weight=0.25)
    return scene


def coasting(seed: int) -> HandedIn:
    """Tracks that go on by themselves for three seconds after their people left or were lost."""
    scene = staged(seed, given=False, people=10, seconds=60.0, tracklet_seconds=30.0)
    for name in scene.lenses.names:
        scene = coasted(scene, name, frames=15)
    return scene


def centres(seed: int) -> HandedIn:
    """Files that state the middle of each box where its upper left corner should be, of all cameras."""
    scene = staged(seed, given=False, preset="basketball", people=7, seconds=40.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        half = np.concatenate([boxes.ltwh[:, 2:] / 2, np.zeros((len(boxes), 2))], axis=1)
        scene = scene.with_boxes(name, replace(boxes, ltwh=boxes.ltwh + half))
    return scene


def watermark(seed: int) -> HandedIn:
    """The recorder's logo, at the same place in all pictures, detected and named as a third person."""
    scene = staged(seed, people=2, cameras=3, seconds=20.0)
    size = np.array(scene.lenses["C1"].lens.size)
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 502, index))
        frames = np.flatnonzero(rng.uniform(size=101) < 0.9)[1:]
        ltwh = np.array([0.05, 0.62, 0.07, 0.27]) * np.tile(size, 2) + rng.normal(0.0, 0.7, (len(frames), 4))
        logo = Boxes(frames, np.full(len(frames), 3), ltwh, np.full(len(frames), 0.6))
        boxes, order = joined(scene.boxes[name], logo)
        scene = scene.with_boxes(name, boxes, np.concatenate([scene.who[name], np.full(len(logo), -1)])[order])
    return scene


def crossings(seed: int) -> HandedIn:
    """People were named by hand in the first frame; the trackers of two cameras exchange them wherever two cross."""
    scene = staged(seed, people=7, seconds=45.0)
    for name in ("C2", "C4"):
        boxes, edges = scene.boxes[name], edges_of(scene.boxes[name])
        identity, called = np.array(boxes.identity), np.arange(8)
        met: dict[tuple[int, int], int] = {}
        for frame in np.unique(boxes.frame):
            rows = np.flatnonzero((boxes.frame == frame) & (boxes.identity > 0))
            for group in _grouped(edges, rows):
                one, *others = (int(boxes.identity[row]) for row in group)
                for other in others:
                    pair = min(one, other), max(one, other)
                    if frame - met.get(pair, -99) > 5:
                        called[[one, other]] = called[[other, one]]
                    met[pair] = int(frame)
            identity[rows] = called[boxes.identity[rows]]
        scene = scene.with_boxes(name, replace(boxes, identity=identity))
    return scene


def reused_numbers(seed: int) -> HandedIn:
    """A tracker that gives each new track the lowest number that is free: one number stands for many people in turn."""
    scene = staged(seed, given=False, preset="construction", people=12, seconds=60.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        tracks = np.unique(boxes.identity[boxes.identity > 0])
        first = np.array([boxes.frame[boxes.identity == track].min() for track in tracks])
        identity, free_from = np.array(boxes.identity), np.zeros(len(tracks))
        for track in tracks[np.argsort(first, kind="stable")]:
            rows = boxes.identity == track
            slot = int(np.flatnonzero(free_from < boxes.frame[rows].min())[0])
            identity[rows], free_from[slot] = slot + 1, boxes.frame[rows].max()
        scene = scene.with_boxes(name, replace(boxes, identity=identity))
    return scene


def half_named(seed: int) -> HandedIn:
    """The tool that names people was restarted half-way: each camera counts them from 1 as they come into its view."""
    scene = staged(seed, preset="basketball", people=8, seconds=40.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        late = (boxes.frame > 100) & (boxes.identity > 0)
        people, first = np.unique(boxes.identity[late], return_index=True)
        called = np.arange(9)
        called[people[np.argsort(first, kind="stable")]] = np.arange(1, len(people) + 1)
        identity = np.where(late, called[np.maximum(boxes.identity, 0)], boxes.identity)
        scene = scene.with_boxes(name, replace(boxes, identity=identity))
    return scene


def two_fast(seed: int) -> HandedIn:
    """Two of four cameras film 30 frames per second, and 25 are stated of all: each rate has two witnesses."""
    scene = staged(seed, given=False, people=5, seconds=60.0, camera_fps=(5.0, 5.0, 6.0, 6.0))
    return replace(scene, fps=5.0)


def mistyped_height(seed: int) -> HandedIn:
    """People's mean height mistyped as 1.27 m, known to 1 cm; two cameras' heights are measured and right."""
    scene = staged(seed, given=False, cameras=3, people=6, seconds=45.0)
    tape = [{"camera": name, "metres": round(height_of(scene.truth, name), 2)} for name in ("C1", "C3")]
    heights = {"person_height_m": 1.27, "person_height_sd_m": 0.03, "person_height_mean_sd_m": 0.01}
    return scene.with_tables(scale={**heights, "camera_heights": tape})


def class_distance(seed: int) -> HandedIn:
    """A class of children taken for adults, and the distance of the first camera to the third stated of the second."""
    scene = staged(seed, given=False, people=8, seconds=40.0, person_height_mean_m=1.25, person_height_sd_m=0.07)
    stated = {"between": ["C1", "C2"], "metres": round(distance(scene.truth, "C1", "C3"), 2)}
    return scene.with_tables(scale={"distances": [stated]})


def slope_cropped(seed: int) -> HandedIn:
    """Ground of 8 % slope, and a picture that lost 14 % of its width on the left; lens and size are stated of the whole."""
    grade = 0.08

    def move(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        return raised(motion, lambda xy: grade * xy[..., 0])

    scene = staged(seed, preset="construction", people=8, seconds=30.0, people_move=move)
    left = 0.14 * scene.lenses["C3"].lens.size[0]
    scene = with_edges(scene, "C3", edges_of(scene.boxes["C3"]) - left * np.array([1.0, 0.0, 1.0, 0.0]))
    scene = scene.as_shown("C3", lambda lens: affine(lens, 1.0, (-left, 0.0)))
    c, s = np.array([1.0, grade]) / np.hypot(1.0, grade)
    return replace(scene, truth=scene.truth.moved(np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.zeros(3)))


def drift_exchanged(seed: int) -> HandedIn:
    """A clock 1.5 % too fast, and in another camera the two people most seen there under each other's name."""
    scene = staged(seed, people=6, seconds=60.0, camera_fps=(5.0, 5.075, 5.0, 5.0))
    boxes = scene.boxes["C3"]
    counts = np.bincount(boxes.identity[boxes.identity > 0], minlength=7)
    one, other = np.argsort(-counts, kind="stable")[:2]
    called = np.arange(7)
    called[[one, other]] = other, one
    identity = np.where(boxes.identity > 0, called[np.maximum(boxes.identity, 0)], boxes.identity)
    scene = scene.with_boxes("C3", replace(boxes, identity=identity))
    return replace(scene, fps=5.0).with_tables(association={"mode": "given", "max_offset_s": 2.0})


def tour_margin(seed: int) -> HandedIn:
    """A camera that turns by 6 degrees and back every five seconds, and boxes 10 pixels too large all around in another."""
    wanted: dict[str, Any] = {"given": False, "preset": "construction", "people": 7, "seconds": 40.0}
    home = staged(seed, **wanted)
    away = staged(seed, rig=lambda rig, _: turned(rig, "C2", pan=6.0), **wanted)
    parts, seen = [], []
    for scene, turn in ((home, 0), (away, 1)):
        boxes = scene.boxes["C2"]
        stay = (boxes.frame - 1) // 25
        there: Mask = stay % 2 == turn
        identity = np.where(boxes.identity > 0, boxes.identity + NEW_TRACKS * stay, -1)
        parts.append(replace(boxes, identity=identity).take(there))
        seen.append(scene.who["C2"][there])
    joint, order = joined(*parts)
    scene = home.with_boxes("C2", joint, np.concatenate(seen)[order])
    return replace(with_margin(scene, "C3", px=10.0), later=away.truth)


def offsets_lens(seed: int) -> HandedIn:
    """Clocks 3 s off though 1 s is stated as the most, and a focal length 15 % short in a camera whose clock is right."""
    clocks = (0.0, 3.0, -2.6, 0.4, 0.0)
    scene = staged(seed, given=False, cameras=5, people=6, seconds=40.0, clock_offsets=clocks)
    scene = scene.with_lens("C5", lambda lens: zoomed(lens, 0.85))
    return scene.with_tables(association={"mode": "combined", "max_offset_s": 1.0})


def swapped_feet(seed: int) -> HandedIn:
    """The videos of two cameras exchanged, and the heights of three cameras stated in feet; the truth goes with the videos."""
    scene = staged(seed, preset="basketball", cameras=5, people=9, seconds=30.0)
    other = {"C2": "C3", "C3": "C2"}
    names = scene.lenses.names
    truth = Rig(tuple(replace(camera, pose=scene.truth[other.get(camera.name, camera.name)].pose) for camera in scene.truth))
    spoilt = scene
    for name in other:
        spoilt = spoilt.with_boxes(name, scene.boxes[other[name]], scene.who[other[name]])
    tall = [{"camera": name, "metres": round(height_of(truth, name) / 0.3048, 1)} for name in (names[0], names[3], names[4])]
    return replace(spoilt, truth=truth).with_tables(scale={"camera_heights": tall})


def pair_drift(seed: int) -> HandedIn:
    """Two cameras and one person: one's focal length stated 15 % short, the other's clock 2 % too fast."""
    scene = staged(seed, given=False, cameras=2, people=1, seconds=60.0, camera_fps=(5.0, 5.1))
    return replace(scene, fps=5.0).with_lens("C1", lambda lens: zoomed(lens, 0.85))


def heights_lag(seed: int) -> HandedIn:
    """Two cameras: the heights of four people in the wrong rows of a list, and boxes in one camera that lag behind."""
    known: list[Floats] = []

    def note(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        known.append(heights)
        return motion

    scene = staged(seed, cameras=2, people=4, seconds=25.0, person_height_sd_m=0.15, people_move=note)
    listed = [
        {"identity": row + 1, "height_m": round(float(height), 2)} for row, height in enumerate(np.roll(known[0], 1).tolist())
    ]
    return lagged(scene, "C2", weight=0.3).with_tables(scale={"people": listed})


def off_by_one_region(seed: int) -> HandedIn:
    """People counted from 0 in one camera, and another's boxes clipped to a region in the middle of its picture."""
    scene = staged(seed, people=6, cameras=5, seconds=12.0)
    boxes = scene.boxes["C3"]
    scene = scene.with_boxes("C3", replace(boxes, identity=np.where(boxes.identity > 0, boxes.identity - 1, -1)))
    return region_of(scene, "C1", (0.1, 0.3, 0.85, 0.72))


def _half_size(lens: Lens) -> Lens:
    """The lens of a picture of half the size, with the middle of the first pixel at 0."""
    matrix = np.array(lens.matrix)
    matrix[:2] *= 0.5
    matrix[:2, 2] -= 0.25
    return replace(lens, size=(lens.size[0] // 2, lens.size[1] // 2), matrix=matrix)


def stream_twice(seed: int) -> HandedIn:
    """A camera's small stream, 1.2 s late, as a camera of its own, and the most that clocks differ stated as 0.5 s."""
    scene = staged(seed, given=False, preset="construction", people=8, seconds=40.0, clock_offsets=(0.0, 0.3, -0.3, 0.0))
    boxes = scene.boxes["C1"]
    small = np.round(edges_of(boxes) / 2)
    ltwh = np.concatenate([small[:, :2], np.maximum(small[:, 2:] - small[:, :2], SMALLEST_PX)], axis=1)
    identity = np.where(boxes.identity > 0, boxes.identity.max() + 1 - boxes.identity, -1)
    late = Boxes(boxes.frame + 6, identity, ltwh, boxes.score)
    twin = replace(scene.truth["C1"], name="C4", lens=_half_size(scene.truth["C1"].lens))
    rig = Rig(tuple(twin if camera.name == "C4" else camera for camera in scene.truth))
    spoilt = replace(scene.with_boxes("C4", late, scene.who["C1"]), lenses=rig, truth=rig)
    return spoilt.with_tables(association={"mode": "combined", "max_offset_s": 0.5})


def doubled_stride(seed: int) -> HandedIn:
    """Everybody has two boxes and tracks in two cameras, and of another camera every second frame is read but numbered on."""
    scene = staged(seed, given=False, people=5, seconds=60.0)
    for index, name in enumerate(("C1", "C3")):
        boxes, rng = scene.boxes[name], np.random.default_rng((seed, 503, index))
        aside = np.array([0.05, 0.02, 0.0, 0.03]) * boxes.ltwh[:, 3:] + rng.normal(0.0, 1.0, (len(boxes), 4))
        second = replace(boxes, identity=boxes.identity + NEW_TRACKS, ltwh=np.maximum(boxes.ltwh + aside, (-1e9, -1e9, 2, 2)))
        second = second.take(boxes.identity > 0)
        both, order = joined(boxes, second)
        scene = scene.with_boxes(name, both, np.concatenate([scene.who[name], scene.who[name][boxes.identity > 0]])[order])
        scene = with_edges(scene, name, edges_of(both))
    scene = scene.kept("C4", scene.boxes["C4"].frame % 2 == 1)
    boxes = scene.boxes["C4"]
    return scene.with_boxes("C4", replace(boxes, frame=(boxes.frame + 1) // 2))


CASES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "scene-heads": ("boxes of heads only in all cameras, identities found", partial(heads)),
        "scene-upper-bodies": ("boxes of upper bodies in two of five cameras", partial(upper_bodies)),
        "scene-low-sun": ("boxes that hold shadows from half-time on, identities found", partial(low_sun)),
        "scene-blocks-32": ("boxes of whole blocks of 32 pixels", partial(blocks)),
        "scene-groups": ("overlapping boxes of fourteen people joined to one", partial(groups_merged)),
        "scene-lagging": ("boxes that lag behind in two of six cameras", partial(lagging)),
        "scene-coasting": ("tracks that go on for 3 s without their people, identities found", partial(coasting)),
        "scene-centres": ("middles of boxes stated as their corners in all cameras, identities found", partial(centres)),
        "scene-watermark": ("a logo at one place in all pictures, named as a third person", partial(watermark)),
        "scene-crossings": ("names exchanged wherever two people cross, in two of four cameras", partial(crossings)),
        "scene-reused-numbers": ("tracks that take the lowest free number, identities found", partial(reused_numbers)),
        "scene-half-named": ("names given anew in each camera from half-time on", partial(half_named)),
        "scene-two-fast": ("25 frames per second stated for 30 in two of four cameras, identities found", partial(two_fast)),
        "scene-mistyped-height": ("a mean height of 1.27 m stated to 1 cm, two heights of cameras right, identities found",
                                  partial(mistyped_height)),
        "scene-class-distance": ("children taken for adults, and a distance stated between the wrong cameras, identities found",
                                 partial(class_distance)),
        "scene-slope-cropped": ("ground of 8 % slope, and a picture cropped on the left", partial(slope_cropped)),
        "scene-drift-exchanged": ("a clock 1.5 % too fast, and two people exchanged in another camera",
                                  partial(drift_exchanged)),
        "scene-tour-margin": ("a camera that turns to and fro, and boxes too large by 10 pixels in another, identities found",
                              partial(tour_margin)),
        "scene-offsets-lens": ("clocks 3 s apart where 1 s is stated, and a focal length 15 % short, identities found",
                               partial(offsets_lens)),
        "scene-swapped-feet": ("two videos exchanged, and heights of cameras stated in feet", partial(swapped_feet)),
        "scene-pair-drift": ("two cameras and one person, a focal length 15 % short and a clock 2 % fast, identities found",
                             partial(pair_drift)),
        "scene-heights-lag": ("heights of people in the wrong rows, and boxes that lag behind in one of two cameras",
                              partial(heights_lag)),
        "scene-off-by-one-region": ("people counted from 0 in one camera, and boxes clipped to a region in another",
                                    partial(off_by_one_region)),
        "scene-stream-twice": ("a second stream as a camera of its own, later than max_offset_s, identities found",
                               partial(stream_twice)),
        "scene-doubled-stride": ("two boxes of everybody in two cameras, and every second frame missing in another's numbers, "
                                 "identities found", partial(doubled_stride)),
    }
)  # fmt: skip
