"""Alternative readings of one camera's observations, constant through the recording.

A local refit cannot reach them: a mirrored image belongs to a camera with quite another pose. Each reading changes the camera's
observations or its lens, and the camera is then registered again (`registration`).
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
"""Ratios of the size of usual second streams to that of the main one. Larger ones are not used: there, people do not keep to a
corner of the main image."""
FEWEST, STRAY, STRIP = 100, 0.001, 0.0125
"""Least number of observations that shows which part of the image is used; share of them that a tracker predicts beyond the
border; and share of an image's size by which boxes that its border cuts off reach beyond it."""

View = tuple[Lens, CameraObservations]


@dataclass(frozen=True, eq=False)
class Reading:
    """Another reading of one camera's observations."""

    code: str
    camera: int
    """Index of the camera."""
    log_prior: float
    """Logarithm of its prior odds against the observations as stated; a site has one prior, shared by its cameras."""
    read: Callable[[Lens, CameraObservations], View]
    """Function from the stated lens and observations, at common time steps, to those of the reading. For images of another
    size, pixels stay and the lens changes: the measured values are the same, so that likelihoods can be compared."""
    anew: bool = True
    """Whether the pose is searched for without an initial one; else from the present one."""
    correctable: bool = False
    late_s: float | None = None
    """Delay of the camera's pictures relative to its clock, seconds; None for other readings."""
    share: float | None = None
    """Ratio of the width of the smaller image to that of the stated one; None for other readings."""


def image_readings(camera: int, n_cameras: int, lens: Lens, seen: CameraObservations) -> list[Reading]:
    """Return the readings as images mirrored left to right, flipped top to bottom, turned by 180 degrees, or smaller."""

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
    """Return the reading as a camera that shows the world `late_s` seconds later than its clock states."""

    def read(lens: Lens, seen: CameraObservations) -> View:
        name, steps = "camera", Clock(fps)
        moved = {name: Clock(fps, -late_s)}
        only = Observations({name: seen}, fps)
        return lens, resample_to_common_steps(only, moved, sizes={name: lens.size}, grid=steps)[name]

    prior = float(np.log(SITES_WRONG["clock_late"] / n_cameras))
    return Reading("clock_late", camera, prior, read, anew=False, correctable=correctable, late_s=late_s)


def mirrored(seen: CameraObservations, size: tuple[int, int]) -> CameraObservations:
    """Exchange left and right in a camera's observations, in images of a size (width, height)."""
    right = size[0] - 1.0

    def points(keypoints: Keypoints) -> Keypoints:
        xy = np.stack([right - keypoints.xy[..., 0], keypoints.xy[..., 1]], axis=-1)
        return replace(keypoints, xy=xy)

    ltwh = np.array(seen.boxes.ltwh)
    ltwh[:, 0] = right - ltwh[:, 0] - ltwh[:, 2]
    boxes: Boxes = replace(seen.boxes, ltwh=ltwh)
    return CameraObservations(boxes, points(seen.keypoints), points(seen.wands))


def possible_share(seen: CameraObservations, size: tuple[int, int]) -> float | None:
    """Return the smallest share in `SUB_STREAMS` of the image's size that contains all people; None if they fill more."""
    extent = extents_of(seen.boxes if len(seen.boxes) else seen.keypoints)
    if len(extent) < FEWEST:
        return None
    filled = float((np.quantile(extent[:, 2:], 1 - STRAY, axis=0) / size).max())
    return next((share for share in SUB_STREAMS if filled <= share * (1 + STRIP)), None)


def smaller(lens: Lens, share: float) -> Lens:
    """Return the lens for images of this share of the size."""
    matrix = np.array(lens.matrix)
    matrix[:2] *= share
    return replace(lens, size=(round(share * lens.size[0]), round(share * lens.size[1])), matrix=matrix)
