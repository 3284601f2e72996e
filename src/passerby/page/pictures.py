"""Pictures of the cameras' videos, in full size: each found by a key frame, decoded once, kept as JPEG."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.perception.sources.recording import open_source
from passerby.perception.video import VideoInfo
from passerby.perception.video_still import still
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import align_wall_clocks, chosen_span, source_of

KEPT = 64
"""Pictures at once: some 20 MB."""
QUALITY = 88
MOST_PIXELS = 5e7
"""Of one picture: larger ones are not decoded."""
MOST_DECODED = 4e8
"""Pixels for one picture: two seconds' work, which reaches 190 pictures of 1920 x 1080 behind a key frame."""
REACH = 250
"""Frames before the requested one that will do where it cannot be decoded in time."""


@dataclass(frozen=True)
class Still:
    """One picture of a camera."""

    jpeg: bytes
    frame: int
    """Its number, as the camera counts."""


@dataclass(eq=False)
class PictureStore:
    """The pictures of the scenes that a page shows."""

    _kept: OrderedDict[tuple[str, str, int], Still] = field(default_factory=OrderedDict)
    _videos: tuple[str, dict[str, VideoInfo | str]] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def video(self, scene: Scene, version: str, camera: str) -> VideoInfo:
        """A camera's video. Raises `InputError` where it has none, or it cannot be read."""
        with self._lock:
            return self._video(scene, version, camera)

    def still(self, scene: Scene, version: str, camera: str, frame: int) -> Still:
        """The picture nearest to a frame, at it or before. Raises `InputError` as `video` does, or where there is none."""
        key = version, camera, frame
        with self._lock:  # one at a time: decoding takes all cores
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
            info = self._video(scene, version, camera)
            if info.size[0] * info.size[1] > MOST_PIXELS:
                raise InputError(f"camera {camera}: pictures of {info.size[0]} x {info.size[1]} are too large to be shown")
            number = np.arange(max(1, frame - REACH), frame + 1, dtype=np.int64)
            found = still(info, number, number.astype(np.float64), MOST_DECODED)
            if found is None:
                raise InputError(f"camera {camera}: the video has no picture at frame {frame}")
            done, data = cv2.imencode(".jpg", found.picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            if not done:
                raise InputError(f"camera {camera}: the picture cannot be shown")
            self._kept[key] = self._kept[version, camera, found.number] = Still(data.tobytes(), found.number)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return self._kept[key]

    def _video(self, scene: Scene, version: str, camera: str) -> VideoInfo:
        if self._videos is None or self._videos[0] != version:
            self._videos = version, open_videos(scene)
        found = self._videos[1][camera]
        if isinstance(found, str):
            raise InputError(found)
        return found


def open_videos(scene: Scene) -> dict[str, VideoInfo | str]:
    """By camera its video, whose frames count as a calibration counts them, or why there is none to be shown."""
    readings = [CameraInput(name, fps=scene.fps_of(name)) for name in scene.cameras]
    why: dict[str, str] = {}
    try:
        span = chosen_span(scene)
    except InputError as error:
        return {name: str(error) for name in scene.cameras}
    for reading in readings:
        try:
            source = source_of(scene, reading.name, span)
            if source is not None:
                reading.video = open_source(source, reading.name).info
        except InputError as error:
            why[reading.name] = str(error)
    align_wall_clocks(scene, readings)
    return {one.name: one.video or why.get(one.name, f"camera {one.name} has no video") for one in readings}
