"""A room that is filmed: two people walk about, one sits at a desk, four cameras hang in the corners; joints beside boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.signal import lfilter

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.simulation.body import BodyState, pose_joints
from passerby.simulation.lenses import place_cameras
from passerby.simulation.motion import Motion, simulate_motion
from passerby.simulation.observe import detect, observe_camera
from passerby.simulation.options import Activity, Preset, SimulationOptions

ROOM_M, HEIGHT_M = (6.0, 8.0), 2.9
"""Extent of the room, and height of the cameras in its corners."""
CORNER_M = 0.2
"""From a camera to either wall of its corner, metres."""
PICTURE = (1280, 720)
FPS = 10.0
_WALK = Activity("walk", 0.9, (4.0, 12.0), speed=(0.6, 1.4))
_STAND = Activity("stand", 0.1, (1.0, 3.0))
_SIT = Activity("sit", 1.0, (8.0, 30.0), crouch=(0.7, 0.8), lean=(0.0, 0.3), seat=(1.0, 1.0))


@dataclass(frozen=True)
class RoomOptions:
    """What is filmed, and how well it is seen."""

    seed: int = 0
    seconds: float = 30.0
    walkers: int = 2
    seated: int = 1
    joint_noise_px: float = 2.0
    box_noise: float = 0.02
    lasting_s: float = 0.0
    """Correlation time of both kinds of noise; 0: every frame's is its own."""
    moves: Mapping[str, tuple[float, Pose]] = field(default_factory=dict)
    """Camera -> seconds and the pose from then on."""
    known: bool = True
    """Whether identities are known over all cameras; each camera has its own numbers else."""


def room_rig(seed: int, cameras: int = 4) -> Rig:
    """The true cameras."""
    return place_cameras(cameras, ROOM_M, -CORNER_M, HEIGHT_M, PICTURE, np.random.default_rng((seed, 1)))


def filmed_room(rig: Rig, options: RoomOptions) -> Observations:
    """What detectors of boxes and joints report of the room."""
    growing, moving, detecting = (np.random.default_rng((options.seed, number)) for number in (2, 3, 4))
    people = options.walkers + options.seated
    heights = PERSON_HEIGHT_M + PERSON_HEIGHT_SD_M * np.clip(growing.standard_normal(people), -2.5, 2.5)
    motion = room_motion(options, heights, moving)
    times = np.arange(round(options.seconds * FPS)) / FPS
    frames, identities = np.arange(1, len(times) + 1), np.arange(1, people + 1)
    state, present = motion.at(times)
    joints = pose_joints(state, heights)
    lasting = options.lasting_s > 0
    faults = SimulationOptions(
        box_noise=0.0 if lasting else options.box_noise, joint_noise_px=0.0 if lasting else options.joint_noise_px
    )
    seen = {}
    for camera, own in zip(rig, detecting.spawn(len(rig)), strict=True):
        view = observe_camera(camera, joints, heights, present)
        if camera.name in options.moves:
            when, pose = options.moves[camera.name]
            after = observe_camera(replace(camera, pose=pose), joints, heights, present)
            late = times >= when
            view = type(view)(**{
                item.name: np.where(
                    late.reshape(-1, *(1,) * (getattr(view, item.name).ndim - 1)), getattr(after, item.name),
                    getattr(view, item.name),
                )
                for item in fields(view)
            })  # fmt: skip
        found = detect(view, frames, identities, camera.lens.size, faults, own).seen
        if lasting:
            found = _with_lasting_noise(found, people, len(times), camera.lens.size, options, own)
        seen[camera.name] = found if options.known else _unnamed(found, people, own)
    return Observations(seen, FPS)


def _with_lasting_noise(
    seen: CameraObservations, people: int, n_times: int, picture: tuple[int, int], options: RoomOptions,
    rng: np.random.Generator,
) -> CameraObservations:  # fmt: skip
    """Boxes and joints whose errors last; edges at the picture's border stay there."""
    keep = float(np.exp(-1 / (FPS * options.lasting_s)))

    def noise(*shape: int) -> Floats:
        """(n_times, people, ...) of unit variance."""
        fresh = rng.standard_normal((n_times, people, *shape))
        fresh[1:] *= np.sqrt(1 - keep**2)
        return np.asarray(lfilter([1.0], [1.0, -keep], fresh, axis=0))

    boxes, joints = seen.boxes, seen.keypoints
    edges = np.column_stack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])
    limits = np.array([*picture, *picture], dtype=np.float64)
    free = (edges > 0.5) & (edges < limits - 0.5)
    off = noise(4)[boxes.frame - 1, boxes.identity - 1] * options.box_noise * boxes.ltwh[:, 3:]
    edges = np.where(free, np.clip(edges + off, 0.0, limits), edges)
    xy = joints.xy + options.joint_noise_px * noise(joints.xy.shape[1], 2)[joints.frame - 1, joints.identity - 1]
    ltwh = np.column_stack([edges[:, :2], np.maximum(edges[:, 2:] - edges[:, :2], 1.0)])
    return CameraObservations(replace(boxes, ltwh=ltwh), replace(joints, xy=xy))


def room_motion(options: RoomOptions, heights: Floats, rng: np.random.Generator) -> Motion:
    """Walkers anywhere in the room, others on a chair."""
    area = (ROOM_M[0] - 0.8, ROOM_M[1] - 0.8)
    parts = []
    for activities, own in (((_WALK, _STAND), heights[: options.walkers]), ((_SIT,), heights[options.walkers :])):
        preset = Preset(area, 4, HEIGHT_M, 0.0, PICTURE, len(own), 0.0, activities)
        if len(own):
            parts.append(simulate_motion(preset, own, options.seconds, rng))
    columns = {
        item.name: np.concatenate([getattr(part.state, item.name) for part in parts], axis=1) for item in fields(BodyState)
    }
    return Motion(parts[0].times, BodyState(**columns), np.concatenate([part.present_from for part in parts]))


def _unnamed(seen: CameraObservations, people: int, rng: np.random.Generator) -> CameraObservations:
    """The same under numbers that mean nothing in another camera."""
    number = np.append(rng.permutation(people), -1)

    def renamed(identity: np.ndarray) -> np.ndarray:
        return number[np.where(identity > 0, identity - 1, people)]

    return CameraObservations(
        replace(seen.boxes, identity=renamed(seen.boxes.identity)),
        replace(seen.keypoints, identity=renamed(seen.keypoints.identity)),
    )
