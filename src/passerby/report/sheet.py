"""The sheet on which a camera's layers are drawn: lines and text over an image of its video, or over a blank canvas.

Coordinates are those of the camera's pixels; their origin is the middle of the first pixel.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.observations import UNKNOWN
from passerby.perception.pictures import Picture, VideoError
from passerby.perception.sources.recording import open_source
from passerby.perception.video import fit_of_size
from passerby.perception.video_still import still
from passerby.report.contents import Contents
from passerby.report.rendering import short

TEXT_SHARE = 1 / 40
"""Height of the letters, as a share of the picture's width."""
MOST_TEXT = 40
WIDEST_PX = 960
QUALITIES = (82, 72, 62, 50, 40, 30, 20, 12)
MOST_CHARACTERS = 100_000
"""Most characters of a picture in the page: 16 such pictures take less than plotly's code."""
FIRST_FRAME = 1


@dataclass(frozen=True, eq=False)
class Backdrop:
    """The image behind a camera's drawing, or a blank canvas."""

    frame: int
    """Frame of the camera whose people are drawn."""
    uri: str | None
    """The picture as a data URI; None for a blank canvas."""
    size: tuple[int, int]
    """Width and height that the picture covers, pixels of the camera."""
    note: str | None
    """Reason for a blank canvas; None with a picture."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """Values that all layers of one drawing share."""

    camera: Camera
    backdrop: Backdrop
    ink: str
    """Colour of lines that belong to no person."""

    @property
    def letters(self) -> float:
        """Height of letters, pixels of the camera."""
        return round(self.camera.lens.size[0] * TEXT_SHARE, 1)


@dataclass(frozen=True)
class Label:
    """A text of a drawing, and the position of its beginning."""

    words: str
    x: str
    y: str


def label_at(words: str, xy: Sequence[float], most: int = MOST_TEXT) -> Label:
    """Return text at a pixel, on one line, shortened if it is too long."""
    return Label(clip_text(words, most), short(xy[0]), short(xy[1]))


def clip_text(words: str, most: int = MOST_TEXT) -> str:
    """Return text on one line that is valid in XML, shortened if it is too long for a drawing."""
    plain = "".join(letter if letter.isprintable() else " " for letter in words)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def path_of(points: Floats) -> str:
    """Return pixels (K, 2) as an SVG path of straight strokes."""
    return "M" + "L".join(f"{short(x)} {short(y)}" for x, y in points.tolist())


def keep_in_picture(sheet: Sheet, xy: Sequence[float] | Floats) -> tuple[float, float]:
    """Move the beginning of a text so that it stays in the picture."""
    width, height = sheet.camera.lens.size
    x, y = float(xy[0]), float(xy[1])
    return min(max(x, 0.3 * sheet.letters), width - 1.5 * sheet.letters), min(
        max(y, 1.1 * sheet.letters), height - 0.4 * sheet.letters
    )


def dot_path(xy: Floats, radius: float) -> str:
    """Return a disc as an SVG path: many discs in one path element take a third of the bytes of separate elements."""
    x, y, r = float(xy[0]), float(xy[1]), short(radius)
    return f"M{short(x - radius)} {short(y)}a{r} {r} 0 1 0 {short(2 * radius)} 0a{r} {r} 0 1 0 {short(-2 * radius)} 0"


def offset_words(offset: Floats) -> str:
    """Write an offset (2,), pixels to the right and down, in words."""
    right, down = offset.tolist()
    return f"{abs(right):.1f} px {'right' if right >= 0 else 'left'} and {abs(down):.1f} px {'down' if down >= 0 else 'up'}"


def backdrop(contents: Contents, name: str) -> Backdrop:
    """Return the image on which a camera's people are drawn. The note reports a missing or broken video; no error is raised."""
    camera = contents.rig[name]
    frames, worth = _count_people(contents, camera)
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
    """Encode a picture (H, W, 3), BGR, as a data URI of a JPEG, scaled down until it has at most `MOST_CHARACTERS`."""
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


def _count_people(contents: Contents, camera: Camera) -> tuple[Ints, Floats]:
    """Return the frames (F,) with people, and the weighted number (F,) of people in each; the first frame if there are none.

    A whole box counts 1, a box that the border cuts off 0.1, a set of joints 0.5; unidentified people count a hundredth of it.
    """
    seen = contents.observations.cameras.get(camera.name)
    if seen is None or not len(seen.boxes) + len(seen.keypoints):
        return np.array([FIRST_FRAME]), np.zeros(1)
    frame = np.concatenate([seen.boxes.frame, seen.keypoints.frame])
    value = np.concatenate([np.where(seen.boxes.inside(camera.lens.size), 1.0, 0.1), np.full(len(seen.keypoints), 0.5)])
    value *= np.where(np.concatenate([seen.boxes.identity, seen.keypoints.identity]) == UNKNOWN, 0.01, 1.0)
    frames, number = np.unique(frame, return_inverse=True)
    return frames.astype(np.int64), np.bincount(number.ravel(), value).astype(np.float64)
