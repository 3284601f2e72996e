"""The videos of a simulated scene, one for each camera."""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path

from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress, silent
from passerby.interchange.video_writer import VideoWriter
from passerby.simulation.rendering.camera import CameraJob, camera_job, pictures
from passerby.simulation.rendering.options import RenderOptions
from passerby.simulation.scene import SimulatedScene


def write_videos(
    simulated: SimulatedScene,
    folder: str | Path,
    options: RenderOptions,
    executor: Executor | None = None,
    tell: Progress = silent,
) -> dict[str, Path]:
    """Write `CAMERA.mp4` (H.264) for every camera, with the frame rates of the scene.

    Args:
        simulated: the scene.
        folder: made where it is missing.
        options: of the pictures.
        executor: renders the cameras side by side; one after the other where it is None.
        tell: called for each camera that is done.

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
    """Render and encode one camera; memory does not grow with its length."""
    camera, path = job
    with VideoWriter(path, camera.camera.lens.size, camera.fps) as video:
        for picture in pictures(camera):
            video.write(picture)
