"""A simulated scene as a folder: a scene file that can be calibrated, and the truth."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes, write_embeddings
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.text_formats import to_csv, to_toml
from passerby.interchange.storage.transaction import whole_folder
from passerby.simulation.rendering import RenderOptions, write_videos
from passerby.simulation.scene import SimulatedScene

SCENE_FILE = "scene.toml"
BOXES_FILE = "boxes.toml"
"""Second scene file in a folder with videos: the same scene with known boxes."""
MEAN_SD = 0.0125
"""Standard deviation of a known mean height as boxes show it, as a share of the height. It is the error of lengths in simulated
scenes of many people."""
OPTIONS_FILE = "simulation.toml"
VIDEOS = "videos"


def write_scene(
    simulated: SimulatedScene,
    directory: str | Path,
    keypoints: bool = False,
    video: RenderOptions | None = None,
    executor: Executor | None = None,
    tell: Progress = silent,
) -> Path:
    """Write a scene folder, as a whole or not at all, and return the path of its scene file.

    The folder holds `scene.toml` (identities given, or to be found if they are unrelated), `intrinsics.toml` (lenses, no
    poses), `tracks/CAMERA.txt` (MOTChallenge), `embeddings/CAMERA.npz` (if the options request them; rows as in the tracks),
    on request `keypoints/CAMERA.json` (COCO), and the truth: `truth.toml` (the rig with its poses), `truth/CAMERA.txt` (if
    identities are unrelated: the boxes of people with their true identities), `heights.csv`, `ground_positions.csv` and
    `simulation.toml` (the options and the cameras' clock offsets).

    With `video`, `videos/CAMERA.mp4` show the scene, and `scene.toml` names only them: no boxes, no identities, no frame rate.
    `boxes.toml` is then the scene file of the boxes, and `truth/CAMERA.txt` is always written. `executor` renders the videos in
    parallel; if it is None, they are rendered one after the other. `tell` is called after each video.

    A folder written by an earlier simulation is replaced as a whole. Raises `InputError` for a folder with any other content,
    and for one that cannot be written.
    """
    directory = Path(directory)
    with whole_folder(directory, OPTIONS_FILE, "a simulated scene") as new:
        _write_files(simulated, new, directory.resolve().name, keypoints, video)
        if video is not None:
            write_videos(simulated, new / VIDEOS, video, executor, tell)
    return directory / SCENE_FILE


def _write_files(simulated: SimulatedScene, folder: Path, name: str, keypoints: bool, video: RenderOptions | None) -> None:
    lenses = Rig(tuple(replace(camera, pose=None, sigma=None) for camera in simulated.rig))
    write_rig(folder / "intrinsics.toml", lenses)
    write_rig(folder / "truth.toml", simulated.rig)
    for camera in simulated.rig.names:
        seen = simulated.observations[camera]
        # Sorted as in the written file, so that the rows of the embeddings are those of the tracks.
        boxes = seen.boxes.take(np.lexsort((seen.boxes.identity, seen.boxes.frame)))
        write_boxes(folder / _tracks(camera), boxes)
        if boxes.embedding is not None:
            write_embeddings(folder / _embeddings(camera), boxes.embedding, boxes.frame)
        if keypoints:
            write_keypoints(folder / _keypoints(camera), seen.keypoints)
    if simulated.options.unrelated_ids or video is not None:
        for camera, boxes in simulated.truth.items():
            write_boxes(folder / "truth" / f"{camera}.txt", boxes)
    write_text(folder / "heights.csv", to_csv(("id", "height_m"), ((i, f"{h:.4f}") for i, h in simulated.heights.items())))
    places = (
        (frame, identity, f"{x:.4f}", f"{y:.4f}")
        for frame, row in zip(simulated.frames.tolist(), simulated.ground_positions, strict=True)
        for identity, (x, y) in zip(simulated.identities.tolist(), row.tolist(), strict=True)
        if np.isfinite(x)
    )
    write_text(folder / "ground_positions.csv", to_csv(("frame", "id", "x_m", "y_m"), places))
    options = {key: value for key, value in asdict(simulated.options).items() if value is not None}
    made: dict[str, Any] = {"options": options, "clock_offsets_s": simulated.clock_offsets}
    if video is not None:
        made["video"] = asdict(video)
    write_text(folder / OPTIONS_FILE, to_toml(made))
    scene = _scene(simulated, name, keypoints)
    write_text(folder / (SCENE_FILE if video is None else BOXES_FILE), to_toml(scene))
    if video is not None:
        write_text(folder / SCENE_FILE, to_toml(_describe_video_scene(scene)))


def _scene(simulated: SimulatedScene, name: str, keypoints: bool) -> dict[str, Any]:
    """Return the content of the scene file; it does not state the clock offsets."""
    options = simulated.options
    cameras = {
        camera: {"intrinsics": "intrinsics.toml", "tracks": _tracks(camera)}
        | ({"embeddings": _embeddings(camera)} if options.embeddings != "none" else {})
        | ({"keypoints": _keypoints(camera)} if keypoints else {})
        | ({"fps": float(fps)} if fps != options.fps else {})
        for camera, fps in zip(simulated.rig.names, options.frame_rates, strict=True)
    }
    return {
        "scene": {"name": name, "fps": float(options.fps)},
        "cameras": cameras,
        "association": {"mode": "combined" if options.unrelated_ids else "given"},
        "solver": {"method": "people"},
        "scale": {
            "person_height_m": options.person_height_mean_m,
            # A spread of zero would state that heights are known exactly; they are known to a centimetre at best.
            "person_height_sd_m": max(options.person_height_sd_m, 0.01),
            # The mean is that of the distribution from which the heights were drawn.
            "person_height_mean_sd_m": MEAN_SD * options.person_height_mean_m,
        },
    }


def _describe_video_scene(scene: dict[str, Any]) -> dict[str, Any]:
    """Return the scene file of the videos, from that of the boxes: the videos state the frame rates, identities are unknown."""
    cameras = {
        camera: {"intrinsics": table["intrinsics"], "video": f"{VIDEOS}/{camera}.mp4"}
        for camera, table in scene["cameras"].items()
    }
    return scene | {"scene": {"name": scene["scene"]["name"]}, "cameras": cameras, "association": {"mode": "combined"}}


def _tracks(camera: str) -> str:
    return f"tracks/{camera}.txt"


def _embeddings(camera: str) -> str:
    return f"embeddings/{camera}.npz"


def _keypoints(camera: str) -> str:
    return f"keypoints/{camera}.json"
