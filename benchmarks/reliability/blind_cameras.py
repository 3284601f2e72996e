"""Blind hostile cases: lenses that are not the stated ones, boxes in other coordinates, and mounts that do not hold still."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Rig
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.disturbances import Disturbance, Move, film_disturbed, gradual_zoom, rig_after
from reliability.staging import HandedIn, affine, aimed, staged, walked_places, zoomed

Build = Callable[[int], HandedIn]
ChangeLens = Callable[[Lens, np.random.Generator], Lens]
INSIDE = 0.1
"""A box of which no more than this share is in the picture is not found."""
SMALLEST_PX = 2.0


def with_true_lenses(change: ChangeLens, *names: str) -> Callable[[Rig, np.random.Generator], Rig]:
    """Other lenses on the cameras that film; without names on all of them."""

    def changed(rig: Rig, rng: np.random.Generator) -> Rig:
        return Rig(tuple(replace(c, lens=change(c.lens, rng)) if not names or c.name in names else c for c in rig))

    return changed


def stated(scene: HandedIn, change: Callable[[Lens], Lens], *names: str) -> HandedIn:
    """Other lenses in the user's files than on the cameras; without names of all cameras."""
    for name in names or scene.lenses.names:
        scene = scene.with_lens(name, change)
    return scene


def with_matrix(lens: Lens, *, fx: float = 1.0, fy: float = 1.0, cx: float | None = None, cy: float | None = None) -> Lens:
    """A lens with multiplied focal lengths and, where given, another principal point (pixels)."""
    matrix = np.array(lens.matrix)
    matrix[0, 0] *= fx
    matrix[1, 1] *= fy
    matrix[0, 2] = matrix[0, 2] if cx is None else cx
    matrix[1, 2] = matrix[1, 2] if cy is None else cy
    return replace(lens, matrix=matrix)


def disturbed(seed: int, moves: Sequence[Disturbance], *, given: bool, stays: bool = False, **wanted: Any) -> HandedIn:
    """A scene like those of `staged`, with cameras that are moved or zoom again and again.

    Args:
        seed: of everything.
        moves: of several of one camera at one time the last one counts.
        given: whether identities are given.
        stays: no camera comes back: in the end the one that moves is where the last move leaves it.
        wanted: fields of `SimulationOptions`.
    """
    defaults = {
        "box_noise": 0.02, "missing": 0.05, "false_boxes": 0.03, "unrelated_ids": not given,
        "tracklet_seconds": 0.0 if given else 10.0, "clock_offsets": 0.0 if given else 1.0,
    }  # fmt: skip
    options = SimulationOptions(seed=seed, **{**defaults, **wanted})
    scene = simulate(options, film_disturbed(options, moves))
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    tables = {"association": {"mode": "given" if given else "combined"}}
    later = rig_after(scene.rig, moves[-1:]) if stays else None
    return HandedIn(scene.rig, boxes, scene.rig, options.fps, tables, later, dict(scene.true_identities), walked_places(scene))


def instants(seconds: float) -> list[float]:
    """The times of the frames, five in a second."""
    return [frame / 5 for frame in range(round(5 * seconds))]


def reframed(scene: HandedIn, name: str, scale: float, shift: Floats) -> HandedIn:
    """Boxes in a picture that is scaled and shifted (2,) or (N, 2), pixels, and cut at the size of the stated lens."""
    boxes, size = scene.boxes[name], np.array(scene.lenses[name].lens.size, dtype=np.float64)
    low = boxes.ltwh[:, :2] * scale + shift
    high = low + boxes.ltwh[:, 2:] * scale
    whole = (high - low).prod(axis=1)
    low, high = np.clip(low, 0.0, size), np.clip(high, 0.0, size)
    seen = ((high - low >= SMALLEST_PX).all(axis=1)) & ((high - low).prod(axis=1) > INSIDE * whole)
    ltwh = np.concatenate([low, np.maximum(high - low, SMALLEST_PX)], axis=1)
    return scene.with_boxes(name, replace(boxes, ltwh=ltwh)).kept(name, seen)


def letterboxed(seed: int) -> HandedIn:
    """All boxes in pixels of the detector's input, 640 x 640 with grey bars; the lenses are for the pictures as filmed."""
    scene = staged(seed, given=False, people=6, seconds=40.0)
    for name in scene.lenses.names:
        boxes, size = scene.boxes[name], np.array(scene.lenses[name].lens.size, dtype=np.float64)
        scale = 640.0 / size.max()
        bars = (640.0 - scale * size) / 2
        scene = scene.with_boxes(name, replace(boxes, ltwh=boxes.ltwh * scale + np.array([*bars, 0.0, 0.0])))
        scene = scene.as_shown(name, partial(affine, scale=scale, shift=bars))
    return scene


def pixel_aspect(seed: int) -> HandedIn:
    """PAL pixels, wider than high by 12 : 11, in all cameras; the lenses are stated for square ones."""
    scene = staged(seed, people=7, seconds=40.0, rig=with_true_lenses(lambda lens, _: with_matrix(lens, fy=12 / 11)))
    return stated(scene, lambda lens: with_matrix(lens, fy=11 / 12))


def centre_from_bottom(seed: int) -> HandedIn:
    """A bar cropped off the top of each picture, and the principal points counted from the bottom."""

    def cropped(lens: Lens, rng: np.random.Generator) -> Lens:
        return with_matrix(lens, cy=(0.5 - rng.uniform(0.03, 0.06)) * lens.size[1])

    scene = staged(seed, preset="basketball", people=8, seconds=40.0, rig=with_true_lenses(cropped))
    return stated(scene, lambda lens: with_matrix(lens, cy=lens.size[1] - lens.matrix[1, 2]))


def portrait(seed: int) -> HandedIn:
    """Three phones held upright; size as filmed, matrices of the pattern, which was filmed with the phones held level."""

    def upright(lens: Lens, _: np.random.Generator) -> Lens:
        width, height = lens.size
        turned = with_matrix(lens, cx=height - lens.matrix[1, 2], cy=float(lens.matrix[0, 2]))
        return replace(turned, size=(height, width))

    scene = staged(seed, cameras=3, people=4, seconds=45.0, rig=with_true_lenses(upright))
    return stated(scene, lambda lens: with_matrix(lens, cx=float(lens.matrix[1, 2]), cy=lens.size[0] - lens.matrix[0, 2]))


def fisheye_as_pinhole(seed: int) -> HandedIn:
    """Two fisheyes of 130 degrees among five cameras, whose matrix and coefficients are stated without `fisheye`."""

    def wide(lens: Lens, _: np.random.Generator) -> Lens:
        factor = lens.size[0] / np.radians(130.0) / lens.focal
        return replace(zoomed(lens, factor), distortions=np.array([-0.02, 0.01, -0.008, 0.002]), fisheye=True)

    scene = staged(seed, cameras=5, people=6, seconds=40.0, rig=with_true_lenses(wide, "C2", "C4"))
    return stated(scene, lambda lens: replace(lens, fisheye=False), "C2", "C4")


def pinhole_as_fisheye(seed: int) -> HandedIn:
    """All lenses are pinholes with k1 and k2, which are read as coefficients of fisheyes."""
    scene = staged(seed, given=False, preset="construction", people=8, seconds=40.0)
    return stated(scene, lambda lens: replace(lens, fisheye=True))


def reversed_distortion(seed: int) -> HandedIn:
    """Coefficients of all lenses with the other sign, of software that maps from the distorted to the straight picture."""
    scene = staged(seed, preset="basketball", cameras=6, people=10, seconds=30.0)
    return stated(scene, lambda lens: replace(lens, distortions=-lens.distortions))


def undistorted(seed: int) -> HandedIn:
    """Videos that the recorder has straightened; the distortion of the lenses is stated of them all the same."""
    scene = staged(
        seed, given=False, people=5, seconds=40.0,
        rig=with_true_lenses(lambda lens, _: replace(lens, distortions=np.zeros(4))),
    )  # fmt: skip
    return stated(scene, lambda lens: replace(lens, distortions=np.array([-0.25, 0.0375, 0.0, 0.0])))


def corner_only(seed: int) -> HandedIn:
    """Digital zoom of one camera to a part of the court, half the picture wide; its lens is stated of the full picture."""
    full: list[Lens] = []

    def window(rig: Rig, _: np.random.Generator) -> Rig:
        camera = rig["C4"]
        full.append(camera.lens)
        size = np.array(camera.lens.size, dtype=np.float64)
        middle = camera.project(np.array([-2.5, -1.5, 0.8]))[0]
        corner = np.clip(middle - size / 4, 0.0, size / 2)
        cx, cy = (2.0 * (camera.lens.matrix[:2, 2] - corner)).tolist()
        magnified = replace(camera, lens=with_matrix(camera.lens, fx=2.0, fy=2.0, cx=cx, cy=cy))
        return Rig(tuple(magnified if c.name == "C4" else c for c in rig))

    scene = staged(seed, given=False, preset="basketball", people=8, seconds=45.0, rig=window)
    return stated(scene, lambda _: full[0], "C4")


def boxes_by_centre(seed: int) -> HandedIn:
    """Centres of all boxes where their left upper corners should be."""
    scene = staged(seed, cameras=5, people=7, seconds=30.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        half = boxes.ltwh[:, 2:] / 2
        scene = scene.with_boxes(name, replace(boxes, ltwh=boxes.ltwh + np.concatenate([half, 0.0 * half], axis=1)))
    return scene


def shorter(lens: Lens, share: float) -> Lens:
    """The lens of an image whose height alone is scaled."""
    matrix = np.array(lens.matrix)
    matrix[1] *= share
    return replace(lens, matrix=matrix)


def wrong_height(seed: int) -> HandedIn:
    """Normalised boxes of all cameras, multiplied by 720 x 480 where the pictures have 720 x 576."""
    scene = staged(seed, given=False, people=6, seconds=40.0)
    for name in scene.lenses.names:
        boxes = scene.boxes[name]
        scene = scene.with_boxes(name, replace(boxes, ltwh=boxes.ltwh * np.array([1.0, 480 / 576, 1.0, 480 / 576])))
        scene = scene.as_shown(name, partial(shorter, share=480 / 576))
    return scene


def stabilised(seed: int) -> HandedIn:
    """Electronic stabilisation of all cameras: a window of 88 %, enlarged, that wanders; lenses of the full picture."""
    scene, share, seconds = staged(seed, given=False, cameras=3, people=8, seconds=40.0), 0.88, 40.0
    rng = np.random.default_rng((seed, 401))
    for name in scene.lenses.names:
        size = np.array(scene.lenses[name].lens.size, dtype=np.float64)
        turns = (scene.boxes[name].frame[:, None] - 1) / 5.0 / seconds * np.array([3.0, 2.0]) + rng.uniform(size=2)
        corner = size * ((1 - share) / 2 + 0.04 * np.sin(2 * np.pi * turns))
        scene = reframed(scene, name, 1 / share, -corner / share)
    return scene


def swaying(camera: str, seconds: float, period: float, phase: float) -> list[Move]:
    """A mast that swings to and fro, in steps of one frame."""
    moves = []
    for time in instants(seconds):
        swing = float(np.sin(2 * np.pi * time / period + phase))
        moves.append(Move(camera, time, (0.9 * swing, 0.0, 0.6 * swing), (0.12 * swing, 0.05 * swing, 0.0)))
    return moves


def masts(seed: int) -> HandedIn:
    """Two cameras on masts that sway in the wind, each in its own time, about where they rest."""
    first, second = np.random.default_rng((seed, 402)).uniform(0, 2 * np.pi, 2).tolist()
    moves = swaying("C1", 40.0, 3.3, first) + swaying("C2", 40.0, 4.7, second)
    return disturbed(seed, moves, given=True, preset="construction", cameras=4, people=10, seconds=40.0)


def patrol(seed: int) -> HandedIn:
    """A camera that patrols between its home and two presets, 8 s at home and 6 s at each of them, again and again."""
    moves = []
    for round_trip in range(3):
        start = 20.0 * round_trip
        moves.append(Move("C4", start + 8.0, (1.0, 20.0, 0.0), until_s=start + 14.0))
        moves.append(Move("C4", start + 14.0, (-1.0, -18.0, 0.0), until_s=start + 20.0))
    return disturbed(seed, moves, given=False, stays=True, preset="basketball", cameras=5, people=9, seconds=60.0)


def sagging(seed: int) -> HandedIn:
    """A mount that gives way slowly: 4 degrees downwards and 1.5 degrees of roll within a minute."""
    moves = [Move("C3", time, (4.0 * time / 60, 0.0, 1.5 * time / 60)) for time in instants(60.0)]
    return disturbed(seed, moves, given=True, stays=True, cameras=4, people=6, seconds=60.0)


def nodding(seed: int) -> HandedIn:
    """Two cameras; a bird lands on the second one four times, which nods by 7 degrees for 2 s and comes back."""
    rng = np.random.default_rng((seed, 403))
    landings = [time + float(rng.uniform(0, 4)) for time in (4.0, 13.0, 22.0, 31.0)]
    moves = [Move("C2", time, (7.0, 1.0, 2.0), until_s=time + 2.0) for time in landings]
    return disturbed(seed, moves, given=False, cameras=2, people=5, seconds=40.0)


def bumped_first(seed: int) -> HandedIn:
    """Two cameras that are still being aimed when the recording begins: for 4 s they look 10 degrees aside."""
    moves = [Move("C2", 0.0, (-3.0, 10.0, 2.0), until_s=4.0), Move("C3", 0.0, (2.0, -10.0, -3.0), until_s=3.0)]
    return disturbed(seed, moves, given=True, preset="basketball", cameras=4, people=8, seconds=30.0)


def bumped_last(seed: int) -> HandedIn:
    """A camera that is bumped 5 s before the end and stays so."""
    moves = [Move("C2", 35.0, (3.0, 6.0, 0.0))]
    return disturbed(seed, moves, given=False, stays=True, cameras=3, people=5, seconds=40.0)


def one_pole(seed: int) -> HandedIn:
    """Three cameras on one pole beside the court, each 0.7 m above the next, that see nearly the same."""

    def pole(rig: Rig, _: np.random.Generator) -> Rig:
        for index, name in enumerate(rig.names):
            centre = np.array([-11.5, 0.1 * index, 3.5 + 0.7 * index])
            rig = aimed(rig, name, centre, np.array([0.0, 3.0 * (index - 1), 0.8]))
        return rig

    return staged(seed, given=False, preset="basketball", cameras=3, people=14, seconds=30.0, rig=pole)


def opposite(seed: int) -> HandedIn:
    """Two cameras that look into each other along the middle line, focal lengths of both stated 12 % too long."""

    def facing(rig: Rig, _: np.random.Generator) -> Rig:
        for name, side in (("C1", -1.0), ("C2", 1.0)):
            rig = aimed(rig, name, np.array([0.0, 7.5 * side, 2.2]), np.array([0.0, 0.0, 0.8]))
        return rig

    scene = staged(seed, cameras=2, people=5, seconds=30.0, rig=facing)
    return stated(scene, lambda lens: zoomed(lens, 1.12))


def rolling_picture(seed: int) -> HandedIn:
    """An analogue camera whose picture runs through from top to bottom, once in 4 s, four times in 40 s."""
    scene = staged(seed, given=False, people=6, seconds=40.0)
    boxes, height = scene.boxes["C3"], float(scene.lenses["C3"].lens.size[1])
    through = np.mod((boxes.frame - 1) / 5.0, 10.0) / 4.0
    top = boxes.ltwh[:, 1] + np.where(through < 1, through, 0.0) * height
    wrapped = top >= height
    ltwh = np.column_stack([boxes.ltwh[:, 0], top - height * wrapped, boxes.ltwh[:, 2:]])
    whole = ltwh[:, 1] + ltwh[:, 3] <= height
    return scene.with_boxes("C3", replace(boxes, ltwh=ltwh)).kept("C3", whole)


def zoom_creep(seed: int) -> HandedIn:
    """A zoom lens that creeps: from 16 to 24 s its focal length grows by 20 %; the lens is stated as it was before."""
    return disturbed(seed, gradual_zoom("C2", 16.0, 24.0, 1.2), given=False, cameras=3, people=6, seconds=45.0)


def one_of_the_model(seed: int) -> HandedIn:
    """Six cameras of one model; the first one was measured, and its lens is stated of all, though each differs a little."""

    def near(rig: Rig, rng: np.random.Generator) -> Rig:
        first = rig["C1"].lens
        width = first.size[0]

        def like(camera: Camera) -> Camera:
            off = rng.uniform(-0.025, 0.025, 2) * width
            lens = with_matrix(first, cx=width / 2 + off[0], cy=first.size[1] / 2 + off[1])
            bent = replace(lens, distortions=first.distortions * rng.uniform(0.7, 1.3))
            return replace(camera, lens=zoomed(bent, rng.uniform(0.97, 1.03)))

        return Rig(tuple(like(camera) for camera in rig))

    scene = staged(seed, preset="construction", cameras=6, people=8, seconds=12.0, rig=near)
    return stated(scene, lambda _: scene.truth["C1"].lens)


def near_and_far(seed: int) -> HandedIn:
    """One person, a camera at the edge of the area, and one 60 m away whose long lens is stated 12 % too long."""

    def placed(rig: Rig, _: np.random.Generator) -> Rig:
        rig = aimed(rig, "C3", np.array([3.9, 0.5, 1.3]), np.array([0.0, 1.0, 1.0]))
        rig = aimed(rig, "C2", np.array([45.0, -40.0, 12.0]), np.array([0.0, 0.0, 0.8]))
        return Rig(tuple(replace(c, lens=zoomed(c.lens, 5.5)) if c.name == "C2" else c for c in rig))

    scene = staged(seed, people=1, seconds=60.0, rig=placed)
    return stated(scene, lambda lens: zoomed(lens, 1.12), "C2")


def side_by_side(seed: int) -> HandedIn:
    """Two cameras on one bar, 0.3 m apart, one lens longer by a fifth; their lenses are stated in exchange."""

    def bar(rig: Rig, _: np.random.Generator) -> Rig:
        assert rig["C1"].pose is not None
        centre = rig["C1"].pose.centre
        aside = 0.3 * rig["C1"].pose.R_cw[0]
        rig = aimed(rig, "C2", centre + aside, np.array([0.0, 0.0, 0.8]))
        longer = zoomed(rig["C1"].lens, 1.2)
        return Rig(tuple(replace(c, lens=longer) if c.name == "C2" else c for c in rig))

    scene = staged(seed, given=False, cameras=3, people=4, seconds=20.0, rig=bar)
    scene = scene.with_lens("C1", lambda _: scene.truth["C2"].lens)
    return scene.with_lens("C2", lambda _: scene.truth["C1"].lens)


CASES: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "cameras-letterboxed": ("boxes in pixels of the detector's 640 x 640 input, identities found", partial(letterboxed)),
        "cameras-pixel-aspect": ("pixels of 12 : 11 stated as square in all cameras", partial(pixel_aspect)),
        "cameras-centre-from-bottom": ("principal points of cropped pictures counted from the bottom",
                                       partial(centre_from_bottom)),
        "cameras-portrait": ("phones held upright with the matrices of phones held level", partial(portrait)),
        "cameras-fisheye-as-pinhole": ("two of five lenses are fisheyes, stated as pinholes", partial(fisheye_as_pinhole)),
        "cameras-pinhole-as-fisheye": ("all lenses stated as fisheyes, identities found", partial(pinhole_as_fisheye)),
        "cameras-distortion-reversed": ("the signs of all distortions reversed", partial(reversed_distortion)),
        "cameras-undistorted": ("distortion stated of straightened videos, identities found", partial(undistorted)),
        "cameras-corner-only": ("one digital zoom, stated as the full picture, identities found",
                                partial(corner_only)),
        "cameras-boxes-by-centre": ("all boxes given by their centres instead of their corners", partial(boxes_by_centre)),
        "cameras-wrong-height": ("normalised boxes rescaled to 720 x 480 instead of 720 x 576, identities found",
                                 partial(wrong_height)),
        "cameras-stabilised": ("pictures stabilised, cropped to 88 % and wandering, identities found", partial(stabilised)),
        "cameras-masts": ("two cameras sway on masts by a degree and 12 cm", partial(masts)),
        "cameras-patrol": ("a camera patrols between three presets, identities found", partial(patrol)),
        "cameras-sagging": ("a mount sags by 4 degrees within a minute", partial(sagging)),
        "cameras-nodding": ("one of two cameras nods four times and comes back, identities found", partial(nodding)),
        "cameras-bumped-first": ("two cameras look aside for the first seconds", partial(bumped_first)),
        "cameras-bumped-last": ("a camera is bumped 5 s before the end, identities found", partial(bumped_last)),
        "cameras-one-pole": ("three cameras on one pole, identities found", partial(one_pole)),
        "cameras-opposite": ("two cameras that face each other, both focal lengths 12 % too long", partial(opposite)),
        "cameras-rolling-picture": ("a picture that runs through four times, identities found", partial(rolling_picture)),
        "cameras-zoom-creep": ("a focal length that grows by 20 % half-way, identities found", partial(zoom_creep)),
        "cameras-one-of-the-model": ("the lens of one of six cameras of a model stated of all", partial(one_of_the_model)),
        "cameras-near-and-far": ("one person, a camera very near, and one far away with a focal length 12 % too long",
                                 partial(near_and_far)),
        "cameras-side-by-side": ("two cameras side by side, their lenses exchanged, identities found", partial(side_by_side)),
    }
)  # fmt: skip
