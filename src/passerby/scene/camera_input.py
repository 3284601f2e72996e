"""Input of one camera: the content of its files, with their faults and findings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens
from passerby.core.observations import UNKNOWN, WAND_ENDS, Boxes, CameraObservations, Keypoints
from passerby.core.quarter_turns import turn_lens, turn_pixels, turn_seen, turn_size
from passerby.findings.finding import Finding
from passerby.perception.video import VideoInfo

LensSource = Literal["file", "hfov_deg", "focal_mm", "focal_35mm", "metadata", "lens_network", "people"]


@dataclass(frozen=True)
class KnownLens:
    """The source of a lens."""

    source: LensSource
    """file: intrinsics; hfov_deg, focal_mm, focal_35mm: this key of the scene file; metadata: metadata of the video;
    lens_network: the estimate of a network from the video; people: only the image size is known.
    """
    place: str
    """The file that states the lens."""
    same_as: str | None = None
    """The camera of the same model that has this lens; None: it is the camera's own."""


@dataclass(eq=False)
class CameraInput:
    """The data of one camera, as far as they could be read."""

    name: str
    given: bool = True
    """Whether the ids are global identities (mode "given"); else they are this camera's own tracklet numbers."""
    rotate: int = 0
    """Degrees clockwise by which its images were turned: lens, boxes, keypoints and video here refer to the turned images."""
    lens: Lens | None = None
    lens_source: KnownLens | None = None
    """Source of the lens; None if there is no lens, or it came from memory."""
    boxes: Boxes = field(default_factory=Boxes.empty)
    """The boxes that are used, with their embeddings, in the order of their file."""
    boxes_path: Path | None = None
    """The file of the boxes: `tracks`, or else `detections` if identities are not given."""
    keypoints: Keypoints = field(default_factory=Keypoints.empty)
    keypoints_path: Path | None = None
    wands: Keypoints = field(default_factory=lambda: Keypoints.empty(WAND_ENDS))
    """Ends of the wands of the scene file; `keypoints` does not contain them."""
    fps: float | None = None
    """Frames per second of the frame numbers."""
    video: VideoInfo | None = None
    awaiting: bool = False
    """Whether people must still be detected in the video."""
    unprocessed: tuple[tuple[float, float], ...] = ()
    """Parts of the video that were not processed, seconds from frame 1 by its own clock."""
    faults: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    """Unusual facts about these files, which do not stop a calibration."""
    doubts: list[Finding] = field(default_factory=list)
    """Evidence against any rig from these files."""

    def copy(self) -> CameraInput:
        """Return a copy with its own lists, which can be completed without a change of this one."""
        return replace(self, faults=list(self.faults), findings=list(self.findings), doubts=list(self.doubts))

    @property
    def filmed_size(self) -> tuple[int, int] | None:
        """(width, height) of the images as filmed, to which the pixels of the scene file refer; None if it is unknown."""
        return None if self.lens is None else turn_size(self.lens.size, self.rotate)

    @property
    def filmed_lens(self) -> Lens | None:
        """The lens of the images as filmed; None if there is none."""
        return None if self.lens is None else turn_lens(self.lens, -self.rotate)

    @property
    def filmed_people(self) -> CameraObservations:
        """All boxes and keypoints, in the images as filmed."""
        size = (0, 0) if self.lens is None else self.lens.size
        return turn_seen(CameraObservations(self.boxes, self.keypoints), size, 0 if self.lens is None else -self.rotate)

    def upright(self, pixels: ArrayLike) -> Floats:
        """Convert pixels (..., 2) of the images as filmed to pixels of the turned images."""
        size = self.filmed_size
        given = np.asarray(pixels, dtype=np.float64)
        return given if size is None or not self.rotate else turn_pixels(given, size, self.rotate)

    def filmed(self, pixels: ArrayLike) -> Floats:
        """Convert pixels (..., 2) of the turned images to pixels of the images as filmed."""
        given = np.asarray(pixels, dtype=np.float64)
        return given if self.lens is None or not self.rotate else turn_pixels(given, self.lens.size, -self.rotate)

    @property
    def seen(self) -> CameraObservations:
        """The observations from which a calibration starts; in mode "given" only those with a known identity."""
        if not self.given:
            return CameraObservations(self.boxes, self.keypoints, self.wands)
        known = self.boxes.take(self.boxes.identity > UNKNOWN), self.keypoints.take(self.keypoints.identity > UNKNOWN)
        return CameraObservations(*known, self.wands)

    @property
    def people(self) -> int:
        """Number of rows of boxes and joints."""
        return len(self.boxes) + len(self.keypoints)

    @property
    def frames(self) -> Ints:
        """(N,) the distinct frames with people in them, in order."""
        return np.asarray(np.unique(np.concatenate([self.boxes.frame, self.keypoints.frame])))

    @property
    def dimensions(self) -> int | None:
        """Dimensions of the boxes' embeddings; None if there are none."""
        return None if self.boxes.embedding is None else self.boxes.embedding.shape[1]
