"""Rendered people to learn from and to be found, and recordings in two halves; kept, as they take a while."""

from __future__ import annotations

import shutil
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path

from command import ONE_THREAD, passerby
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.video_writer import VideoWriter
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.rendering import RenderOptions
from passerby.simulation.rendering.camera import CameraJob, camera_job, pictures
from passerby.simulation.write import write_scene
from perception_scenes import render_key
from simulations import WORKERS

CROWD, CROWD_SECONDS, CROWD_FPS = 20, 20.0, 1.0
"""A second apart everybody has turned or taken a step, so that every picture is worth its rendering."""
HALVES = ("first", "second")
TEAM, TEAM_PRESET, HALF_SECONDS, TEAM_FPS = 8, "terrace", 40.0, 5.0


def crowd(scenes: Path, preset: str, seed: int, clothes: str) -> Path:
    """Folder of a rendered crowd, with its videos and the true boxes."""
    options = ["--preset", preset, "--seed", str(seed), "--people", str(CROWD), "--seconds", f"{CROWD_SECONDS:g}"]
    options += ["--fps", f"{CROWD_FPS:g}", "--video", "--clothes", clothes]
    folder = scenes / f"crowd-{clothes}-{preset}-{seed}-{render_key(*options)}"
    if not (folder / "scene.toml").is_file():
        passerby("simulate", *options, "-o", str(folder), environment=ONE_THREAD)
    return folder


def team(scenes: Path, seed: int) -> Path:
    """Folder of a team in one vest, filmed once: videos and true boxes in `first` and `second`, lenses and true rig beside."""
    options = SimulationOptions(TEAM_PRESET, seed, people=TEAM, seconds=2 * HALF_SECONDS, fps=TEAM_FPS)
    video = RenderOptions(clothes="alike")
    folder = scenes / f"team-{seed}-{render_key(str(options), str(video))}"
    if folder.is_dir():
        return folder
    simulated = simulate(options)
    scenes.mkdir(parents=True, exist_ok=True)
    workshop = Path(tempfile.mkdtemp(dir=scenes, prefix=f".{folder.name}."))
    try:
        new = workshop / "new"
        write_scene(simulated, new)
        half = round(HALF_SECONDS * TEAM_FPS)
        for name, boxes in simulated.truth.items():
            for part, begin in zip(HALVES, (0, half), strict=True):
                write_boxes(new / part / "truth" / f"{name}.txt", _shifted(boxes, begin, half))
        with ProcessPoolExecutor(WORKERS) as pool:
            jobs = [(camera_job(simulated, name, video), new, half) for name in simulated.rig.names]
            for _ in pool.map(_film, jobs):
                pass
        new.rename(folder)
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    return folder


def _shifted(boxes: Boxes, begin: int, length: int) -> Boxes:
    """The boxes of one half, its frames counted from 1."""
    part = boxes.take((boxes.frame > begin) & (boxes.frame <= begin + length))
    return replace(part, frame=part.frame - begin)


def _film(job: tuple[CameraJob, Path, int]) -> None:
    """One camera's recording, cut in two."""
    camera, folder, half = job
    film = pictures(camera)
    for part in HALVES:
        path = folder / part / "videos" / f"{camera.camera.name}.mp4"
        path.parent.mkdir(parents=True, exist_ok=True)
        with VideoWriter(path, camera.camera.lens.size, camera.fps) as video:
            for picture in islice(film, half):
                video.write(picture)
