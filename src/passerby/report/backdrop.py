"""What lies behind a camera's drawing: the picture of its video in which most people are seen, or nothing, with the reason."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import cv2
import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.observations import UNKNOWN
from passerby.perception.pictures import Picture
from passerby.perception.sources.recording import open_source
from passerby.perception.video import fit_of_size
from passerby.perception.video_error import VideoError
from passerby.perception.video_still import still
from passerby.report.contents import Contents

WIDEST_PX = 960
QUALITIES = (82, 72, 62, 50, 40, 30, 20, 12)
MOST_CHARACTERS = 100_000
"""Of a picture as it stands in the page: 16 of them take less than plotly's code."""
FIRST_FRAME = 1


@dataclass(frozen=True, eq=False)
class Backdrop:
    """A picture, or none."""

    frame: int
    """Of the camera's own frames: the one whose people are drawn."""
    uri: str | None
    """The picture as a data URI; None for a blank canvas."""
    size: tuple[int, int]
    """Width and height that it covers, pixels of the camera."""
    note: str | None
    """Why there is none."""


def backdrop(contents: Contents, name: str) -> Backdrop:
    """The picture that a camera's people are drawn on. A video that is missing or broken is reported, not raised."""
    camera = contents.rig[name]
    frames, worth = _worth(contents, camera)
    best = int(frames[np.argmax(worth)])
    blank = Backdrop(best, None, camera.lens.size, "no video of this camera")
    source = contents.videos.get(name)
    if source is None:
        return blank
    try:
        info = open_source(source, name).info
        fit_of_size(info.size, camera.lens.size, info.rotation)
        found = still(info, frames, worth)
    except VideoError as error:
        return Backdrop(best, None, camera.lens.size, f"no image: {error.what}")
    except InputError as error:
        return Backdrop(best, None, camera.lens.size, f"no image: {error}")
    except OSError as error:
        return Backdrop(best, None, camera.lens.size, f"no image: {error.strerror or 'the video cannot be read'}")
    if found is None:
        return Backdrop(best, None, camera.lens.size, f"no image: the video has no frame {best}")
    return Backdrop(found.number, data_uri(found.picture), info.size, None)


def data_uri(picture: Picture) -> str:
    """A picture (H, W, 3), BGR, as JPEG of at most `MOST_CHARACTERS`, scaled down until it is so small."""
    width = min(WIDEST_PX, picture.shape[1])
    while True:
        height = max(1, round(picture.shape[0] * width / picture.shape[1]))
        small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        for quality in QUALITIES:
            data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
            uri = "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")
            if len(uri) <= MOST_CHARACTERS:
                return uri
        width = max(1, width * 2 // 3)


def _worth(contents: Contents, camera: Camera) -> tuple[Ints, Floats]:
    """Frames in which the camera saw a person, and how many whole people it did; the first frame if there is none.

    A person whose box the border cuts off counts a tenth.
    """
    seen = contents.observations.cameras.get(camera.name)
    if seen is None or not len(seen.boxes) + len(seen.keypoints):
        return np.array([FIRST_FRAME]), np.zeros(1)
    frame = np.concatenate([seen.boxes.frame, seen.keypoints.frame])
    value = np.concatenate([np.where(seen.boxes.inside(camera.lens.size), 1.0, 0.1), np.full(len(seen.keypoints), 0.5)])
    value *= np.where(np.concatenate([seen.boxes.identity, seen.keypoints.identity]) == UNKNOWN, 0.01, 1.0)
    frames, number = np.unique(frame, return_inverse=True)
    return frames.astype(np.int64), np.bincount(number.ravel(), value).astype(np.float64)
