"""People and rigs that the tests of the person-model solver share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.solution import Solution
from passerby.simulation import SimulatedScene, SimulationOptions
from passerby.solver.people import PeopleOptions, solve_people
from support.scenes.simulated import from_shared_views

LENS = Lens((1280, 720), np.array([[800.0, 0, 640], [0, 802.0, 360], [0, 0, 1]]), np.array([-0.08, 0.01, 0.0005, -0.0003, 0.0]))


def looking_at(centre: Sequence[float], target: Sequence[float]) -> Pose:
    """A camera at `centre` that looks at `target`, upright (world z up)."""
    z = np.asarray(target, float) - np.asarray(centre, float)
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return Pose.from_centre(np.array([x, np.cross(z, x), z]), np.asarray(centre, float))


def ring(count: int, radius: float = 8.0, height: float = 2.5, lens: Lens = LENS) -> Rig:
    """Cameras C1, C2, ... around the origin, at unequal steps and heights, all looking at the middle."""
    cameras = []
    for number in range(count):
        angle = 2 * np.pi * (number + 0.15 * np.sin(number + 1)) / count
        centre = (radius * np.cos(angle), radius * np.sin(angle), height + 0.3 * np.cos(3 * number))
        cameras.append(Camera(f"C{number + 1}", lens, looking_at(centre, (0.3 * number - 0.4, 0.2, 0.9))))
    return Rig(tuple(cameras))


def without_poses(rig: Rig) -> Rig:
    return Rig(tuple(replace(camera, pose=None, sigma=None) for camera in rig))


def poles(rig: Rig, ground: np.ndarray, heights: np.ndarray, *, width: float = 0.4) -> dict[str, np.ndarray]:
    """Boxes (N, 4) ltwh by camera around upright poles at `ground` (N, 2), without any error; NaN where not in front."""
    out = {}
    for camera in rig:
        foot = camera.project(np.column_stack([ground, np.zeros(len(ground))]))
        head = camera.project(np.column_stack([ground, heights]))
        tall = foot[:, 1] - head[:, 1]
        middle = 0.5 * (foot[:, 0] + head[:, 0])
        out[camera.name] = np.column_stack([middle - 0.5 * width * tall, head[:, 1], width * tall, tall])
    return out


def observe(
    rig: Rig, ground: np.ndarray, heights: np.ndarray, frame: np.ndarray, identity: np.ndarray
) -> dict[str, CameraObservations]:
    """What the cameras see of poles: boxes wholly inside the picture."""
    seen = {}
    for name, ltwh in poles(rig, ground, heights).items():
        low, high = ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]
        with np.errstate(invalid="ignore"):
            inside = (low > 5).all(axis=1) & (high < np.array(rig[name].lens.size) - 5).all(axis=1) & (ltwh[:, 3] > 10)
        seen[name] = CameraObservations(Boxes(frame[inside], identity[inside], ltwh[inside], np.ones(inside.sum())))
    return seen


@cache
def simulated(preset: str = "terrace", seconds: float = 20.0, seed: int = 0, **faults: float) -> SimulatedScene:
    """A scene with 2 % box noise unless told otherwise, simulated once per session."""
    options = SimulationOptions(preset=preset, seed=seed, seconds=seconds, **{"box_noise": 0.02, **faults})  # type: ignore[arg-type]
    return from_shared_views(options)


def part(observations: Observations, *, boxes: bool = True, keypoints: bool = False) -> Observations:
    """The boxes alone, the keypoints alone, or both."""
    return Observations(
        {
            name: CameraObservations(seen.boxes if boxes else Boxes.empty(), seen.keypoints if keypoints else Keypoints.empty())
            for name, seen in observations.cameras.items()
        },
        observations.fps,
    )


def solve(
    rig: Rig, observations: Observations, cues: ScaleCues | None = None, options: PeopleOptions | None = None, *, seed: int = 0
) -> Solution:
    return solve_people(without_poses(rig), observations, cues or ScaleCues(), options, rng=np.random.default_rng(seed))
