"""Alternatives about what one camera's observations are, constant through the recording.

A local refit cannot reach them: a mirrored image belongs to a camera that stands elsewhere. Each is a way of reading the
camera's observations, after which the camera is registered anew (`registration`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from passerby.core.cameras import Lens
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations, extents_of
from passerby.core.quarter_turns import turn_seen
from passerby.core.synchronisation import resample_to_common_steps

SITES_WRONG: Mapping[str, float] = MappingProxyType({
    "image_mirrored": 0.005, "image_overturned": 0.005, "image_turned": 0.01, "smaller_image": 0.03, "clock_late": 0.05,
})  # fmt: skip
"""Share of sites in which one camera's observations are wrong in this respect: recorders and drivers mirror few images, some
cameras hang upside down, detectors run on second streams, and clocks are set by hand."""
SUB_STREAMS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3)
"""Width and height of usual second streams over those of the main one, as far as people in them keep to a corner of it."""
FEWEST, STRAY, STRIP = 100, 0.001, 0.0125
"""Observations that show which part of the image is used; share of them that a tracker predicts past the border; and share of
an image's size by which boxes that are cut off by its border reach beyond it."""

View = tuple[Lens, CameraObservations]


@dataclass(frozen=True, eq=False)
class Reading:
    """One camera's observations read differently."""

    code: str
    camera: int
    """Index."""
    log_prior: float
    """Logarithm of its prior odds against the observations as stated; a site has one prior, shared by its cameras."""
    read: Callable[[Lens, CameraObservations], View]
    """The lens and what the camera saw, at common time steps, from those as stated. Pixels of images of another size stay, and
    the lens changes: the measured values are the same, so that likelihoods compare."""
    anew: bool = True
    """Whether the pose is sought from nothing; else from the one it has."""
    correctable: bool = False
    late_s: float | None = None
    """Seconds that the camera shows the world after its clock."""
    share: float | None = None
    """Width of the smaller image over that of the stated one."""


def image_readings(camera: int, n_cameras: int, lens: Lens, seen: CameraObservations) -> list[Reading]:
    """Images that are mirrored left to right, flipped top to bottom, turned by 180 degrees, or smaller than stated."""

    def reading(code: str, read: Callable[[Lens, CameraObservations], View], share: float | None = None) -> Reading:
        return Reading(code, camera, float(np.log(SITES_WRONG[code] / n_cameras)), read, share=share)

    found = [
        reading("image_mirrored", lambda lens, seen: (lens, mirrored(seen, lens.size))),
        reading("image_overturned", lambda lens, seen: (lens, turn_seen(mirrored(seen, lens.size), lens.size, 180))),
        reading("image_turned", lambda lens, seen: (lens, turn_seen(seen, lens.size, 180))),
    ]
    share = possible_share(seen, lens.size)
    if share is not None:
        found.append(reading("smaller_image", lambda lens, seen: (smaller(lens, share), seen), share))
    return found


def late_clock(camera: int, n_cameras: int, late_s: float, fps: float, *, correctable: bool) -> Reading:
    """A camera that shows the world so much later than its clock says."""

    def read(lens: Lens, seen: CameraObservations) -> View:
        name, steps = "camera", Clock(fps)
        moved = {name: Clock(fps, -late_s)}
        only = Observations({name: seen}, fps)
        return lens, resample_to_common_steps(only, moved, sizes={name: lens.size}, grid=steps)[name]

    prior = float(np.log(SITES_WRONG["clock_late"] / n_cameras))
    return Reading("clock_late", camera, prior, read, anew=False, correctable=correctable, late_s=late_s)


def mirrored(seen: CameraObservations, size: tuple[int, int]) -> CameraObservations:
    """What a camera saw with left and right of its images of a size (width, height) exchanged."""
    right = size[0] - 1.0

    def points(keypoints: Keypoints) -> Keypoints:
        xy = np.stack([right - keypoints.xy[..., 0], keypoints.xy[..., 1]], axis=-1)
        return replace(keypoints, xy=xy)

    ltwh = np.array(seen.boxes.ltwh)
    ltwh[:, 0] = right - ltwh[:, 0] - ltwh[:, 2]
    boxes: Boxes = replace(seen.boxes, ltwh=ltwh)
    return CameraObservations(boxes, points(seen.keypoints), points(seen.wands))


def possible_share(seen: CameraObservations, size: tuple[int, int]) -> float | None:
    """The smallest usual share of the image's size within which all people lie; None where they fill it."""
    extent = extents_of(seen.boxes if len(seen.boxes) else seen.keypoints)
    if len(extent) < FEWEST:
        return None
    filled = float((np.quantile(extent[:, 2:], 1 - STRAY, axis=0) / size).max())
    return next((share for share in SUB_STREAMS if filled <= share * (1 + STRIP)), None)


def smaller(lens: Lens, share: float) -> Lens:
    """The lens for images of that share of the size."""
    matrix = np.array(lens.matrix)
    matrix[:2] *= share
    return replace(lens, size=(round(share * lens.size[0]), round(share * lens.size[1])), matrix=matrix)
