"""Hostile cameras: wrong lenses, wrong videos, odd views, and cameras that move."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Boxes
from reliability.staging import HandedIn, aimed, staged, turned, zoomed

Build = Callable[[int], HandedIn]


def wrong_focal(seed: int, *, factor: float, cameras: tuple[str, ...] = ("C2",), given: bool = True, **wanted: Any) -> HandedIn:
    """A focal length stated `factor` times the true one."""
    scene = staged(seed, given=given, **wanted)
    for name in cameras:
        scene = scene.with_lens(name, lambda lens: zoomed(lens, factor))
    return scene


def wrong_distortion(seed: int, *, k1: float, cameras: tuple[str, ...], given: bool = True) -> HandedIn:
    """Another first radial coefficient stated than the lens has (-0.3)."""

    def bent(lens: Lens, k: float) -> Lens:
        return replace(lens, distortions=np.array([k, 0.6 * k * k, 0.0, 0.0]))

    def strong(rig: Rig, rng: np.random.Generator) -> Rig:
        return Rig(tuple(replace(c, lens=bent(c.lens, -0.3)) for c in rig))

    scene = staged(seed, given=given, rig=strong)
    for name in cameras:
        scene = scene.with_lens(name, lambda lens: bent(lens, k1))
    return scene


def off_centre(seed: int, *, share: float, given: bool = True) -> HandedIn:
    """A cropped picture: the principal point is stated wrongly by a share of the width."""

    def moved(lens: Lens) -> Lens:
        matrix = np.array(lens.matrix)
        matrix[0, 2] += share * lens.size[0]
        return replace(lens, matrix=matrix)

    return staged(seed, given=given).with_lens("C2", moved)


def _two_lenses(factor: float) -> Callable[[Rig, np.random.Generator], Rig]:
    """The second camera farther away with a longer lens."""

    def change(rig: Rig, rng: np.random.Generator) -> Rig:
        cameras = []
        for camera in rig:
            assert camera.pose is not None
            if camera.name == "C2":
                centre = camera.pose.centre * (factor, factor, 1.4)
                camera = aimed(Rig((camera,)), "C2", centre, np.array([0.0, 0.0, 0.8])).cameras[0]
                camera = replace(camera, lens=zoomed(camera.lens, factor))
            cameras.append(camera)
        return Rig(tuple(cameras))

    return change


def swapped(seed: int, *, factor: float = 1.0, names: tuple[str, str] = ("C1", "C2"), given: bool = True) -> HandedIn:
    """The videos of two cameras exchanged: each is worked on with the other's lens. The truth goes with the videos."""
    scene = staged(seed, given=given, rig=_two_lenses(factor) if factor != 1 else None)
    a, b = names
    other = {a: b, b: a}
    boxes = {name: scene.boxes[other.get(name, name)] for name in scene.lenses.names}
    truth = Rig(tuple(Camera(c.name, c.lens, scene.truth[other.get(c.name, c.name)].pose) for c in scene.truth))
    return replace(scene, boxes=boxes, truth=truth)


def rolled(seed: int, *, degrees: float, given: bool) -> HandedIn:
    """A camera that hangs upside down, or on its side."""
    return staged(seed, given=given, rig=lambda rig, rng: turned(rig, "C2", roll=degrees))


def flipped(seed: int, *, given: bool, cameras: tuple[str, ...] = ("C2",)) -> HandedIn:
    """A camera that films a mirror, or mirrors its picture: left and right are exchanged."""
    scene = staged(seed, given=given)
    for name in cameras:
        width = scene.lenses[name].lens.size[0]
        boxes = scene.boxes[name]
        ltwh = boxes.ltwh.copy()
        ltwh[:, 0] = width - ltwh[:, 0] - ltwh[:, 2]
        scene = scene.with_boxes(name, replace(boxes, ltwh=ltwh))
    return scene


def moved(
    seed: int, *, share: float = 0.5, names: tuple[str, ...] = ("C2",), given: bool = True, shift: Floats | None = None,
    **turn: float,
) -> HandedIn:  # fmt: skip
    """Cameras that are turned (degrees) or shifted (metres) at a share of the recording: no one pose is right."""

    def later(rig: Rig, rng: np.random.Generator) -> Rig:
        for name in names:
            rig = turned(rig, name, shift=shift, **turn)
        return rig

    return staged(seed, given=given, later=(30.0 * share, later))


def elsewhere(seed: int, *, given: bool) -> HandedIn:
    """A camera whose view shows another place, where other people walk at the same time, numbered alike."""
    scene, other = staged(seed, given=given), staged(seed + 500_000, given=given)
    rig = Rig(tuple(other.truth["C4"] if c.name == "C4" else c for c in scene.truth))
    return replace(scene.with_boxes("C4", other.boxes["C4"], other.who["C4"]), lenses=rig, truth=_far(rig, "C4"))


def _far(rig: Rig, name: str) -> Rig:
    """A rig one of whose cameras is really somewhere else."""
    return turned(rig, name, shift=np.array([250.0, 0.0, 0.0]))


def overhead(seed: int, *, given: bool) -> HandedIn:
    """A camera that looks straight down."""
    return staged(seed, given=given,
                  rig=lambda rig, rng: aimed(rig, "C2", np.array([0.4, 0.3, 6.0]), np.array([0.41, 0.31, 0.0])))  # fmt: skip


def far_away(seed: int, *, given: bool) -> HandedIn:
    """People who are tiny in the picture: all cameras six times as far, and boxes to two pixels."""

    def change(rig: Rig, rng: np.random.Generator) -> Rig:
        for camera in rig:
            assert camera.pose is not None
            rig = aimed(rig, camera.name, camera.pose.centre * (6.0, 6.0, 4.0), np.array([0.0, 0.0, 0.8]))
        return rig

    return staged(seed, given=given, rig=change, corner_noise_px=2.0)


def feet_cut(seed: int, *, given: bool) -> HandedIn:
    """All cameras look so high that the picture's border cuts the feet off most people."""

    def change(rig: Rig, rng: np.random.Generator) -> Rig:
        for name in rig.names:
            rig = turned(rig, name, tilt=-18.0)
        return rig

    return staged(seed, given=given, rig=change)


def twice(seed: int, *, given: bool) -> HandedIn:
    """The tracks of one camera handed in again as another camera of the same lens."""
    scene = staged(seed, given=given)
    rig = Rig(tuple(replace(scene.truth["C1"], name="C4") if c.name == "C4" else c for c in scene.truth))
    return replace(scene.with_boxes("C4", scene.boxes["C1"], scene.who["C1"]), lenses=rig, truth=rig)


def slack(seed: int, *, given: bool) -> HandedIn:
    """Detectors that box people with slack that differs from camera to camera, by up to 20 % of their height."""
    scene = staged(seed, given=given)
    for share, name in zip((0.0, 0.1, -0.05, 0.05), scene.lenses.names, strict=True):
        boxes = scene.boxes[name]
        high = boxes.ltwh[:, 3:]
        grown = boxes.ltwh + share * high * np.array([-1.0, -1.0, 2.0, 2.0])
        scene = scene.with_boxes(name, Boxes(boxes.frame, boxes.identity, np.maximum(grown, (-1e9, -1e9, 2, 2)), boxes.score))
    return scene


def slip(seed: int, *, given: bool = True) -> HandedIn:
    """Two faults at once: a focal length 10 % too long, and another camera turned by 4 degrees half-way."""
    return moved(seed, names=("C3",), pan=4.0, given=given).with_lens("C2", lambda lens: zoomed(lens, 1.1))


EVERY = ("C1", "C2", "C3", "C4")
CAMERAS: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "focal-5-one": ("a focal length 5 % too long", partial(wrong_focal, factor=1.05)),
        "focal-5-all": ("all of them", partial(wrong_focal, factor=1.05, cameras=EVERY)),
        "focal-20-one": ("a focal length 20 % too long", partial(wrong_focal, factor=1.2)),
        "focal-20-short": ("one 20 % too short", partial(wrong_focal, factor=0.8)),
        "focal-20-found": ("one 20 % too long, identities found", partial(wrong_focal, factor=1.2, given=False)),
        "focal-20-all": ("all 20 % too long", partial(wrong_focal, factor=1.2, cameras=EVERY)),
        "focal-20-short-all": ("all 20 % too short", partial(wrong_focal, factor=0.8, cameras=EVERY)),
        "focal-20-all-found": ("all 20 % too long, identities found",
                               partial(wrong_focal, factor=1.2, cameras=EVERY, given=False)),
        "focal-20-wide": ("all 20 % too long on a building site",
                          partial(wrong_focal, factor=1.2, cameras=EVERY, preset="construction")),
        "distortion-one": ("a lens of k1 = -0.3 stated without distortion", partial(wrong_distortion, k1=0.0, cameras=("C2",))),
        "distortion-all": ("all of them", partial(wrong_distortion, k1=0.0, cameras=EVERY)),
        "distortion-other": ("one stated with k1 = 0.1, identities found",
                             partial(wrong_distortion, k1=0.1, cameras=("C2",), given=False)),
        "off-centre": ("a picture cropped on one side by 20 % of its width", partial(off_centre, share=0.1)),
        "off-centre-found": ("the same, identities found", partial(off_centre, share=0.1, given=False)),
        "videos-swapped": ("two videos exchanged, lenses alike", partial(swapped)),
        "videos-swapped-zoom": ("two videos exchanged, one lens twice as long", partial(swapped, factor=2.0)),
        "videos-swapped-found": ("the same, identities found", partial(swapped, factor=2.0, given=False)),
        "upside-down": ("a camera upside down", partial(rolled, degrees=180.0, given=True)),
        "upside-down-found": ("the same, identities found", partial(rolled, degrees=180.0, given=False)),
        "on-its-side": ("a camera on its side", partial(rolled, degrees=90.0, given=False)),
        "flipped": ("a picture mirrored left to right", partial(flipped, given=True)),
        "flipped-found": ("the same, identities found", partial(flipped, given=False)),
        "moved-pan-4": ("a camera turned by 4 degrees half-way", partial(moved, pan=4.0)),
        "moved-pan-4-found": ("the same, identities found", partial(moved, pan=4.0, given=False)),
        "moved-pan-15": ("turned by 15 degrees half-way", partial(moved, pan=15.0)),
        "moved-pan-15-found": ("the same, identities found", partial(moved, pan=15.0, given=False)),
        "moved-tilt-5": ("tilted by 5 degrees half-way", partial(moved, tilt=5.0)),
        "moved-late": ("turned by 8 degrees after three quarters", partial(moved, pan=8.0, share=0.75)),
        "moved-away": ("shifted by 1.5 m half-way", partial(moved, shift=np.array([1.2, 0.9, 0.0]))),
        "moved-away-found": ("the same, identities found", partial(moved, shift=np.array([1.2, 0.9, 0.0]), given=False)),
        "moved-two": ("two cameras turned by 5 degrees half-way", partial(moved, pan=5.0, names=("C2", "C4"))),
        "elsewhere-given": ("a camera that films another place, people numbered alike", partial(elsewhere, given=True)),
        "elsewhere-found": ("the same, identities found", partial(elsewhere, given=False)),
        "overhead": ("a camera looks straight down", partial(overhead, given=True)),
        "overhead-found": ("the same, identities found", partial(overhead, given=False)),
        "tiny-given": ("people of 15 to 30 pixels, boxes to two pixels", partial(far_away, given=True)),
        "tiny-found": ("the same, identities found", partial(far_away, given=False)),
        "feet-cut": ("the border cuts most feet off", partial(feet_cut, given=True)),
        "feet-cut-found": ("the same, identities found", partial(feet_cut, given=False)),
        "camera-twice": ("the same tracks handed in as two cameras", partial(twice, given=True)),
        "camera-twice-found": ("the same, identities found", partial(twice, given=False)),
        "slack": ("detectors with slack of their own, -5 to 10 %", partial(slack, given=True)),
        "slack-found": ("the same, identities found", partial(slack, given=False)),
        "two-faults": ("a focal length 10 % too long, and another camera turned half-way", partial(slip)),
        "two-faults-found": ("the same, identities found", partial(slip, given=False)),
    }
)  # fmt: skip
