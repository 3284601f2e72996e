"""Whether a camera's picture size, its matrix and the people in it are of one picture."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens
from passerby.core.extents import extents_of
from passerby.findings.finding import doubt, notice
from passerby.findings.texts import text_of
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

OUTSIDE_SHARE = 0.01
"""A tracker may predict a box or two past the border; where more than this share of the boxes does not touch the picture (grown
by 2 %), the boxes were made on a picture of another size."""
BORDER_SHARE = 0.02
FILLED_SHARE = 0.6
"""People who all stay within this share of the width and the height hint at a size that is too large."""
FILLED_ROWS = 100
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


def check_extents(scene: Scene, reading: CameraInput, lens: Lens) -> None:
    """Picture size against where the people are, both as filmed."""
    width, height = lens.size
    size, intrinsics = [width, height], source_of_size(scene, reading.name)
    people = reading.filmed_people
    for path, extent, rows in (
        (reading.boxes_path, extents_of(people.boxes), people.boxes),
        (reading.keypoints_path, extents_of(people.keypoints), people.keypoints),
    ):
        if path is None or not len(extent):
            continue
        margin = BORDER_SHARE * np.array([width, height])
        outside = ((extent[:, :2] > np.array([width, height]) + margin) | (extent[:, 2:] < -margin)).any(axis=1)
        count, place = int(outside.sum()), str(path)
        if count:
            first = int(np.flatnonzero(outside)[0])
            corners = extent[first].round(1).reshape(2, 2).tolist()
            finding = notice(
                "people_outside_image", reading.name, place=place, outside=count, people=len(extent),
                frame=int(rows.frame[first]), corners=corners, size=size,
            )  # fmt: skip
            if count > OUTSIDE_SHARE * len(extent):
                reading.faults.append(
                    f"{text_of(finding)}: wrong image size? the size {width} x {height} in {intrinsics} is not the size of "
                    f"the images in which the people were detected"
                )
            else:
                reading.findings.append(finding)
        filled = (extent[:, 2:] / lens.size).max(axis=0)
        smaller = smaller_picture(extent, lens.size)
        if smaller is not None:
            cut, seen_size = smaller
            reading.doubts.append(
                doubt("smaller_image_cut", reading.name, place=place, cut=cut, seen_size=list(seen_size), size=size)
            )
        elif len(extent) >= FILLED_ROWS and filled.max() < FILLED_SHARE:
            values = {"across": float(filled[0]), "down": float(filled[1]), "size": size, "intrinsics": intrinsics}
            reading.findings.append(notice("people_in_part_of_image", reading.name, place=place, **values))


def smaller_picture(extent: Floats, size: tuple[int, int]) -> tuple[int, tuple[int, int]] | None:
    """The size of the smaller picture that people were found in, and how many its right and lower borders cut off.

    Nobody reaches beyond it, and people of different heights at different places end just at its border. Where people keep to a
    corner of a right picture nothing cuts them off there.

    Args:
        extent: (N, 4) left, top, right, bottom of people, pixels.
        size: width and height of the picture that they are said to be in.
    """
    if len(extent) < FILLED_ROWS:
        return None
    ends = extent[:, 2:] / size
    most = np.quantile(ends, 1 - OUTSIDE_SHARE / 10, axis=0)
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
