"""Pictures of the cameras' videos, in full size. Each is decoded once, from a key frame on, and kept as JPEG."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.recording import open_source
from passerby.perception.video import VideoInfo
from passerby.perception.video_still import still
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import align_wall_clocks, choose_span, source_of

KEPT = 64
"""Most pictures in memory: some 20 MB."""
QUALITY = 88
MOST_PIXELS = 5e7
"""Most pixels of a picture: larger pictures are not decoded."""
MOST_DECODED = 4e8
"""Most pixels that are decoded for one picture. This takes two seconds and is 190 frames of 1920 x 1080 after a key frame."""
REACH = 250
"""Largest number of frames by which the shown frame may precede the requested one, if that cannot be decoded in time."""


@dataclass(frozen=True)
class Still:
    """One picture of a camera."""

    jpeg: bytes
    frame: int
    """Frame number of the camera."""


@dataclass(eq=False)
class PictureStore:
    """The pictures of the scene that a page shows. As many are decoded in parallel as there are cores, each in one thread."""

    _kept: OrderedDict[tuple[str, str, int], Still] = field(default_factory=OrderedDict)
    _videos: dict[str, VideoInfo | str] = field(default_factory=dict)
    _version: str | None = None
    """Version of the scene that `_videos` belong to."""
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _opening: dict[str, threading.Lock] = field(default_factory=dict)
    turn: threading.Semaphore = field(default_factory=lambda: threading.BoundedSemaphore(os.cpu_count() or 1))
    """Callers hold it for their calls of `video` and `still`: a request is completed before a further one is begun."""

    def video(self, scene: Scene, version: str, camera: str) -> VideoInfo:
        """Return a camera's video. Raises `InputError` if it has none, or it cannot be read."""
        with self._lock:
            if self._version != version:
                self._version, self._videos, self._opening = version, {}, {}
            # Recordings in pieces share one wall clock, and so are opened together. Others are opened when they are requested.
            alone = _is_alone(scene)
            lock = self._opening.setdefault(camera if alone else "", threading.Lock())
        with lock:
            found = self._open_video(version, camera)
            if found is None:
                opened = {camera: open_video_alone(scene, camera)} if alone else open_videos(scene)
                found = opened[camera]
                with self._lock:
                    if self._version == version:
                        self._videos |= opened
        if isinstance(found, str):
            raise InputError(found)
        return found

    def still(self, scene: Scene, version: str, camera: str, frame: int) -> Still:
        """Return the picture at a frame, or the nearest before. Raises `InputError` as `video` does, or if there is none."""
        key = version, camera, frame
        known = self.known(*key)
        if known is not None:
            return known
        info = self.video(scene, version, camera)
        found = _decode_picture(info, camera, frame)
        with self._lock:
            self._kept[key] = self._kept[version, camera, found.frame] = found
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return found

    def known(self, version: str, camera: str, frame: int) -> Still | None:
        """Return a picture that is already decoded, without waiting for `turn`; None if it is not."""
        with self._lock:
            found = self._kept.get((version, camera, frame))
            if found is not None:
                self._kept.move_to_end((version, camera, frame))
            return found

    def _open_video(self, version: str, camera: str) -> VideoInfo | str | None:
        with self._lock:
            return self._videos.get(camera) if self._version == version else None


def _decode_picture(info: VideoInfo, camera: str, frame: int) -> Still:
    """Decode the picture at a frame, or the nearest before."""
    if info.size[0] * info.size[1] > MOST_PIXELS:
        raise InputError(f"camera {camera}: pictures of {info.size[0]} x {info.size[1]} are too large to be shown")
    number = np.arange(max(1, frame - REACH), frame + 1, dtype=np.int64)
    found = still(info, number, number.astype(np.float64), MOST_DECODED)
    if found is None:
        raise InputError(f"camera {camera}: the video has no picture at frame {frame}")
    done, data = cv2.imencode(".jpg", found.picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise InputError(f"camera {camera}: the picture cannot be shown")
    return Still(data.tobytes(), found.number)


def _is_alone(scene: Scene) -> bool:
    """Check whether each video can be opened without the others: single files whose frames count from their first frame."""
    if scene.scene.from_ is not None or scene.scene.until is not None:
        return False
    sources = [source_of(scene, name) for name in scene.cameras]
    return all(source is None or source.single is not None for source in sources)


def open_video_alone(scene: Scene, camera: str) -> VideoInfo | str:
    """Open a camera's video that is a single file; return the reason as text if there is none to show."""
    try:
        source = source_of(scene, camera)
        return f"camera {camera} has no video" if source is None else _read_video(source, camera)
    except InputError as error:
        return str(error)


def _read_video(source: VideoSource, camera: str) -> VideoInfo:
    """Open a camera's video without the rotation `rotate`: boxes, clicks and rig of the page refer to the images as filmed."""
    return open_source(replace(source, rotate=0), camera).info


def open_videos(scene: Scene) -> dict[str, VideoInfo | str]:
    """Open all videos, by camera, with the frame numbers of a calibration; the value is a reason if there is none to show."""
    readings = [CameraInput(name, fps=scene.fps_of(name)) for name in scene.cameras]
    why: dict[str, str] = {}
    try:
        span = choose_span(scene)
    except InputError as error:
        return {name: str(error) for name in scene.cameras}
    for reading in readings:
        try:
            source = source_of(scene, reading.name, span)
            if source is not None:
                reading.video = _read_video(source, reading.name)
        except InputError as error:
            why[reading.name] = str(error)
    align_wall_clocks(scene, readings)
    return {one.name: one.video or why.get(one.name, f"camera {one.name} has no video") for one in readings}
