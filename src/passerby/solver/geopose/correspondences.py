"""Points that several cameras see, from people with identities.

A box at one instant gives its centre (an estimate of the centre of body mass, as in Xu et al., CVPR 2021), and the middles of
its top and bottom edges. Keypoints give every joint, matched by its number. The same identity, frame and part in two cameras is
one correspondence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Columns, Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Lens, Rig
from passerby.core.observations import MIN_JOINT_SCORE, UNKNOWN, Boxes, Keypoints, Observations
from passerby.geometry.triangulation import PointObservations

CENTRE, TOP, BOTTOM = -1, -2, -3
"""Parts of a box; parts from 0 are joints, by number."""

# Standard deviations: pixels, and share of the person's height in the image. A box's slack moves its edges in opposite
# directions and cancels in the centre, which is therefore less uncertain; joints have errors of about a hundredth of the body.
CENTRE_SIGMA = (0.5, 0.02)
EDGE_SIGMA = (0.5, 0.03)
JOINT_SIGMA = (0.5, 0.01)


@dataclass(frozen=True, eq=False)
class ImagePoints(Columns):
    """M sightings of body points, all cameras in one table, sorted by camera."""

    camera: Ints
    """(M,) index of the camera in the rig."""
    identity: Ints
    """(M,) identity of the person."""
    frame: Ints
    """(M,) instant."""
    part: Ints
    """(M,) CENTRE, TOP, BOTTOM, or the number of a joint."""
    pixel: Floats
    """(M, 2) pixels in the image, distorted."""
    bearing: Floats
    """(M, 3) unit rays in the camera's frame."""
    sigma_px: Floats
    """(M,) standard deviation, pixels."""

    def __len__(self) -> int:
        return len(self.camera)

    def labels(self) -> tuple[Ints, Ints]:
        """Number the points, so that sightings of the same point have the same number.

        Returns:
            label: (M,) number of the point of each sighting, 0 to N - 1.
            key: (N, 3) identity, frame and part of each point, in ascending order.
        """
        if len(self) == 0:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int64)
        columns = np.column_stack([self.identity, self.frame, self.part])
        key, label = np.unique(columns, axis=0, return_inverse=True)
        return label.reshape(-1).astype(np.int64), key


def box_points(rig: Rig, observations: Observations, parts: tuple[int, ...] = (CENTRE,)) -> ImagePoints:
    """Return the given parts of all boxes that have an identity and lie completely inside the image.

    Args:
        rig: gives the order of the cameras and their lenses; cameras without observations give no points.
        observations: boxes with identities that hold across cameras.
        parts: any of CENTRE, TOP and BOTTOM.

    Raises:
        InputError: one identity has two boxes in one camera and frame.
    """

    def of_camera(index: int, name: str, lens: Lens) -> ImagePoints:
        boxes = observations[name].boxes
        boxes = boxes.take(whole_boxes(boxes, lens))
        _check_single(name, "boxes", boxes)
        left, top, width, height = boxes.ltwh.T
        tables = []
        for part in parts:
            v = {CENTRE: top + height / 2, TOP: top, BOTTOM: top + height}[part]
            base, share = CENTRE_SIGMA if part == CENTRE else EDGE_SIGMA
            pixel = np.column_stack([left + width / 2, v])
            tables.append(_table(index, boxes.identity, boxes.frame, np.full(len(boxes), part), pixel, base + share * height))
        return _stacked(tables, lens)

    return _all_cameras(rig, observations, of_camera)


def joint_points(rig: Rig, observations: Observations, *, min_score: float = MIN_JOINT_SCORE) -> ImagePoints:
    """Return all joints with a confidence of at least `min_score` of people with an identity; the part is the joint's number.

    Args:
        rig: gives the order of the cameras and their lenses; cameras without observations give no points.
        observations: keypoints with identities that hold across cameras.
        min_score: smallest confidence of a joint.

    Raises:
        InputError: one identity has two skeletons in one camera and frame, or the cameras' layouts differ in length.
    """
    layouts = {camera.name: observations[camera.name].keypoints for camera in rig if camera.name in observations.cameras}
    counts = {name: len(people.joints) for name, people in layouts.items() if len(people)}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"the cameras' skeletons differ in the number of keypoints ({listed}): use one layout for all")

    def of_camera(index: int, name: str, lens: Lens) -> ImagePoints:
        people = observations[name].keypoints
        people = people.take(people.identity != UNKNOWN)
        _check_single(name, "skeletons", people)
        found = people.score >= min_score
        row, joint = np.nonzero(found)
        base, share = JOINT_SIGMA
        sigma = base + share * _extents(people, found)[row]
        table = _table(index, people.identity[row], people.frame[row], joint, people.xy[row, joint], sigma)
        return _stacked([table], lens)

    return _all_cameras(rig, observations, of_camera)


def numbered_points(rig: Rig, sightings: Mapping[str, tuple[Ints, Floats]], sigma_px: float = 1.0) -> ImagePoints:
    """Return points of any origin, such as matches between images: the same number is the same point in space.

    Args:
        rig: gives the order of the cameras and their lenses; cameras without sightings give no points.
        sightings: camera -> numbers (N,) of the points, each once, and their pixels (N, 2), distorted as in the image.
        sigma_px: standard deviation of every pixel.

    Raises:
        InputError: a camera is not in the rig, or a camera sees one point twice.
    """
    unknown = sorted(set(sightings) - set(rig.names))
    if unknown:
        raise InputError(f"points are marked in camera {unknown[0]}: the rig has {', '.join(rig.names)}")
    tables = []
    for index, camera in enumerate(rig):
        number, pixel = sightings.get(camera.name, (np.zeros(0, dtype=np.int64), np.zeros((0, 2))))
        number, pixel = np.asarray(number, dtype=np.int64), np.asarray(pixel, dtype=np.float64).reshape(-1, 2)
        if len(np.unique(number)) < len(number):
            twice, count = np.unique(number, return_counts=True)
            raise InputError(f"camera {camera.name} sees point {twice[np.argmax(count)]} twice: give each place its own number")
        none = np.zeros(len(number), dtype=np.int64)
        sigma = np.full(len(number), float(sigma_px))
        tables.append(_stacked([_table(index, number, none, none, pixel, sigma)], camera.lens))
    return ImagePoints.joined(tables)


def whole_boxes(boxes: Boxes, lens: Lens) -> NDArray[np.bool_]:
    """Return whether each box (N,) has an identity and lies inside the image."""
    return np.asarray(boxes.inside(lens.size) & (boxes.identity != UNKNOWN))


def match_pair(points: ImagePoints, label: Ints, camera_a: int, camera_b: int) -> tuple[Ints, Ints]:
    """Return the rows (K,), (K,) of the sightings of the same points in two cameras: row_a[i] and row_b[i] see one point.

    Args:
        points: sightings of all cameras.
        label: (M,) numbers from `ImagePoints.labels`.
        camera_a: index of one camera.
        camera_b: index of the other.
    """
    rows_a, rows_b = np.flatnonzero(points.camera == camera_a), np.flatnonzero(points.camera == camera_b)
    _, in_a, in_b = np.intersect1d(label[rows_a], label[rows_b], assume_unique=True, return_indices=True)
    return rows_a[in_a], rows_b[in_b]


def point_observations(rig: Rig, points: ImagePoints, point: Ints) -> PointObservations:
    """Return sightings in the form for the bundle adjustment; `point` (M,) is the number of each one's 3D point."""
    tangent = np.zeros((len(points), 2, 3))
    for index, camera in enumerate(rig):
        rows = points.camera == index
        tangent[rows] = camera.lens.tangents(points.bearing[rows])
    return PointObservations(points.camera, point, points.bearing, tangent, points.sigma_px)


def _all_cameras(rig: Rig, observations: Observations, of_camera: Callable[[int, str, Lens], ImagePoints]) -> ImagePoints:
    tables = [
        of_camera(index, camera.name, camera.lens) for index, camera in enumerate(rig) if camera.name in observations.cameras
    ]
    none = np.zeros(0, dtype=np.int64)
    return ImagePoints.joined([_table(0, none, none, none, np.zeros((0, 2)), np.zeros(0)), *tables])


def _table(camera: int, identity: Ints, frame: Ints, part: Ints, pixel: Floats, sigma_px: Floats) -> ImagePoints:
    """Build a table without rays."""
    column = np.full(len(identity), camera, dtype=np.int64)
    return ImagePoints(column, identity, frame, part.astype(np.int64), pixel, np.full((len(pixel), 3), np.nan), sigma_px)


def _stacked(tables: list[ImagePoints], lens: Lens) -> ImagePoints:
    """Join the tables of one camera and add the rays; pixels outside the range of the lens model are dropped."""
    table = ImagePoints.joined(tables)
    bearing = lens.bearings(table.pixel)
    sound = np.flatnonzero(np.isfinite(bearing).all(axis=1))
    return replace(table, bearing=bearing).take(sound)


def _extents(people: Keypoints, found: NDArray[np.bool_]) -> Floats:
    """Return the diagonal (N,) of the box around each person's detected joints, pixels."""
    wide = found[:, :, None]
    low = np.where(wide, people.xy, np.inf).min(axis=1, initial=np.inf)
    high = np.where(wide, people.xy, -np.inf).max(axis=1, initial=-np.inf)
    return np.asarray(np.where(found.any(axis=1), np.hypot(*np.maximum(high - low, 0.0).T), 0.0))


def _check_single(camera: str, what: str, people: Boxes | Keypoints) -> None:
    key, count = np.unique(np.column_stack([people.identity, people.frame]), axis=0, return_counts=True)
    if (count > 1).any():
        identity, frame = key[int(np.argmax(count > 1))]
        raise InputError(
            f"camera {camera} has two {what} of identity {identity} in frame {frame}: an identity is one person, "
            "who can be seen once in an image; give unknown people the identity -1"
        )
