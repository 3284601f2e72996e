"""Footage of a later day for the pictures of the local page: the cameras of the demonstration, one of them turned meanwhile."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from itertools import islice
from pathlib import Path

from passerby.interchange.video_writer import VideoWriter
from passerby.simulation import SimulationOptions, simulate, write_scene
from passerby.simulation.disturbances import Move, film_disturbed, rig_after
from passerby.simulation.rendering import RenderOptions
from passerby.simulation.rendering.camera import render_camera

SECONDS, FPS = 180.0, 2.0
MOVE = Move("C2", 100.0, turn_deg=(0.5, 3.0, 0.0))


def monitor_turned(out: Path, folder: Path) -> Path:
    """Film the cameras of a demonstration again and monitor its rig; returns the folder of `passerby monitor`."""
    options = SimulationOptions(preset="terrace", seconds=SECONDS, fps=FPS, box_noise=0.02)
    before = simulate(options, film_disturbed(options, [MOVE]))
    after = dataclasses.replace(before, rig=rig_after(before.rig, [MOVE]))
    scene = write_scene(before, folder / "today")
    text = scene.read_text()
    for name in before.rig.names:
        first = round(MOVE.from_s * FPS) if name == MOVE.camera else None
        with VideoWriter(scene.parent / f"{name}.mp4", before.rig[name].lens.size, FPS) as video:
            for picture in islice(render_camera(before, name, RenderOptions()), first):
                video.write(picture)
            for picture in islice(render_camera(after, name, RenderOptions()), first, None) if first else ():
                video.write(picture)
        text = text.replace(f"[cameras.{name}]\n", f'[cameras.{name}]\nvideo = "{name}.mp4"\n')
    scene.write_text(text)
    command = [sys.executable, "-m", "passerby", "monitor", str(out), str(scene), "-o", str(folder / "checked"), "--in-step"]
    subprocess.run(command, check=False)  # 3: a camera has moved
    return folder / "checked"
