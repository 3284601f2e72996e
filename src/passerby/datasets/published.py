"""The content of a published data set in Passerby's tables, with a right-handed world and z up.

A projection cannot distinguish `x_c = A X + t` from `x_c = -(A X + t)`. If a calibration was fitted to points of a left-handed
world, but limited to proper rotations, all points are behind its cameras; the true `A` is then a rotation with a reflection.
The people that a camera sees determine the sign. The sign and the determinant of `A` determine the handedness of the world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.linalg import rq

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import UNKNOWN, Boxes, Keypoints

AGREEMENT = 0.95
"""Minimum share of a camera's people on one side of it. Single annotations may be wrong; below it, the calibration is wrong."""
ROTATION_TOLERANCE = 1e-3
"""Maximum error of `R R^T`; published rotations are rounded to four digits or more."""
SKEW_TOLERANCE_PX = 0.05
"""OpenCV's lenses have no skew. A skew that moves no pixel of the picture by more than this is left out without a note."""
LEFT_HANDED = "The published world is left-handed: x was negated, for the cameras and the people alike."


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """True positions of the people on the ground."""

    frame: Ints
    """(N,) frame numbers, counted as in the boxes."""
    identity: Ints
    """(N,) true person ids, the same as in the boxes."""
    xy: Floats
    """(N, 2) positions on the ground, in the world of the rig, metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", np.asarray(self.frame, dtype=np.int64))
        object.__setattr__(self, "identity", np.asarray(self.identity, dtype=np.int64))
        object.__setattr__(self, "xy", np.asarray(self.xy, dtype=np.float64).reshape(-1, 2))
        if not len(self.frame) == len(self.identity) == len(self.xy):
            raise ValueError("the columns of the ground truth differ in length")

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True, eq=False)
class Published:
    """A data set as read from its files.

    Frames are whole numbers from 1; the same number is the same instant in all cameras. Frame f is picture f of a video. For
    single pictures, `picture_frames` states the frame of each.
    """

    name: str
    """Name of the scene: letters, digits, spaces and _ . -"""
    rig: Rig
    """All cameras: lenses, and true poses if the set has them (otherwise `pose` is None). Metres, z up; the ground is z = 0 if
    the set states it."""
    fps: float | None
    """Frames per second of the frame numbers; None if unknown."""
    boxes: Mapping[str, Boxes] = field(default_factory=dict)
    """Camera -> boxes; the identity is the true person id, or -1 if unknown. A camera that saw no person has no rows, or is
    left out."""
    keypoints: Mapping[str, Keypoints] = field(default_factory=dict)
    """Camera -> keypoints; identities as in the boxes."""
    videos: Mapping[str, Path] = field(default_factory=dict)
    """Camera -> existing file."""
    pictures: Mapping[str, tuple[Path, ...]] = field(default_factory=dict)
    """Camera -> existing files in the order of time."""
    picture_frames: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Camera -> frame of each picture, ascending. The pictures of a missing camera are counted 1, 2, 3, ..."""
    ground: GroundTruth | None = None
    notes: tuple[str, ...] = ()
    """Missing information of the set, and assumptions: whole sentences for the user."""

    def __post_init__(self) -> None:
        for what in ("boxes", "keypoints", "videos", "pictures", "picture_frames"):
            strange = set(getattr(self, what)) - set(self.rig.names)
            if strange:
                raise ValueError(f"{what} of {sorted(strange)}, who are no cameras of the rig")
        for camera, frames in self.picture_frames.items():
            if len(frames) != len(self.pictures.get(camera, ())):
                raise ValueError(f"camera {camera} has {len(frames)} numbers for {len(self.pictures.get(camera, ()))} images")

    def frames_of_pictures(self, camera: str) -> tuple[int, ...]:
        """Return the frame of each picture of a camera."""
        return self.picture_frames.get(camera) or tuple(range(1, len(self.pictures.get(camera, ())) + 1))

    @property
    def identities_known(self) -> bool:
        """Whether the boxes and joints have identities, in at least two cameras."""
        known = {camera for camera, boxes in self.boxes.items() if (boxes.identity > UNKNOWN).any()}
        known |= {camera for camera, joints in self.keypoints.items() if (joints.identity > UNKNOWN).any()}
        return len(known) >= 2

    @property
    def people(self) -> int:
        """Number of people with different identities."""
        columns = [boxes.identity for boxes in self.boxes.values()]
        columns += [joints.identity for joints in self.keypoints.values()]
        columns += [self.ground.identity] if self.ground is not None else []
        known = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *columns]))
        return int((known > UNKNOWN).sum())


@dataclass(frozen=True, eq=False)
class PublishedCamera:
    """A camera as published: `x_c = A X + t` or `x_c = -(A X + t)`, metres."""

    name: str
    lens: Lens
    A: Floats
    """(3, 3) orthonormal, determinant 1 or -1."""
    t: Floats
    """(3,) translation, metres."""


def right_handed(place: str, cameras: Sequence[PublishedCamera], seen: Mapping[str, Floats]) -> tuple[Rig, Floats]:
    """Convert the cameras of a set into a rig in a right-handed world.

    Args:
        place: the file or folder of the calibration, for messages.
        cameras: the cameras as published.
        seen: camera -> (N, 3) points of the people that it sees, published world, metres. A camera that sees no person takes
            the handedness of the others.

    Returns:
        The rig, and factors (3,) from the published world into the rig's: ones, or (-1, 1, 1) if it was left-handed.

    Raises:
        InputError: some people that a camera sees lie in front of it and some behind, or cameras differ in handedness.
    """
    signs = {camera.name: _sign(place, camera, seen[camera.name]) for camera in cameras if len(seen.get(camera.name, ()))}
    hands = {camera.name: signs[camera.name] * _hand(camera.A) for camera in cameras if camera.name in signs}
    if len(set(hands.values())) > 1:
        left, right = (next(name for name, hand in hands.items() if hand == which) for which in (-1, 1))
        raise InputError(
            f"{place}: people seen by camera {left} are in front of it only in a left-handed world, those of camera {right} "
            "only in a right-handed one: the calibration files do not belong together; take them from the set again"
        )
    hand = next(iter(hands.values()), 1)
    mirror = np.array([float(hand), 1.0, 1.0])
    posed = []
    for camera in cameras:
        sign = signs.get(camera.name, hand * _hand(camera.A))
        posed.append(Camera(camera.name, camera.lens, Pose(sign * camera.A * mirror, sign * camera.t)))
    return Rig(tuple(posed)), mirror


def rotation(matrix: Floats, place: str) -> Floats:
    """Return the rotation nearest to a published, rounded one. Raises `InputError` for a matrix that is not a rotation."""
    with np.errstate(over="ignore", invalid="ignore"):  # a matrix with NaN is not a rotation
        is_rotation = bool(np.abs(matrix @ matrix.T - np.eye(3)).max() <= ROTATION_TOLERANCE)
    if not is_rotation or np.linalg.det(matrix) < 0:
        raise InputError(
            f"{place} is {shortened(matrix.tolist())}: this is not a rotation matrix; take the file from the set again"
        )
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def from_projection(name: str, matrix: Floats, size: tuple[int, int], place: str) -> tuple[PublishedCamera, float]:
    """Compute a camera from its projection matrix, by RQ decomposition (Hartley and Zisserman 2004, section 6.2.4).

    Args:
        name: name of the camera.
        matrix: (3, 4), from metres to homogeneous pixels, any scale and sign.
        size: (width, height) of the pictures.
        place: the file, for messages.

    Returns:
        The camera, with a lens without skew, and the largest shift of a pixel of the picture without the skew, pixels.

    Raises:
        InputError: the matrix is not that of a camera.
    """
    with np.errstate(all="ignore"):
        scaled = matrix / np.linalg.norm(matrix[2, :3])
        left = scaled[:, :3]
    if not np.isfinite(scaled).all() or abs(np.linalg.det(left)) < 1e-9 * np.linalg.norm(left) ** 2:
        raise InputError(f"{place} is {shortened(matrix.tolist())}: this is not a projection matrix of a camera")
    upper, orthonormal = rq(left)
    signs = np.where(np.diag(upper) < 0, -1.0, 1.0)
    upper, orthonormal = upper * signs, signs[:, None] * orthonormal
    t = np.linalg.solve(upper, scaled[:, 3])
    upper = upper / upper[2, 2]
    skew = float(upper[0, 1])
    lens_matrix = upper.copy()
    lens_matrix[0, 1] = 0.0
    reach = max(abs(upper[1, 2]), abs(size[1] - upper[1, 2])) / upper[1, 1]
    try:
        lens = Lens(size, lens_matrix, np.zeros(0))
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    camera = PublishedCamera(name, lens, np.asarray(orthonormal, dtype=np.float64), np.asarray(t, dtype=np.float64))
    return camera, abs(skew) * float(reach)


def skew_note(name: str, moved_px: float) -> tuple[str, ...]:
    """Return the note about a skew that was left out; none if it is small."""
    if moved_px <= SKEW_TOLERANCE_PX:
        return ()
    return (
        f"The published matrix of camera {name} has a skew, which OpenCV's lenses lack: left out, up to {moved_px:.2f} px.",
    )


def _sign(place: str, camera: PublishedCamera, points: Floats) -> int:
    """Return 1 if the people that a camera sees lie in front of it as published, and -1 if they lie behind it."""
    in_front = int(np.count_nonzero((points @ camera.A.T + camera.t)[:, 2] > 0))
    if in_front >= AGREEMENT * len(points):
        return 1
    if in_front <= (1 - AGREEMENT) * len(points):
        return -1
    raise InputError(
        f"{place}: of {len(points)} people that camera {camera.name} sees, {in_front} lie in front of it, the others behind: "
        "calibration and annotation do not belong together; take both from the set again"
    )


def _hand(A: Floats) -> int:
    return 1 if np.linalg.det(A) > 0 else -1
