"""The pictures and videos of the cameras of a simulated scene, with the effects of the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Camera
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.pictures import Picture
from passerby.simulation.body import pose_joints
from passerby.simulation.motion import Motion
from passerby.simulation.options import PRESETS
from passerby.simulation.rendering.background import World, background
from passerby.simulation.rendering.clothes import draw_outfits
from passerby.simulation.rendering.drawing import PeoplePainter, ShadowCaster
from passerby.simulation.rendering.surroundings import Light
from passerby.simulation.scene import Areas, SimulatedScene

BODIES_AT_ONCE = 1000
SALT = 7119
"""Makes the seeds of the pictures differ from those of the scene."""
BANK = 4
"""Number of noise fields. They are made once, and each frame uses one of them with a random shift."""
MARGIN_PX = 64
DRIFT_S = (20.0, 60.0)
"""Range of the period of the light's drift."""
CLOTHES = ("individual", "alike")


@dataclass(frozen=True)
class RenderOptions:
    """Options of the pictures. Raises `InputError` for a value out of range."""

    clothes: str = "individual"
    """individual (each person's own) | alike (the same vest and trousers for all: only height, hair, skin and shoes differ)."""
    shadows: bool = True
    """Whether the sun casts shadows. Otherwise the sky is overcast, and there are only contact shadows."""
    noise: float = 2.5
    """Standard deviation of the sensor's noise, grey levels of 0 to 255."""
    light_drift: float = 0.015
    """Amplitude of the slow change of the light, as a fraction."""
    blur_px: float = 0.5
    """Standard deviation of the optics' blur, pixels; 0 for none."""

    def __post_init__(self) -> None:
        if self.clothes not in CLOTHES:
            raise InputError(f"clothes {self.clothes!r} do not exist: choose one of {', '.join(CLOTHES)}")
        for name, high in (("noise", 50.0), ("light_drift", 0.3), ("blur_px", 5.0)):
            value = getattr(self, name)
            if not np.isfinite(value) or not 0 <= value <= high:
                raise InputError(f"{name} = {value} is out of range: give a value from 0 to {high:g}")


@dataclass(frozen=True, eq=False)
class CameraJob:
    """All inputs of the pictures of one camera; picklable."""

    camera: Camera
    fps: float
    times: Floats
    """(T,) world time of each frame, seconds."""
    motion: Motion
    heights: Floats
    """(P,) standing heights, metres."""
    here: NDArray[np.bool_]
    """(P,) whether a person is in this camera's area."""
    preset: str
    middle: Floats
    """(2,) middle of this camera's area, world, metres."""
    seed: int
    index: int
    """Index of the camera in its rig."""
    options: RenderOptions


def camera_job(simulated: SimulatedScene, camera: str, options: RenderOptions) -> CameraJob:
    """Return the job of one camera. Raises `KeyError` for a camera that the scene does not have."""
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
    """Render the pictures (H, W, 3) of one camera, from frame 1 on; the same scene and options give the same pictures.

    All cameras of the scene share light, textures and clothes; noise and gain differ by camera. All are drawn from random
    generators that no other part of the simulation uses. Raises `KeyError` for a camera that the scene does not have.
    """
    return pictures(camera_job(simulated, camera, options))


def pictures(job: CameraJob) -> Iterator[Picture]:
    """Render the pictures (H, W, 3) of a job."""
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
    """Draw smooth periodic noise (128, 128) of unit variance."""
    field = np.tile(rng.standard_normal((128, 128)).astype(np.float32), (3, 3))
    smooth = (cv2.GaussianBlur(field, (0, 0), 1.2) + 2 * cv2.GaussianBlur(field, (0, 0), 3.0))[128:256, 128:256]
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


class Sensor:
    """The sensor of one camera: blur, gain, drift of the light, and noise."""

    def __init__(self, size: tuple[int, int], options: RenderOptions, rng: np.random.Generator) -> None:
        """Draw the sensor of a camera whose pictures have `size` (width, height)."""
        self._rng, self._options, self._size = rng, options, size
        gain, balance = rng.uniform(0.94, 1.05), rng.uniform(0.97, 1.03, 3)
        self._gain = tuple((gain * balance).tolist())
        self._period, self._start = rng.uniform(*DRIFT_S), rng.uniform(0, 2 * np.pi)
        self._bank = [self._field() for _ in range(BANK)] if options.noise > 0 else []

    def _field(self) -> NDArray[np.int16]:
        """Draw noise, slightly correlated in space, of the requested strength; channels share a third of the variance."""
        width, height = self._size[0] + MARGIN_PX, self._size[1] + MARGIN_PX
        common = self._rng.standard_normal((height, width, 1), dtype=np.float32)
        own = self._rng.standard_normal((height, width, 3), dtype=np.float32)
        field = cv2.GaussianBlur(np.sqrt(1 / 3) * common + np.sqrt(2 / 3) * own, (3, 3), 0.5)
        return np.asarray(np.round(field * (self._options.noise / field.std())), dtype=np.int16)

    def __call__(self, picture: Picture, seconds: float) -> Picture:
        """Return the picture with the sensor's effects at a world time; frames must come in order."""
        if self._options.blur_px > 0:
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), self._options.blur_px), dtype=np.uint8)
        drift = 1 + self._options.light_drift * np.sin(2 * np.pi * seconds / self._period + self._start)
        scales = tuple(float(gain * drift) for gain in self._gain)
        picture = np.asarray(cv2.multiply(picture, np.array((*scales, 1.0))), dtype=np.uint8)
        if self._bank:
            field = self._bank[int(self._rng.integers(BANK))]
            x, y = (int(move) for move in self._rng.integers(0, MARGIN_PX, 2))
            moved = field[y : y + self._size[1], x : x + self._size[0]]
            picture = np.asarray(cv2.add(picture, moved, dtype=cv2.CV_8U), dtype=np.uint8)
        return picture


def write_videos(
    simulated: SimulatedScene,
    folder: str | Path,
    options: RenderOptions,
    executor: Executor | None = None,
    tell: Progress = silent,
) -> dict[str, Path]:
    """Write `CAMERA.mp4` (H.264) for each camera, with the frame rates of the scene.

    Args:
        simulated: the scene.
        folder: output folder; made if it is missing.
        options: options of the pictures.
        executor: renders the cameras in parallel; if None, they are rendered one after the other.
        tell: called after each camera.

    Returns:
        Camera -> the path of its video.

    Raises:
        InputError: the pictures have an odd width or height, or a file cannot be written.
    """
    paths = {name: Path(folder) / f"{name}.mp4" for name in simulated.rig.names}
    jobs = [(camera_job(simulated, name, options), path) for name, path in paths.items()]
    side_by_side(_write, jobs, executor, tell, "videos")
    return paths


def _write(job: tuple[CameraJob, Path]) -> None:
    """Render and encode one camera; memory does not grow with the length of the video."""
    camera, path = job
    with VideoWriter(path, camera.camera.lens.size, camera.fps) as video:
        for picture in pictures(camera):
            video.write(picture)
