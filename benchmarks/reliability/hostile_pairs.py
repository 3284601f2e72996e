"""Two faults at once: each pair of fourteen faults, the first in one camera and the second in another.

A fault that a check finds by itself may hide behind another one, or make a right camera look wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from types import MappingProxyType

import numpy as np

from passerby.core.cameras import Lens, Rig
from passerby.core.observations import Boxes
from passerby.simulation import PRESETS
from reliability.staging import HandedIn, affine, staged, zoomed

Build = Callable[[int], HandedIn]
Spoil = Callable[[HandedIn, str], HandedIn]
FIRST, SECOND, COPIED = "C2", "C3", "C1"
"""The cameras that have the two faults, and the one whose file is copied."""
LATE_FRAMES = 3
LOST_SHARE = 0.05
LEGS = 0.4
GROWN = 0.1


@dataclass(frozen=True)
class Fault:
    """What is wrong with one camera."""

    what: str
    spoil: Spoil


def _longer(scene: HandedIn, camera: str) -> HandedIn:
    return scene.with_lens(camera, lambda lens: zoomed(lens, 1.1))


def _cropped(scene: HandedIn, camera: str) -> HandedIn:
    def moved(lens: Lens) -> Lens:
        matrix = np.array(lens.matrix)
        matrix[0, 2] += 0.06 * lens.size[0]
        return replace(lens, matrix=matrix)

    return scene.with_lens(camera, moved)


def _mirrored(scene: HandedIn, camera: str, *, axis: int) -> HandedIn:
    """Left and right exchanged (axis 0), or top and bottom (1)."""
    boxes = scene.boxes[camera]
    ltwh = boxes.ltwh.copy()
    ltwh[:, axis] = scene.lenses[camera].lens.size[axis] - ltwh[:, axis] - ltwh[:, axis + 2]
    return scene.with_boxes(camera, replace(boxes, ltwh=ltwh))


def _half_size(scene: HandedIn, camera: str) -> HandedIn:
    boxes = scene.boxes[camera]
    half = scene.with_boxes(camera, replace(boxes, ltwh=0.5 * boxes.ltwh))
    return half.as_shown(camera, lambda lens: affine(lens, 0.5, (0.0, 0.0)))


def _frames_lost(scene: HandedIn, camera: str) -> HandedIn:
    boxes, who = scene.boxes[camera], scene.who[camera]
    lost = np.random.default_rng(17).uniform(size=int(boxes.frame.max()) + 1) < LOST_SHARE
    number = np.cumsum(~lost)
    kept = ~lost[boxes.frame]
    rest = boxes.take(kept)
    return scene.with_boxes(camera, replace(rest, frame=np.maximum(number[rest.frame] - 1, 1)), who[kept])


def _late(scene: HandedIn, camera: str) -> HandedIn:
    boxes = scene.boxes[camera]
    return scene.with_boxes(camera, replace(boxes, frame=boxes.frame + LATE_FRAMES))


def _exchanged(scene: HandedIn, camera: str, *, from_share: float) -> HandedIn:
    """The two people with the most boxes under each other's number, from a share of the recording on."""
    boxes = scene.boxes[camera]
    numbers, counts = np.unique(boxes.identity[boxes.identity > 0], return_counts=True)
    if len(numbers) < 2:
        return scene
    a, b = numbers[np.argsort(-counts, kind="stable")[:2]]
    late = boxes.frame > from_share * boxes.frame.max()
    swapped = np.where(boxes.identity == a, b, np.where(boxes.identity == b, a, boxes.identity))
    return scene.with_boxes(camera, replace(boxes, identity=np.where(late, swapped, boxes.identity)))


def _legs_hidden(scene: HandedIn, camera: str) -> HandedIn:
    boxes = scene.boxes[camera]
    return scene.with_boxes(camera, replace(boxes, ltwh=boxes.ltwh * np.array([1.0, 1.0, 1.0, 1.0 - LEGS])))


def _grown(scene: HandedIn, camera: str) -> HandedIn:
    """Boxes with shadows in them: longer to one side and downwards."""
    boxes = scene.boxes[camera]
    longer = GROWN * boxes.ltwh[:, 3:] * np.array([0.0, 0.0, 2.0, 1.0])
    return scene.with_boxes(camera, replace(boxes, ltwh=boxes.ltwh + longer))


def _static_box(scene: HandedIn, camera: str) -> HandedIn:
    """A poster that is boxed in each frame, under the number of the person with the fewest boxes."""
    boxes, who = scene.boxes[camera], scene.who[camera]
    numbers, counts = np.unique(boxes.identity[boxes.identity > 0], return_counts=True)
    number = int(numbers[counts.argmin()]) if len(numbers) else 1
    free = np.setdiff1d(np.unique(boxes.frame), boxes.frame[boxes.identity == number])
    size = np.array(scene.lenses[camera].lens.size, dtype=np.float64)
    box = np.concatenate([0.4 * size, 0.06 * size[1] * np.array([1.0, 3.0])])
    columns = (
        np.concatenate([boxes.frame, free]), np.concatenate([boxes.identity, np.full(len(free), number)]),
        np.concatenate([boxes.ltwh, np.tile(box, (len(free), 1))]), np.concatenate([boxes.score, np.ones(len(free))]),
    )  # fmt: skip
    order = np.argsort(columns[0], kind="stable")
    return scene.with_boxes(
        camera, Boxes(*(column[order] for column in columns)), np.concatenate([who, np.full(len(free), -1)])[order]
    )  # fmt: skip


def _half_blind(scene: HandedIn, camera: str) -> HandedIn:
    """Nobody is detected in the left half of the picture."""
    boxes = scene.boxes[camera]
    return scene.kept(camera, boxes.ltwh[:, 0] + 0.5 * boxes.ltwh[:, 2] > 0.5 * scene.lenses[camera].lens.size[0])


def _copied(scene: HandedIn, camera: str) -> HandedIn:
    """Another camera's file under this one's name, one pixel aside: it was recorded anew."""
    boxes = scene.boxes[COPIED]
    scene = scene.with_boxes(camera, replace(boxes, ltwh=boxes.ltwh + np.array([1.0, 0.0, 0.0, 0.0])), scene.who[COPIED])
    truth = Rig(tuple(replace(scene.truth[COPIED], name=camera) if c.name == camera else c for c in scene.truth))
    return replace(scene, truth=truth)


FAULTS: Mapping[str, Fault] = MappingProxyType({
    "longer": Fault("a focal length 10 % too long", _longer),
    "cropped": Fault("a picture cropped by 12 %", _cropped),
    "mirrored": Fault("a picture mirrored left to right", partial(_mirrored, axis=0)),
    "overturned": Fault("a picture flipped top to bottom", partial(_mirrored, axis=1)),
    "half-size": Fault("boxes in pixels of a picture of half the size", _half_size),
    "frames-lost": Fault("5 % of the frames lost", _frames_lost),
    "late": Fault("a video three frames late", _late),
    "exchanged": Fault("two people exchanged", partial(_exchanged, from_share=0.0)),
    "exchanged-late": Fault("two people exchanged from half-time on", partial(_exchanged, from_share=0.5)),
    "legs": Fault("legs hidden", _legs_hidden),
    "shadows": Fault("shadows in the boxes", _grown),
    "poster": Fault("a poster that is detected", _static_box),
    "half-blind": Fault("nobody detected in one half of the picture", _half_blind),
    "copied": Fault("another camera's file, one pixel aside", _copied),
})  # fmt: skip


def both(seed: int, *, first: str, second: str, preset: str, given: bool) -> HandedIn:
    """A scene of four cameras, the second and the third of which have a fault each."""
    scene = staged(seed, preset=preset, given=given)
    return FAULTS[second].spoil(FAULTS[first].spoil(scene, FIRST), SECOND)


def _pairs() -> dict[str, tuple[str, Build]]:
    """Presets by turns, identities given in every other pair."""
    presets = list(PRESETS)
    out: dict[str, tuple[str, Build]] = {}
    for number, (first, second) in enumerate(combinations(FAULTS, 2)):
        given = number % 2 == 0
        what = f"{FAULTS[first].what}, and {FAULTS[second].what}{'' if given else ', identities found'}"
        build = partial(both, first=first, second=second, preset=presets[number % len(presets)], given=given)
        out[f"pair-{first}-{second}"] = what, build
    return out


PAIRS: Mapping[str, tuple[str, Build]] = MappingProxyType(_pairs())
