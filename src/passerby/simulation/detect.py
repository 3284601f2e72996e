"""A detector's view of the truth: which people get a box, and what is wrong with it.

Every fault has its own generator and is drawn for all people and instants, seen or not, so that one option never changes what
another one draws.

What a re-identification network would make of the people: one unit vector for each box.

A vector is the person's own look, a shift that is the camera's (its light, its colours), the side from which this camera sees
the person, and noise of the box. The three sizes were chosen together: the nearest of another camera's vectors is the right
person's for 76, 66 and 61 % of single boxes among 7, 14 and 20 people, and for 94, 91 and 88 % of the means of eight boxes
(60 draws with four cameras), about what networks reach on people whom they were not trained for.

Identities as a tracker has them: numbers that hold in one camera and, if wished, break off at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Keypoints, Vectors
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
DIMENSIONS = 128
CAMERA_SHIFT = 0.6
"""Length of a camera's shift; a person's look has length 1."""
SIDE = 1.5
"""Root mean square length of what one camera makes of one person, in all its boxes alike: an average does not remove it."""
BOX_NOISE = 1.4
"""Root mean square length of the noise of a box: pose, light, occlusion."""
LONGEST_GAP_S = 1.0
"""A tracker lets go of a person whom it has not seen for longer than this."""


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
        if wanted < 2:  # nobody can be exchanged alone: two at once, half as often as one
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


def people_looks(n_people: int, rng: np.random.Generator) -> Floats:
    """(P, D) one random unit vector for each person."""
    appearance = rng.standard_normal((n_people, DIMENSIONS))
    return np.asarray(appearance / np.linalg.norm(appearance, axis=1, keepdims=True))


def box_embeddings(identity: Ints, appearance: Floats | None, rng: np.random.Generator) -> Vectors:
    """Embeddings of one camera's boxes.

    Args:
        identity: (N,) true identities from 1, -1 for a box without a person, which gets noise.
        appearance: (P, D) from `people_looks`; None where everybody is dressed alike, and every box gets noise.
        rng: the camera's.

    Returns:
        (N, D) unit vectors.
    """
    shifting, siding, noising = rng.spawn(3)
    vectors = noising.standard_normal((len(identity), DIMENSIONS)) / np.sqrt(DIMENSIONS)
    if appearance is not None:
        shift = shifting.standard_normal(DIMENSIONS)
        side = siding.standard_normal(appearance.shape) / np.sqrt(DIMENSIONS)
        known = identity != UNKNOWN
        vectors[known] *= BOX_NOISE
        vectors[known] += (appearance + SIDE * side)[identity[known] - 1] + CAMERA_SHIFT * shift / np.linalg.norm(shift)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), dtype=np.float32)


def renumber(
    seen: CameraObservations, n_people: int, fps: float, mean_seconds: float, rng: np.random.Generator
) -> CameraObservations:
    """Boxes and joints of one camera with tracklet numbers, 1 and up in random order, instead of identities.

    Args:
        seen: identities from 1 to `n_people`; those of the joints are the boxes' of the same rows, -1 left out.
        n_people: how many people there are.
        fps: of the camera's frame numbers.
        mean_seconds: mean of the exponential length of a tracklet; 0 cuts none.
        rng: every person's cuts come from a child of it, whatever the camera sees of others.
    """
    boxes, joints = seen.boxes, seen.keypoints
    number = number_tracklets(boxes, n_people, fps, mean_seconds, rng)
    return CameraObservations(
        Boxes(boxes.frame, number, boxes.ltwh, boxes.score, boxes.embedding),
        Keypoints(joints.frame, number[boxes.identity != UNKNOWN], joints.xy, joints.score, joints.joints),
    )


def number_tracklets(boxes: Boxes, n_people: int, fps: float, mean_seconds: float, rng: np.random.Generator) -> Ints:
    """(N,) tracklet numbers of one camera's boxes, with the arguments of `renumber`; -1 stays."""
    numbering, *people = rng.spawn(1 + n_people)
    piece = np.zeros(len(boxes), dtype=np.int64)
    if mean_seconds > 0 and len(boxes):
        length = float(boxes.frame.max()) / fps
        for person, child in enumerate(people, start=1):
            rows = np.flatnonzero(boxes.identity == person)
            piece[rows] = _pieces((boxes.frame[rows] - 1) / fps, 1.0 / fps, length, mean_seconds, child)
    known = boxes.identity != UNKNOWN
    pieces, which = np.unique(np.stack([boxes.identity, piece])[:, known], axis=1, return_inverse=True)
    number = np.full(len(boxes), UNKNOWN)
    number[known] = (numbering.permutation(pieces.shape[1]) + 1)[which.ravel()]
    return number


def _pieces(seconds: NDArray[np.float64], step: float, length: float, mean_seconds: float, rng: np.random.Generator) -> Ints:
    """(N,) which piece each of a person's boxes, at ascending times, belongs to.

    Exponential lengths are the gaps of a Poisson process, and that is a Poisson number of cuts at uniform times.
    """
    cuts = np.sort(rng.uniform(0.0, length, rng.poisson(length / mean_seconds)))
    gaps = np.diff(seconds, prepend=seconds[:1]) > max(LONGEST_GAP_S, step) + 1e-9
    return np.asarray(2 * np.searchsorted(cuts, seconds) + np.cumsum(gaps) * (2 * len(cuts) + 2), dtype=np.int64)
