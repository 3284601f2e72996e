"""Cameras whose files are one and the same, or copies of it: of videos, boxes, joints and embeddings.

Only files of one size are read for it.
"""

from __future__ import annotations

import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from passerby.perception.kept import fingerprint
from passerby.perception.video import VideoInfo
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

FEWEST_ROWS = 10
"""Fewer may be equal in two cameras: a detector that sees a person in the first, empty images, the same in each."""


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


@dataclass(frozen=True)
class _Named:
    """A file that a camera names."""

    camera: str
    key: str
    """Of the scene file."""
    written: Path
    """As the scene file has it."""
    path: Path
    rows: int
    """0 where they are not used."""


def faults_of_same_file(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Cameras that name one and the same file of boxes, joints or embeddings, or a copy of it."""
    first: dict[Path, _Named] = {}
    faults = []
    for one in _named(scene, readings):
        # Unlike `Path.resolve` it bears links that lead in a circle, which reading has reported.
        other = first.setdefault(Path(os.path.realpath(one.path)), one)
        if other.camera != one.camera:
            faults.append(
                f"{scene.place}: [cameras.{one.camera}] {one.key} {one.path.name} is camera {other.camera}'s too: give each "
                "camera its own"
            )
    for one, other in _copies([one for one in first.values() if one.rows >= FEWEST_ROWS]):
        faults.append(
            f"{scene.place}: [cameras.{one.camera}] {one.key} {one.written} has the same content as {other.written} of camera "
            f"{other.camera}: give each camera its own"
        )
    return faults


def _named(scene: Scene, readings: Sequence[CameraInput]) -> Iterator[_Named]:
    """The files that cameras name; those of arrays in memory do not exist."""
    for reading in readings:
        table = scene.cameras[reading.name]
        for key in ("tracks", "detections", "keypoints", "embeddings"):
            written: Path | None = getattr(table, key)
            if written is None or not (path := scene.resolve(written)).is_file():
                continue
            used = path == reading.keypoints_path if key == "keypoints" else path == reading.boxes_path or key == "embeddings"
            rows = reading.keypoints if key == "keypoints" else reading.boxes
            yield _Named(reading.name, key, written, path, len(rows) if used else 0)


def _copies(files: Sequence[_Named]) -> Iterator[tuple[_Named, _Named]]:
    """Files with the content of another camera's, each with the first of these."""
    by_size: dict[int, list[_Named]] = defaultdict(list)
    for one in files:
        by_size[one.path.stat().st_size].append(one)
    for same in by_size.values():
        first: dict[str, _Named] = {}
        for one in same if len(same) > 1 else ():
            with one.path.open("rb") as file:
                other = first.setdefault(hashlib.file_digest(file, "blake2b").hexdigest(), one)
            if other.camera != one.camera:
                yield one, other


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
