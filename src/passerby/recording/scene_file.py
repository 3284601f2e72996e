"""The scene file of a recording: what `passerby calibrate` reads afterwards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from passerby.common.addresses import plain_without_credentials
from passerby.common.errors import InputError
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.toml_text import to_toml
from passerby.recording.settings import RecordingPlan
from passerby.scene.scene import Scene

SCENE_FILE = "scene.toml"
TABLES = ("scene", "association", "sites", "scale", "solver")
"""Of a file of cameras, that are copied: they name no files."""


def write_scene_file(plan: RecordingPlan, folder: Path) -> Path:
    """Write the scene file of a recording into its folder, before anything is recorded; one that is there stays.

    Raises `InputError` (`FileFaults`) for keys that no scene has, or that contradict each other: found now, not after the
    recording.
    """
    path = folder / SCENE_FILE
    if path.exists():
        known = set(Scene.load(path).cameras)
        missing = [stream.camera for stream in plan.streams if stream.camera not in known]
        if missing:
            raise InputError(f"{path}: is there already, without camera {missing[0]}: record into another folder")
        return path
    for table in plan.tables:
        if table not in TABLES:
            raise InputError(f"{plan.place}: [{table}] has no place here: add it to {path} when that is written")
    cameras: dict[str, dict[str, Any]] = {}
    for name, given in plan.cameras.items():
        cameras[name] = {"video": name, **given}
        if isinstance(given.get("intrinsics"), str):
            cameras[name]["intrinsics"] = str((plan.place.parent / given["intrinsics"]).resolve())
    content = plain_without_credentials({**plan.tables, "cameras": cameras})
    Scene.of_content(content, plan.place)
    write_text(path, f"# Recorded by passerby record.\n\n{to_toml(content)}")
    return path
