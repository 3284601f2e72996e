"""What somebody would mark by hand in the pictures of a scene: points, a known length, who is who.

The truth is at hand here, and stands in for the annotator: places are projected by the true cameras, and missed by as much as a
hand misses them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from metrics.detections import paired
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import BODY_17, UNKNOWN, Boxes
from passerby.core.scale_cues import KnownLength
from passerby.simulation import SimulatedScene

MARKED = ("ground", "nose", "left_shoulder", "right_hip", "left_ankle", "ground", "right_wrist", "right_ankle")
"""In turn: the ground between the feet, and joints. A point is marked where the person's box is seen."""
BORDER_PX = 3.0
SAME_PERSON_IOU = 0.5
NEAR_M, STEP_M = 12.0, 0.5
"""A known length is looked for this far around the place that the cameras look at, and so finely."""


def marked_points(scene: SimulatedScene, count: int, noise_px: float, rng: np.random.Generator) -> dict[str, Floats]:
    """Points of people and of the ground below them, as marked in all views that show them.

    Those that most cameras see are taken first, by lot among equals, each of another person or instant; the first camera sees
    all of them, since it is the reference.

    Args:
        scene: with its truth.
        count: of points.
        noise_px: standard deviation of a mark, each coordinate.
        rng: chooses, and misses.

    Returns:
        camera -> (count, 2) pixels, NaN where a point is not seen.
    """
    seen = np.stack([_visible(scene, name) for name in scene.rig.names], axis=-1)
    frame, person = np.nonzero(seen.sum(axis=-1) >= 2)
    chance = rng.uniform(size=len(frame))
    views = np.where(seen[frame, person, 0], seen[frame, person].sum(axis=-1), 0)
    chosen = np.lexsort((chance, -views))[:count]
    frame, person = frame[chosen], person[chosen]
    places = np.stack(
        [
            _place(scene, MARKED[k % len(MARKED)], f, p)
            for k, (f, p) in enumerate(zip(frame.tolist(), person.tolist(), strict=True))
        ]
    )
    marks = {}
    for index, camera in enumerate(scene.rig):
        pixels = camera.project(places) + noise_px * rng.standard_normal((len(places), 2))
        marks[camera.name] = np.where((seen[frame, person, index] & _inside(camera, pixels))[:, None], pixels, np.nan)
    return marks


def _visible(scene: SimulatedScene, camera: str) -> NDArray[np.bool_]:
    """(T, P) who has a box in this camera, and so is not hidden by more than half."""
    boxes = scene.truth[camera]
    seen = np.zeros((len(scene.frames), len(scene.identities)), dtype=bool)
    seen[np.searchsorted(scene.frames, boxes.frame), np.searchsorted(scene.identities, boxes.identity)] = True
    return seen


def _place(scene: SimulatedScene, what: str, frame: int, person: int) -> Floats:
    """(3,) world, metres."""
    if what == "ground":
        return np.array([*scene.ground_positions[frame, person], 0.0])
    return np.asarray(scene.joints3d[frame, person, BODY_17.index(what)])


def marked_length(
    rig: Rig, metres: float, noise_px: float, rng: np.random.Generator, heights_m: tuple[float, ...] = (0.0,)
) -> KnownLength:
    """A level line of known length, marked in as many views as can see one.

    Args:
        rig: with true poses, the ground at z = 0.
        metres: how long it is.
        noise_px: standard deviation of a mark, each coordinate.
        rng: misses.
        heights_m: where it may be: on the ground, or held above it.

    Raises:
        InputError: no such line lies in the first camera's view and in another's.
    """
    middle = _looked_at(rig)
    steps = np.arange(-NEAR_M, NEAR_M + STEP_M, STEP_M)
    x, y, turn, z = (part.ravel() for part in np.meshgrid(steps, steps, np.radians([0, 45, 90, 135]), heights_m, indexing="ij"))
    near = np.argsort(np.hypot(x, y), kind="stable")
    centre = np.column_stack([x, y, z])[near] + [*middle, 0.0]
    half = metres / 2 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])[near]
    lines = np.stack([centre - half, centre + half], axis=1)
    seen = np.stack([_inside(camera, camera.project(lines.reshape(-1, 3))).reshape(-1, 2).all(axis=1) for camera in rig])
    best = int(np.argmax(np.where(seen[0], seen.sum(axis=0), 0)))
    if not seen[0, best] or seen[:, best].sum() < 2:
        raise InputError(f"no line of {metres:g} m lies in the views of {rig.names[0]} and of another camera")
    marks = {
        camera.name: camera.project(lines[best]) + noise_px * rng.standard_normal((2, 2))
        for camera, sees in zip(rig, seen[:, best], strict=True)
        if sees
    }
    # A pixel's noise at either end is no more than a few thousandths of the line: the weight matters to nobody, it is alone.
    return KnownLength(metres, 0.01 * metres, marks)


def _looked_at(rig: Rig) -> Floats:
    """(2,) where the ground lies nearest to all optical axes, world, metres."""
    normal, right = np.zeros((2, 2)), np.zeros(2)
    for camera in rig:
        assert camera.pose is not None
        axis = camera.pose.R_cw[2, :2] / np.linalg.norm(camera.pose.R_cw[2, :2])
        across = np.eye(2) - np.outer(axis, axis)
        normal += across
        right += across @ camera.centre[:2]
    return np.asarray(np.linalg.lstsq(normal, right)[0])


def _inside(camera: Camera, pixels: Floats) -> NDArray[np.bool_]:
    """(N,) which pixels lie inside the picture, and where its lens has rays."""
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((pixels > BORDER_PX) & (pixels < np.array(camera.lens.size) - BORDER_PX)).all(axis=1))
    inside[inside] = np.isfinite(camera.lens.bearings(pixels[inside])).all(axis=1)
    return inside


def named_by_hand(found: Mapping[str, Boxes], truth: Mapping[str, Boxes]) -> dict[str, Boxes]:
    """Boxes that a detector found, with the identities that somebody who knows the people would give them.

    A box gets the identity of the true box that it stands for, -1 where it stands for none.
    """
    named = {}
    for name, boxes in found.items():
        boxes, true = (some.take(np.argsort(some.frame, kind="stable")) for some in (boxes, truth[name]))
        rows, columns = paired(true, boxes, SAME_PERSON_IOU)
        identity = np.full(len(boxes), UNKNOWN)
        identity[columns] = true.identity[rows]
        named[name] = replace(boxes, identity=identity)
    return named
