"""Conversion of observations with identities to the solver's evidence: sightings of upright people, and of joints.

A *person-instant* is one identity at one frame. It is used when two or more cameras saw it. A box whose edge lies at the
image's border is cut off there, and does not show the body's extent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import MIN_JOINT_SCORE, MIN_JOINTS, Observations
from passerby.findings.finding import Finding, doubt
from passerby.geometry.triangulation import PointObservations
from passerby.people.segments import (
    MIN_EXTENT_PX,
    MIN_ORDER_CORRELATION,
    Segments,
    image_velocity,
    order_correlations,
    segments_of_boxes,
    segments_of_keypoints,
    segments_without,
)
from passerby.people.sightings import Sightings

# A joint with lower confidence than usual gets a larger sigma: the factor is this power of the ratio of usual to own
# confidence, within a range. Errors of a network's joints in rendered films grow with the first power, in single instants and
# in means over seconds; other powers barely change the rigs (docs/results/limits.md). Residuals of OpenPose's joints in two
# real recordings grow with the first power too. The third power gives smaller position errors in both, by 0.7 and 5.5 mm, but
# not systematically: of the four quarters of the second recording, two have larger ones.
DOUBT_POWER, DOUBT_RANGE = 1.0, (0.5, 10.0)
USUAL_CAMERAS = 50
"""Number of cameras above which the limits of the evidence grow with the cameras."""
OVERLAPPING_ALL = 12
"""Number of cameras up to which evidence is drawn from the whole rig at random. In larger rigs few cameras see each person,
and overlaps of a few square metres would get too little evidence. There it is drawn overlap by overlap (a simulated floor of
50 cameras, seed 800: the largest error of a camera is 0.9 instead of 1.5 m, four cameras of a hall are no longer uncertain)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for the solver: M sightings of people and K sightings of joints, over N person-instants and J joints."""

    sightings: Sightings
    person: Ints
    """(N,) index into `identities`."""
    frame: Ints
    """(N,) instant of each person-instant."""
    identities: Ints
    """(P,) identity of each person."""
    joints: PointObservations
    """K sightings; `sigma_px` holds the person's extent in the image, enlarged for a joint of low confidence."""
    joint_kind: Ints
    """(J,) body joint of each 3D joint, by its number in the files."""
    joint_person: Ints
    """(J,) identity of the person of each 3D joint."""
    joint_frame: Ints
    """(J,) instant of each 3D joint."""
    n_cameras: int
    findings: tuple[Finding, ...] = ()
    """Findings about errors in the input."""

    @property
    def n_people(self) -> int:
        """Number of persons."""
        return len(self.identities)

    @property
    def n_joints(self) -> int:
        """Number of 3D joints."""
        return len(self.joint_kind)


def gather_evidence(
    rig: Rig, observations: Observations, rng: np.random.Generator, *, max_sightings: int = 30_000, max_joints: int = 24_000,
    moving: bool = False,
) -> Evidence:  # fmt: skip
    """Collect the evidence of all cameras.

    Args:
        rig: lenses; poses are not read.
        observations: boxes and keypoints with identities.
        rng: draws the person-instants that are kept where there are more than the limits allow.
        max_sightings: largest number of sightings of people in rigs of up to `USUAL_CAMERAS`; it bounds time and memory for
            long recordings.
        max_joints: the same for sightings of joints.
        moving: whether to compute velocities in the image, from which errors of the clocks are estimated.

    Raises:
        InputError: `moving`, and the observations' frame rate is not known.
    """
    if moving and not observations.fps:
        raise InputError("clocks cannot be refined without a frame rate: give the time steps' fps")
    fps = observations.fps if moving else None
    named, findings = _names_hold(rig, observations)
    tables: list[tuple[int, Segments]] = []
    velocity = []
    for index, camera in enumerate(rig):
        seen = observations[camera.name]
        boxes = segments_of_boxes(seen.boxes, camera.lens)
        keypoints = segments_without(segments_of_keypoints(seen.keypoints, named), boxes)
        tables += [(index, boxes), (index, keypoints)]
        velocity += [segments.velocity(fps) for segments in (boxes, keypoints)] if fps else []
    camera_of = np.concatenate([np.full(len(s.frame), c, dtype=np.int64) for c, s in tables])
    frame, identity = (np.concatenate([getattr(s, name) for _, s in tables]) for name in ("frame", "identity"))
    more = max(1.0, len(rig) / USUAL_CAMERAS)
    keep, block, key = _shared_instants(
        camera_of, frame, identity, rng, round(more * max_sightings), even=len(rig) > OVERLAPPING_ALL
    )
    identities, person = np.unique(key[:, 0], return_inverse=True)
    sightings = _sightings(
        rig, tables, (camera_of, frame, identity), keep, block, np.concatenate(velocity)[keep] if fps else None
    )
    joints, kind, whose, when = _joints(rig, observations, rng, round(more * max_joints), fps)
    return Evidence(sightings, person, key[:, 1], identities, joints, kind, whose, when, len(rig), findings)


def _names_hold(rig: Rig, observations: Observations) -> tuple[bool, tuple[Finding, ...]]:
    """Return whether the joints' names give the same order from head to feet as the images, and a finding if not.

    Some tools write one joint layout under the names of another. A hip under the name of a head would ruin vertical and scale.
    """
    every = [observations[camera.name].keypoints for camera in rig]
    correlations = [one for keypoints in every for one in order_correlations(keypoints, keypoints.joints)]
    if not correlations:
        return True, ()
    order = float(np.median(correlations))
    if order >= MIN_ORDER_CORRELATION:
        return True, ()
    return False, (doubt("keypoint_names_unfit", correlation=order),)


def _shared_instants(
    camera: Ints, frame: Ints, identity: Ints, rng: np.random.Generator, limit: int, *, even: bool = False
) -> tuple[Ints, Ints, Ints]:
    """Return the rows of person-instants that two or more cameras saw, their block numbers, and (identity, frame) per block.

    Above the limit, whole person-instants are drawn at random; with `even`, equal numbers from all pairs of cameras, as far as
    they have enough.
    """
    if len(frame) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
    base = frame.min()
    span = int(frame.max() - base) + 1
    key, number, count = np.unique(identity * span + (frame - base), return_inverse=True, return_counts=True)
    shared = count >= 2
    if count[shared].sum() > limit:
        order = rng.permutation(np.flatnonzero(shared))
        if even:
            order = order[np.argsort(_turns(camera, number, order, len(key)), kind="stable")]
        shared = np.zeros(len(key), dtype=bool)
        shared[order[: np.searchsorted(np.cumsum(count[order]), limit)]] = True
    rows = np.flatnonzero(shared[number])
    rows = rows[np.argsort(camera[rows], kind="stable")]
    renumbered = np.cumsum(shared) - 1
    kept = key[shared]
    return rows, renumbered[number[rows]], np.column_stack([kept // span, kept % span + base])


def draw_blocks(evidence: Evidence, most: int, rng: np.random.Generator) -> Ints:
    """Draw at most `most` person-instants (K,) of the evidence at random, ascending; for many cameras overlap by overlap."""
    order = rng.permutation(len(evidence.person))
    if evidence.n_cameras > OVERLAPPING_ALL and most < len(order) and len(evidence.sightings):
        s = evidence.sightings
        order = order[np.argsort(_turns(s.camera, s.block, order, len(order)), kind="stable")]
    return np.sort(order[:most])


def _turns(camera: Ints, number: Ints, order: Ints, count: int) -> Ints:
    """Return the turn (K,) of each person-instant of `order` if all pairs of cameras select theirs in turns, in that order.

    Each pair selects one of its person-instants per turn. A person-instant gets the earliest turn of its pairs.

    Args:
        camera: (M,) camera of each sighting.
        number: (M,) person-instant of each sighting.
        order: (K,) person-instants in their order.
        count: number of person-instants that `number` refers to.
    """
    place = np.full(count, -1)
    place[order] = np.arange(len(order))
    rows = np.flatnonzero(place[number] >= 0)
    rows = rows[np.argsort(place[number[rows]], kind="stable")]
    at, of_camera = place[number[rows]], camera[rows].astype(np.int64)
    first, second = [], []
    step = 1
    while True:  # the pairs of a person-instant: each sighting with the next one, then with the second next one, and so on
        same = np.flatnonzero(at[:-step] == at[step:]) if step < len(at) else np.zeros(0, np.int64)
        if not len(same):
            break
        first.append(same)
        second.append(same + step)
        step += 1
    a, b = np.concatenate(first), np.concatenate(second)
    pair = np.minimum(of_camera[a], of_camera[b]) * (int(of_camera.max()) + 1) + np.maximum(of_camera[a], of_camera[b])
    by_pair = np.lexsort((at[a], pair))
    begins = np.flatnonzero(np.diff(pair[by_pair], prepend=-1))
    turn = np.empty(len(pair), np.int64)
    turn[by_pair] = np.arange(len(pair)) - np.repeat(begins, np.diff(begins, append=len(pair)))
    out = np.full(len(order), len(pair), np.int64)
    np.minimum.at(out, at[a], turn)
    return out


def _sightings(
    rig: Rig, tables: list[tuple[int, Segments]], who: tuple[Ints, Ints, Ints], keep: Ints, block: Ints, velocity: Floats | None
) -> Sightings:
    """Compute the rays and tangents of the kept rows; a row for which the lens gives no ray is dropped."""

    def column(name: str) -> Floats:
        return np.concatenate([np.asarray(getattr(s, name), dtype=np.float64) for _, s in tables])[keep]

    camera, step, identity = (each[keep] for each in who)
    top, bottom = column("top").reshape(-1, 2), column("bottom").reshape(-1, 2)
    top_ray, bottom_ray = np.zeros((len(keep), 3)), np.zeros((len(keep), 3))
    top_tangent, bottom_tangent = np.zeros((len(keep), 2, 3)), np.zeros((len(keep), 2, 3))
    for index, item in enumerate(rig):
        rows = camera == index
        top_ray[rows], bottom_ray[rows] = item.lens.bearings(top[rows]), item.lens.bearings(bottom[rows])
        top_tangent[rows], bottom_tangent[rows] = item.lens.tangents(top_ray[rows]), item.lens.tangents(bottom_ray[rows])
    sightings = Sightings(
        camera, step, identity, block=block, top=top_ray, bottom=bottom_ray, top_tangent=top_tangent,
        bottom_tangent=bottom_tangent, extent_px=np.linalg.norm(bottom - top, axis=1), top_fraction=column("top_fraction"),
        bottom_fraction=column("bottom_fraction"), has_foot=column("has_foot"), velocity=velocity,
    )  # fmt: skip
    return sightings.take(np.isfinite(np.concatenate([top_ray, bottom_ray], axis=1)).all(axis=1))


def _joints(
    rig: Rig, observations: Observations, rng: np.random.Generator, limit: int, fps: float | None
) -> tuple[PointObservations, Ints, Ints, Ints]:
    """Return every joint that two or more cameras saw as a point: its sightings, body joint, identity and instant."""
    columns: list[tuple[Ints, ...]] = []
    xy, size_px, velocity = [], [], []
    for index, camera in enumerate(rig):
        keypoints = observations[camera.name].keypoints
        found = (keypoints.score > MIN_JOINT_SCORE) & (keypoints.identity >= 0)[:, None]
        found &= (found.sum(axis=1) >= MIN_JOINTS)[:, None]
        row, joint = np.nonzero(found)
        columns.append((np.full(len(row), index), keypoints.frame[row], keypoints.identity[row], joint))
        xy.append(keypoints.xy[row, joint])
        y = keypoints.xy[:, :, 1]
        height = np.where(found, y, -np.inf).max(axis=1, initial=-np.inf) - np.where(found, y, np.inf).min(
            axis=1, initial=np.inf
        )
        usual = float(np.median(keypoints.score[found])) if len(row) else 1.0
        unsure = np.clip((usual / keypoints.score[row, joint]) ** DOUBT_POWER, *DOUBT_RANGE)
        size = np.maximum(height[row], MIN_EXTENT_PX)
        size_px.append(size * unsure)
        if fps:
            whose = keypoints.identity[row] * len(keypoints.joints) + joint
            velocity.append(image_velocity(keypoints.frame[row], whose, xy[-1], size, fps))
    camera_of, frame, identity, joint = (np.concatenate(parts).astype(np.int64) for parts in zip(*columns, strict=True))
    if len(frame) == 0:
        still = np.zeros((0, 2)) if fps else None
        empty = PointObservations(camera_of[:0], camera_of[:0], np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0), still)
        none = np.zeros(0, np.int64)
        return empty, none, none, none
    n_joints = int(joint.max()) + 1
    rows, point, key = _shared_instants(camera_of, frame, identity * n_joints + joint, rng, limit)
    pixels, size = np.concatenate(xy)[rows], np.concatenate(size_px)[rows]
    camera_of = camera_of[rows]
    bearing, tangent = np.zeros((len(rows), 3)), np.zeros((len(rows), 2, 3))
    for index, item in enumerate(rig):
        own = camera_of == index
        bearing[own] = item.lens.bearings(pixels[own])
        tangent[own] = item.lens.tangents(bearing[own])
    good = np.flatnonzero(np.isfinite(bearing).all(axis=1))
    motion = np.concatenate(velocity)[rows] if fps else None
    sightings = PointObservations(camera_of, point, bearing, tangent, size, motion)
    return sightings.take(good), key[:, 0] % n_joints, key[:, 0] // n_joints, key[:, 1]
