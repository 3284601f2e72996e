"""Cameras whose videos are one and the same file, or copies of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from passerby.perception.kept import fingerprint
from passerby.perception.video import VideoInfo
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene


def faults_of_same_video(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Cameras that name one and the same file, or a copy of it: a slip of the pen, as a rule."""
    first: dict[Path, str] = {}
    copied: dict[tuple[int, str], tuple[str, Path]] = {}
    faults = []
    for reading in readings:
        if reading.video is None:
            continue
        owners = {first.setdefault(path.resolve(), reading.name): path for path in reading.video.files}
        other = next((name for name in owners if name != reading.name), None)
        if other is not None:
            faults.append(
                f"{scene.place}: [cameras.{reading.name}] video {owners[other].name} is camera {other}'s too: give each "
                "camera its own"
            )
            continue
        own = reading.video.files[0]
        name, path = copied.setdefault(_content(reading.video), (reading.name, own))
        if name != reading.name:
            faults.append(
                f"{scene.place}: [cameras.{reading.name}] video {own.name} has the same content as {path.name} of camera "
                f"{name}: give each camera its own"
            )
    return faults


def _content(video: VideoInfo) -> tuple[int, str]:
    """What tells a video's first file from others; of images its path, since cameras may begin with equal ones."""
    path = video.files[0]
    if video.pieces and video.pieces[0].info is None:
        return 0, str(path)
    try:
        found = fingerprint(path)
    except OSError:
        return 0, str(path)
    return found["bytes"], found["digest"]
