"""A camera that no pair of cameras could register, registered to the rig of the others: to people whose place it knows.

A pair of cameras shares what both saw at the same time, each by its own first guess of the ground. The rig knows where
everybody was, all cameras together, and how tall. One of the camera's tracklets and one known person, at one clock offset, make
a pose (perspective n points, of feet and heads); the pose that explains most of all that the camera saw is the one, if it
explains most of it, and no other pose explains nearly as much.
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
"""Times that a pose is made anew of all that it explains."""
TOLERANCE = 0.2
"""A person is explained where foot and head are seen within so much of the body's extent from where the known person's are."""
FEWEST = 6
"""Samples (half a second each) of a tracklet and a person at one time, from which a pose is computed. With 8, three rendered
rooms (seeds 0 to 2), whose tracklets are short, lost a camera each: this figure was chosen on them."""
LEAST_WAY_M = 1.0
"""A person who moves less says little about where the camera is."""
LEAST_SHARE, LEAST_EXPLAINED = 0.5, 16
"""Of the samples of the camera's walkers while a person is known, and in number: those that a believed pose explains.
Rendered rooms, seeds 901 to 904, and a simulated terrace, seed 3, each camera left out in turn: 0.84 to 1.00 of them, 20 of 20
cameras within 0.34 m. Cameras among the people of another of these scenes: 0.14 to 0.37, 10 of 10."""
LEAST_WAYS = 2
"""Pairs of a tracklet and a person of which it explains half of `FEWEST` or more: one alone fits in other ways too."""
RUNNER_UP = 0.8
"""Another pose must explain less than this share of what the best one does: 0.39 to 0.73 for the same cameras, 0.75 to 1.00
among other people, whom the share above keeps out."""
APART_M, APART_RAD, APART_S = 1.0, np.deg2rad(15.0), 0.75
"""Poses, and offsets, that are farther apart are others."""
OFFSET_STEP_S, MOST_OFFSET_S = 0.25, 5.0
"""Steps of the offsets that are tried: a person walks 0.35 m in one. And how far they go."""
MOST_TRACKLETS, MOST_PEOPLE = 8, 12
"""The longest tracklets, and of each the people with most common samples, of which poses are made."""
MOST_COMPARED = 8000
"""Samples together with people known at their time by which a pose is refined, of all of the recording: more refine it no
better, and take most of the time on sites. A pose that explains less than half of `LEAST_SHARE` of these is not looked at
further."""

_PINHOLE = {"model": "SIMPLE_PINHOLE", "width": 2, "height": 2, "params": [1.0, 0.0, 0.0]}


@dataclass(frozen=True, eq=False)
class Attached:
    """Where a camera stands by the people of the others."""

    pose: Pose
    offset_s: float
    """What to add to the camera's clock."""
    explained: int
    """Samples that the pose explains,"""
    share: float
    """of all while a person is known, as a share."""
    runner_up: float
    """What the best other pose explains, as a share of that."""

    @property
    def believed(self) -> bool:
        """Whether it is significant."""
        return self.share >= LEAST_SHARE and self.explained >= LEAST_EXPLAINED and self.runner_up < RUNNER_UP


@dataclass(frozen=True, eq=False)
class KnownPeople:
    """Where people were, by a rig: N samples on the grid of time, by its clock."""

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
    """By the camera's own clock."""
    tracklet: Ints
    top: Floats
    """(M, 2) directions to the highest points, x / z and y / z in the camera's frame."""
    bottom: Floats
    extent: Floats
    """(M,) their distance."""


def known_people(
    cameras: Sequence[CameraTracklets], poses: Sequence[Pose | None], person: Sequence[Ints], offset_s: Floats
) -> KnownPeople:
    """The ground positions of the people whom posed cameras see: of several cameras the median.

    Args:
        cameras: their people.
        poses: world z up, ground at z = 0.
        person: of each camera, (tracklets,) the person of each, or -1.
        offset_s: (C,) what to add to each camera's clock.
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
    """The cameras that the people of the posed ones place significantly, by number.

    Args:
        cameras: their people.
        poses: world z up, ground at z = 0; None for cameras without.
        person: of each camera, (tracklets,) the person of each, or -1.
        offset_s: (C,) what to add to each camera's clock.
        person_height_m: how tall people are by the rig, metres.
        lost: the cameras that are tried: how far their clock offset is searched, and around which.
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
    """The pose of a camera by people whose places are known; None where none explains anything.

    Args:
        bodies: of the camera's people.
        people: of the rig.
        person_height_m: how tall people are by the rig, metres.
        search_s: how far the offset of the camera's clock is searched, on either side, up to `MOST_OFFSET_S`.
        around_s: of this offset.
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
    """The camera's people on the grid, those in front of it."""
    own = (bodies.identity >= 0) & (bodies.top[:, 2] > 0.1) & (bodies.bottom[:, 2] > 0.1)
    whole = own & (bodies.top_fraction > 0.8) & (bodies.bottom_fraction < 0.2)
    bodies = bodies.take(whole & of_moving_tracklets(bodies))
    order = np.lexsort((bodies.seconds, bodies.identity))
    top, bottom = (ray[order, :2] / ray[order, 2:] for ray in (bodies.top, bodies.bottom))
    found = interpolate_samples(bodies.identity[order], bodies.seconds[order], np.column_stack([top, bottom]))
    top, bottom = found.value[:, :2], found.value[:, 2:]
    return _Seen(found.step, found.tracklet, top, bottom, np.linalg.norm(bottom - top, axis=1))


def _at_offset(seen: _Seen, people: KnownPeople, height_m: float, offset: float) -> list[tuple[int, float, float, Pose]]:
    """(explained, share, offset, pose) of the poses that one offset allows, each by a tracklet and a person."""
    late = round(offset / STEP_S)
    i, j = rows_of_equal(seen.step + late, people.step)
    if len(i) < FEWEST:
        return []
    # The person's place at the sample's very time.
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
    """The rows of those pairs of a tracklet and a person that have `FEWEST` or more, of the longest tracklets."""
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
    """The pose that sees most of these feet and heads where they are; None for one that lies on its side, or in the ground."""
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
    """(K,) how far a foot or a head is seen from where the pose says, the farther one, as a share of the body's extent."""
    off = np.zeros(len(i))
    for points, at in ((feet, seen.bottom[i]), (heads, seen.top[i])):
        local = points @ pose.R_cw.T + pose.t_cw
        depth = local[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            miss = np.linalg.norm(local[:, :2] / depth[:, None] - at, axis=1) / seen.extent[i]
        off = np.maximum(off, np.where(depth > 0.1, miss, np.inf))
    return off


def _explained(good: Bools, i: Ints, pair: Ints) -> tuple[int, int]:
    """How many samples are explained by anybody, and how many pairs of a tracklet and a person by `FEWEST` or more."""
    _, count = np.unique(pair[good], return_counts=True)
    return len(np.unique(i[good])), int((count >= FEWEST // 2).sum())


def _other(pose: Pose, offset: float, second: Pose, second_offset: float) -> bool:
    """Whether two poses, or their offsets, are not about the same."""
    turn = np.arccos(np.clip((np.trace(pose.R_cw @ second.R_cw.T) - 1) / 2, -1, 1))
    apart = float(np.linalg.norm(pose.centre - second.centre))
    return apart > APART_M or turn > APART_RAD or abs(offset - second_offset) > APART_S
