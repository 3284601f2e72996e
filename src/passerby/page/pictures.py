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
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import source_of

KEPT = 64
"""Pictures at once: some 20 MB."""
QUALITY = 88
MOST_PIXELS = 5e7
"""Of one picture: larger ones are not decoded."""
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
    _videos: dict[tuple[str, str], VideoInfo | str] = field(default_factory=dict)
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
            found = still(info, number, number.astype(np.float64))
            if found is None:
                raise InputError(f"camera {camera}: the video has no picture at frame {frame}")
            done, data = cv2.imencode(".jpg", found.picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            if not done:
                raise InputError(f"camera {camera}: the picture cannot be shown")
            self._kept[key] = Still(data.tobytes(), found.number)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return self._kept[key]

    def _video(self, scene: Scene, version: str, camera: str) -> VideoInfo:
        key = version, camera
        if key not in self._videos:
            source = source_of(scene, camera)
            try:
                self._videos[key] = open_source(source, camera).info if source is not None else f"camera {camera} has no video"
            except InputError as error:
                self._videos[key] = str(error)
        found = self._videos[key]
        if isinstance(found, str):
            raise InputError(found)
        return found
