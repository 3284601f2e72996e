"""Data types that the stages of perception exchange, and the interfaces of the stages.

Pictures are (H, W, 3) of uint8, BGR as in OpenCV. Boxes are left, top, width, height in pixels of the whole picture, with
OpenCV's origin, the middle of the first pixel. Only `Detections` count from that pixel's outer corner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.observations import Vectors

Picture = NDArray[np.uint8]
Identity = Mapping[str, Any]
"""Settings that determine a stage's results, as plain values for JSON: its name, its options, the checksum of its network. Two
stages with the same identity give the same results for the same pictures."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a video."""

    number: int
    """From 1, by the clock of the video: see `passerby.perception.video.VideoInfo.clock_fps`."""
    seconds: float
    """Its timestamp, seconds from the video's first picture."""
    picture: Picture


@dataclass(frozen=True, eq=False)
class Detections:
    """The people found in one picture."""

    ltwh: Floats
    """(N, 4) left, top, width, height, pixels; within the picture, from (0, 0) to (width, height)."""
    score: Floats
    """(N,) confidence, 0 to 1."""

    @property
    def centred(self) -> Floats:
        """(N, 4) the boxes as cameras project: (0, 0) is the middle of the first pixel, half a pixel from its corner."""
        return np.asarray(self.ltwh - np.array([0.5, 0.5, 0.0, 0.0]))

    @classmethod
    def none(cls) -> Detections:
        """Return no detections."""
        return cls(np.zeros((0, 4)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.score)


class Detector(Protocol):
    """Finds people in pictures; the result for one picture does not depend on the pictures before it."""

    @property
    def identity(self) -> Identity:
        """Settings that determine its results."""

    def __call__(self, frame: Frame) -> Detections:
        """Find the people in a frame."""


class Embedder(Protocol):
    """Describes the appearance of people."""

    @property
    def identity(self) -> Identity:
        """Settings that determine its results."""

    @property
    def dimensions(self) -> int:
        """Length of a vector."""

    def __call__(self, picture: Picture, ltwh: Floats) -> Vectors:
        """Compute unit vectors (N, D) of the boxes (N, 4); a row of zeros if unknown."""


class KeypointEstimator(Protocol):
    """Finds the joints of people whose boxes are known."""

    @property
    def identity(self) -> Identity:
        """Settings that determine its results."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the J joints."""

    def __call__(self, picture: Picture, ltwh: Floats) -> tuple[Floats, Floats]:
        """Find joints (N, J, 2), pixels of the whole picture, with confidence (N, J), 0 to 1, 0 for one not found."""


class VideoError(InputError):
    """A video cannot be read, or not as required (exit status 2)."""

    def __init__(self, path: Path, what: str) -> None:
        """Compose the message from the file and `what`, which states the error and its remedy."""
        super().__init__(f"{path}: {what}")
        self.path, self.what = path, what

    def __reduce__(self) -> tuple[type[VideoError], tuple[Path, str]]:
        # An exception that another process raised is built again from its arguments.
        return type(self), (self.path, self.what)
