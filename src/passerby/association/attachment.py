"""Registration of a camera that no pair could register, to the rig of the others: by people with known positions.

A pair registration uses only people that both cameras saw, and each camera's first guess of the ground. The rig gives the
positions and the heights of all people, from all of its cameras. One of the camera's tracklets and one known person, at one
clock offset, give a pose (perspective n points, of feet and heads). The pose is taken that explains most samples of the camera,
if it explains at least `LEAST_SHARE` of them and no other pose explains nearly as many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import poselib

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.candidates import Candidates
from passerby.association.sampling import STEP_S, interpolate_samples
from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Pose
from passerby.geometry.groups import rows_of_equal
from passerby.people.level import of_moving_tracklets
from passerby.people.sightings import Sightings

REFINEMENTS = 2
"""Number of times that a pose is computed again from all samples that it explains."""
TOLERANCE = 0.2
"""Largest distance of foot and head from those of the known person, as a share of the body's extent, at which a sample is
explained."""
FEWEST = 6
"""Least number of common samples (half a second each) of a tracklet and a person, from which a pose is computed. With 8, three
rendered rooms (seeds 0 to 2), whose tracklets are short, lost a camera each: this figure was chosen on them."""
LEAST_WAY_M = 1.0
"""Least extent of a person's motion, metres. A person who moves less gives little information on the camera's pose."""
LEAST_SHARE, LEAST_EXPLAINED = 0.5, 16
"""Least share, and least number, of the samples of the camera's walkers while a person is known that a believed pose explains.
Rendered rooms, seeds 901 to 904, and a simulated terrace, seed 3, each camera left out in turn: 0.84 to 1.00 of them, 20 of 20
cameras within 0.34 m. Cameras among the people of another of these scenes: 0.14 to 0.37, 10 of 10."""
LEAST_WAYS = 2
"""Least number of pairs of a tracklet and a person with half of `FEWEST` or more explained samples. One pair alone is explained
by other poses too."""
RUNNER_UP = 0.8
"""Largest share of the best pose's explained samples that another pose may explain: 0.39 to 0.73 for the same cameras, 0.75 to
1.00 among other people, which `LEAST_SHARE` rejects."""
APART_M, APART_RAD, APART_S = 1.0, np.deg2rad(15.0), 0.75
"""Poses, or offsets, that are farther apart than this count as different."""
OFFSET_STEP_S, MOST_OFFSET_S = 0.25, 5.0
"""Step of the offsets that are tried, in which a person walks 0.35 m, and the largest offset."""
MOST_TRACKLETS, MOST_PEOPLE = 8, 12
"""Poses are computed from this number of longest tracklets, each with this number of people with most common samples."""
MOST_COMPARED = 8000
"""Number of pairs of a sample and a person known at its time, of the whole recording, by which a pose is refined. More refine
it no better, and take most of the time on sites. A pose that explains less than half of `LEAST_SHARE` of these is dropped."""

_PINHOLE = {"model": "SIMPLE_PINHOLE", "width": 2, "height": 2, "params": [1.0, 0.0, 0.0]}


@dataclass(frozen=True, eq=False)
class Attached:
    """Pose of a camera by the people of the others."""

    pose: Pose
    offset_s: float
    """Offset to add to the camera's clock, seconds."""
    explained: int
    """Number of samples that the pose explains."""
    share: float
    """The same as a share of all samples while a person is known."""
    runner_up: float
    """Samples that the best other pose explains, as a share of `explained`."""

    @property
    def believed(self) -> bool:
        """Whether the pose is significant."""
        return self.share >= LEAST_SHARE and self.explained >= LEAST_EXPLAINED and self.runner_up < RUNNER_UP


@dataclass(frozen=True, eq=False)
class KnownPeople:
    """Positions of people in a rig: N samples on the time grid, by the rig's clock."""

    step: Ints
    """(N,) the time is `step * STEP_S`."""
    person: Ints
    ground: Floats
    """(N, 2) metres."""
    rate: Floats
    """(N, 2) metres per second."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """M samples of the camera."""

    step: Ints
    """(M,) grid times by the camera's own clock."""
    tracklet: Ints
    top: Floats
    """(M, 2) directions to the highest points, x / z and y / z in the camera's frame."""
    bottom: Floats
    extent: Floats
    """(M,) their distance."""


def known_people(
    cameras: Sequence[CameraTracklets], poses: Sequence[Pose | None], person: Sequence[Ints], offset_s: Floats
) -> KnownPeople:
    """Compute the ground positions of the people that posed cameras see, as the median over cameras.

    Args:
        cameras: their people.
        poses: world z up, ground at z = 0.
        person: for each camera, (tracklets,) the person of each, or -1.
        offset_s: (C,) offset to add to each camera's clock, seconds.
    """
    step, who, places, rates = [], [], [], []
    for camera, pose, own, offset in zip(cameras, poses, person, offset_s.tolist(), strict=True):
        bodies = camera.bodies
        if pose is None or not len(bodies):
            continue
        ray = bodies.bottom @ pose.R_cw
        down = ray[:, 2] < -0.02
        known = down & (bodies.identity >= 0)
        bodies, ray = bodies.take(known), ray[known]
        place = pose.centre[:2] - pose.centre[2] * ray[:, :2] / ray[:, 2:]
        order = np.lexsort((bodies.seconds, bodies.identity))
        found = interpolate_samples(bodies.identity[order], bodies.seconds[order] + offset, place[order])
        step.append(found.step)
        who.append(own[found.tracklet])
        places.append(found.value)
        rates.append(found.rate)
    if not step:
        return KnownPeople(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2)))
    at, whose, place, rate = (np.concatenate(parts) for parts in (step, who, places, rates))
    known = whose >= 0
    keys, owner = np.unique(np.column_stack([at, whose])[known], axis=0, return_inverse=True)
    rows = np.argsort(owner.ravel(), kind="stable")
    groups = np.split(rows, np.flatnonzero(np.diff(owner.ravel()[rows])) + 1)
    place, rate = place[known], rate[known]
    medians = np.array([np.median(place[group], axis=0) for group in groups]).reshape(-1, 2)
    speeds = np.array([np.median(rate[group], axis=0) for group in groups]).reshape(-1, 2)
    return KnownPeople(keys[:, 0], keys[:, 1], medians, speeds)


def attach_cameras(
    cameras: Sequence[CameraTracklets], poses: Sequence[Pose | None], person: Sequence[Ints], offset_s: Floats,
    person_height_m: float, lost: Mapping[int, tuple[float, float]], near: Candidates | None = None,
    executor: Executor | None = None, tell: Progress = silent,
) -> dict[int, Attached]:  # fmt: skip
    """Register cameras by the people of the posed cameras; return the significant results, by number of the camera.

    Args:
        cameras: their people.
        poses: world z up, ground at z = 0; None for cameras without.
        person: for each camera, (tracklets,) the person of each, or -1.
        offset_s: (C,) offset to add to each camera's clock, seconds.
        person_height_m: height of people in the rig, metres.
        lost: the cameras that are tried, by number: range of the search for their clock offset, and its middle, seconds.
        near: the pairs of cameras that may share ground: a camera is tried by the people of these; None: by all.
        executor: tries them side by side; one after the other where it is None.
        tell: called for each camera that was tried.
    """
    if not lost:
        return {}
    numbers, jobs = [], []
    everybody = known_people(cameras, poses, person, offset_s) if near is None else None
    for c, (search_s, around_s) in lost.items():
        people = everybody
        if near is not None:
            posed = [k for k in range(len(cameras)) if poses[k] is not None and (min(c, k), max(c, k)) in near]
            if not posed:
                continue
            own = [cameras[k] for k in posed], [poses[k] for k in posed], [person[k] for k in posed]
            people = known_people(*own, offset_s[posed])
        assert people is not None
        numbers.append(c)
        jobs.append(_Job(cameras[c].bodies, people, person_height_m, search_s, around_s))
    found = side_by_side(_attached, jobs, executor, tell, "placing other cameras by people")
    return {c: one for c, one in zip(numbers, found, strict=True) if one is not None and one.believed}


@dataclass(frozen=True, eq=False)
class _Job:
    bodies: Sightings
    people: KnownPeople
    person_height_m: float
    search_s: float
    around_s: float


def _attached(job: _Job) -> Attached | None:
    return attach_camera(job.bodies, job.people, job.person_height_m, job.search_s, job.around_s)


def attach_camera(
    bodies: Sightings, people: KnownPeople, person_height_m: float, search_s: float, around_s: float = 0.0
) -> Attached | None:
    """Compute the pose of a camera from people with known positions; return None where no pose explains enough.

    Args:
        bodies: sightings of the camera's people.
        people: people of the rig.
        person_height_m: height of people in the rig, metres.
        search_s: range of the search for the clock offset on either side, seconds, up to `MOST_OFFSET_S`.
        around_s: middle of this search, seconds.
    """
    seen = _samples(bodies)
    if len(seen.step) < FEWEST or not len(people.step):
        return None
    found: list[tuple[int, float, float, Pose]] = []
    count = round(min(search_s, MOST_OFFSET_S) / OFFSET_STEP_S)
    for k in sorted(range(-count, count + 1), key=abs):
        found += _at_offset(seen, people, person_height_m, around_s + k * OFFSET_STEP_S)
    if not found:
        return None
    found.sort(key=lambda one: (-one[0], abs(one[2] - around_s)))
    explained, share, offset, pose = found[0]
    rest = [one[0] for one in found[1:] if _other(pose, offset, one[3], one[2])]
    return Attached(pose, offset, explained, share, max(rest, default=0) / max(explained, 1))


def _samples(bodies: Sightings) -> _Seen:
    """Sample the camera's walking people on the grid; only whole bodies in front of the camera are used."""
    own = (bodies.identity >= 0) & (bodies.top[:, 2] > 0.1) & (bodies.bottom[:, 2] > 0.1)
    whole = own & (bodies.top_fraction > 0.8) & (bodies.bottom_fraction < 0.2)
    bodies = bodies.take(whole & of_moving_tracklets(bodies))
    order = np.lexsort((bodies.seconds, bodies.identity))
    top, bottom = (ray[order, :2] / ray[order, 2:] for ray in (bodies.top, bodies.bottom))
    found = interpolate_samples(bodies.identity[order], bodies.seconds[order], np.column_stack([top, bottom]))
    top, bottom = found.value[:, :2], found.value[:, 2:]
    return _Seen(found.step, found.tracklet, top, bottom, np.linalg.norm(bottom - top, axis=1))


def _at_offset(seen: _Seen, people: KnownPeople, height_m: float, offset: float) -> list[tuple[int, float, float, Pose]]:
    """Compute the poses at one offset, each from a tracklet and a person, as (explained, share, offset, pose)."""
    late = round(offset / STEP_S)
    i, j = rows_of_equal(seen.step + late, people.step)
    if len(i) < FEWEST:
        return []
    # The person's position at the exact time of the sample.
    ground = people.ground[j] + people.rate[j] * (offset - late * STEP_S)
    feet = np.column_stack([ground, np.zeros(len(i))])
    heads = feet + [0.0, 0.0, height_m]
    pair = seen.tracklet[i] * (int(people.person.max()) + 1) + people.person[j]
    anybody = len(np.unique(i))
    every = -(-len(i) // MOST_COMPARED)
    part = np.flatnonzero(i % every == 0)
    i_part, feet_part, heads_part = i[part], feet[part], heads[part]
    least = 0.0 if every == 1 else 0.5 * LEAST_SHARE * len(np.unique(i_part))
    found = []
    for rows in _longest(seen.tracklet[i], pair):
        if np.linalg.norm(np.ptp(ground[rows], axis=0)) < LEAST_WAY_M:
            continue
        pose = _pose(seen, i[rows], feet[rows], heads[rows])
        for _ in range(REFINEMENTS):
            if pose is None:
                break
            rows = part[_misses(pose, seen, i_part, feet_part, heads_part) < TOLERANCE]
            pose = _pose(seen, i[rows], feet[rows], heads[rows]) if len(rows) >= FEWEST and len(rows) >= least else None
        if pose is None:
            continue
        explained, ways = _explained(_misses(pose, seen, i, feet, heads) < TOLERANCE, i, pair)
        if ways >= LEAST_WAYS:
            found.append((explained, explained / anybody, offset, pose))
    return found


def _longest(tracklet: Ints, pair: Ints) -> list[Ints]:
    """Return the rows of each pair of a long tracklet and a person that has `FEWEST` rows or more."""
    numbers, count = np.unique(tracklet, return_counts=True)
    wanted = numbers[np.argsort(-count, kind="stable")[:MOST_TRACKLETS]]
    found = []
    for number in wanted.tolist():
        rows = np.flatnonzero(tracklet == number)
        pairs, count = np.unique(pair[rows], return_counts=True)
        order = np.argsort(-count, kind="stable")[:MOST_PEOPLE]
        found += [rows[pair[rows] == pairs[k]] for k in order.tolist() if count[k] >= FEWEST]
    return found


def _pose(seen: _Seen, rows: Ints, feet: Floats, heads: Floats) -> Pose | None:
    """Estimate the pose from feet and heads by RANSAC; None for too few inliers, or a camera on its side or in the ground."""
    size = float(np.median(seen.extent[rows]))
    options = {"max_reproj_error": TOLERANCE * size, "max_iterations": 200, "min_iterations": 20, "seed": 0}
    points = np.concatenate([seen.bottom[rows], seen.top[rows]])
    found, said = poselib.estimate_absolute_pose(points, np.concatenate([feet, heads]), _PINHOLE, options, {})
    if said["num_inliers"] < 1.2 * len(rows):
        return None
    pose = Pose(np.asarray(found.R), np.asarray(found.t))
    upright = pose.R_cw[1, 2] < -0.5
    return pose if upright and 0.3 < pose.centre[2] < 100.0 else None


def _misses(pose: Pose, seen: _Seen, i: Ints, feet: Floats, heads: Floats) -> Floats:
    """Return the larger reprojection error (K,) of foot and head under a pose, as a share of the body's extent."""
    off = np.zeros(len(i))
    for points, at in ((feet, seen.bottom[i]), (heads, seen.top[i])):
        local = points @ pose.R_cw.T + pose.t_cw
        depth = local[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            miss = np.linalg.norm(local[:, :2] / depth[:, None] - at, axis=1) / seen.extent[i]
        off = np.maximum(off, np.where(depth > 0.1, miss, np.inf))
    return off


def _explained(good: Bools, i: Ints, pair: Ints) -> tuple[int, int]:
    """Count the samples explained by any person, and the pairs of a tracklet and a person with half of `FEWEST` or more."""
    _, count = np.unique(pair[good], return_counts=True)
    return len(np.unique(i[good])), int((count >= FEWEST // 2).sum())


def _other(pose: Pose, offset: float, second: Pose, second_offset: float) -> bool:
    """Check whether two poses, or their offsets, differ."""
    turn = np.arccos(np.clip((np.trace(pose.R_cw @ second.R_cw.T) - 1) / 2, -1, 1))
    apart = float(np.linalg.norm(pose.centre - second.centre))
    return apart > APART_M or turn > APART_RAD or abs(offset - second_offset) > APART_S
