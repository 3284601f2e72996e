"""Whether a camera's picture size and its matrix are of one picture, and whether people were found in a smaller one."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens
from passerby.findings.finding import notice
from passerby.findings.texts import text_of
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

FILLED_ROWS = 100
"""Fewer people say nothing of the size of the picture."""
STRAY_SHARE = 0.001
"""Boxes that a tracker predicts past the border."""
SUB_STREAMS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3, 3 / 4)
"""Width and height of usual second streams over those of the main one."""
STRIP = 0.0125
"""Boxes that a picture's border cuts end within this share of its size of it, give or take."""
CUT_ROWS, CUT_SHARE = 10, 0.003
"""So many boxes, and such a share of all, end at the border of a smaller picture,"""
CUT_SPREAD = 0.1
"""over this share of that border, and differ as much in height: not one person who stands there."""
REACHED = 0.7
"""Along the other border people come at least so near to the corner, as a share."""
PRINCIPAL_SHARE = 0.25
"""A cropped picture can have its principal point outside; further out than this share of the size, matrix and size disagree."""


def source_of_size(scene: Scene, camera: str) -> str:
    """The file that states a camera's image size: its intrinsics, or else its video or the scene file."""
    table = scene.cameras[camera]
    if table.intrinsics is not None:
        return str(scene.resolve(table.intrinsics))
    return str(scene.place if table.image_size is not None or not table.videos else scene.resolve(table.videos[0]))


def check_principal_point(scene: Scene, reading: CameraInput, lens: Lens) -> None:
    """Matrix against picture size."""
    beyond = float((np.abs(lens.matrix[:2, 2] / lens.size - 0.5) - 0.5).max())
    if beyond > 0:
        place, point = source_of_size(scene, reading.name), lens.matrix[:2, 2].round(1).tolist()
        finding = notice("principal_point_outside_image", reading.name, place=place, point=point, size=list(lens.size))
        if beyond > PRINCIPAL_SHARE:
            reading.faults.append(text_of(finding))
        else:
            reading.findings.append(finding)


def smaller_picture(extent: Floats, size: tuple[int, int]) -> tuple[int, tuple[int, int]] | None:
    """The size of the smaller picture that people were found in, and how many its right and lower borders cut off.

    No person reaches beyond it, and people of different heights at different places end just at its border. Where people
    keep to a corner of a right picture nothing cuts them off there.

    Args:
        extent: (N, 4) left, top, right, bottom of people, pixels.
        size: width and height of the picture that they are said to be in.
    """
    if len(extent) < FILLED_ROWS:
        return None
    ends = extent[:, 2:] / size
    most = np.quantile(ends, 1 - STRAY_SHARE, axis=0)
    for share in SUB_STREAMS:
        reach = most / share
        if reach.max() > 1 + STRIP or reach.min() < REACHED:
            continue
        count = 0
        for axis in range(2):
            cut = np.abs(ends[:, axis] / share - 1) <= STRIP
            along = 0.5 * (extent[cut, 1 - axis] + extent[cut, 3 - axis]) / (share * size[1 - axis])
            tall = extent[cut, 3] - extent[cut, 1]
            if cut.sum() < max(CUT_ROWS, CUT_SHARE * len(extent)):
                continue
            if np.std(along) >= CUT_SPREAD and np.std(tall) >= CUT_SPREAD * np.mean(tall):
                count += int(cut.sum())
        if count:
            return count, (round(share * size[0]), round(share * size[1]))
    return None
