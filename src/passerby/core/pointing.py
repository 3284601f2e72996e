"""Search for the person that a pixel names: the person of one camera at one time whose box or keypoints contain the pixel."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import MIN_JOINT_SCORE, CameraObservations, Keypoints, sampling_step

NEAR_S = 0.25
"""The nearest frame with people is searched up to this time away: a walker moves by less than half a body's width in it. A
camera that is sampled less often is searched up to one sample away."""
JOINT_MARGIN = 0.1
"""Keypoints end inside of the body: the rectangle around them is widened by this share of its height on all sides."""


@dataclass(frozen=True)
class Sighting:
    """A person in one camera at one of its frames, named by a pixel."""

    camera: str
    frame: int
    """A frame in which the camera saw a person, in the camera's own numbering."""
    at: tuple[float, float]
    """Pixel (u, v) in the image."""
    place: str
    """Name of the table in the scene file: `[[association.same]] 1`."""


@dataclass(frozen=True)
class PointedPerson:
    """A person of known standing height, named by a pixel of one camera at one of its frames."""

    number: int
    """Number of the table in the scene file, from 1."""
    camera: str
    frame: int
    """A frame in which the camera saw a person, in the camera's own numbering."""
    at: tuple[float, float]
    """Pixel (u, v) in the image."""
    metres: float
    sd_m: float


@dataclass(frozen=True)
class StatedIdentities:
    """Corrections of identities by the user."""

    same: tuple[tuple[Sighting, ...], ...] = ()
    """Groups of sightings; those of a group are of one person."""
    different: tuple[tuple[Sighting, ...], ...] = ()
    """Groups of sightings; those of a group are all of different people."""
    not_people: tuple[Sighting, ...] = ()

    def within(self, names: Collection[str]) -> StatedIdentities:
        """Return the corrections that are about these cameras."""

        def inside(groups: tuple[tuple[Sighting, ...], ...]) -> tuple[tuple[Sighting, ...], ...]:
            parts = (tuple(one for one in group if one.camera in names) for group in groups)
            return tuple(part for part in parts if len(part) > 1)

        nobody = tuple(one for one in self.not_people if one.camera in names)
        return StatedIdentities(inside(self.same), inside(self.different), nobody)


@dataclass(frozen=True, eq=False)
class PeopleInFrame:
    """The N people that a camera saw in one frame: boxes or, where there are none, rectangles around keypoints."""

    kind: Literal["boxes", "keypoints"]
    row: Ints
    """(N,) rows of the camera's boxes or keypoints."""
    ltwh: Floats
    """(N, 4) left, top, width, height, pixels."""

    def holding(self, at: tuple[float, float]) -> Ints:
        """Return the people whose rectangles contain a pixel, the nearest to the camera first.

        Of people who overlap, the nearest hides the others, and its box reaches lowest; of equally low ones the smallest.
        """
        inside = np.flatnonzero(self.distance_px(at) == 0)
        _, top, width, height = self.ltwh[inside].T
        return np.asarray(inside[np.lexsort((width * height, -(top + height)))], dtype=np.int64)

    def distance_px(self, at: tuple[float, float]) -> Floats:
        """Return the distances (N,) from a pixel to each rectangle, pixels; 0 inside."""
        first, last = self.ltwh[:, :2], self.ltwh[:, :2] + self.ltwh[:, 2:]
        outside = np.maximum(np.maximum(first - np.array(at), np.array(at) - last), 0.0)
        return np.asarray(np.linalg.norm(outside, axis=1))


def find_nearest_frame(seen: CameraObservations, frame: float, fps: float | None) -> int | None:
    """Return the frame with people that is nearest to a (fractional) frame number; None where none is near enough."""
    frames = np.unique(np.concatenate([seen.boxes.frame, seen.keypoints.frame]))
    if not len(frames):
        return None
    found = int(frames[np.argmin(np.abs(frames - frame))])
    near = max(float(sampling_step(frames)), NEAR_S * fps if fps else 1.0)
    return found if abs(found - frame) <= near else None


def people_in_frame(seen: CameraObservations, frame: int) -> PeopleInFrame:
    """Return all people that a camera saw in a frame."""
    boxes = np.flatnonzero(seen.boxes.frame == frame)
    if len(boxes):
        return PeopleInFrame("boxes", boxes, seen.boxes.ltwh[boxes])
    rows = np.flatnonzero(seen.keypoints.frame == frame)
    around = [_rectangle(seen.keypoints, row) for row in rows.tolist()]
    known = np.array([one is not None for one in around], dtype=bool)
    return PeopleInFrame("keypoints", rows[known], np.array([one for one in around if one is not None]).reshape(-1, 4))


def find_pointed(
    seen: CameraObservations, frame: int, at: tuple[float, float]
) -> tuple[Literal["boxes", "keypoints"], int] | None:
    """Find the row of the person who contains a pixel in a frame, in the boxes or the keypoints; None if there is none."""
    people = people_in_frame(seen, frame)
    holding = people.holding(at)
    return (people.kind, int(people.row[holding[0]])) if len(holding) else None


def _rectangle(keypoints: Keypoints, row: int) -> Floats | None:
    """Return left, top, width, height (4,) around a person's keypoints; None where fewer than two were found."""
    points = keypoints.xy[row][keypoints.score[row] >= MIN_JOINT_SCORE]
    if len(points) < 2:
        return None
    first, last = points.min(axis=0), points.max(axis=0)
    margin = JOINT_MARGIN * float(last[1] - first[1])
    return np.concatenate([first - margin, last - first + 2 * margin])
