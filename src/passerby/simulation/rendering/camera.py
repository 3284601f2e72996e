"""The pictures of one camera of a simulated scene, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.perception.pictures import Picture
from passerby.simulation.areas import Areas
from passerby.simulation.body import pose_joints
from passerby.simulation.motion import Motion
from passerby.simulation.presets import PRESETS
from passerby.simulation.rendering.background import World, background
from passerby.simulation.rendering.clothes import draw_outfits
from passerby.simulation.rendering.drawing import PeoplePainter
from passerby.simulation.rendering.light import Light
from passerby.simulation.rendering.options import RenderOptions
from passerby.simulation.rendering.sensor import Sensor
from passerby.simulation.rendering.shadows import ShadowCaster
from passerby.simulation.scene import SimulatedScene

BODIES_AT_ONCE = 1000
SALT = 7119
"""Keeps the seeds of the pictures apart from those of the scene."""


@dataclass(frozen=True, eq=False)
class CameraJob:
    """All that the pictures of one camera depend on; picklable."""

    camera: Camera
    fps: float
    times: Floats
    """(T,) seconds of the world at each frame."""
    motion: Motion
    heights: Floats
    """(P,) metres."""
    here: NDArray[np.bool_]
    """(P,) who is in this camera's area."""
    preset: str
    middle: Floats
    """(2,) of this camera's area, world, metres."""
    seed: int
    index: int
    """Of the camera in its rig."""
    options: RenderOptions


def camera_job(simulated: SimulatedScene, camera: str, options: RenderOptions) -> CameraJob:
    """The job of one camera. Raises `KeyError` for a camera that the scene has not."""
    scene, index = simulated.options, simulated.rig.names.index(simulated.rig[camera].name)
    fps = scene.frame_rates[index]
    count = max(1, round(scene.seconds * fps))
    areas = Areas.of(scene)
    area = int(areas.of_camera[index])
    return CameraJob(
        camera=simulated.rig[camera],
        fps=fps,
        times=np.arange(count) / fps + simulated.clock_offsets[camera],
        motion=simulated.motion,
        heights=np.array([simulated.heights[identity] for identity in simulated.identities.tolist()]),
        here=areas.of_person == area,
        preset=scene.preset,
        middle=areas.middle(area),
        seed=scene.seed,
        index=index,
        options=options,
    )


def render_camera(simulated: SimulatedScene, camera: str, options: RenderOptions) -> Iterator[Picture]:
    """The pictures (H, W, 3) of one camera, from its frame 1 on; the same scene and options give the same pictures.

    Light, world and clothes are the scene's, noise and gain the camera's own: everything is drawn from generators that nothing
    else of the simulation uses. Raises `KeyError` for a camera that the scene has not.
    """
    return pictures(camera_job(simulated, camera, options))


def pictures(job: CameraJob) -> Iterator[Picture]:
    """The pictures of a job."""
    cv2.setNumThreads(1)
    seeds = np.random.SeedSequence((SALT, job.seed, list(PRESETS).index(job.preset)))
    lighting, building, dressing, graining, sensing = (np.random.default_rng(seed) for seed in seeds.spawn(5))
    light = Light.drawn(job.options.shadows, lighting)
    world = World.drawn(job.preset, job.middle, light, building)
    outfits = draw_outfits(job.options.clothes, len(job.heights), dressing)
    painter = PeoplePainter(job.camera, job.heights, outfits, light, _grain(graining))
    caster = ShadowCaster(job.camera, job.heights, outfits, light)
    sensor = Sensor(job.camera.lens.size, job.options, sensing.spawn(job.index + 1)[-1])
    empty = background(job.camera, world)
    stretch = max(1, BODIES_AT_ONCE // len(job.heights))
    for start in range(0, len(job.times), stretch):
        times = job.times[start : start + stretch]
        state, present = job.motion.at(times)
        joints = pose_joints(state, job.heights)
        for seconds, body, there in zip(times.tolist(), joints, present & job.here, strict=True):
            frame = empty.copy()
            caster.cast(frame, body, there)
            for surface in painter.surfaces(body, there):
                painter.paint(frame, surface)
            yield sensor(frame, seconds)


def _grain(rng: np.random.Generator) -> NDArray[np.float32]:
    """(128, 128) smooth noise of unit variance that continues over its borders."""
    field = np.tile(rng.standard_normal((128, 128)).astype(np.float32), (3, 3))
    smooth = (cv2.GaussianBlur(field, (0, 0), 1.2) + 2 * cv2.GaussianBlur(field, (0, 0), 3.0))[128:256, 128:256]
    return np.asarray(smooth / smooth.std(), dtype=np.float32)
