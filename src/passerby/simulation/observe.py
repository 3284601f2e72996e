"""What cameras and detectors see of the bodies: tight boxes, keypoints, occlusion, errors, identities, embeddings.

Every fault has its own generator and is drawn for all people and instants, seen or not, so that one option never changes what
another one draws.

A vector is the person's own look, a shift that is the camera's (its light, its colours), the side from which this camera sees
the person, and noise of the box. The three sizes were chosen together: the nearest of another camera's vectors is the right
person's for 76, 66 and 61 % of single boxes among 7, 14 and 20 people, and for 94, 91 and 88 % of the means of eight boxes
(60 draws with four cameras), about what networks reach on people whom they were not trained for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.observations import BODY_17, UNKNOWN, Boxes, CameraObservations, Keypoints, Vectors
from passerby.simulation.body import body_spheres
from passerby.simulation.lenses import before_fold
from passerby.simulation.options import SimulationOptions

Mask = NDArray[np.bool_]
NEAREST_M = 0.3
"""A person any part of whom is nearer to the image plane than this (or behind it) is not seen at all."""
PAIRS_AT_ONCE = 1024
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
class View:
    """What one camera sees, free of any detector's faults. T instants, P people."""

    box: Floats
    """(T, P, 4) left, top, right, bottom of the whole body, clipped at the picture's border, pixels."""
    visible_box: Floats
    """(T, P, 4) the same of the parts that no person hides; meaningless where everything is hidden."""
    clipped: Mask
    """(T, P, 4) edges that the picture's border cut."""
    inside: Floats
    """(T, P) share of the body inside the picture, 0 to 1; 0 for a person behind the camera."""
    hidden: Floats
    """(T, P) share of that part which is hidden by people nearer to the camera, 0 to 1."""
    joints: Floats
    """(T, P, 17, 2) COCO's joints, pixels."""
    joint_visible: Mask
    """(T, P, 17) inside the picture and not hidden by another person."""


def observe_camera(camera: Camera, joints: Floats, heights: Floats, present: Mask, occlusion: bool = True) -> View:
    """Project all bodies into one camera.

    Args:
        camera: with a pose.
        joints: (T, P, J, 3) world, metres, from `body.pose_joints`.
        heights: (P,) metres.
        present: (T, P) who is there.
        occlusion: whether people hide each other.
    """
    n_times, n_people = present.shape
    centres, radii = body_spheres(joints, heights)
    seen = _camera_frame(camera, centres)
    in_front = find_whole_in_view(camera, seen) & present
    seen = np.where(in_front[..., None, None], seen, np.array([0.0, 0.0, 1e3]))
    extents = _extents(camera, seen, np.broadcast_to(radii, seen.shape[:-1]))
    discs = camera.lens.project_rays(seen.reshape(-1, 3)).reshape((*seen.shape[:-1], 2))
    disc_radii = camera.lens.focal * radii / seen[..., 2]
    body_17 = _camera_frame(camera, joints[:, :, : len(BODY_17)])
    body_17 = np.where(in_front[..., None, None], body_17, np.array([0.0, 0.0, 1e3]))
    joint_px = camera.lens.project_rays(body_17.reshape(-1, 3)).reshape(n_times, n_people, len(BODY_17), 2)

    picture = np.array(camera.lens.size, dtype=np.float64)
    limits = np.array([*picture, *picture])
    whole = _hull(extents, np.ones(extents.shape[:-1], dtype=np.bool_))
    points = np.concatenate([discs, joint_px], axis=2)
    depth = np.where(in_front, np.linalg.norm(seen, axis=-1).mean(axis=-1), np.inf)
    covered = _find_covered(points, discs, disc_radii, whole, depth if occlusion else np.full_like(depth, np.inf))
    disc_covered, joint_covered = covered[:, :, : discs.shape[2]], covered[:, :, discs.shape[2] :]
    disc_inside = ((discs > 0) & (discs < picture)).all(axis=-1) & in_front[..., None]
    weight = np.broadcast_to(radii**2, discs.shape[:-1])
    inside = (weight * disc_inside).sum(axis=-1) / weight.sum(axis=-1)
    hidden = (weight * (disc_inside & disc_covered)).sum(axis=-1) / np.maximum((weight * disc_inside).sum(axis=-1), 1e-12)
    box = np.clip(whole, 0.0, limits)
    return View(
        box=box,
        visible_box=np.clip(_hull(extents, ~disc_covered), 0.0, limits),
        clipped=box != whole,
        inside=inside,
        hidden=hidden,
        joints=joint_px,
        joint_visible=((joint_px > 0) & (joint_px < picture)).all(axis=-1) & ~joint_covered & in_front[..., None],
    )


def find_whole_in_view(camera: Camera, seen: Floats) -> Mask:
    """(...) which bodies (..., points, 3), camera frame, are in front, and nowhere so far aside that the lens folds.

    What is beyond the fold of a lens would appear inside the picture, which no real lens does.
    """
    return np.asarray((seen[..., 2].min(axis=-1) - 0.12 > NEAREST_M) & before_fold(camera.lens, seen).all(axis=-1))


def _camera_frame(camera: Camera, points: Floats) -> Floats:
    pose = camera.pose
    if pose is None:
        raise InputError(f"camera {camera.name} has no pose: only a camera with a pose can see people")
    return np.asarray(points @ pose.R_cw.T + pose.t_cw)


def _extents(camera: Camera, centres: Floats, radii: Floats) -> Floats:
    """(..., 4) left, top, right, bottom of spheres given in the camera frame.

    The extreme x / z of a sphere lies where a plane through the camera's y axis touches it; that point is projected through
    the distorted lens (likewise for y). Exact without distortion; under mild distortion off by a hundredth of a pixel.
    """
    extremes = []
    for axis, sign in ((0, -1.0), (1, -1.0), (0, 1.0), (1, 1.0)):
        across, depth = centres[..., axis], centres[..., 2]
        angle = np.arctan2(across, depth) + sign * np.arcsin(np.minimum(radii / np.hypot(across, depth), 1.0))
        touch = centres.copy()
        touch[..., axis] += sign * radii * np.cos(angle)
        touch[..., 2] -= sign * radii * np.sin(angle)
        pixels = camera.lens.project_rays(touch.reshape(-1, 3))[:, axis]
        extremes.append(pixels.reshape(radii.shape))
    return np.stack(extremes, axis=-1)


def _hull(extents: Floats, use: Mask) -> Floats:
    """(T, P, 4) box around the extents (T, P, S, 4) of the spheres in use (T, P, S)."""
    low = np.where(use[..., None], extents[..., :2], np.inf).min(axis=2)
    high = np.where(use[..., None], extents[..., 2:], -np.inf).max(axis=2)
    return np.concatenate([low, high], axis=-1)


def _find_covered(points: Floats, discs: Floats, disc_radii: Floats, boxes: Floats, depth: Floats) -> Mask:
    """(T, P, S) which of the points (T, P, S, 2) lie behind a disc (T, P, D) of a person nearer to the camera."""
    overlap = (boxes[:, :, None, :2] < boxes[:, None, :, 2:]).all(axis=-1) & (
        boxes[:, :, None, 2:] > boxes[:, None, :, :2]
    ).all(axis=-1)
    time, back, front = np.nonzero(overlap & (depth[:, None, :] < depth[:, :, None]) & np.isfinite(depth)[:, :, None])
    covered = np.zeros(points.shape[:-1], dtype=np.bool_)
    for start in range(0, len(time), PAIRS_AT_ONCE):
        t, b, f = (index[start : start + PAIRS_AT_ONCE] for index in (time, back, front))
        apart = points[t, b][:, :, None].astype(np.float32) - discs[t, f][:, None].astype(np.float32)
        distance2 = apart[..., 0] ** 2 + apart[..., 1] ** 2
        behind = (distance2 < (disc_radii[t, f] ** 2).astype(np.float32)[:, None]).any(axis=-1)
        np.logical_or.at(covered, (t, b), behind)
    return covered


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
    noisy = _perturb_boxes(edges, on_border, picture, options, noise)
    size = noisy[..., 2:] - noisy[..., :2]
    found &= (size >= SMALLEST_PX).all(axis=-1)
    found &= drops.uniform(size=shape) >= options.missing
    assigned = _swap_identities(np.broadcast_to(identities, shape), found, options.identity_swaps, swaps)

    rows = np.nonzero(found)
    ltwh = np.concatenate([noisy[rows][:, :2], size[rows]], axis=1)
    boxes = Boxes(frames[rows[0]], assigned[rows], ltwh, 1.0 - 0.6 * view.hidden[rows])
    joints = view.joints + options.joint_noise_px * joint_noise.standard_normal(view.joints.shape)
    keypoints = Keypoints(frames[rows[0]], assigned[rows], joints[rows], np.where(view.joint_visible[rows], 0.9, 0.0))
    boxes = _add_false_boxes(boxes, frames, picture, options.false_boxes, false)
    true_identity = np.full(len(boxes), UNKNOWN)
    true_identity[boxes.identity != UNKNOWN] = identities[rows[1]]  # false boxes come between, the order stays
    return Detected(CameraObservations(boxes, keypoints), true_identity)


def _perturb_boxes(
    edges: Floats, on_border: NDArray[np.bool_], picture: tuple[int, int], options: SimulationOptions, rng: np.random.Generator
) -> Floats:
    """Slack and noise on the edges; an edge on the picture's border stays there, and none leaves the picture."""
    height = edges[..., 3:] - edges[..., 1:2]
    gaussian, uniform = rng.standard_normal(edges.shape), rng.uniform(-1, 1, edges.shape)
    moved = edges + options.box_slack * height * np.array([-1.0, -1.0, 1.0, 1.0])
    moved = moved + options.box_noise * height * gaussian + options.corner_noise_px * uniform
    return np.clip(np.where(on_border, edges, moved), 0.0, np.array([*picture, *picture], dtype=np.float64))


def _swap_identities(identities: Ints, found: NDArray[np.bool_], share: float, rng: np.random.Generator) -> Ints:
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


def _add_false_boxes(boxes: Boxes, frames: Ints, picture: tuple[int, int], share: float, rng: np.random.Generator) -> Boxes:
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
