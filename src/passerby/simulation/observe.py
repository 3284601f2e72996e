"""Observations of the bodies by cameras and detectors: tight boxes, keypoints, occlusion, errors, identities, embeddings.

Each fault has its own generator and is drawn for all people and instants, seen or not. Therefore one option never changes the
random numbers of another one.

An embedding is the sum of four parts: the person's own look, a shift of the camera (its light, its colours), a part for the
side from which this camera sees the person, and noise of the box. The sizes of the last three were chosen together. The
nearest vector of another camera belongs to the right person for 76, 66 and 61 % of single boxes among 7, 14 and 20 people, and
for 94, 91 and 88 % of the means of eight boxes (60 draws with four cameras). Networks reach about the same on people who are
not in their training data.
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
"""A person with any part at a smaller depth than this, or behind the camera, is not seen at all."""
PAIRS_AT_ONCE = 1024
HIDDEN_LIMIT = 0.6
"""Maximum hidden share of a person with a box."""
NOTICED = 0.1
"""Minimum hidden share of a person whose box may show the visible part only; below it, the box shows the whole body."""
INSIDE_LIMIT = 0.1
"""Minimum share of a person inside the picture for a box."""
VISIBLE_PART_PROBABILITY = 0.5
"""Probability that a partly hidden person gets a box of the visible part instead of the whole body."""
SMALLEST_PX = 2.0
DIMENSIONS = 128
CAMERA_SHIFT = 0.6
"""Length of a camera's shift; a person's look has length 1."""
SIDE = 1.5
"""Root mean square length of the part for one person in one camera. It is the same in all boxes, so an average keeps it."""
BOX_NOISE = 1.4
"""Root mean square length of the noise of a box: pose, light, occlusion."""
LONGEST_GAP_S = 1.0
"""A track ends if its person is not seen for longer than this."""


@dataclass(frozen=True, eq=False)
class View:
    """View of one camera, without a detector's faults. T instants, P people."""

    box: Floats
    """(T, P, 4) left, top, right, bottom of the whole body, clipped at the picture's border, pixels."""
    visible_box: Floats
    """(T, P, 4) the same for the parts that no person hides; meaningless if all parts are hidden."""
    clipped: Mask
    """(T, P, 4) whether the picture's border cuts an edge."""
    inside: Floats
    """(T, P) share of the body inside the picture, 0 to 1; 0 for a person behind the camera."""
    hidden: Floats
    """(T, P) share of the part inside the picture that people nearer to the camera hide, 0 to 1."""
    joints: Floats
    """(T, P, 17, 2) COCO's joints, pixels."""
    joint_visible: Mask
    """(T, P, 17) whether a joint is inside the picture and not hidden by another person."""


def observe_camera(camera: Camera, joints: Floats, heights: Floats, present: Mask, occlusion: bool = True) -> View:
    """Project all bodies into one camera.

    Args:
        camera: camera with a pose.
        joints: (T, P, J, 3) world, metres, from `body.pose_joints`.
        heights: (P,) standing heights, metres.
        present: (T, P) whether a person is present.
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
    """Return whether bodies (..., points, 3), camera frame, are whole in front of the camera and inside its lens's fold, (...).

    Points beyond the fold of a lens model would appear inside the picture, which no real lens does.
    """
    return np.asarray((seen[..., 2].min(axis=-1) - 0.12 > NEAREST_M) & before_fold(camera.lens, seen).all(axis=-1))


def _camera_frame(camera: Camera, points: Floats) -> Floats:
    pose = camera.pose
    if pose is None:
        raise InputError(f"camera {camera.name} has no pose: only a camera with a pose can see people")
    return np.asarray(points @ pose.R_cw.T + pose.t_cw)


def _extents(camera: Camera, centres: Floats, radii: Floats) -> Floats:
    """Compute left, top, right, bottom (..., 4), pixels, of spheres in the camera frame.

    A sphere has its extreme x / z at the point where a plane through the camera's y axis touches it. This point is projected
    through the distorted lens (likewise for y). The result is exact without distortion; with mild distortion its error is a
    hundredth of a pixel.
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
    """Return the box (T, P, 4) around the extents (T, P, S, 4) of the spheres in use (T, P, S)."""
    low = np.where(use[..., None], extents[..., :2], np.inf).min(axis=2)
    high = np.where(use[..., None], extents[..., 2:], -np.inf).max(axis=2)
    return np.concatenate([low, high], axis=-1)


def _find_covered(points: Floats, discs: Floats, disc_radii: Floats, boxes: Floats, depth: Floats) -> Mask:
    """Return whether points (T, P, S, 2) lie behind a disc (T, P, D) of a person nearer to the camera, (T, P, S)."""
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
    """Output of a detector, and the people that its boxes really show."""

    seen: CameraObservations
    """Boxes and joints; the rows of the joints are those of the boxes with a person, in the same order."""
    true_identity: Ints
    """(N,) true identity of each box; -1 for a box without a person."""


def detect(
    view: View, frames: Ints, identities: Ints, picture: tuple[int, int], options: SimulationOptions, rng: np.random.Generator
) -> Detected:
    """Return the boxes and joints of one camera with the faults that the options request.

    Args:
        view: view of T instants and P people.
        frames: (T,) frame numbers.
        identities: (P,) true identities.
        picture: (width, height), pixels.
        options: options of the scene.
        rng: generator of this camera.
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
    true_identity[boxes.identity != UNKNOWN] = identities[rows[1]]  # false boxes lie between true ones, which keep their order
    return Detected(CameraObservations(boxes, keypoints), true_identity)


def _perturb_boxes(
    edges: Floats, on_border: NDArray[np.bool_], picture: tuple[int, int], options: SimulationOptions, rng: np.random.Generator
) -> Floats:
    """Add slack and noise to the edges; an edge on the picture's border stays there, and none leaves the picture."""
    height = edges[..., 3:] - edges[..., 1:2]
    gaussian, uniform = rng.standard_normal(edges.shape), rng.uniform(-1, 1, edges.shape)
    moved = edges + options.box_slack * height * np.array([-1.0, -1.0, 1.0, 1.0])
    moved = moved + options.box_noise * height * gaussian + options.corner_noise_px * uniform
    return np.clip(np.where(on_border, edges, moved), 0.0, np.array([*picture, *picture], dtype=np.float64))


def _swap_identities(identities: Ints, found: NDArray[np.bool_], share: float, rng: np.random.Generator) -> Ints:
    """Exchange the identities (T, P) of a share of the people found at each instant in a random cycle: all these are wrong."""
    swapped = np.array(identities)
    for frame, seed in enumerate(rng.spawn(len(found)) if share > 0 else ()):
        people = seed.permutation(found.shape[1])
        chance = seed.uniform()
        people = people[found[frame, people]]
        wanted = share * len(people)
        count = int(wanted) + int(chance < wanted - int(wanted))
        if wanted < 2:  # one person cannot be exchanged alone: exchange two, half as often
            count = 2 if chance < wanted / 2 else 0
        chosen = people[: min(count, len(people))]
        if len(chosen) > 1:
            swapped[frame, chosen] = identities[frame, np.roll(chosen, 1)]
    return swapped


def _add_false_boxes(boxes: Boxes, frames: Ints, picture: tuple[int, int], share: float, rng: np.random.Generator) -> Boxes:
    """Add boxes without a person: sizes like those of true boxes, random places, unknown identity."""
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
    """Draw a random unit vector for each person, (P, D)."""
    appearance = rng.standard_normal((n_people, DIMENSIONS))
    return np.asarray(appearance / np.linalg.norm(appearance, axis=1, keepdims=True))


def box_embeddings(identity: Ints, appearance: Floats | None, rng: np.random.Generator) -> Vectors:
    """Draw the embeddings of one camera's boxes.

    Args:
        identity: (N,) true identities from 1; -1 for a box without a person, which gets noise.
        appearance: (P, D) from `people_looks`; None if all people are dressed alike, and each box gets noise.
        rng: generator of the camera.

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
    """Return the boxes and joints of one camera with tracklet numbers, from 1 in random order, instead of identities.

    Args:
        seen: boxes with identities from 1 to `n_people` or -1, and joints of the boxes whose identity is not -1, in order.
        n_people: number of people.
        fps: frame rate of the camera's frame numbers.
        mean_seconds: mean of the exponential length of a tracklet; 0 makes no cuts.
        rng: the cuts of each person come from a child of it, and do not depend on the other people in view.
    """
    boxes, joints = seen.boxes, seen.keypoints
    number = number_tracklets(boxes, n_people, fps, mean_seconds, rng)
    return CameraObservations(
        Boxes(boxes.frame, number, boxes.ltwh, boxes.score, boxes.embedding),
        Keypoints(joints.frame, number[boxes.identity != UNKNOWN], joints.xy, joints.score, joints.joints),
    )


def number_tracklets(boxes: Boxes, n_people: int, fps: float, mean_seconds: float, rng: np.random.Generator) -> Ints:
    """Return tracklet numbers (N,) of one camera's boxes; -1 stays. The arguments are those of `renumber`."""
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
    """Return the number of the piece to which each box of one person belongs, (N,); the times ascend.

    Exponential lengths are the intervals of a Poisson process, which is a Poisson number of cuts at uniform times.
    """
    cuts = np.sort(rng.uniform(0.0, length, rng.poisson(length / mean_seconds)))
    gaps = np.diff(seconds, prepend=seconds[:1]) > max(LONGEST_GAP_S, step) + 1e-9
    return np.asarray(2 * np.searchsorted(cuts, seconds) + np.cumsum(gaps) * (2 * len(cuts) + 2), dtype=np.int64)
