"""The cameras of a site: neighbours, identities over the cameras, and the test of each camera with its neighbours.

Neighbours are cameras that may share people: by their poses, they see ground in common. Walls are not known, so that neighbours
may share no people. The work is proportional to the number of cameras, not to that of their pairs.

If no identities are stated, tracklets that meet in space are joined, as in a calibration (`association.associate`), but with
poses that are known from the beginning. With a camera that has moved by a few degrees, a person is still nearer to its position
by the other cameras than to that of another person.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.association.associate import Tracklets, cluster_by_rig
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.graph import ViewGraph
from passerby.common.arrays import Floats, Ints
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Clock, Keypoints, Observations, once_in_frame
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.core.synchronisation import resample_to_common_steps
from passerby.monitoring.neighbourhoods import Site, watch_neighbourhoods
from passerby.monitoring.watched import Watched, WatchOptions
from passerby.people.ground import rough_height
from passerby.people.sightings import gather_sightings

MANY = 12
"""Up to this number, all cameras are tested together, with the observations of all."""
CELL_M = 1.0
RANGE_M = 40.0
LEAST_PX = 25.0
"""Height of a person in the image, pixels, below which no person is detected."""
SAME_RAY = 1e-3
"""Largest difference between the ray of a point and that of its pixel. Beyond the border of its range, a distortion model is
not unique: a pixel with another ray shows something else."""
LEAST_SHARED = 5
"""Least number of cells that neighbours have in common: on less ground almost no person walks."""
SAME_FLOOR_M = 1.5
"""Two cameras whose ground differs by more in height, metres, stand on different floors."""
MOST_NEIGHBOURS = 12
"""Largest number of neighbours of a camera: those with most ground in common, as many as a calibration registers it with."""
Pairs = frozenset[tuple[int, int]]
"""Indices of two cameras in a rig, a < b."""
SEED = 0
"""Seed of the sample of people that determine each camera's vertical without known identities."""


@dataclass(frozen=True, eq=False)
class CamerasOfSite:
    """Cameras, their observations, and the pairs of them that are compared."""

    rig: Rig
    """The cameras, with poses."""
    observations: Observations
    """Observations of these cameras, with a clock for each."""
    height_m: Mapping[str, float]
    """Approximate height of the ground, metres, by camera that saw a person."""
    pairs: Pairs
    """The neighbours; no other pairs are compared."""

    @classmethod
    def of(cls, rig: Rig, observations: Observations) -> CamerasOfSite:
        """Find the neighbours by poses, and by the height of the ground on which each camera's people stand."""
        # Each height is by one camera's people alone: each floor of a building has its own ground.
        heights = {
            camera.name: rough_height(Rig((camera,)), observations) for camera in rig if _sees_ground(observations[camera.name])
        }
        return cls(rig, observations, heights, neighbours_by_rig(rig, heights))

    @property
    def pairs_by_name(self) -> list[tuple[str, str]]:
        """The pairs, in the order of the rig."""
        names = self.rig.names
        return [(names[a], names[b]) for a, b in sorted(self.pairs)]


def _sees_ground(seen: CameraObservations) -> bool:
    return len(seen.boxes) > 0 or len(seen.keypoints) > 0


def watch_site(
    cameras: CamerasOfSite, options: WatchOptions, *, known: bool, tell: Progress = silent, executor: Executor | None = None
) -> Watched:
    """Test the cameras of a rig of many cameras with footage.

    Args:
        cameras: the cameras to test.
        options: see `WatchOptions`.
        known: whether identities hold over all cameras; else they are each camera's own tracklets, or -1 for detections.
        tell: called with each stage.
        executor: processes cameras in parallel.
    """
    # The systems are small, and the number of BLAS threads would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        sites = [_site(cameras, part, known, tell, executor) for part in connect_cameras(cameras.pairs, len(cameras.rig))]
        span = _span(cameras.observations)
        return watch_neighbourhoods(sites, cameras.rig.names, options, span, tell=tell, executor=executor)


def _site(cameras: CamerasOfSite, numbers: list[int], known: bool, tell: Progress, executor: Executor | None) -> Site:
    """Return some of the cameras, with identities that hold over them."""
    seen, rig = cameras.observations, Rig(tuple(cameras.rig.cameras[k] for k in numbers))
    clocks = {name: seen.clocks[name] for name in rig.names}
    own = Observations({name: seen[name] for name in rig.names}, seen.fps, clocks)
    height = float(np.median([cameras.height_m[name] for name in rig.names]))
    if not known:
        place = {k: index for index, k in enumerate(numbers)}
        near = frozenset((place[a], place[b]) for a, b in cameras.pairs if a in place)
        tell("associating identities")
        rng = np.random.default_rng(SEED)
        own = identify_by_rig(rig, own, clocks, rng, ground_m=height, executor=executor, tell=tell, candidates=near)
    at_steps = resample_to_common_steps(own, clocks, sizes={camera.name: camera.lens.size for camera in rig})
    return Site(rig, at_steps, gather_sightings(rig, at_steps), height)


def _span(observations: Observations) -> tuple[float, float]:
    """Return the first time at which a person was seen and the time just after the last, seconds; zeros without people."""
    ends: list[Floats] = []
    for name, seen in observations.cameras.items():
        frames = np.concatenate([seen.boxes.frame, seen.keypoints.frame])
        if len(frames):
            ends.append(observations.clocks[name].seconds(np.array([frames.min(), frames.max()])))
    if not ends:
        return 0.0, 0.0
    return float(np.min(ends)), float(np.max(ends)) + 1e-6


def neighbours_by_rig(rig: Rig, ground_m: Mapping[str, float]) -> Pairs:
    """Find the pairs of cameras that share ground.

    Args:
        rig: cameras with poses.
        ground_m: height of the ground at each camera, metres; a camera that is not in it has no neighbours.
    """
    owners: dict[tuple[int, int], list[int]] = {}
    for number, camera in enumerate(rig):
        if camera.name in ground_m:
            for x, y in _cells_seen(camera, ground_m[camera.name]).tolist():
                owners.setdefault((x, y), []).append(number)
    height = [ground_m.get(name, np.nan) for name in rig.names]
    shared: list[dict[int, int]] = [{} for _ in height]
    for cameras in owners.values():
        for a in cameras:
            for b in cameras:
                if a != b and abs(height[a] - height[b]) <= SAME_FLOOR_M:
                    shared[a][b] = shared[a].get(b, 0) + 1
    found = set()
    for a, counts in enumerate(shared):
        enough = [b for b, count in counts.items() if count >= LEAST_SHARED]
        for b in sorted(enough, key=lambda b: (-counts[b], b))[:MOST_NEIGHBOURS]:
            found.add((min(a, b), max(a, b)))
    return frozenset(found)


def connect_cameras(pairs: Pairs, n: int) -> list[list[int]]:
    """Return the sets of cameras 0 to n - 1 that pairs connect, each ascending; cameras without a neighbour are in none."""
    beside: list[list[int]] = [[] for _ in range(n)]
    for a, b in sorted(pairs):
        beside[a].append(b)
        beside[b].append(a)
    found, seen = [], set[int]()
    for start in range(n):
        if start in seen or not beside[start]:
            continue
        seen.add(start)
        part = [start]
        for camera in part:
            part += [new for new in beside[camera] if new not in seen]
            seen.update(beside[camera])
        found.append(sorted(part))
    return found


def _cells_seen(camera: Camera, ground_m: float) -> Ints:
    """Return the indices (N, 2) of the cells of ground on which a standing person is whole in the image and tall enough."""
    assert camera.pose is not None
    middle = np.floor(camera.pose.centre[:2] / CELL_M)
    reach = np.arange(-RANGE_M // CELL_M, RANGE_M // CELL_M + 1)
    cells = middle + np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
    place = (cells + 0.5) * CELL_M
    away = np.linalg.norm(place - camera.pose.centre[:2], axis=1)
    cells, place = cells[away <= RANGE_M], place[away <= RANGE_M]
    ends = [
        _project_visible(camera, np.column_stack([place, np.full(len(place), ground_m + up)])) for up in (0.0, PERSON_HEIGHT_M)
    ]
    # A height is NaN if an end is not in the image; then the comparison is false.
    tall = np.linalg.norm(ends[0] - ends[1], axis=1) >= LEAST_PX
    return np.asarray(cells[tall], dtype=np.int64)


def _project_visible(camera: Camera, points: Floats) -> Floats:
    """Project points (N, 3) of the world to pixels (N, 2); NaN where they are not in the image."""
    assert camera.pose is not None
    own = points @ camera.pose.R_cw.T + camera.pose.t_cw
    pixel = camera.lens.project_rays(own)
    inside = ((pixel >= 0) & (pixel <= np.array(camera.lens.size))).all(axis=1)
    ray = np.full_like(own, np.nan)
    ray[inside] = camera.lens.bearings(pixel[inside])
    with np.errstate(invalid="ignore"):
        same = np.linalg.norm(ray - own / np.linalg.norm(own, axis=1, keepdims=True), axis=1) < SAME_RAY
    return np.where((inside & same)[:, None], pixel, np.nan)


def identify_by_rig(
    rig: Rig, observations: Observations, clocks: Mapping[str, Clock], rng: np.random.Generator, *, ground_m: float = 0.0,
    executor: Executor | None = None, tell: Progress = silent, candidates: Container[tuple[int, int]] | None = None,
) -> Observations:  # fmt: skip
    """Find identities over all cameras, and return the observations with them, in each camera's own frames.

    Args:
        rig: cameras with poses.
        observations: identities are each camera's own tracklets, or -1 for detections.
        clocks: clock of every camera.
        rng: random numbers to sample the people to whom each camera's vertical is fitted.
        ground_m: height of the ground, metres.
        executor: processes cameras in parallel.
        tell: called for every camera that is done.
        candidates: the pairs of cameras, a < b by their indices in the rig, that are compared; None: all.
    """
    level = rig.moved(np.eye(3), np.array([0.0, 0.0, -ground_m]))
    cameras = build_tracklets(level, observations, clocks, PERSON_HEIGHT_M, rng, executor, tell=tell)
    tracklets = Tracklets.of(cameras)
    offsets = np.array([clocks[camera.name].offset_s for camera in level])
    # The cameras' own times already include their offsets.
    nothing = ViewGraph((), (), np.zeros_like(offsets))
    person = cluster_by_rig(
        tracklets, cameras, nothing, [camera.pose for camera in level], np.zeros_like(offsets), PERSON_HEIGHT_M,
        candidates=candidates,
    )  # fmt: skip
    return Observations({
        camera.name: _name_people(camera, person[low:high])
        for camera, low, high in zip(cameras, tracklets.first[:-1], tracklets.first[1:], strict=True)
    }, observations.fps, dict(clocks))  # fmt: skip


def _name_people(camera: CameraTracklets, person: Ints) -> CameraObservations:
    """Return a camera's observations with identities from 1; `person` (T,) has the person of each tracklet, from 0."""
    boxes, joints = (_rename_rows(part, person) for part in (camera.seen.boxes, camera.seen.keypoints))
    assert isinstance(boxes, Boxes)
    assert isinstance(joints, Keypoints)
    return CameraObservations(boxes, joints)


def _rename_rows(part: Boxes | Keypoints, person: Ints) -> Boxes | Keypoints:
    """Replace tracklets by people, each once in a frame: of two rows of a person, that of the longer tracklet is kept."""
    rows = np.flatnonzero(part.identity > UNKNOWN)
    tracklet = part.identity[rows]
    who = person[tracklet] + 1
    length = np.bincount(tracklet, minlength=1)[tracklet]
    kept = once_in_frame(part.frame[rows], who, -length)
    found = part.take(rows[kept])
    return replace(found, identity=who[kept])
