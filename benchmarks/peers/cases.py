"""What is compared: data sets under four conditions, each one a scene file for Passerby and tables of points for its peers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tomli_w

from datasets import data_set, folder_of, swap_identities
from passerby.core.cameras import Lens, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.interchange.coco import read_keypoints, write_keypoints
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import simulate
from passerby.solver.geopose.correspondences import BOTTOM, CENTRE, TOP, ImagePoints, box_points, joint_points
from peers.protocol import Points

Kind = Literal["centre", "top+bottom", "joints"]
BOX_PARTS: Mapping[Kind, tuple[int, ...]] = {"centre": (CENTRE,), "top+bottom": (TOP, BOTTOM)}
COEFFICIENTS = 5  # of OpenCV's distortion that every peer takes: k1, k2, p1, p2, k3


def points_of(rig: Rig, seen: Mapping[str, CameraObservations], kind: Kind) -> Points:
    """All points that two cameras or more saw.

    They are picked as Passerby's own are: whole boxes only, joints of a confidence of 0.3 at least. A peer would suffer from
    the others more than Passerby does.
    """
    observations = Observations(seen)
    found = joint_points(rig, observations) if kind == "joints" else box_points(rig, observations, BOX_PARTS[kind])
    label, _ = found.labels()
    found = found.take(np.bincount(label, minlength=1)[label] >= 2)
    part = np.unique(found.part, return_inverse=True)[1].reshape(-1)
    return Points(
        names=np.array(rig.names), size=np.array([camera.lens.size for camera in rig]),
        matrix=np.array([camera.lens.matrix for camera in rig]),
        distortions=np.array([_coefficients(camera.lens) for camera in rig]), camera=found.camera, person=found.identity,
        instant=found.frame, part=found.part if kind == "joints" else part, pixel=found.pixel,
        undistorted=_undistorted(rig, found), score=_scores(rig, seen, found) if kind == "joints" else np.ones(len(found)),
    )  # fmt: skip


def _coefficients(lens: Lens) -> np.ndarray:
    if lens.fisheye or lens.distortions[COEFFICIENTS:].any():
        raise ValueError("the peers' table has room for pinhole lenses of five coefficients only")
    return np.concatenate([lens.distortions, np.zeros(COEFFICIENTS)])[:COEFFICIENTS]


def _undistorted(rig: Rig, found: ImagePoints) -> np.ndarray:
    """(M, 2) pixels of the same rays through a lens of the same matrix without distortion."""
    pixels = np.zeros((len(found), 2))
    for index, camera in enumerate(rig):
        rows = found.camera == index
        pixels[rows] = Lens(camera.lens.size, camera.lens.matrix, np.zeros(0)).project_rays(found.bearing[rows])
    return pixels


def _scores(rig: Rig, seen: Mapping[str, CameraObservations], found: ImagePoints) -> np.ndarray:
    """(M,) confidences of joints."""
    scores = np.zeros(len(found))
    for index, camera in enumerate(rig):
        people = seen[camera.name].keypoints
        row_of = {key: row for row, key in enumerate(zip(people.identity.tolist(), people.frame.tolist(), strict=True))}
        rows = np.flatnonzero(found.camera == index)
        people_rows = [row_of[key] for key in zip(found.identity[rows].tolist(), found.frame[rows].tolist(), strict=True)]
        scores[rows] = people.score[people_rows, found.part[rows]] if len(rows) else 0.0
    return scores


INSTANTS, JOINT_INSTANTS = 50, 30
"""At most so many instants, evenly spread, for all engines alike: with 200 caliscope and COLMAP need minutes for one run. With
200, clean, on the centres, caliscope measured 285 mm on PETS2009 and 23 mm on WILDTRACK, COLMAP 278 and 25 mm."""
SEEDS = 2  # of simulated scenes of boxes: two engines that are as good as each other differ by half on one seed
BOX_NOISE, JOINT_NOISE = 0.03, 0.01
"""Extra noise of the condition `noisy`: of a box's edges as a share of its height, of joints as a share of their person's."""
SIMULATED_BOX_NOISE, SIMULATED_JOINT_NOISE_PX = 0.02, 2.0
"""Noise that simulated observations have in every condition; 2 % is that of the other pages."""
CONDITIONS: Mapping[str, float] = {"clean": 0.0, "noisy": 0.0, "10 % swaps": 0.1, "30 % swaps": 0.3}
"""Condition -> share of the people of each camera and instant whose identities are exchanged among each other."""
Cameras = dict[str, CameraObservations]


@dataclass(frozen=True, eq=False)
class Seen:
    """What the cameras of one data set saw, with identities, and the truth about the cameras."""

    rig: Rig  # true poses
    cameras: Cameras
    fps: float | None


@dataclass(frozen=True)
class Data:
    """One data set."""

    name: str
    joints: bool
    read: Callable[[int], Seen | None]  # seed -> observations; None where the data are not at hand
    seeds: int = 1  # scenes to take the mean of
    one_person: bool = False  # joints of one person alone: what humancalib is made for. There is nobody to be mistaken for.

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The points that peers are given."""
        return ("joints",) if self.joints else ("centre", "top+bottom")

    @property
    def conditions(self) -> tuple[str, ...]:
        """Those that make sense."""
        return ("clean", "noisy") if self.one_person else tuple(CONDITIONS)


@dataclass(frozen=True)
class Case:
    """One data set under one condition, one seed."""

    data: Data
    condition: str
    seed: int = 0

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.data.name}, {self.condition}"


def all_cases() -> tuple[Case, ...]:
    """The cases of the page, the seeds of one data set and condition in a row."""
    return tuple(Case(data, condition, seed) for data in DATA for condition in data.conditions for seed in range(data.seeds))


def quick_cases() -> tuple[Case, ...]:
    """Two of them."""
    return tuple(Case(DATA[0], condition) for condition in ("clean", "30 % swaps"))


def observed(case: Case) -> Seen | None:
    """The observations of a case; None where its data are not at hand."""
    seen = case.data.read(case.seed)
    if seen is None:
        return None
    cameras = thinned(seen.cameras, JOINT_INSTANTS if case.data.joints else INSTANTS)
    rng = np.random.default_rng([case.seed, *case.name.encode()])
    if case.condition == "noisy":
        cameras = {name: noisy(camera, rng) for name, camera in cameras.items()}
    share = CONDITIONS[case.condition]
    if share:
        cameras = {name: swapped(camera, share, rng) for name, camera in cameras.items()}
    return replace(seen, cameras=cameras)


def thinned(cameras: Cameras, instants: int) -> Cameras:
    """The observations of so many instants, evenly spread over those in which anybody is seen."""
    frames = np.unique(np.concatenate([part.frame for camera in cameras.values() for part in (camera.boxes, camera.keypoints)]))
    if len(frames) <= instants:
        return cameras
    kept = frames[np.linspace(0, len(frames) - 1, instants).round().astype(int)]
    return {
        name: CameraObservations(
            camera.boxes.take(np.isin(camera.boxes.frame, kept)), camera.keypoints.take(np.isin(camera.keypoints.frame, kept))
        )
        for name, camera in cameras.items()
    }


def noisy(camera: CameraObservations, rng: np.random.Generator) -> CameraObservations:
    """Every edge of a box and every joint moved by Gaussian noise of its own."""
    boxes, people = camera.boxes, camera.keypoints
    left, top, width, height = boxes.ltwh.T
    edges = np.column_stack([left, top, left + width, top + height])
    edges = edges + BOX_NOISE * height[:, None] * rng.standard_normal(edges.shape)
    size = np.maximum(edges[:, 2:] - edges[:, :2], 1.0)
    boxes = replace(boxes, ltwh=np.column_stack([edges[:, :2], size]))
    found = people.score > 0
    low = np.where(found, people.xy[..., 1], np.inf).min(axis=1, initial=np.inf)
    high = np.where(found, people.xy[..., 1], -np.inf).max(axis=1, initial=-np.inf)
    extent = np.where(found.any(axis=1), np.maximum(high - low, 0.0), 0.0) if len(people) else np.zeros(0)
    shift = JOINT_NOISE * extent[:, None, None] * rng.standard_normal(people.xy.shape)
    return CameraObservations(boxes, replace(people, xy=people.xy + shift))


def swapped(camera: CameraObservations, share: float, rng: np.random.Generator) -> CameraObservations:
    """Identities exchanged among a share of the people of every instant."""
    change = swap_identities(share, rng)
    people = camera.keypoints
    stand_in = Boxes(people.frame, people.identity, np.ones((len(people), 4)), np.ones(len(people)))
    return CameraObservations(change(camera.boxes), replace(people, identity=change(stand_in).identity))


def write_scene(seen: Seen, folder: Path) -> Path:
    """The same observations as a scene for Passerby, identities given; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    write_rig(folder / "intrinsics.toml", Rig(tuple(replace(camera, pose=None, sigma=None) for camera in seen.rig)))
    cameras = {}
    for name in seen.rig.names:
        cameras[name] = {"intrinsics": "intrinsics.toml"}
        if len(seen.cameras[name].boxes):
            write_boxes(folder / f"{name}.txt", seen.cameras[name].boxes)
            cameras[name]["tracks"] = f"{name}.txt"
        if len(seen.cameras[name].keypoints):
            write_keypoints(folder / f"{name}.json", seen.cameras[name].keypoints)
            cameras[name]["keypoints"] = f"{name}.json"
    scene = {"name": folder.name} | ({} if seen.fps is None else {"fps": seen.fps})
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps({"scene": scene, "cameras": cameras, "association": {"mode": "given"}}))
    return path


def _simulated(preset: str, joints: bool) -> Callable[[int], Seen]:
    def read(seed: int) -> Seen:
        options = SimulationOptions(
            preset=preset, seed=seed, box_noise=SIMULATED_BOX_NOISE, joint_noise_px=SIMULATED_JOINT_NOISE_PX
        )
        made = simulate(options)
        cameras = {name: _part(made.observations[name], joints) for name in made.rig.names}
        return Seen(made.rig, cameras, options.fps)

    return read


def _real(name: str, joints: bool, busiest_alone: bool = False) -> Callable[[int], Seen | None]:
    def read(seed: int) -> Seen | None:
        data = data_set(name)
        folder = folder_of(data)
        if folder is None:
            return None
        rig = read_rig(folder / "rig.toml")
        cameras = {}
        for camera in rig.names:
            if joints:
                people = read_keypoints(folder / "keypoints" / f"{camera}.json")
                cameras[camera] = CameraObservations(keypoints=people.take(people.identity >= 0))
            else:
                boxes = read_boxes(folder / "identities" / f"{camera}.txt")
                cameras[camera] = CameraObservations(boxes.take(boxes.identity >= 0))
        return Seen(rig, busiest(cameras) if busiest_alone else cameras, data.fps)

    return read


def _part(camera: CameraObservations, joints: bool) -> CameraObservations:
    return CameraObservations(keypoints=camera.keypoints) if joints else CameraObservations(boxes=camera.boxes)


def busiest(cameras: Cameras) -> Cameras:
    """The joints of the one person whom the cameras saw most often."""
    everybody = np.concatenate([camera.keypoints.identity for camera in cameras.values()])
    who, count = np.unique(everybody, return_counts=True)
    one = who[np.argmax(count)]

    def of(people: Keypoints) -> Keypoints:
        return people.take(people.identity == one)

    return {name: CameraObservations(keypoints=of(camera.keypoints)) for name, camera in cameras.items()}


DATA: Sequence[Data] = (
    Data("simulated terrace", False, _simulated("terrace", False), SEEDS),
    Data("simulated basketball", False, _simulated("basketball", False), SEEDS),
    Data("simulated construction", False, _simulated("construction", False), SEEDS),
    Data("PETS2009", False, _real("pets2009", False)), Data("WILDTRACK", False, _real("wildtrack", False)),
    Data("MultiviewX", False, _real("multiviewx", False)), Data("simulated terrace, joints", True, _simulated("terrace", True)),
    Data("Shelf", True, _real("shelf", True)),
    Data("Shelf, one person", True, _real("shelf", True, busiest_alone=True), one_person=True),
    Data("Pose2Sim, one person", True, _real("pose2sim_single", True), one_person=True),
)  # fmt: skip
