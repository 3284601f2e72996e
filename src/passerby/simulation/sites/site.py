"""A simulated site: its truth, the observations of its cameras, and its folder, which is written camera by camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations
from passerby.interchange.motchallenge import write_boxes, write_embeddings
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.text_formats import to_csv, to_toml
from passerby.interchange.storage.transaction import whole_folder
from passerby.simulation.body import BodyState, pose_joints
from passerby.simulation.lenses import AIM_HEIGHT_M, draw_lenses, looking_at
from passerby.simulation.observe import Detected, box_embeddings, detect, number_tracklets, observe_camera, people_looks
from passerby.simulation.sites.plan import RANGE_M, Sight, SitePlan, airport, shared_ground, sight_of
from passerby.simulation.sites.walkers import NOWHERE, SiteOptions, Walkers, walk
from passerby.simulation.write import MEAN_SD, OPTIONS_FILE, SCENE_FILE

PICTURE = (1280, 720)
HEIGHT_JITTER_M, ROLL_DEG = 0.2, 2.0
CHUNK_FRAMES = 25
"""Number of time steps of a camera that are computed together: so few that most people near it stay near it."""
BUCKET_M, BUCKET_S = 12.0, 1.0
"""Side of the squares, and time step, of the table by which people near a camera are found."""
PEOPLE_AT_ONCE = 100


@dataclass(frozen=True, eq=False)
class SiteCamera:
    """Observations of one camera, and the people that its boxes really show."""

    name: str
    seen: CameraObservations
    """Boxes without joints; identities are tracklet numbers of this camera."""
    true_identity: Ints
    """(N,) true identity of each box, from 1; -1 for a box without a person."""

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
    """(C,) time offsets: frame f of a camera shows the world at (f - 1) / fps + offset."""

    @cached_property
    def shared_m2(self) -> dict[tuple[int, int], float]:
        """Pairs of cameras, a < b, that see ground in common -> the area of this ground, square metres."""
        return shared_ground(self.sights)

    def cameras(self) -> Iterator[SiteCamera]:
        """Compute the observations of the cameras one after the other, without keeping those of earlier cameras."""
        for index in range(len(self.rig)):
            yield self.camera(index)

    def camera(self, index: int) -> SiteCamera:
        """Compute the observations of one camera; they do not depend on calls for other cameras."""
        options, name = self.options, self.rig.names[index]
        times = np.arange(options.n_frames) / options.fps + self.clock_offsets_s[index]
        parts = [
            part
            for number, start in enumerate(range(0, options.n_frames, CHUNK_FRAMES))
            if (part := self._chunk(index, start, times[start : start + CHUNK_FRAMES], options.rng(5, index, number)))
        ]
        boxes = _join_boxes([part.seen.boxes for part in parts])
        true_identity = np.concatenate([np.zeros(0, dtype=np.int64), *(part.true_identity for part in parts)])
        people, local = np.unique(true_identity[true_identity != UNKNOWN], return_inverse=True)
        own = np.full(len(boxes), UNKNOWN)
        own[true_identity != UNKNOWN] = local + 1
        shown = self._number_locally(boxes.identity, people)
        boxes = replace(boxes, identity=shown)
        number = number_tracklets(boxes, len(people), options.fps, options.tracklet_seconds, options.rng(6, index))
        seen = CameraObservations(replace(boxes, identity=number))
        if options.embeddings != "none":
            looks = self._appearance[people - 1] if options.embeddings == "distinct" else None
            vectors = box_embeddings(own, looks, options.rng(7, index))
            seen = replace(seen, boxes=replace(seen.boxes, embedding=vectors))
        return SiteCamera(name, seen, true_identity)

    def _number_locally(self, identity: Ints, people: Ints) -> Ints:
        """Convert identities into numbers, from 1, among the people that a camera sees; -1 stays."""
        known = identity != UNKNOWN
        out = np.full(len(identity), UNKNOWN)
        out[known] = np.searchsorted(people, identity[known]) + 1
        return out

    def _chunk(self, index: int, start: int, times: Floats, rng: np.random.Generator) -> Detected | None:
        """Compute the detections in a stretch of one camera's recording; None if no person may be in view."""
        people = self._find_near(index, float(times[0]), float(times[-1]))
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

    def _find_near(self, index: int, begin_s: float, end_s: float) -> Ints:
        """Return the numbers, from 0, of the people who come near a camera between two times."""
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
        """(floor, square along x, along y) -> (N,) people in the square, and (N,) ascending times of it, seconds."""
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
    """Simulate the plan, the cameras and the people of a site; the same options give the same site, bit for bit.

    The observations of a camera are computed by a call of `Site.camera`.
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


def _join_boxes(parts: list[Boxes]) -> Boxes:
    none = np.zeros(0, dtype=np.int64)
    return Boxes(
        np.concatenate([none, *(part.frame for part in parts)]),
        np.concatenate([none, *(part.identity for part in parts)]),
        np.concatenate([np.zeros((0, 4)), *(part.ltwh for part in parts)]),
        np.concatenate([np.zeros(0), *(part.score for part in parts)]),
    )


@dataclass(frozen=True)
class QuickLens(Lens):
    """A pinhole lens with two radial coefficients: the same pixels as `Lens`, to the last bits, in a fifth of OpenCV's time."""

    @classmethod
    def of(cls, lens: Lens) -> QuickLens:
        """Convert a lens. Its tangential and higher coefficients must be zero, as in all simulated lenses."""
        assert not lens.fisheye
        assert not lens.distortions[2:].any()
        return cls(**{item.name: getattr(lens, item.name) for item in fields(Lens)})

    def project_rays(self, points: Floats) -> Floats:
        """Compute the pixels (N, 2) of points (N, 3) in the camera's frame; NaN for points behind the camera."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        k1, k2 = self.distortions[:2]
        front = points[:, 2] > 0
        depth = np.where(front, points[:, 2], np.nan)
        x, y = points[:, 0] / depth, points[:, 1] / depth
        square = x * x + y * y
        scale = 1.0 + square * (k1 + k2 * square)
        return np.column_stack([
            self.matrix[0, 0] * (x * scale) + self.matrix[0, 2], self.matrix[1, 1] * (y * scale) + self.matrix[1, 2]
        ])  # fmt: skip


def write_site(site: Site, directory: str | Path, tell: Progress = silent) -> Path:
    """Write a site's folder, as a whole or not at all, and return the path of its scene file.

    The folder holds the same files as that of `write_scene`: `scene.toml` (identities to be found), `intrinsics.toml`,
    `tracks/CAMERA.txt`, `embeddings/CAMERA.npz` on request, and the truth: `truth.toml`, `truth/CAMERA.txt`, `heights.csv`,
    `simulation.toml`. Only a site has `cameras.csv` (floor, its height, and clock offset of each camera), `overlaps.csv` (pairs
    of cameras that see ground in common, and its area) and `ground_positions.csv` (positions of people each second, with their
    floor).

    `tell` is called after each camera. A folder written by an earlier simulation is replaced as a whole. Raises `InputError`
    for a folder with any other content, and for one that cannot be written.
    """
    directory = Path(directory)
    with whole_folder(directory, OPTIONS_FILE, "a simulated scene") as new:
        _write_truth(site, new)
        write_text(new / SCENE_FILE, to_toml(_scene(site, directory.resolve().name)))
        stage, count = "simulating cameras", len(site.rig)
        tell(stage, 0, count)
        for done, camera in enumerate(site.cameras(), start=1):
            _write_camera(camera, new)
            tell(stage, done, count)
    return directory / SCENE_FILE


def _write_camera(camera: SiteCamera, folder: Path) -> None:
    # Sorted as in the written file, so that the rows of the embeddings are those of the tracks.
    boxes = camera.seen.boxes.take(np.lexsort((camera.seen.boxes.identity, camera.seen.boxes.frame)))
    write_boxes(folder / "tracks" / f"{camera.name}.txt", boxes)
    if boxes.embedding is not None:
        write_embeddings(folder / "embeddings" / f"{camera.name}.npz", boxes.embedding, boxes.frame)
    write_boxes(folder / "truth" / f"{camera.name}.txt", camera.truth)


def _write_truth(site: Site, folder: Path) -> None:
    rig, names = site.rig, site.rig.names
    write_rig(folder / "intrinsics.toml", Rig(tuple(replace(camera, pose=None, sigma=None) for camera in rig)))
    write_rig(folder / "truth.toml", rig)
    heights = ((person, f"{height:.4f}") for person, height in enumerate(site.walkers.heights, start=1))
    write_text(folder / "heights.csv", to_csv(("id", "height_m"), heights))
    floors = site.plan.floors.tolist()
    cameras = (
        (name, floor, f"{site.plan.floor_z_m[floor]:g}", f"{offset:.6f}")
        for name, floor, offset in zip(names, floors, site.clock_offsets_s.tolist(), strict=True)
    )
    write_text(folder / "cameras.csv", to_csv(("camera", "floor", "floor_z_m", "clock_offset_s"), cameras))
    shared = ((names[a], names[b], f"{area:g}") for (a, b), area in site.shared_m2.items())
    write_text(folder / "overlaps.csv", to_csv(("camera_a", "camera_b", "shared_m2"), shared))
    write_text(folder / "ground_positions.csv", to_csv(("frame", "id", "floor", "x_m", "y_m"), _positions(site)))
    options = {key: value for key, value in asdict(site.options).items() if value is not None}
    offsets = dict(zip(names, site.clock_offsets_s.tolist(), strict=True))
    write_text(folder / OPTIONS_FILE, to_toml({"options": options, "clock_offsets_s": offsets}))


def _positions(site: Site) -> Iterator[tuple[object, ...]]:
    """Return the rows of `ground_positions.csv`: positions at the first frame of each second, person by person."""
    options = site.options
    frames = np.unique(np.round(np.arange(0.0, options.seconds, max(1.0, 1.0 / options.fps)) * options.fps).astype(int))
    for start in range(0, len(site.walkers), PEOPLE_AT_ONCE):
        people = np.arange(start, min(start + PEOPLE_AT_ONCE, len(site.walkers)))
        xy, floors = site.walkers.places(people, frames / options.fps)
        for column, person in enumerate(people.tolist()):
            for frame, floor, (x, y) in zip(frames.tolist(), floors[:, column].tolist(), xy[:, column].tolist(), strict=True):
                if floor != NOWHERE:
                    yield frame + 1, person + 1, floor, f"{x:.3f}", f"{y:.3f}"


def _scene(site: Site, name: str) -> dict[str, Any]:
    """Return the content of the scene file; it states neither the poses of the cameras nor their clock offsets."""
    options = site.options
    cameras = {
        camera: {"intrinsics": "intrinsics.toml", "tracks": f"tracks/{camera}.txt"}
        | ({"embeddings": f"embeddings/{camera}.npz"} if options.embeddings != "none" else {})
        for camera in site.rig.names
    }
    # Two clocks differ by up to twice the largest offset of one.
    search = {"max_offset_s": 2.0 * options.clock_offsets} if options.clock_offsets > 0 else {}
    return {
        "scene": {"name": name, "fps": float(options.fps)},
        "cameras": cameras,
        "association": {"mode": "combined"} | search,
        "solver": {"method": "people"},
        "scale": {
            "person_height_m": options.person_height_mean_m,
            # As in `write_scene`: heights are known to a centimetre at best.
            "person_height_sd_m": max(options.person_height_sd_m, 0.01),
            "person_height_mean_sd_m": MEAN_SD * options.person_height_mean_m,
        },
    }
