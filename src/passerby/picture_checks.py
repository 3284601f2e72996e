"""Whether a camera's picture size, its matrix and the people in it are of one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Lens
from passerby.observations import Boxes, Keypoints
from passerby.scene import Scene

if TYPE_CHECKING:
    from passerby.reading import CameraReading

OUTSIDE_SHARE = 0.01
"""A tracker may predict a box or two past the border; where more than this share of the boxes does not touch the picture (grown
by 2 %), the boxes were made on a picture of another size."""
BORDER_SHARE = 0.02
FILLED_SHARE = 0.6
"""People who all stay within this share of the width and the height hint at a size that is too large."""
FILLED_ROWS = 100
PRINCIPAL_SHARE = 0.25
"""A cropped picture can have its principal point outside; further out than this share of the size, matrix and size disagree."""


def check_principal_point(scene: Scene, reading: CameraReading, lens: Lens) -> None:
    """Matrix against picture size."""
    beyond = float((np.abs(lens.matrix[:2, 2] / lens.size - 0.5) - 0.5).max())
    if beyond > 0:
        text = (
            f"{scene.resolve(scene.cameras[reading.name].intrinsics)}: [{reading.name}] the principal point "
            f"{lens.matrix[:2, 2].round(1).tolist()} lies outside the {lens.size[0]} x {lens.size[1]} picture: "
            "wrong image size? Matrix and size must be of one picture"
        )
        (reading.faults if beyond > PRINCIPAL_SHARE else reading.findings).append(text)


def check_extents(scene: Scene, reading: CameraReading, lens: Lens) -> None:
    """Picture size against where the people are."""
    table = scene.cameras[reading.name]
    width, height = lens.size
    mend = f"the size {width} x {height} in {scene.resolve(table.intrinsics)} is not that of the picture"
    for path, extent, rows in (
        (reading.boxes_path, _box_extents(reading.boxes), reading.boxes),
        (reading.keypoints_path, _joint_extents(reading.keypoints), reading.keypoints),
    ):
        if path is None or not len(extent):
            continue
        margin = BORDER_SHARE * np.array([width, height])
        outside = ((extent[:, :2] > np.array([width, height]) + margin) | (extent[:, 2:] < -margin)).any(axis=1)
        count, place = int(outside.sum()), f"{path}: camera {reading.name}"
        if count:
            first = int(np.flatnonzero(outside)[0])
            text = (
                f"{place}: {count} of {len(extent)} people lie outside the {width} x {height} picture (first: frame "
                f"{rows.frame[first]}, from {extent[first, :2].round(1).tolist()} to {extent[first, 2:].round(1).tolist()})"
            )
            if count > OUTSIDE_SHARE * len(extent):
                reading.faults.append(f"{text}: wrong image size? {mend} in which the people were found")
            else:
                reading.findings.append(text)
        filled = (extent[:, 2:] / lens.size).max(axis=0)
        if len(extent) >= FILLED_ROWS and filled.max() < FILLED_SHARE:
            reading.findings.append(
                f"{place}: all people lie within {filled[0]:.0%} of the width and {filled[1]:.0%} of the height: "
                f"wrong image size? perhaps {mend} in which they were found"
            )


def _box_extents(boxes: Boxes) -> NDArray[np.float64]:
    """(N, 4) left, top, right, bottom in pixels."""
    return np.column_stack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])


def _joint_extents(keypoints: Keypoints) -> NDArray[np.float64]:
    """(N, 4) left, top, right, bottom of the joints found in each person, pixels; (0, 0, 0, 0) where there is none."""
    found = keypoints.score[..., None] > 0
    some = found.any(axis=1)
    low = np.where(some, np.where(found, keypoints.xy, np.inf).min(axis=1, initial=np.inf), 0.0)
    high = np.where(some, np.where(found, keypoints.xy, -np.inf).max(axis=1, initial=-np.inf), 0.0)
    return np.column_stack([low, high])
