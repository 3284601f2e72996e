"""A crowd that passes through a place for an hour, seen by cameras that start minutes apart: boxes of upright people only.

`scene.simulate` simulates bodies with joints that all stay in one area, for clocks some seconds apart. Here people come and go,
and much of their path is outside the common area. An hour is simulated in seconds, because a person is only an upright segment
with a width.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.simulation.lenses import looking_at

PICTURE = (1280, 720)
PLACE_M = 36.0
"""Side of the square that people cross; each camera sees a part of it."""
RADIUS_M, CAMERA_HEIGHT_M, FIELD_OF_VIEW_DEG = 13.0, 4.0, (55.0, 75.0)
AIM_M = 3.0
"""Largest distance, along x and y, between the middle of the place and the point that a camera looks at."""
HALF_WIDTH_M = 0.25
SPEED_MS, STOP_S, STOPS = (0.8, 1.7), (3.0, 40.0), (0, 3)
BOX_NOISE = 0.015
"""Standard deviation of a box's four edges, as a share of its height."""
RETURN_S = 2.0
"""A person who is not seen for longer gets a new tracklet in the camera."""
STEP_S = 0.1


@dataclass(frozen=True)
class CrowdOptions:
    """Options of `simulate_crowd`."""

    seed: int
    starts_s: tuple[float, ...] = (0.0, 1200.0, 600.0)
    """Start of each camera's recording, seconds."""
    seconds: float = 2400.0
    """Length of each camera's recording."""
    fps: float = 2.5
    per_minute: float = 6.0
    """Mean number of people who enter per minute."""
    missing: float = 0.1
    """Share of the boxes that are missing."""
    identities_known: bool = False
    """Whether the same number is the same person in all cameras; otherwise each camera numbers its tracklets on its own."""
    strangers: tuple[int, ...] = ()
    """Indices, from 0, of cameras that stand at a similar place elsewhere and see other people."""

    def __post_init__(self) -> None:
        """Raise `InputError` for no camera, no time or no people."""
        if not self.starts_s or min(self.seconds, self.fps, self.per_minute) <= 0 or not 0 <= self.missing < 1:
            raise InputError("a crowd needs starts_s, seconds, fps and per_minute above 0, and missing from 0 to below 1")


@dataclass(frozen=True, eq=False)
class PassingCrowd:
    """Observations of the cameras, and the truth."""

    rig: Rig
    """The true cameras."""
    observations: Observations
    """Boxes, with frames counted from 1 by each camera's own clock; clocks have rates, but no offsets."""
    starts_s: tuple[float, ...]
    """Start of each recording, seconds: the time offsets of the clocks."""


@dataclass(frozen=True, eq=False)
class _Walk:
    """Path of one person."""

    seconds: Floats
    """(K,) times, `STEP_S` apart."""
    ground: Floats
    """(K, 2) positions on the ground, metres."""
    height: float


def simulate_crowd(options: CrowdOptions) -> PassingCrowd:
    """Simulate people who cross a place, and the boxes that the cameras around it report."""
    place, elsewhere, aims, boxes = np.random.default_rng((options.seed, 41)).spawn(4)
    begin, end = min(options.starts_s), max(options.starts_s) + options.seconds
    crowds = [_draw_walks(options.per_minute, begin, end, rng) for rng in (place, elsewhere)]
    rig = Rig(tuple(_camera(c, len(options.starts_s), rng) for c, rng in enumerate(aims.spawn(len(options.starts_s)))))
    seen = {
        camera.name: _observe_crowd(camera, crowds[c in options.strangers], start, options, rng)
        for c, (camera, start, rng) in enumerate(zip(rig, options.starts_s, boxes.spawn(len(rig)), strict=True))
    }
    clocks = {camera.name: Clock(options.fps) for camera in rig}
    return PassingCrowd(rig, Observations(seen, options.fps, clocks), options.starts_s)


def _draw_walks(per_minute: float, begin: float, end: float, rng: np.random.Generator) -> list[_Walk]:
    """Draw the paths of people who enter as a Poisson process, from a minute before the first recording."""
    begin -= 60.0
    arrivals = np.sort(rng.uniform(begin, end, rng.poisson(per_minute * (end - begin) / 60.0)))
    return [_walk(float(at), own) for at, own in zip(arrivals, rng.spawn(len(arrivals)), strict=True)]


def _walk(at: float, rng: np.random.Generator) -> _Walk:
    """Draw a path from one edge of the place to another, through some points and with stops; it starts at time `at`."""
    half = 0.5 * PLACE_M
    ends = [np.array([rng.uniform(-half, half), half]) @ _quarter(int(side)) for side in rng.choice(4, 2, replace=False)]
    between = rng.uniform(-0.6 * half, 0.6 * half, (int(rng.integers(*STOPS)), 2))
    points = [ends[0], *between, ends[1]]
    times, ground, speed = [at], [points[0]], rng.uniform(*SPEED_MS)
    for number, point in enumerate(points[1:], start=1):
        times.append(times[-1] + float(np.linalg.norm(point - ground[-1])) / speed)
        ground.append(point)
        if number < len(points) - 1 and rng.uniform() < 0.5:
            times.append(times[-1] + rng.uniform(*STOP_S))
            ground.append(point)
    seconds = np.arange(times[0], times[-1], STEP_S)
    xy = np.array(ground)
    path = np.column_stack([np.interp(seconds, times, xy[:, axis]) for axis in range(2)])
    return _Walk(seconds, path, float(rng.normal(PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M)))


def _quarter(turns: int) -> Floats:
    """Return the rotation (2, 2) by a number of quarter turns."""
    return np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turns)


def _camera(number: int, count: int, rng: np.random.Generator) -> Camera:
    """Draw a camera on a circle around the middle of the place; it looks at its own point near the middle."""
    angle = 2 * np.pi * (number / count + rng.uniform(-0.06, 0.06))
    centre = np.array([RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), CAMERA_HEIGHT_M + rng.uniform(-0.5, 0.5)])
    aim = np.array([*rng.uniform(-AIM_M, AIM_M, 2), 0.8])
    focal = 0.5 * PICTURE[0] / np.tan(0.5 * np.radians(rng.uniform(*FIELD_OF_VIEW_DEG)))
    lens = Lens(PICTURE, np.array([[focal, 0.0, PICTURE[0] / 2], [0.0, focal, PICTURE[1] / 2], [0.0, 0.0, 1.0]]), np.zeros(4))
    return Camera(f"C{number + 1}", lens, Pose.from_centre(looking_at(centre, aim), centre))


def _observe_crowd(
    camera: Camera, walks: Sequence[_Walk], start: float, options: CrowdOptions, rng: np.random.Generator
) -> CameraObservations:
    """Return the boxes, with noise, of people who are whole in the image."""
    frames = np.arange(1, round(options.seconds * options.fps) + 1)
    times = start + (frames - 1) / options.fps
    person, frame, ltwh = [], [], []
    for number, walk in enumerate(walks):
        low, high = np.searchsorted(times, [walk.seconds[0], walk.seconds[-1]])
        if low == high:
            continue
        at = np.column_stack([np.interp(times[low:high], walk.seconds, walk.ground[:, axis]) for axis in range(2)])
        box = _boxes(camera, at, walk.height)
        keep = _find_whole(box) & (rng.uniform(size=len(box)) >= options.missing)
        person.append(np.full(np.count_nonzero(keep), number))
        frame.append(frames[low:high][keep])
        ltwh.append(box[keep])
    who, when, where = np.concatenate(person), np.concatenate(frame), np.concatenate(ltwh)
    edges = where[:, 3:] * BOX_NOISE * rng.standard_normal(where.shape)
    where = np.column_stack([where[:, :2] + edges[:, :2], where[:, 2:] + edges[:, 2:] - edges[:, :2]])
    if not options.identities_known:
        who = _tracklets(who, when, options.fps)
    order = np.lexsort((who, when))
    return CameraObservations(Boxes(when[order], who[order], where[order], np.ones(len(order))))


def _boxes(camera: Camera, ground: Floats, height: float) -> Floats:
    """Compute left, top, width, height (N, 4) of people at places (N, 2); NaN behind the camera."""
    foot = np.column_stack([ground, np.zeros(len(ground))])
    feet, head = camera.project(foot), camera.project(foot + np.array([0.0, 0.0, height]))
    assert camera.pose is not None
    depth = (foot @ camera.pose.R_cw.T + camera.pose.t_cw)[:, 2]
    half = camera.lens.focal * HALF_WIDTH_M / np.maximum(depth, 0.5)
    left, right = np.minimum(feet[:, 0], head[:, 0]) - half, np.maximum(feet[:, 0], head[:, 0]) + half
    return np.column_stack([left, head[:, 1], right - left, feet[:, 1] - head[:, 1]])


def _find_whole(box: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return whether boxes are inside the image and large enough for a detector, (N,)."""
    first, last = box[:, :2], box[:, :2] + box[:, 2:]
    return np.asarray((first > 2).all(axis=1) & (last < np.array(PICTURE) - 2).all(axis=1) & (box[:, 3] > 40))


def _tracklets(who: Ints, frame: Ints, fps: float) -> Ints:
    """Return tracklet numbers (N,); a gap over `RETURN_S` starts a new one. Rows are sorted by person, then by frame."""
    new = (np.diff(who) != 0) | (np.diff(frame) > RETURN_S * fps)
    return np.concatenate([[0], np.cumsum(new)]).astype(np.int64)
