"""Selection of a camera's used observations: within its times, outside excluded regions, one row per person and frame.

Trackers sometimes write several rows of one identity in one frame, and merged files contain such rows. A few do no harm. If
there are many, the ids are no identities (a class number, a counter that restarts in every tile), and no row can be used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.observations import MIN_JOINT_SCORE, UNKNOWN, Boxes, Keypoints, extents_of
from passerby.findings.finding import Finding, notice
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene

Part = TypeVar("Part", Boxes, Keypoints)
MOST_DOUBLED = 0.05
"""Maximum share of duplicate rows. In the worst case, every second row that is kept is the wrong one: 2.5 % of the rows; a
calibration tolerates that 20 % of the identities are exchanged (simulated scenes, sigmas still correct). An id that is no
identity causes far more: if it is one class number, in frames with two people or more, half of the rows."""


def keep_used(scene: Scene, reading: CameraInput) -> None:
    """Remove the observations of one camera that the scene file leaves out; faults are collected, not raised."""
    if not reading.faults:
        _keep_times(scene, reading)
    if not reading.faults:
        _keep_places(scene, reading)


def _keep_times(scene: Scene, reading: CameraInput) -> None:
    """Leave out observations before `from_s`, after `until_s`, and in the spans of `exclude_s`."""
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
    if reading.filmed_size is not None:
        width, height = reading.filmed_size
        for number, polygon in enumerate(polygons, start=1):
            low, high = np.min(polygon, axis=0), np.max(polygon, axis=0)
            if (high < 0).any() or (low > (width, height)).any():
                reading.faults.append(
                    f"{place}: polygon {number} is outside the image of {width} x {height} pixels: give its corners in the "
                    "pixels of the boxes"
                )
                return
    before, corners = reading.people, [reading.upright(polygon) for polygon in polygons]
    reading.boxes = reading.boxes.take(~find_inside_any(feet_of_boxes(reading.boxes), corners))
    reading.keypoints = reading.keypoints.take(~find_inside_any(feet_of_keypoints(reading.keypoints), corners))
    left_out = before - reading.people
    if before and not reading.people:
        reading.faults.append(f"{place}: all {before} people of the camera are in it, so nothing is left: check its corners")
    elif not reading.awaiting:
        counts = {"left_out": left_out, "rows": before}
        reading.findings.append(notice("people_excluded", reading.name, place=str(scene.place), **counts))


def feet_of_boxes(boxes: Boxes) -> Floats:
    """Return the middles (N, 2) of the lower edges, pixels."""
    left, top, width, height = boxes.ltwh.T
    return np.column_stack([left + 0.5 * width, top + height])


def feet_of_keypoints(keypoints: Keypoints) -> Floats:
    """Return (N, 2) pixels: across, the middle of all detected keypoints; down, the lowest one; NaN if none is detected."""
    found = (keypoints.score > MIN_JOINT_SCORE)[..., None]
    low = np.where(found, keypoints.xy, np.inf).min(axis=1, initial=np.inf)
    high = np.where(found, keypoints.xy, -np.inf).max(axis=1, initial=-np.inf)
    some = np.isfinite(low).all(axis=1)
    middle = 0.5 * (np.where(some, low[:, 0], 0.0) + np.where(some, high[:, 0], 0.0))
    return np.where(some[:, None], np.column_stack([middle, high[:, 1]]), np.nan)


@dataclass(frozen=True)
class DuplicateRows:
    """The duplicate rows of one camera that were left out."""

    rows: int
    """Number of rows before."""
    second: int
    """Number of rows that were left out because the same identity has a better one in the frame."""
    repeated: int
    """Number of rows without an identity that were left out because all their numbers equal those of another row."""
    first: tuple[int, int]
    """Frame and identity of the first row that was left out."""

    @property
    def is_rule(self) -> bool:
        """Whether there are too many duplicates for the ids to be identities."""
        return self.second + self.repeated > MOST_DOUBLED * self.rows

    def finding(self, place: str, *camera: str) -> Finding:
        """Return the notice of the duplicates; `place` is the file, which may belong to no camera."""
        frame, identity = self.first
        return notice(
            "duplicate_rows", *camera, place=place, doubled=self.second + self.repeated, rows=self.rows, frame=frame,
            identity=None if identity == UNKNOWN else identity, too_many=self.is_rule,
        )  # fmt: skip


def remove_duplicates(part: Part) -> tuple[Part, DuplicateRows | None]:
    """Keep each identity once per frame; return the rows in their order, and the duplicates, None if there are none.

    Of several rows of one identity in one frame, the one with the highest score is kept; among equal scores, the one nearest to
    the positions of the identity in the frames before and after; among equal distances, the first. Rows without an identity
    (-1) are all kept, except those whose numbers all equal those of another row.
    """
    score, extent = _scores(part), extents_of(part)
    known: NDArray[np.bool_] = part.identity > UNKNOWN
    keep = np.ones(len(part), dtype=bool)
    groups = _groups([part.frame[known], part.identity[known]], np.flatnonzero(known))
    crowded = np.zeros(len(part), dtype=bool)
    for rows in groups:
        crowded[rows] = True
    few = len(groups) <= max(100, 2 * MOST_DOUBLED * len(part))  # with more groups, no row is used: any choice will do
    for rows in groups:
        best = rows[score[rows] == score[rows].max()]
        if len(best) > 1 and few:
            away = _measure_jumps(part, extent, best, ~crowded)
            best = best[away == away.min()]
        keep[rows] = False
        keep[best[0]] = True
    second = int((~keep).sum())
    for rows in _groups([part.frame[~known], *_numbers(part)[~known].T], np.flatnonzero(~known)):
        keep[rows[1:]] = False
    if keep.all():
        return part, None
    out = np.flatnonzero(~keep)
    first = out[np.argmin(part.frame[out])]
    doubled = DuplicateRows(len(part), second, len(out) - second, (int(part.frame[first]), int(part.identity[first])))
    return part.take(np.flatnonzero(keep)), doubled


def _groups(keys: Sequence[NDArray[np.generic]], rows: Ints) -> list[Ints]:
    """Group the rows that have the same keys (N,); groups of one row are left out, and each group is in the rows' order."""
    if len(rows) < 2:
        return []
    order = np.lexsort(tuple(keys))
    same = np.ones(len(rows) - 1, dtype=bool)
    for key in keys:
        same &= key[order][1:] == key[order][:-1]
    return [np.sort(group) for group in np.split(rows[order], np.flatnonzero(~same) + 1) if len(group) > 1]


def _measure_jumps(part: Boxes | Keypoints, extent: Floats, rows: Ints, single: NDArray[np.bool_]) -> Floats:
    """Compute the distances (K,) of rows of one identity and frame from its interpolated extent, pixels; 0 if it has no other.

    The extent is interpolated between the nearest single rows of the identity before and after.
    """
    frame, identity = part.frame[rows[0]], part.identity[rows[0]]
    own = np.flatnonzero(single & (part.identity == identity))
    before, after = own[part.frame[own] < frame], own[part.frame[own] > frame]
    ends = [end for end in (before[np.argmax(part.frame[before])] if len(before) else None,
                            after[np.argmin(part.frame[after])] if len(after) else None) if end is not None]  # fmt: skip
    if not ends:
        return np.zeros(len(rows))
    at = extent[ends[0]]
    if len(ends) == 2:
        share = (frame - part.frame[ends[0]]) / (part.frame[ends[1]] - part.frame[ends[0]])
        at = (1 - share) * at + share * extent[ends[1]]
    return np.asarray(np.abs(extent[rows] - at).sum(axis=1))


def _scores(part: Boxes | Keypoints) -> Floats:
    """Return the confidence (N,) of each row; for joints the mean over all, so that a row with more joints has a higher one."""
    if isinstance(part, Boxes):
        return part.score
    return np.asarray(part.score.mean(axis=1)) if part.score.shape[1] else np.zeros(len(part))


def _numbers(part: Boxes | Keypoints) -> Floats:
    """Return all numbers (N, K) of each row except frame and identity."""
    if isinstance(part, Boxes):
        return np.column_stack([part.ltwh, part.score])
    return np.column_stack([part.xy.reshape(len(part), 2 * len(part.joints)), part.score])


def find_inside_any(points: Floats, polygons: Iterable[Floats]) -> Bools:
    """Return whether points lie in at least one polygon.

    Args:
        points: (N, 2); a point with NaN lies in none.
        polygons: (K, 2) corners each, in either direction; a polygon that crosses itself has holes (the even-odd rule).

    Returns:
        Mask (N,).
    """
    found = np.zeros(len(points), dtype=np.bool_)
    for corners in polygons:
        found |= _find_inside(points, corners)
    return found


def _find_inside(points: Floats, corners: Floats) -> Bools:
    """Return whether points lie in a polygon: a ray to the right crosses the sides an odd number of times (even-odd rule)."""
    x, y = points[:, :1], points[:, 1:]
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    crosses = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.asarray((crosses & (x < at)).sum(axis=1) % 2 == 1)
