"""Later hostile cases: cameras whose people are not where, who or when they seem, and boxes by other conventions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.simulation.motion import Motion
from reliability.blind_people import OTHERS, clocks, lissajous, striding, together
from reliability.blind_scene import cut_to, with_edges
from reliability.staging import HandedIn, Mask, aimed, edges_of, joined, raised, staged, turned, walking

Build = Callable[[int], HandedIn]
Change = Callable[[Floats, Floats], Floats]
"""From boxes (N, 4) and the size of the picture (2,) to what the file says instead."""


def reflected(motion: Motion, axis: int, at: float) -> Motion:
    """Everybody's image in a wall at a place on an axis of the ground."""
    xy = np.array(motion.state.xy)
    xy[..., axis] = 2 * at - xy[..., axis]
    heading = -motion.state.heading if axis == 1 else np.pi - motion.state.heading
    return replace(motion, state=replace(motion.state, xy=xy, heading=heading))


def mixed(scene: HandedIn, other: HandedIn, name: str, first: Mask, second: Mask) -> HandedIn:
    """One camera's boxes put together of some rows (N,) of two scenes with the same people."""
    boxes, order = joined(scene.boxes[name].take(first), other.boxes[name].take(second))
    return scene.with_boxes(name, boxes, np.concatenate([scene.who[name][first], other.who[name][second]])[order])


def mirror_named(seed: int) -> HandedIn:
    """A studio one wall of which is a mirror; in one camera each name is now on the person and now on the image in it."""
    wanted: dict[str, Any] = {"people": 6, "seconds": 40.0}
    scene = staged(seed, **wanted)
    images = staged(seed, rig=lambda *_: scene.truth, people_move=lambda motion, *_: reflected(motion, 1, 8.0), **wanted)
    in_mirror = np.random.default_rng((seed, 601)).uniform(size=(7, 12)) < 0.45
    own, image = (one.boxes["C2"] for one in (scene, images))
    chosen = [in_mirror[np.maximum(boxes.identity, 0), boxes.frame // 20] & (boxes.identity > 0) for boxes in (own, image)]
    return mixed(scene, images, "C2", ~chosen[0], chosen[1])


def shop_window(seed: int) -> HandedIn:
    """One of five cameras hangs beside a shop and sees the street mainly in its window."""
    wanted: dict[str, Any] = {"given": False, "cameras": 5, "people": 5, "seconds": 40.0, "clock_offsets": clocks(seed, 5)}

    def beside(rig: Rig, _: np.random.Generator) -> Rig:
        return aimed(rig, "C3", np.array([3.0, -6.8, 2.3]), np.array([6.0, 0.5, 0.8]))

    scene = staged(seed, rig=beside, **wanted)
    images = staged(seed, rig=lambda *_: scene.truth, people_move=lambda motion, *_: reflected(motion, 0, 6.0), **wanted)
    return together(scene, images, ("C3",))


def monitor_filmed(seed: int) -> HandedIn:
    """One file was filmed with a phone in the control room: a monitor that shows another camera, seen from aside."""
    scene = staged(seed, given=False, people=6, seconds=40.0)
    size = np.array(scene.lenses["C2"].lens.size, float)
    boxes = scene.boxes["C2"]
    low, high = edges_of(boxes)[:, :2] / size, edges_of(boxes)[:, 2:] / size
    corners = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], axis=1)
    depth = 1.0 + 0.25 * corners[..., :1]
    seen = (np.array([0.06, 0.04]) + corners * (1.1, 0.9) + corners[..., :1] * (0.0, 0.12)) / depth * size
    edges = np.concatenate([seen.min(axis=1), seen.max(axis=1)], axis=1)
    number = np.where(boxes.identity > 0, boxes.identity.max() + 1 - boxes.identity, -1)
    ltwh = np.concatenate([edges[:, :2], edges[:, 2:] - edges[:, :2]], axis=1)
    shown = Boxes(boxes.frame + 2, number, ltwh, boxes.score)
    truth = aimed(scene.truth, "C4", np.array([30.0, 8.0, 1.4]), np.array([33.0, 8.5, 1.2]))
    return replace(with_edges(scene.with_boxes("C4", shown, scene.who["C2"]), "C4", edges), truth=truth)


def atrium(seed: int) -> HandedIn:
    """A gallery with three people and a floor of glass, through which one camera sees six more on the ground 3.4 m below."""
    wanted: dict[str, Any] = {"given": False, "seconds": 40.0, "clock_offsets": clocks(seed, 4)}
    gallery = staged(seed, people=3, **wanted)

    def below(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        return raised(walking(motion, 1.5 * motion.state.xy, heights), lambda xy: np.full(xy.shape[:-1], -3.4))

    floor = staged(seed + OTHERS, people=6, rig=lambda *_: gallery.truth, people_move=below, **wanted)
    return together(gallery, floor, ("C4",))


def led_wall(seed: int) -> HandedIn:
    """Three people on a stage before a screen, on which five larger ones are seen walking by all cameras."""
    wanted: dict[str, Any] = {"given": False, "seconds": 40.0, "clock_offsets": clocks(seed, 4)}

    def audience(rig: Rig, _: np.random.Generator) -> Rig:
        for name, place in zip(rig.names, ((-5.0, -7.0), (0.5, -8.0), (5.2, -6.5), (-6.0, -1.5)), strict=True):
            rig = aimed(rig, name, np.array([*place, 2.2]), np.array([0.0, 1.5, 1.0]))
        return rig

    def on_screen(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        way = lissajous(motion, rng, len(heights), (3.6, 0.02), (15.0, 30.0)) + (0.0, 7.0)
        return raised(striding(motion, way, heights), lambda xy: np.full(xy.shape[:-1], 0.9))

    stage = staged(seed, people=3, rig=audience, **wanted)
    screen = staged(seed + OTHERS, people=5, rig=lambda *_: stage.truth, people_move=on_screen, person_height_mean_m=2.3,
                    person_height_sd_m=0.08, **wanted)  # fmt: skip
    return together(stage, screen)


def next_court(seed: int) -> HandedIn:
    """One camera films the court next door, and sees a strip of this one past the curtain; the others see this one only."""
    wanted: dict[str, Any] = {"given": False, "seconds": 45.0, "clock_offsets": clocks(seed, 4)}

    def at_curtain(rig: Rig, _: np.random.Generator) -> Rig:
        return aimed(rig, "C4", np.array([4.0, -8.5, 2.2]), np.array([6.2, -0.3, 0.8]))

    here = staged(seed, people=4, rig=at_curtain, **wanted)

    def aside(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        return walking(motion, motion.state.xy + (11.0, 0.0), heights)

    there = staged(seed + OTHERS, people=6, rig=lambda *_: here.truth, people_move=aside, **wanted)
    left = here.boxes["C4"].ltwh[:, 0] + here.boxes["C4"].ltwh[:, 2] / 2
    return together(here.kept("C4", left < 0.25 * here.lenses["C4"].lens.size[0]), there, ("C4",))


def danced(seed: int, take: int, off_m: float, off_s: float) -> Callable[[Motion, Floats, np.random.Generator], Motion]:
    """Everybody follows the same figures in every take, but for so many metres and seconds."""

    def move(motion: Motion, heights: Floats, _: np.random.Generator) -> Motion:
        n, own = len(heights), np.random.default_rng((seed, 603, take))
        period, phase = np.random.default_rng((seed, 602)).uniform((13.0, 0.0), (29.0, 2 * np.pi), (2, n, 2)).transpose(2, 1, 0)
        stray = lissajous(motion, own, n, (off_m, off_m), (5.0, 12.0))
        time = motion.times[:, None] + off_s * np.sin(2 * np.pi * motion.times[:, None] / 17.0 + own.uniform(0, 2 * np.pi, n))
        return striding(motion, np.array([2.8, 4.4]) * np.sin(2 * np.pi * time[..., None] / period + phase) + stray, heights)

    return move


def two_studios(seed: int, *, given: bool, off_m: float) -> HandedIn:
    """Two studios alike, 14 m apart, with one lesson on a screen: one camera hangs in the other studio, at the same place."""
    wanted: dict[str, Any] = {"given": given, "people": 6, "seconds": 35.0,
                              "clock_offsets": (0.0,) * 4 if given else clocks(seed, 4)}  # fmt: skip
    one = staged(seed, people_move=danced(seed, 0, off_m, 0.0), **wanted)
    other = staged(seed + OTHERS, rig=lambda *_: one.truth, people_move=danced(seed, 1, off_m, 0.0), **wanted)
    truth = turned(one.truth, "C3", shift=np.array([14.0, 0.0, 0.0]))
    return replace(one.with_boxes("C3", other.boxes["C3"], other.who["C3"]), truth=truth)


def rehearsal(seed: int) -> HandedIn:
    """One file is of the rehearsal: the same five actors go the same ways, but for 0.3 m and 0.8 s."""
    wanted: dict[str, Any] = {"cameras": 3, "people": 5, "seconds": 40.0}
    show = staged(seed, people_move=danced(seed, 0, 0.0, 0.0), **wanted)
    before = staged(seed, rig=lambda *_: show.truth, people_move=danced(seed, 1, 0.3, 0.8), **wanted)
    return show.with_boxes("C2", before.boxes["C2"], before.who["C2"])


def half_last_week(seed: int) -> HandedIn:
    """The recorder did not overwrite the first three fifths of one camera's file: they are of last week, names alike."""
    wanted: dict[str, Any] = {"people": 5, "seconds": 40.0}
    today = staged(seed, **wanted)
    before = staged(seed + OTHERS, rig=lambda *_: today.truth, **wanted)
    return mixed(today, before, "C3", today.boxes["C3"].frame > 120, before.boxes["C3"].frame <= 120)


def written(scene: HandedIn, change: Change, *names: str, cut: bool = False) -> HandedIn:
    """Boxes that the files of some cameras, or of all, state otherwise; `cut` at the border of the picture or not."""
    for name in names or scene.lenses.names:
        boxes, size = scene.boxes[name], np.array(scene.lenses[name].lens.size, float)
        ltwh = change(np.array(boxes.ltwh), size)
        if cut:
            scene = with_edges(scene, name, np.concatenate([ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]], axis=1))
        else:
            scene = scene.with_boxes(name, replace(boxes, ltwh=ltwh))
    return scene


def centres_one(seed: int) -> HandedIn:
    """The middles of boxes instead of their corners, in the file of one camera."""
    return written(staged(seed, people=5, seconds=30.0), lambda b, _: b + np.pad(b[:, 2:] / 2, ((0, 0), (0, 2))), "C3")


def centres_down(seed: int) -> HandedIn:
    """One camera's file states the left edge of each box, but its middle from top to bottom instead of the upper edge."""
    scene = staged(seed, given=False, cameras=5, people=6, seconds=40.0)
    return written(scene, lambda b, _: b + np.outer(b[:, 3] / 2, (0.0, 1.0, 0.0, 0.0)), "C2")


def corners_as_sizes(seed: int) -> HandedIn:
    """Right and lower edges where widths and heights should be, in one of three cameras, and cut at the border on reading."""
    scene = staged(seed, cameras=3, people=4, seconds=30.0)
    return written(scene, lambda b, _: np.concatenate([b[:, :2], b[:, :2] + b[:, 2:]], axis=1), "C2", cut=True)


def rows_and_columns(seed: int) -> HandedIn:
    """Boxes of one camera written as an array's rows and columns: x and y are exchanged, and so are width and height."""
    scene = staged(seed, given=False, people=6, seconds=40.0)
    return written(scene, lambda b, _: b[:, [1, 0, 3, 2]], "C4", cut=True)


def as_4cif(seed: int) -> HandedIn:
    """Normalised boxes of all cameras, multiplied by 704 x 576 where the pictures have 720 x 576."""
    scene = staged(seed, given=False, preset="basketball", people=8, seconds=40.0)
    return written(scene, lambda b, _: b * (704 / 720, 1.0, 704 / 720, 1.0))


def from_below(seed: int) -> HandedIn:
    """One camera's tool counts rows from below: the upper edge is stated so, and read from above; cut at the border."""
    scene = staged(seed, cameras=3, people=5, seconds=30.0)
    return written(scene, lambda b, size: np.stack([b[:, 0], size[1] - b[:, 1], b[:, 2], b[:, 3]], axis=1), "C2", cut=True)


def to_the_knees(seed: int) -> HandedIn:
    """One camera's detector was trained on people behind counters: its boxes end at the knees."""
    scene = staged(seed, given=False, people=6, seconds=40.0)
    return cut_to(scene, "C2", share=0.75)


def padded_below(seed: int) -> HandedIn:
    """A detector that pads all boxes by 15 % of their height at the lower edge, in all cameras; twelve seconds."""
    scene = staged(seed, preset="construction", people=6, seconds=12.0)
    return written(scene, lambda b, _: b * (1.0, 1.0, 1.0, 1.15), cut=True)


def blocks_16(seed: int) -> HandedIn:
    """Motion found in blocks of 16 pixels in all six cameras: each box is made of whole blocks."""
    scene = staged(seed, given=False, preset="basketball", cameras=6, people=6, seconds=30.0)

    def outwards(b: Floats, _: Floats) -> Floats:
        low, high = 16 * np.floor(b[:, :2] / 16), 16 * np.ceil((b[:, :2] + b[:, 2:]) / 16)
        return np.concatenate([low, high - low], axis=1)

    return written(scene, outwards, cut=True)


def substream(seed: int) -> HandedIn:
    """One camera's boxes are of its stream of a quarter the size, to the nearest 8 pixels of that, and scaled up fourfold."""
    scene = staged(seed, people=5, seconds=30.0)

    def coarse(b: Floats, _: Floats) -> Floats:
        low, high = np.round(b[:, :2] / 32), np.round((b[:, :2] + b[:, 2:]) / 32)
        return 32 * np.concatenate([low, np.maximum(high - low, 1.0)], axis=1)

    return written(scene, coarse, "C3", cut=True)


CASES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "later-mirror-named": ("one camera's names go to people or to their images in a mirror", partial(mirror_named)),
        "later-shop-window": ("one of five cameras sees the street mainly in a window, identities found", partial(shop_window)),
        "later-monitor-filmed": ("one file is of a monitor that shows another camera, identities found",
                                 partial(monitor_filmed)),
        "later-atrium": ("one camera sees more people a floor below than on its own, identities found", partial(atrium)),
        "later-led-wall": ("three people before a screen with five larger ones, identities found", partial(led_wall)),
        "later-next-court": ("one camera films the court next door, identities found", partial(next_court)),
        "later-two-studios": ("one camera hangs in a studio alike with the same lesson, within 0.2 m",
                              partial(two_studios, given=True, off_m=0.2)),
        "later-two-studios-found": ("the same within 0.4 m, identities found", partial(two_studios, given=False, off_m=0.4)),
        "later-rehearsal": ("one of three files is of the rehearsal of the same ways", partial(rehearsal)),
        "later-half-last-week": ("three fifths of one file are of last week", partial(half_last_week)),
        "later-centres-one": ("middles of boxes stated as their corners in one camera", partial(centres_one)),
        "later-centres-down": ("middles stated as upper edges, but left edges right, in one camera, identities found",
                               partial(centres_down)),
        "later-corners-as-sizes": ("right and lower edges stated as widths and heights in one of three cameras",
                                   partial(corners_as_sizes)),
        "later-rows-and-columns": ("x and y exchanged in one camera, identities found", partial(rows_and_columns)),
        "later-as-4cif": ("normalised boxes rescaled to 704 x 576 instead of 720 x 576, identities found", partial(as_4cif)),
        "later-from-below": ("upper edges counted from below in one of three cameras", partial(from_below)),
        "later-to-the-knees": ("boxes that end at the knees in one camera, identities found", partial(to_the_knees)),
        "later-padded-below": ("boxes padded by 15 % at the lower edge in all cameras", partial(padded_below)),
        "later-blocks-16": ("boxes of whole blocks of 16 pixels in all cameras, identities found", partial(blocks_16)),
        "later-substream": ("boxes of a small stream in whole blocks, scaled up, in one camera", partial(substream)),
    }
)  # fmt: skip
