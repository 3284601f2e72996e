"""Tests whether the people of the cameras are at possible places in the images: box format, rotation and image size.

Certain causes are faults, with the key that corrects them; others are doubts or notices. A camera has one cause: if its boxes
are in another format, their size and rotation are not tested.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens
from passerby.core.observations import Boxes, BoxFormat, CameraObservations, Keypoints, extents_of
from passerby.core.quarter_turns import turn_lens
from passerby.findings.finding import Finding, doubt, notice
from passerby.findings.texts import text_of
from passerby.scene.box_interpretations import (
    BoxesAsStated,
    OtherFormat,
    find_other_formats,
    is_upside_down,
    rotation_of_sideways,
)
from passerby.scene.camera_input import CameraInput
from passerby.scene.lens_sources import FILLED_ROWS, smaller_picture, source_of_size
from passerby.scene.scene import Scene

OUTSIDE_SHARE = 0.01
"""Maximum share of boxes that do not touch the image (enlarged by 2 %). A tracker may predict a box or two beyond the border;
with a larger share, the boxes were made on an image of another size."""
BORDER_SHARE = 0.02
CUT, CUT_SHARE = 0.1, 0.3
"""If more than `CUT_SHARE` of the people reach beyond the image by more than `CUT` of their box, the boxes are of another
image. With bodies that are cut off, but drawn whole, this share is 0.16 at most, and 0.005 in the median of 144 simulated
cameras (all presets, seeds 100 to 105). If boxes are 39 % of the height too low, the cameras with more than half of them below
the image have 0.46 to 0.54."""
FILLED_SHARE = 0.6
"""If all people stay within this share of the width and of the height, the stated size may be too large."""


def faults_of_people(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Return the faults of boxes in another format, images on their side, and people outside the image."""
    found = [one for one in _find_other_formats(scene, readings) if one.certain]
    misread = {name for one in found for name in one.cameras}
    faults = [_format_fault(scene, readings, one) for one in found]
    for reading, lens in _list_testable(readings):
        if reading.name in misread:
            continue
        if outside := [fault for part in _parts(reading) if (fault := _describe_outside(scene, reading, lens, *part))]:
            faults += outside
        elif turn := rotation_of_sideways(*_turn_upright(reading, lens), scene.scale.person_height_m):
            faults.append(_describe_sideways(reading, turn))
    return faults


def findings_of_people(scene: Scene, readings: Sequence[CameraInput]) -> list[Finding]:
    """Return notices of a few people outside the image, and of people who all stay in a part of it."""
    misread = {name for one in _find_other_formats(scene, readings) if one.certain for name in one.cameras}
    found = []
    for reading, lens in _list_testable(readings):
        for path, rows in _parts(reading) if reading.name not in misread else ():
            extent = extents_of(rows)
            outside = _find_outside(extent, lens.size)
            if 0 < outside.sum() <= OUTSIDE_SHARE * len(extent):
                found.append(_note_outside(reading, lens, path, rows, outside))
            filled = (extent[:, 2:] / lens.size).max(axis=0)
            full = len(extent) < FILLED_ROWS or filled.max() >= FILLED_SHARE
            if not full and smaller_picture(extent, lens.size) is None:
                values = {"across": float(filled[0]), "down": float(filled[1]), "size": list(lens.size)}
                source = source_of_size(scene, reading.name)
                found.append(notice("people_in_part_of_image", reading.name, place=str(path), **values, intrinsics=source))
    return found


def doubts_of_people(scene: Scene, readings: Sequence[CameraInput]) -> list[Finding]:
    """Return the doubts about people in smaller images, images upside down, and boxes that seem to be in another format."""
    found = []
    for reading, lens in _list_testable(readings):
        for path, rows in _parts(reading):
            smaller = smaller_picture(extents_of(rows), lens.size)
            if smaller is not None:
                sizes = {"seen_size": list(smaller[1]), "size": list(lens.size)}
                found.append(doubt("smaller_image_fits", reading.name, place=str(path), cut=smaller[0], **sizes))
    found += [
        doubt("image_misread", reading.name, how="upside_down", rotate=(reading.rotate + 180) % 360)
        for reading, lens in _list_testable(readings)
        if is_upside_down(*_turn_upright(reading, lens), scene.scale.person_height_m)
    ]
    return found + [
        doubt(
            "boxes_by_centres", *one.cameras, beyond=one.beyond, box_format=str(one.box_format),
            stated=str(scene.box_format(one.cameras[0])),
        )
        for one in _find_other_formats(scene, readings)
        if not one.certain
    ]  # fmt: skip


def _list_testable(readings: Sequence[CameraInput]) -> Iterator[tuple[CameraInput, Lens]]:
    """Yield the cameras whose people can be tested, with the lenses of their images as filmed."""
    for reading in readings:
        if reading.filmed_lens is not None and not reading.faults and not reading.awaiting:
            yield reading, reading.filmed_lens


def _turn_upright(reading: CameraInput, filmed: Lens) -> tuple[Lens, CameraObservations]:
    """Return the lens and the people of a camera after the rotation that the scene file states."""
    return turn_lens(filmed, reading.rotate), reading.seen


def _parts(reading: CameraInput) -> list[tuple[Path, Boxes | Keypoints]]:
    """Return boxes and keypoints as filmed, with their files, except those from the camera's own video: its size is known."""
    own, people = None if reading.video is None else reading.video.path, reading.filmed_people
    parts = ((reading.boxes_path, people.boxes), (reading.keypoints_path, people.keypoints))
    return [(path, rows) for path, rows in parts if path is not None and path != own and len(rows)]


def _find_other_formats(scene: Scene, readings: Sequence[CameraInput]) -> tuple[OtherFormat, ...]:
    return find_other_formats(
        [
            BoxesAsStated(reading.name, rows, lens.size, scene.box_format(reading.name))
            for reading, lens in _list_testable(readings)
            for path, rows in _parts(reading)
            if path == reading.boxes_path and isinstance(rows, Boxes)
        ]
    )


def _format_fault(scene: Scene, readings: Sequence[CameraInput], found: OtherFormat) -> str:
    first = next(reading for reading in readings if reading.name == found.cameras[0])
    stated, better = scene.box_format(first.name), found.box_format
    with_boxes = [reading.name for reading in readings if len(reading.boxes)]
    if scene.path is None:
        remedy = f'give box_format = "{better}"'
    elif len(found.cameras) == len(with_boxes) and not any(scene.cameras[name].boxes for name in found.cameras):
        remedy = f'under [scene] set boxes = "{better}"'
    else:
        remedy = f'under {", ".join(f"[cameras.{name}]" for name in found.cameras)} set boxes = "{better}"'
    if better.normalised != stated.normalised:
        units = ("pixels", "shares of the image (0 to 1)")
        seems = f"the boxes are in {units[better.normalised]}, not in {units[stated.normalised]}"
        if better.normalised and better.convention != "corners":
            other = BoxFormat("ltwh" if better.convention == "centres" else "centres", True)
            yolo = ", as YOLO tools write them" if other.convention == "centres" else ""
            remedy += f', or "{other}" if they are {", ".join(other.columns)}{yolo}'
    else:
        seems = (
            f"the boxes are {', '.join(better.columns)}: in every row {better.columns[2]} is beyond {better.columns[0]} and "
            f"{better.columns[3]} beyond {better.columns[1]}, and read as {', '.join(stated.columns)} many reach far beyond "
            "the images"
        )
    who = f"camera{'s' if len(found.cameras) > 1 else ''} {', '.join(found.cameras)}"
    return f"{first.boxes_path}: {who}: {seems}: {remedy}"


def _describe_sideways(reading: CameraInput, turn: int) -> str:
    rotate = (reading.rotate + turn) % 360
    remedy = f"set rotate = {rotate} (degrees clockwise)" if rotate else "delete rotate"
    return f"{reading.boxes_path}: camera {reading.name}: people lie on their side: under [cameras.{reading.name}] {remedy}"


def _find_outside(extent: Floats, size: tuple[int, int]) -> Floats:
    """Return a mask (N,) of the people who do not touch the image, enlarged by 2 %."""
    margin = BORDER_SHARE * np.array(size)
    return np.asarray(((extent[:, :2] > size + margin) | (extent[:, 2:] < -margin)).any(axis=1))


def _note_outside(reading: CameraInput, lens: Lens, path: Path, rows: Boxes | Keypoints, outside: Floats) -> Finding:
    first = int(np.flatnonzero(outside)[0])
    corners = extents_of(rows)[first].round(1).reshape(2, 2).tolist()
    return notice(
        "people_outside_image", reading.name, place=str(path), outside=int(outside.sum()), people=len(rows),
        frame=int(rows.frame[first]), corners=corners, size=list(lens.size),
    )  # fmt: skip


def _describe_outside(scene: Scene, reading: CameraInput, lens: Lens, path: Path, rows: Boxes | Keypoints) -> str | None:
    """Return the fault of many people outside the image, or far beyond its borders; None if there is none."""
    extent, size = extents_of(rows), np.array(lens.size)
    outside = _find_outside(extent, lens.size)
    width, height = lens.size
    stated = f"the size {width} x {height} in {source_of_size(scene, reading.name)}"
    remedy = (
        "give intrinsics and size of those images; if these are a crop of them or they of these, add or subtract its offset in "
        "the boxes and keypoints"
    )
    if outside.sum() > OUTSIDE_SHARE * len(extent):
        text = text_of(_note_outside(reading, lens, path, rows, outside))
        return f"{text}: wrong image size? {stated} is not the size of the images in which the people were detected: {remedy}"
    over = np.maximum(-extent[:, :2], extent[:, 2:] - size) / np.maximum(extent[:, 2:] - extent[:, :2], 1e-9)
    beyond = (over > CUT).any(axis=1)
    if beyond.mean() <= CUT_SHARE:
        return None
    first, last = extent[:, :2].min(axis=0), extent[:, 2:].max(axis=0)
    return (
        f"{path}: camera {reading.name}: {beyond.mean():.0%} of the people reach beyond the {width} x {height} image by more "
        f"than a tenth of their size (they extend from [{first[0]:.0f}, {first[1]:.0f}] to [{last[0]:.0f}, {last[1]:.0f}]): "
        f"wrong image size or crop? {stated} is not that of the images in which the people were detected: {remedy}; if whole "
        "bodies were drawn where the border cuts them off, clip the boxes to the image"
    )
