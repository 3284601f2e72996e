"""A detector's view of the truth: which people get a box, and what is wrong with it.

Every fault has its own generator and is drawn for all people and instants, seen or not, so that one option never changes what
another one draws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Keypoints
from passerby.simulation.observe import View
from passerby.simulation.options import SimulationOptions

HIDDEN_LIMIT = 0.6
"""A person of whom more than this share is hidden gets no box."""
NOTICED = 0.1
"""A person of whom less than this share is hidden always gets the whole box."""
INSIDE_LIMIT = 0.1
"""A person of whom less than this share is inside the picture gets no box."""
VISIBLE_PART_PROBABILITY = 0.5
"""How often a partly hidden person gets a box of the visible part instead of the whole body."""
SMALLEST_PX = 2.0


@dataclass(frozen=True, eq=False)
class Detected:
    """What a detector reports, and whom its boxes really show."""

    seen: CameraObservations
    """Boxes and joints; the joints' rows are those of the boxes with a person, in their order."""
    true_identity: Ints
    """(N,) of the boxes' rows; -1 for a box without a person."""


def detect(
    view: View, frames: Ints, identities: Ints, picture: tuple[int, int], options: SimulationOptions, rng: np.random.Generator
) -> Detected:
    """Boxes and joints of one camera with the faults that the options ask for.

    Args:
        view: T instants, P people.
        frames: (T,) frame numbers.
        identities: (P,) the true identities.
        picture: (width, height), pixels.
        options: of the scene.
        rng: this camera's.
    """
    parts, noise, drops, swaps, joint_noise, false = rng.spawn(6)
    shape = view.hidden.shape
    part = (parts.uniform(size=shape) < VISIBLE_PART_PROBABILITY) & (view.hidden >= NOTICED)
    edges = np.where(part[..., None], view.visible_box, view.box)
    found = (view.inside >= INSIDE_LIMIT) & (view.hidden <= HIDDEN_LIMIT)
    edges = np.where(found[..., None], edges, np.array([0.0, 0.0, 1.0, 1.0]))
    on_border = edges == np.array([0.0, 0.0, *picture])
    noisy = _perturbed(edges, on_border, picture, options, noise)
    size = noisy[..., 2:] - noisy[..., :2]
    found &= (size >= SMALLEST_PX).all(axis=-1)
    found &= drops.uniform(size=shape) >= options.missing
    assigned = _swapped(np.broadcast_to(identities, shape), found, options.identity_swaps, swaps)

    rows = np.nonzero(found)
    ltwh = np.concatenate([noisy[rows][:, :2], size[rows]], axis=1)
    boxes = Boxes(frames[rows[0]], assigned[rows], ltwh, 1.0 - 0.6 * view.hidden[rows])
    joints = view.joints + options.joint_noise_px * joint_noise.standard_normal(view.joints.shape)
    keypoints = Keypoints(frames[rows[0]], assigned[rows], joints[rows], np.where(view.joint_visible[rows], 0.9, 0.0))
    boxes = _with_false_boxes(boxes, frames, picture, options.false_boxes, false)
    true_identity = np.full(len(boxes), UNKNOWN)
    true_identity[boxes.identity != UNKNOWN] = identities[rows[1]]  # false boxes come between, the order stays
    return Detected(CameraObservations(boxes, keypoints), true_identity)


def _perturbed(
    edges: Floats, on_border: NDArray[np.bool_], picture: tuple[int, int], options: SimulationOptions, rng: np.random.Generator
) -> Floats:
    """Slack and noise on the edges; an edge on the picture's border stays there, and none leaves the picture."""
    height = edges[..., 3:] - edges[..., 1:2]
    gaussian, uniform = rng.standard_normal(edges.shape), rng.uniform(-1, 1, edges.shape)
    moved = edges + options.box_slack * height * np.array([-1.0, -1.0, 1.0, 1.0])
    moved = moved + options.box_noise * height * gaussian + options.corner_noise_px * uniform
    return np.clip(np.where(on_border, edges, moved), 0.0, np.array([*picture, *picture], dtype=np.float64))


def _swapped(identities: Ints, found: NDArray[np.bool_], share: float, rng: np.random.Generator) -> Ints:
    """(T, P) identities with a share of those found at each instant exchanged in a random cycle, so that each is wrong."""
    swapped = np.array(identities)
    for frame, seed in enumerate(rng.spawn(len(found)) if share > 0 else ()):
        people = seed.permutation(found.shape[1])
        chance = seed.uniform()
        people = people[found[frame, people]]
        wanted = share * len(people)
        count = int(wanted) + int(chance < wanted - int(wanted))
        if wanted < 2:  # one person cannot be exchanged alone: two at once, half as often as one
            count = 2 if chance < wanted / 2 else 0
        chosen = people[: min(count, len(people))]
        if len(chosen) > 1:
            swapped[frame, chosen] = identities[frame, np.roll(chosen, 1)]
    return swapped


def _with_false_boxes(boxes: Boxes, frames: Ints, picture: tuple[int, int], share: float, rng: np.random.Generator) -> Boxes:
    """Add boxes without a person: sizes of true ones, places at random, identity unknown."""
    count = round(share * len(boxes))
    if count == 0:
        return boxes
    size = np.minimum(boxes.ltwh[rng.integers(len(boxes), size=count), 2:] * rng.uniform(0.7, 1.3, (count, 1)), picture)
    corner = rng.uniform(size=(count, 2)) * (np.array(picture) - size)
    frame = np.concatenate([boxes.frame, rng.choice(frames, count)])
    order = np.argsort(frame, kind="stable")
    return Boxes(
        frame[order],
        np.concatenate([boxes.identity, np.full(count, UNKNOWN)])[order],
        np.concatenate([boxes.ltwh, np.concatenate([corner, size], axis=1)])[order],
        np.concatenate([boxes.score, rng.uniform(0.3, 0.8, count)])[order],
    )
