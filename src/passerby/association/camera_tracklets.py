"""Input of association: the tracklets of each camera, split and stitched, and its people on its own ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.optimize import linear_sum_assignment

from passerby.association.ground.ground_tracks import GroundTracks, ground_tracks
from passerby.association.not_people import without_people
from passerby.association.tracking.splitting import find_continuations, find_motion_links, split_tracklets
from passerby.association.tracking.stitching import StitchingOptions, find_stitches
from passerby.association.tracking.tracking import overlaps, track
from passerby.common.arrays import Floats, Ints
from passerby.common.parallel import EarlierResults
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import MIN_JOINT_SCORE, UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.core.pointing import Sighting
from passerby.geometry.single_view import Level
from passerby.people.level import levelled_people
from passerby.people.sightings import Sightings

SAME_PERSON_OVERLAP = 0.5
"""Least intersection over union of joints' extent and a box, with which the joints belong to the box."""
BEYOND_DOUBT = StitchingOptions(margin=6.0)
"""Stitching with the odds of the tracker's links, 20 to 1. On pets2009 precision and recall of joined pairs of boxes are
0.947 and 0.803 with these stitches, 0.942 and 0.785 without, and 0.945 and 0.800 with all links of odds above 2.7 to 1."""


Tracked = tuple[CameraObservations, tuple[Ints, Ints]]
"""A camera's people with the numbers of their tracklets, and (K,) tracklets and (K,) the tracklets that continue them."""


class KnownTracklets(Protocol):
    """Tracklets that earlier runs found. It is picklable, for processes that work on cameras."""

    def load(self, seen: CameraObservations, fps: float) -> Tracked | None:
        """Return the tracklets of these people at this frame rate; None where they are not known."""

    def save(self, seen: CameraObservations, fps: float, tracked: Tracked) -> None:
        """Store the tracklets for a later run."""


@dataclass(frozen=True, eq=False)
class CameraTracklets:
    """Tracklets of one camera, input for association."""

    name: str
    seen: CameraObservations
    """Boxes and joints as they were read. Their identities are the tracklets 0, 1, ... of this camera, or -1."""
    clock: Clock
    bodies: Sightings
    """The same people, with times by the camera's own clock."""
    level: Level | None
    """Vertical and height of the camera above its own ground; None where people are too few."""
    tracks: GroundTracks | None
    continued: tuple[Ints, Ints]
    """(K,) tracklets and (K,) the tracklets that significantly continue them."""

    @property
    def n_tracklets(self) -> int:
        """Number of tracklets: all tracklet numbers are below it."""
        return max((int(part.identity.max(initial=-1)) for part in (self.seen.boxes, self.seen.keypoints)), default=-1) + 1


def build_camera_tracklets(
    camera: Camera,
    seen: CameraObservations,
    clock: Clock,
    person_height_m: float,
    rng: np.random.Generator,
    *,
    given: bool = False,
    kept: KnownTracklets | None = None,
    not_people: tuple[Sighting, ...] = (),
) -> CameraTracklets:
    """Track the people of a camera, split the tracklets, and level the camera.

    Args:
        camera: name and lens.
        seen: boxes and joints whose identities are tracklets of this camera, or -1 for detections.
        clock: from frames to seconds.
        person_height_m: expected standing height, metres.
        rng: draws the people that the level is fitted to.
        given: whether the identities are known people, which are neither tracked nor split nor renumbered.
        kept: store of tracklets: those of earlier runs are read from it, and those of this run are written to it.
        not_people: boxes of this camera that the user says are no person.
    """
    none = np.zeros(0, np.int64)
    tracked, continued = (seen, (none, none)) if given else _tracked_or_kept(seen, clock.fps, kept)
    if not_people:
        tracked = without_people(tracked, not_people)
    bodies, level = levelled_people(tracked, camera.lens, clock, person_height_m, rng)
    tracks = None if level is None else ground_tracks(bodies, level)
    return CameraTracklets(camera.name, tracked, clock, bodies, level, tracks, continued)


def with_lens(camera: CameraTracklets, lens: Lens, person_height_m: float, rng: np.random.Generator) -> CameraTracklets:
    """Return the same people with another lens: rays, level and ground tracks are computed again, the tracklets stay.

    Args:
        camera: tracklets built with one lens.
        lens: the other lens.
        person_height_m: expected standing height, metres.
        rng: draws the people that the level is fitted to.
    """
    bodies, level = levelled_people(camera.seen, lens, camera.clock, person_height_m, rng)
    tracks = None if level is None else ground_tracks(bodies, level)
    return replace(camera, bodies=bodies, level=level, tracks=tracks)


def build_tracklets(
    rig: Rig, observations: Observations, clocks: Mapping[str, Clock], person_height_m: float, rng: np.random.Generator,
    executor: Executor | None = None, *, given: bool = False, tell: Progress = silent,
    earlier: EarlierTracklets | None = None, kept: KnownTracklets | None = None, not_people: Sequence[Sighting] = (),
) -> list[CameraTracklets]:  # fmt: skip
    """Build the tracklets of all cameras of a rig, in parallel where there is an executor. The result does not depend on it.

    `tell` is called for every camera that is done. `earlier` are results of other estimates of the scene: a camera with the
    same people, lens and clock is taken from there, including the draws of its level. `kept` are the tracklets of earlier
    runs; the result does not depend on them. `not_people` are boxes that the user says are no person.
    """
    nobody = {camera.name: tuple(one for one in not_people if one.camera == camera.name) for camera in rig}
    jobs = [
        _Job(camera, observations[camera.name], clocks[camera.name], person_height_m, own, given, kept, nobody[camera.name])
        for camera, own in zip(rig, rng.spawn(len(rig)), strict=True)
    ]
    earlier = earlier_tracklets() if earlier is None else earlier
    keys = [job.camera.name for job in jobs]
    return earlier.side_by_side(_prepared, jobs, keys, executor, tell, "tracking in each camera")


@dataclass(frozen=True, eq=False)
class _Job:
    camera: Camera
    seen: CameraObservations
    clock: Clock
    person_height_m: float
    rng: np.random.Generator
    given: bool
    kept: KnownTracklets | None
    not_people: tuple[Sighting, ...]


EarlierTracklets = EarlierResults[_Job, CameraTracklets]
"""Earlier results by the name of the camera."""


def earlier_tracklets() -> EarlierTracklets:
    """Return no tracklets: earlier tracklets exist only after the first estimate."""
    return EarlierTracklets(_same_job)


def _same_job(a: _Job, b: _Job) -> bool:
    """Check whether two jobs of one camera give the same tracklets, for any draws of people for their levels."""
    same_input = a.camera.lens is b.camera.lens and a.seen is b.seen
    settings = [(one.clock, one.person_height_m, one.given, one.not_people) for one in (a, b)]
    return same_input and settings[0] == settings[1]


def _prepared(job: _Job) -> CameraTracklets:
    return build_camera_tracklets(
        job.camera, job.seen, job.clock, job.person_height_m, job.rng, given=job.given, kept=job.kept,
        not_people=job.not_people,
    )  # fmt: skip


def _tracked_or_kept(seen: CameraObservations, fps: float, kept: KnownTracklets | None) -> Tracked:
    """Return the stored tracklets, or those of `_tracked`, which are then stored."""
    found = None if kept is None else kept.load(seen, fps)
    if found is None:
        found = _tracked(seen, fps)
        if kept is not None:
            kept.save(seen, fps, found)
    return found


def _tracked(seen: CameraObservations, fps: float) -> Tracked:
    """Assign boxes and joints to tracklets of one person, or to none; return also the tracklets that continue as others."""
    boxes, joints = seen.boxes, seen.keypoints
    if len(boxes):
        boxes, continued = _tracklets(boxes, fps)
        joints = _joints_of_boxes(joints, boxes) if len(joints) else joints
        return replace(seen, boxes=boxes, keypoints=joints), continued
    extents = _extents(joints)
    found = extents[:, 2] > 0
    made = Boxes(joints.frame[found], joints.identity[found], extents[found], joints.score[found].mean(axis=1))
    made, continued = _tracklets(made, fps)
    identity = np.full(len(joints), UNKNOWN)
    identity[found] = made.identity
    return replace(seen, boxes=boxes, keypoints=replace(joints, identity=identity)), continued


def _tracklets(boxes: Boxes, fps: float) -> tuple[Boxes, tuple[Ints, Ints]]:
    """Number tracklets from 0: the given ones, split where they change person, and those tracked from detections.

    This package's tracker splits its own tracklets. Continuations of given tracklets, which another tracker may have ended
    anywhere, come from links between frames; those of the own tracklets come from whole tracklets (`find_stitches`).
    """
    known = boxes.identity > UNKNOWN
    identity = np.full(len(boxes), UNKNOWN)
    given = boxes.take(known)
    links = find_motion_links(given, fps)
    given = split_tracklets(given, fps, links=links)
    numbers, identity[known] = np.unique(given.identity, return_inverse=True)
    given = replace(given, identity=identity[known])
    continued = find_continuations(given, links)
    if not known.all():
        found = track(boxes.take(~known), fps)
        identity[~known] = np.where(found.identity > UNKNOWN, found.identity + len(numbers), UNKNOWN)
        ends, begins = find_stitches(found, fps, BEYOND_DOUBT)
        continued = np.append(continued[0], ends + len(numbers)), np.append(continued[1], begins + len(numbers))
    return replace(boxes, identity=identity), continued


def _extents(joints: Keypoints) -> Floats:
    """Return the extents (N, 4) of the joints found in each person: left, top, width, height; zeros for fewer than two."""
    found = (joints.score > MIN_JOINT_SCORE)[..., None]
    low = np.where(found, joints.xy, np.inf).min(axis=1, initial=np.inf)
    high = np.where(found, joints.xy, -np.inf).max(axis=1, initial=-np.inf)
    some = (high > low).all(axis=1)
    return np.where(some[:, None], np.column_stack([low, high - low]), 0.0)


def _joints_of_boxes(joints: Keypoints, boxes: Boxes) -> Keypoints:
    """Assign joints to the tracklets of the boxes that they overlap, one to one, with the largest sum of overlaps."""
    identity = np.full(len(joints), UNKNOWN)
    extents = _extents(joints)
    by_frame = np.argsort(boxes.frame, kind="stable")
    frames = boxes.frame[by_frame]
    found = np.flatnonzero(extents[:, 2] > 0)
    found = found[np.argsort(joints.frame[found], kind="stable")]
    for rows in np.split(found, np.flatnonzero(np.diff(joints.frame[found])) + 1):
        if not len(rows):
            continue
        frame = joints.frame[rows[0]]
        own = by_frame[np.searchsorted(frames, frame) : np.searchsorted(frames, frame, side="right")]
        if not len(own):
            continue
        overlap = overlaps(extents[rows], boxes.ltwh[own])
        for i, j in zip(*linear_sum_assignment(-overlap), strict=True):
            if overlap[i, j] > SAME_PERSON_OVERLAP:
                identity[rows[i]] = boxes.identity[own[j]]
    return replace(joints, identity=identity)
