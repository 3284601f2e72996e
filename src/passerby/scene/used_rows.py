"""Which of a camera's observations are used: those within its times, and not of people in a region that is excluded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.observations import MIN_JOINT_SCORE, Boxes, Keypoints
from passerby.findings.finding import notice
from passerby.geometry.polygons import inside_any
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene


def keep_used(scene: Scene, reading: CameraInput) -> None:
    """Remove what a scene file leaves out of one camera's observations; faults are gathered, not raised."""
    if not reading.faults:
        _keep_times(scene, reading)
    if not reading.faults:
        _keep_places(scene, reading)


def _keep_times(scene: Scene, reading: CameraInput) -> None:
    """Leave out what the camera saw before `from_s` and after `until_s`, and in the spans of `exclude_s`."""
    table, place = scene.cameras[reading.name], f"{scene.place}: [cameras.{reading.name}]"
    named = [key for key in ("from_s", "until_s", "exclude_s") if getattr(table, key)]
    if not named:
        return
    if reading.fps is None:
        reading.faults.append(f"{place} {named[0]}: its frame rate is not known: set fps there, or under [scene] set fps to it")
        return
    fps, first, last = reading.fps, table.from_s or 0.0, np.inf if table.until_s is None else table.until_s
    before = reading.frames

    def used(frame: Ints) -> Bools:
        seconds = (frame - 1) / fps
        kept = np.asarray((seconds >= first) & (seconds <= last))
        for low, high in table.exclude_s:
            kept &= (seconds < low) | (seconds > high)
        return kept

    reading.boxes = reading.boxes.take(used(reading.boxes.frame))
    reading.keypoints = reading.keypoints.take(used(reading.keypoints.frame))
    reading.wands = reading.wands.take(used(reading.wands.frame))
    if len(before) and not reading.people:
        seen = f"{(before[0] - 1) / fps:.1f} to {(before[-1] - 1) / fps:.1f} s"
        values = {key: getattr(table, key) for key in named}
        stated = " and ".join(
            f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {[list(span) for span in value]}"
            for key, value in values.items()
        )
        reading.faults.append(f"{place} {stated}: it saw people only from {seen}, so nothing is left: check the seconds")


def _keep_places(scene: Scene, reading: CameraInput) -> None:
    """Leave out people whose feet are in a polygon of `exclude`."""
    polygons = scene.cameras[reading.name].exclude
    if not polygons:
        return
    place = f"{scene.place}: [cameras.{reading.name}] exclude"
    if reading.lens is not None:
        width, height = reading.lens.size
        for number, polygon in enumerate(polygons, start=1):
            low, high = np.min(polygon, axis=0), np.max(polygon, axis=0)
            if (high < 0).any() or (low > (width, height)).any():
                reading.faults.append(
                    f"{place}: polygon {number} is outside the image of {width} x {height} pixels: give its corners in the "
                    "pixels of the boxes"
                )
                return
    before = reading.people
    reading.boxes = reading.boxes.take(~inside_any(feet_of_boxes(reading.boxes), _corners(polygons)))
    reading.keypoints = reading.keypoints.take(~inside_any(feet_of_keypoints(reading.keypoints), _corners(polygons)))
    left_out = before - reading.people
    if before and not reading.people:
        reading.faults.append(f"{place}: all {before} people of the camera are in it, so nothing is left: check its corners")
    elif not reading.awaiting:
        counts = {"left_out": left_out, "rows": before}
        reading.findings.append(notice("people_excluded", reading.name, place=str(scene.place), **counts))


def feet_of_boxes(boxes: Boxes) -> Floats:
    """(N, 2) the middles of the lower edges, pixels."""
    left, top, width, height = boxes.ltwh.T
    return np.column_stack([left + 0.5 * width, top + height])


def feet_of_keypoints(keypoints: Keypoints) -> Floats:
    """(N, 2) the lowest detected keypoint's height, in the middle of all detected ones; NaN where there is none."""
    found = (keypoints.score > MIN_JOINT_SCORE)[..., None]
    low = np.where(found, keypoints.xy, np.inf).min(axis=1, initial=np.inf)
    high = np.where(found, keypoints.xy, -np.inf).max(axis=1, initial=-np.inf)
    some = np.isfinite(low).all(axis=1)
    middle = 0.5 * (np.where(some, low[:, 0], 0.0) + np.where(some, high[:, 0], 0.0))
    return np.where(some[:, None], np.column_stack([middle, high[:, 1]]), np.nan)


def _corners(polygons: Sequence[Sequence[Sequence[float]]]) -> list[Floats]:
    return [np.asarray(polygon, dtype=np.float64) for polygon in polygons]
