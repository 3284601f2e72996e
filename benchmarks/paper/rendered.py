"""Rendered scenes, which take long to make: kept in a folder for the next time, under names that tell what made them."""

from __future__ import annotations

import hashlib
import os
from importlib import metadata
from pathlib import Path

import passerby as package
from passerby.simulation import SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions

SECONDS, FPS = 40.0, 5.0
LIBRARIES = ("numpy", "opencv-python-headless", "av")  # whose versions change the pictures


def rendered(scenes: Path, preset: str, seed: int, seconds: float = SECONDS, fps: float = FPS) -> Path:
    """Folder of a scene as `passerby simulate --video` writes it; made unless it is there, by the same renderer.

    Raises `InputError` for options out of range, or a folder that cannot be written.
    """
    told = ("--preset", preset, "--seed", str(seed), "--seconds", f"{seconds:g}", "--fps", f"{fps:g}", "--video")
    folder = scenes / f"{preset}-{seed}-{render_key(*told)}"
    if not (folder / "scene.toml").is_file():
        options = SimulationOptions(preset=preset, seed=seed, seconds=seconds, fps=fps, unrelated_ids=True)
        write_scene(simulate(options), folder, video=RenderOptions())
    return folder


def render_key(*options: str) -> str:
    """Of the options and of all that makes the pictures, down to the renderer's source."""
    home = Path(package.__file__).parent
    sources = [*sorted((home / "simulation").rglob("*.py")), home / "interchange" / "video_writer.py"]
    digest = hashlib.blake2b(digest_size=5)
    for part in (*options, *(f"{name} {metadata.version(name)}" for name in LIBRARIES)):
        digest.update(part.encode() + b"\0")
    for source in sources:
        digest.update(os.fsencode(source.relative_to(home)) + b"\0" + source.read_bytes())
    return digest.hexdigest()
