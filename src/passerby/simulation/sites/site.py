"""A simulated site: its truth, and what each of its cameras reports, one camera at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations
from passerby.simulation.appearance import box_embeddings, people_looks
from passerby.simulation.body import BodyState, pose_joints
from passerby.simulation.detect import Detected, detect
from passerby.simulation.lenses import draw_lenses
from passerby.simulation.observe import observe_camera
from passerby.simulation.placement import AIM_HEIGHT_M, looking_at
from passerby.simulation.sites.lens import QuickLens
from passerby.simulation.sites.options import SiteOptions
from passerby.simulation.sites.plan import SitePlan, airport
from passerby.simulation.sites.sight import RANGE_M, Sight, shared_ground, sight_of
from passerby.simulation.sites.walkers import NOWHERE, Walkers, walk
from passerby.simulation.tracklets import number_tracklets

PICTURE = (1280, 720)
HEIGHT_JITTER_M, ROLL_DEG = 0.2, 2.0
CHUNK_FRAMES = 25
"""So many time steps of a camera are computed at once: few enough that most people near it are near it throughout."""
BUCKET_M, BUCKET_S = 12.0, 1.0
"""People are found by where they are, to so many metres, every second."""


@dataclass(frozen=True, eq=False)
class SiteCamera:
    """What one camera reports, and whom its boxes really show."""

    name: str
    seen: CameraObservations
    """Identities are tracklet numbers of this camera; without joints."""
    true_identity: Ints
    """(N,) of the boxes' rows, from 1; -1 for a box without a person."""

    @property
    def truth(self) -> Boxes:
        """The boxes of people with their true identities."""
        return replace(self.seen.boxes, identity=self.true_identity).take(self.true_identity != UNKNOWN)


@dataclass(frozen=True, eq=False)
class Site:
    """The truth of a site. World z up; each floor is a plane at its own height; metres."""

    options: SiteOptions
    plan: SitePlan
    rig: Rig
    """The true cameras, C1 and up, with poses."""
    walkers: Walkers
    """People 0, 1, ...; their identities are 1, 2, ..."""
    sights: tuple[Sight, ...]
    clock_offsets_s: Floats
    """(C,) frame f of a camera shows the world at (f - 1) / fps + offset."""

    @cached_property
    def shared_m2(self) -> dict[tuple[int, int], float]:
        """Pairs of cameras, a < b, that see ground in common, and how much, square metres."""
        return shared_ground(self.sights)

    def cameras(self) -> Iterator[SiteCamera]:
        """What the cameras report, one after the other: nothing of a camera is kept when the next begins."""
        for index in range(len(self.rig)):
            yield self.camera(index)

    def camera(self, index: int) -> SiteCamera:
        """What one camera reports; the same whether or not others were asked before."""
        options, name = self.options, self.rig.names[index]
        times = np.arange(options.n_frames) / options.fps + self.clock_offsets_s[index]
        parts = [
            part
            for number, start in enumerate(range(0, options.n_frames, CHUNK_FRAMES))
            if (part := self._chunk(index, start, times[start : start + CHUNK_FRAMES], options.rng(5, index, number)))
        ]
        boxes = _joined([part.seen.boxes for part in parts])
        true_identity = np.concatenate([np.zeros(0, dtype=np.int64), *(part.true_identity for part in parts)])
        people, local = np.unique(true_identity[true_identity != UNKNOWN], return_inverse=True)
        own = np.full(len(boxes), UNKNOWN)
        own[true_identity != UNKNOWN] = local + 1
        shown = self._local(boxes.identity, people)
        boxes = replace(boxes, identity=shown)
        number = number_tracklets(boxes, len(people), options.fps, options.tracklet_seconds, options.rng(6, index))
        seen = CameraObservations(replace(boxes, identity=number))
        if options.embeddings != "none":
            looks = self._appearance[people - 1] if options.embeddings == "distinct" else None
            vectors = box_embeddings(own, looks, options.rng(7, index))
            seen = replace(seen, boxes=replace(seen.boxes, embedding=vectors))
        return SiteCamera(name, seen, true_identity)

    def _local(self, identity: Ints, people: Ints) -> Ints:
        """Identities as numbers among the people whom a camera sees, from 1; -1 stays."""
        known = identity != UNKNOWN
        out = np.full(len(identity), UNKNOWN)
        out[known] = np.searchsorted(people, identity[known]) + 1
        return out

    def _chunk(self, index: int, start: int, times: Floats, rng: np.random.Generator) -> Detected | None:
        """A stretch of one camera's recording; None where no person is near."""
        people = self._near(index, float(times[0]), float(times[-1]))
        if not len(people):
            return None
        state, floor = self.walkers.state(people, times)
        sight, camera = self.sights[index], self._quick[index]
        present = (floor == sight.floor) & sight.lets_see(state.xy)
        some = present.any(axis=0)
        if not some.any():
            return None
        state = BodyState(**{item.name: getattr(state, item.name)[:, some] for item in fields(BodyState)})
        people, present = people[some], present[:, some]
        joints = pose_joints(state, self.walkers.heights[people])
        joints[..., 2] += self.plan.floor_z_m[sight.floor]
        view = observe_camera(camera, joints, self.walkers.heights[people], present, self.options.occlusion)
        frames = np.arange(start + 1, start + len(times) + 1)
        return detect(view, frames, people + 1, camera.lens.size, self.options.faults, rng)

    def _near(self, index: int, begin_s: float, end_s: float) -> Ints:
        """Numbers of the people who come near a camera between two times."""
        mount = self.plan.mounts[index]
        low, high = (np.floor((np.array(mount.ground) + side * (RANGE_M + 2.0)) / BUCKET_M).astype(int) for side in (-1, 1))
        found = []
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                people, seconds = self._buckets.get((mount.floor, x, y), _NOBODY)
                first, last = np.searchsorted(seconds, [begin_s - BUCKET_S, end_s + BUCKET_S])
                found.append(people[first:last])
        return np.unique(np.concatenate(found))

    @cached_property
    def _buckets(self) -> dict[tuple[int, int, int], tuple[Ints, Floats]]:
        """By floor and square: (N,) people and (N,) ascending seconds at which they are there."""
        reach = float(np.abs(self.clock_offsets_s).max()) + 2 * BUCKET_S
        times = np.arange(-reach, self.options.seconds + reach, BUCKET_S)
        rows = []
        for person in range(len(self.walkers)):
            xy, floor = self.walkers.places(np.array([person]), times)
            there = floor[:, 0] != NOWHERE
            square = np.floor(xy[there, 0] / BUCKET_M)
            rows.append(np.column_stack([floor[there], square, np.full(len(square), person), times[there]]))
        table = np.concatenate(rows)
        table = table[np.lexsort((table[:, 4], table[:, 2], table[:, 1], table[:, 0]))]
        cuts = np.flatnonzero((np.diff(table[:, :3], axis=0) != 0).any(axis=1)) + 1
        return {
            (int(part[0, 0]), int(part[0, 1]), int(part[0, 2])): (part[:, 3].astype(np.int64), part[:, 4])
            for part in np.split(table, cuts)
        }

    @cached_property
    def _quick(self) -> tuple[Camera, ...]:
        return tuple(replace(camera, lens=QuickLens.of(camera.lens)) for camera in self.rig)

    @cached_property
    def _appearance(self) -> Floats:
        return people_looks(len(self.walkers), self.options.rng(8))


_NOBODY = (np.zeros(0, dtype=np.int64), np.zeros(0))


def simulate_site(options: SiteOptions) -> Site:
    """The plan, the cameras and the people of a site; the same options give the same site, bit for bit.

    What a camera reports is computed when `Site.camera` is asked for it.
    """
    plan = airport(options.cameras, options.rng(0))
    rig = _rig(plan, options)
    free = {floor: plan.free(floor) for floor in range(len(plan.floor_z_m))}
    sights = tuple(sight_of(camera, plan, k, free[plan.mounts[k].floor]) for k, camera in enumerate(rig))
    offsets = options.rng(3).uniform(-1, 1, len(rig)) * options.clock_offsets
    offsets[0] = 0.0
    return Site(options, plan, rig, walk(plan, options), sights, offsets)


def _rig(plan: SitePlan, options: SiteOptions) -> Rig:
    cameras = []
    for index, mount in enumerate(plan.mounts):
        rng = options.rng(4, index)
        z = plan.floor_z_m[mount.floor]
        centre = np.array([*mount.ground, z + options.camera_height_m + rng.uniform(-1, 1) * HEIGHT_JITTER_M])
        turn = looking_at(centre, np.array([*mount.aim, z + AIM_HEIGHT_M]), np.radians(rng.uniform(-1, 1) * ROLL_DEG))
        lens = draw_lenses(options.lenses, PICTURE, options.rng(4))(rng)
        cameras.append(Camera(f"C{index + 1}", lens, Pose.from_centre(turn, centre)))
    return Rig(tuple(cameras))


def _joined(parts: list[Boxes]) -> Boxes:
    none = np.zeros(0, dtype=np.int64)
    return Boxes(
        np.concatenate([none, *(part.frame for part in parts)]),
        np.concatenate([none, *(part.identity for part in parts)]),
        np.concatenate([np.zeros((0, 4)), *(part.ltwh for part in parts)]),
        np.concatenate([np.zeros(0), *(part.score for part in parts)]),
    )
