"""Videos to try perception on: rendered scenes, which are kept as they are expensive, and a long video made of a short one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import numpy as np

from paper.rendered import FPS, SECONDS, render_key, rendered
from passerby.core.cameras import Camera, Rig
from passerby.interchange.video_writer import VideoWriter
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.rendering import RenderOptions
from passerby.simulation.rendering.camera import camera_job, pictures

__all__ = ["FPS", "LARGE", "LARGE_FPS", "SECONDS", "large_video", "render_key", "rendered", "repeated"]

LARGE, LARGE_FPS, LARGE_SECONDS = (1920, 1080), 25.0, 20.0


def large_video(scenes: Path) -> Path:
    """A video of 1920 x 1080 pixels of the construction site."""
    path = scenes / f"large-{render_key(str(LARGE), str(LARGE_FPS), str(LARGE_SECONDS))}.mp4"
    if not path.is_file():
        scene = simulate(SimulationOptions(preset="construction", fps=LARGE_FPS, seconds=LARGE_SECONDS))
        scene = replace(scene, rig=Rig(tuple(_enlarged(camera) for camera in scene.rig)))
        with VideoWriter(path, LARGE, LARGE_FPS) as video:
            for picture in pictures(camera_job(scene, scene.rig.names[0], RenderOptions())):
                video.write(picture)
    return path


def repeated(video: Path, seconds: float, into: Path) -> Path:
    """The video again and again, its packets as they are, until it is so long."""
    length = LARGE_SECONDS
    with av.open(str(into), "w", options={"movflags": "+faststart"}) as target:
        stream = None
        for turn in range(round(seconds / length)):
            with av.open(str(video)) as source:
                own = source.streams.video[0]
                stream = stream or target.add_stream_from_template(own)
                for packet in source.demux(own):
                    if packet.dts is None or packet.pts is None or own.time_base is None:
                        continue
                    later = round(turn * length / own.time_base)
                    packet.pts, packet.dts, packet.stream = packet.pts + later, packet.dts + later, stream
                    target.mux(packet)
    return into


def _enlarged(camera: Camera) -> Camera:
    """The same view with more pixels: as wide, and as high as the new shape makes it."""
    lens = camera.lens
    matrix, scale = np.array(lens.matrix), LARGE[0] / lens.size[0]
    matrix[:2] *= scale
    matrix[:2, 2] = [scale * (part + 0.5) - 0.5 for part in lens.matrix[:2, 2]]
    return replace(camera, lens=replace(lens, size=LARGE, matrix=matrix))
