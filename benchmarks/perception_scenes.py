"""Videos to try perception on: rendered scenes, which are kept as they are expensive, and a long video made of a short one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import numpy as np

from paper.rendered import FPS, SECONDS, render_key, rendered
from passerby.core.cameras import Camera, Rig
from passerby.interchange.video_writer import VideoWriter
from passerby.simulation import SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from passerby.simulation.rendering.camera import camera_job, pictures
from reliability.room import FPS as FPS_OF_ROOM
from reliability.room import RoomOptions, room_motion, room_rig

__all__ = [
    "FPS", "LARGE", "LARGE_FPS", "ROOM_FPS", "ROOM_SECONDS", "SECONDS", "large_video", "render_key", "rendered",
    "rendered_room", "repeated",
]  # fmt: skip

ROOM_SECONDS, ROOM_FPS = 27.0, FPS_OF_ROOM
LARGE, LARGE_FPS, LARGE_SECONDS = (1920, 1080), 25.0, 20.0


def rendered_room(scenes: Path, seed: int) -> Path:
    """Folder of a room's videos and its true cameras: two people walk and one sits, on the terrace's paving."""
    told = ("room", str(seed), f"{ROOM_SECONDS:g}", f"{ROOM_FPS:g}")
    folder = scenes / f"room-{seed}-{render_key(*told)}"
    if not (folder / "scene.toml").is_file():
        room = RoomOptions(seed, ROOM_SECONDS)
        people = room.walkers + room.seated
        scene = simulate(
            SimulationOptions(
                preset="terrace", seed=seed, people=people, seconds=ROOM_SECONDS, fps=ROOM_FPS, unrelated_ids=True
            )
        )
        heights = np.array([scene.heights[identity] for identity in scene.identities.tolist()])
        motion = room_motion(room, heights, np.random.default_rng((seed, 3)))
        # Boxes and joints of the scene remain those of the terrace: only the videos and the true cameras are used.
        write_scene(replace(scene, rig=room_rig(seed), motion=motion), folder, video=RenderOptions())
    return folder


def large_video(scenes: Path, key_every_s: float | None = None) -> Path:
    """A video of 1920 x 1080 pixels of the construction site; seconds between key frames, ten where None."""
    keys = () if key_every_s is None else (f"{key_every_s:g}",)
    path = scenes / f"large-{render_key(str(LARGE), str(LARGE_FPS), str(LARGE_SECONDS), *keys)}.mp4"
    if not path.is_file():
        scene = simulate(SimulationOptions(preset="construction", fps=LARGE_FPS, seconds=LARGE_SECONDS))
        scene = replace(scene, rig=Rig(tuple(_enlarged(camera) for camera in scene.rig)))
        key_every = round(LARGE_FPS * (10.0 if key_every_s is None else key_every_s))
        with VideoWriter(path, LARGE, LARGE_FPS, key_every=key_every) as video:
            for picture in pictures(camera_job(scene, scene.rig.names[0], RenderOptions())):
                video.write(picture)
    return path


def repeated(video: Path, seconds: float, into: Path, length: float = LARGE_SECONDS) -> Path:
    """The video of some length again and again, its packets as they are, until it is so long."""
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
