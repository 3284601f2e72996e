"""Observations of the cameras in columns (one array per property, one row per box or person), and the formats of boxes.

Frames are whole numbers. Without clocks all cameras count them alike: the same number is the same instant. An identity is a
whole number; -1 means unknown. The arrays are checked once, when an object is made, and are read-only from then on.

The four numbers of a box are left, top, width, height (MOTChallenge, COCO); left, top, right, bottom (most detectors in
memory); or centre x, centre y, width, height. Each is in pixels or, normalised, a share of the image's width or height (YOLO
text: centres).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.geometry.groups import group_numbers, least_of_groups

Vectors = NDArray[np.float32]
UNKNOWN = -1
BORDER_PX = 2.0
"""A box nearer than this to the picture's border is cut off there: neither its centre nor its edges are those of the body."""
MIN_JOINT_SCORE = 0.3
"""Joints of lower confidence are left out, as Pose2Sim and Anipose do by default."""
MIN_JOINTS = 4
"""Smallest number of found joints with which a person counts as one."""
BODY_17 = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
"""COCO's 17 joints, in COCO's order."""
WAND_ENDS = ("first end", "second end")
"""The two keypoints of a wand."""
Convention = Literal["ltwh", "corners", "centres"]
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
_COLUMNS: dict[Convention, tuple[str, str, str, str]] = {
    "ltwh": ("left", "top", "width", "height"),
    "corners": ("left", "top", "right", "bottom"),
    "centres": ("centre x", "centre y", "width", "height"),
}


def _column(values: object, dtype: type, shape_tail: tuple[int, ...], name: str) -> NDArray[Any]:
    given = np.asarray(values)
    if given.size == 0:
        given = given.reshape(0, *shape_tail)
    if given.shape[1:] != shape_tail or given.ndim != 1 + len(shape_tail):
        raise InputError(f"{name} has the shape {given.shape}: (rows, {', '.join(map(str, shape_tail))}) is needed")
    try:
        numbers = given.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} does not hold numbers: {error}") from None
    finite = np.isfinite(numbers).all(axis=tuple(range(1, numbers.ndim)))
    if not finite.all():
        row = int(np.flatnonzero(~finite)[0])
        raise InputError(f"{name} of row {row + 1} is not a finite number: {given[row].tolist()}")
    if np.issubdtype(dtype, np.integer) and (numbers != np.round(numbers)).any():
        row = int(np.flatnonzero(numbers != np.round(numbers))[0])
        raise InputError(f"{name} of row {row + 1} is {given[row]}: a whole number is needed")
    array: NDArray[Any] = np.array(given, dtype=dtype)
    array.setflags(write=False)
    return array


def _unit_vectors(values: object) -> Vectors:
    """Scale the rows (N, D) to unit length. A row of zeros stays as it is: the appearance of its box is not known."""
    given = np.array(values, dtype=np.float32)
    if given.ndim != 2:
        raise InputError(f"boxes.embedding has the shape {given.shape}: (boxes, dimensions) is needed")
    length = np.linalg.norm(given, axis=1)
    if not np.isfinite(length).all():
        raise InputError(f"boxes.embedding of row {int(np.flatnonzero(~np.isfinite(length))[0]) + 1} is not finite")
    unit = given / np.where(length > 0, length, 1.0)[:, None]
    unit.setflags(write=False)
    return np.asarray(unit, dtype=np.float32)


def _describe_rows(frame: Ints, identity: Ints) -> str:
    """Describe rows in words: their number, their frames and the number of identities."""
    if not len(frame):
        return "none"
    known = len(np.unique(identity[identity != UNKNOWN]))
    return f"{len(frame)} in frames {frame.min()} to {frame.max()}, {known} identit{'y' if known == 1 else 'ies'}"


def sampling_step(frame: Ints) -> int:
    """Return the number of frames between neighbouring samples, such as 1 or 10; 1 where there are fewer than two.

    The tenth percentile of the steps is used, so that a camera that seldom sees people does not seem to be slow.

    Args:
        frame: (N,) frames with people in them, in any order; a frame may occur several times.
    """
    steps = np.diff(np.unique(frame))
    return int(np.percentile(steps, 10.0, method="lower")) if len(steps) else 1


def find_inside_picture(ltwh: Floats, size: tuple[int, int] | NDArray[Any], border: float = BORDER_PX) -> NDArray[np.bool_]:
    """Return whether each box (N,) is whole: the picture's border does not cut it off.

    Args:
        ltwh: (N, 4) left, top, width, height in pixels.
        size: width and height of the picture, pixels; (N, 2) where the boxes are from several cameras.
        border: distance from the border below which a box counts as cut off, pixels.
    """
    first, last = ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]
    return np.asarray(((first > border) & (last < np.asarray(size) - border)).all(axis=1))


def once_in_frame(frame: Ints, identity: Ints, cost: NDArray[Any] | None = None) -> Ints:
    """Return the rows, ascending, in which each identity occurs once in a frame; rows of unknown identity all stay.

    Args:
        frame: (N,) frame numbers.
        identity: (N,) identities, or -1.
        cost: (N,) of rows with the same frame and identity, the one of the lowest cost stays. None: the first one stays.
    """
    own = np.where(identity > UNKNOWN, identity, UNKNOWN - 1 - np.arange(len(frame)))
    return np.sort(least_of_groups(group_numbers(frame, own), np.zeros(len(frame)) if cost is None else cost))


@dataclass(frozen=True)
class Clock:
    """Conversion from a camera's frame numbers to the rig's time."""

    fps: float
    """Frames per second of the camera's frame numbers."""
    offset_s: float = 0.0
    """The rig's time at frame 1, seconds: frame f shows the world at (f - 1) / fps + offset_s."""

    def seconds(self, frame: Ints | Floats) -> Floats:
        """Convert frames (N,) to the rig's time, seconds."""
        return np.asarray((frame - 1.0) / self.fps + self.offset_s)

    def frames(self, seconds: Floats) -> Floats:
        """Convert the rig's times (N,), seconds, to fractional frame numbers."""
        return np.asarray((seconds - self.offset_s) * self.fps + 1.0)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Bounding boxes of people in one camera."""

    frame: Ints
    """(N,) frame numbers."""
    identity: Ints
    """(N,) identities (global), tracklet numbers (per camera), or -1."""
    ltwh: Floats
    """(N, 4): left, top, width, height in pixels; width and height above 0."""
    score: Floats
    """(N,) the detector's confidence."""
    embedding: Vectors | None = None
    """(N, D) appearance, one unit vector per box; None where no appearance is known."""

    def __post_init__(self) -> None:
        for name, dtype, tail in (("frame", np.int64, ()), ("identity", np.int64, ()), ("ltwh", np.float64, (4,)),
                                  ("score", np.float64, ())):  # fmt: skip
            object.__setattr__(self, name, _column(getattr(self, name), dtype, tail, f"boxes.{name}"))
        if self.embedding is not None:
            object.__setattr__(self, "embedding", _unit_vectors(self.embedding))
        lengths = {len(self.frame), len(self.identity), len(self.ltwh), len(self.score)}
        if len(lengths | ({len(self.embedding)} if self.embedding is not None else set())) > 1:
            raise InputError("the columns of the boxes differ in length")
        flat = np.flatnonzero((self.ltwh[:, 2:] <= 0).any(axis=1))
        if len(flat):
            row = int(flat[0])
            raise InputError(
                f"box of frame {self.frame[row]}, identity {self.identity[row]} has width and height "
                f"{self.ltwh[row, 2:].tolist()}: both must be above 0"
            )

    def __repr__(self) -> str:
        appearance = "" if self.embedding is None else f", embeddings of {self.embedding.shape[1]}"
        return f"Boxes({_describe_rows(self.frame, self.identity)}{appearance})"

    @classmethod
    def empty(cls) -> Boxes:
        """Return a table without boxes."""
        return cls(np.zeros(0), np.zeros(0), np.zeros((0, 4)), np.zeros(0))  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.frame)

    def inside(self, size: tuple[int, int], border: float = BORDER_PX) -> NDArray[np.bool_]:
        """Return whether each box (N,) is whole in a picture of a size (width, height), see `find_inside_picture`."""
        return find_inside_picture(self.ltwh, size, border)

    def take(self, rows: NDArray[np.generic]) -> Boxes:
        """Return the boxes of the given rows (indices or a mask)."""
        embedding = None if self.embedding is None else self.embedding[rows]
        return Boxes(self.frame[rows], self.identity[rows], self.ltwh[rows], self.score[rows], embedding)


@dataclass(frozen=True, eq=False)
class Keypoints:
    """2D joints of people in one camera."""

    frame: Ints
    """(N,) frame numbers."""
    identity: Ints
    """(N,) as in `Boxes`."""
    xy: Floats
    """(N, J, 2) pixels; meaningless where the score is 0."""
    score: Floats
    """(N, J) confidence, 0 for a joint that was not found."""
    joints: tuple[str, ...] = BODY_17
    """The J joints' names."""

    def __post_init__(self) -> None:
        n_joints = len(self.joints)
        for name, dtype, tail in (("frame", np.int64, ()), ("identity", np.int64, ()), ("xy", np.float64, (n_joints, 2)),
                                  ("score", np.float64, (n_joints,))):  # fmt: skip
            object.__setattr__(self, name, _column(getattr(self, name), dtype, tail, f"keypoints.{name}"))
        if not len(self.frame) == len(self.identity) == len(self.xy) == len(self.score):
            raise InputError("the columns of the keypoints differ in length")

    def __repr__(self) -> str:
        return f"Keypoints({_describe_rows(self.frame, self.identity)}, {len(self.joints)} keypoints)"

    @classmethod
    def empty(cls, joints: tuple[str, ...] = BODY_17) -> Keypoints:
        """Return a table without keypoints."""
        n_joints = len(joints)
        return cls(np.zeros(0), np.zeros(0), np.zeros((0, n_joints, 2)), np.zeros((0, n_joints)), joints)  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: NDArray[np.generic]) -> Keypoints:
        """Return the people of the given rows (indices or a mask)."""
        return Keypoints(self.frame[rows], self.identity[rows], self.xy[rows], self.score[rows], self.joints)


@dataclass(frozen=True, eq=False)
class CameraObservations:
    """All observations of one camera; boxes or keypoints may be empty."""

    boxes: Boxes = field(default_factory=Boxes.empty)
    keypoints: Keypoints = field(default_factory=Keypoints.empty)
    wands: Keypoints = field(default_factory=lambda: Keypoints.empty(WAND_ENDS))
    """Ends of the wands (sticks of known length that people carry through the scene); the identity is the wand's number."""


@dataclass(frozen=True, eq=False)
class Observations:
    """All observations of a scene's cameras, by camera name."""

    cameras: Mapping[str, CameraObservations]
    fps: float | None = None
    """Frames per second of the frame numbers, those of the first camera where they differ; None where they are not known."""
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    """Each camera's clock. Empty: the same frame number is the same instant in all cameras."""

    def __repr__(self) -> str:
        boxes = sum(len(seen.boxes) for seen in self.cameras.values())
        joints = sum(len(seen.keypoints) for seen in self.cameras.values())
        bodies = f", {joints} skeletons" if joints else ""
        return f"Observations({len(self.cameras)} cameras, {boxes} boxes{bodies})"

    def __getitem__(self, name: str) -> CameraObservations:
        return self.cameras[name]


def extents_of(part: Boxes | Keypoints) -> NDArray[np.float64]:
    """Return left, top, right, bottom (N, 4) of each person, pixels; of joints around the found ones, zeros without any."""
    if isinstance(part, Boxes):
        return np.column_stack([part.ltwh[:, :2], part.ltwh[:, :2] + part.ltwh[:, 2:]])
    found = part.score[..., None] > 0
    some = found.any(axis=1)
    low = np.where(some, np.where(found, part.xy, np.inf).min(axis=1, initial=np.inf), 0.0)
    high = np.where(some, np.where(found, part.xy, -np.inf).max(axis=1, initial=-np.inf), 0.0)
    return np.column_stack([low, high])


@dataclass(frozen=True)
class BoxFormat:
    """Format of the four numbers of a box."""

    convention: Convention = "ltwh"
    normalised: bool = False
    """Whether the numbers are shares of the image's width and height, and not pixels."""

    @classmethod
    def of_text(cls, text: str) -> BoxFormat:
        """Return the format that a text names, as "corners" or "normalised centres"; "normalized" and "centers" are accepted.

        Raises `ValueError` with the formats that exist.
        """
        words = re.findall(r"[a-z]+", text.lower().replace("centers", "centres").replace("normalized", "normalised"))
        found = [format for format in FORMATS if sorted(words) == sorted(str(format).split())]
        if not found:
            raise ValueError(f"{shortened(text)} is no box format: write one of {', '.join(map(str, FORMATS))}")
        return found[0]

    def __str__(self) -> str:
        return f"normalised {self.convention}" if self.normalised else self.convention

    @property
    def columns(self) -> tuple[str, str, str, str]:
        """Names of the four numbers."""
        return _COLUMNS[self.convention]

    def to_ltwh(self, numbers: Floats, size: tuple[int, int] | None = None) -> Floats:
        """Convert numbers to left, top, width, height (N, 4); widths and heights are negative where corners are exchanged.

        Args:
            numbers: (N, 4) in this format.
            size: width and height of the image, pixels: shares become pixels. None: the unit stays.
        """
        first, last = numbers[:, :2], numbers[:, 2:]
        if self.convention == "corners":
            last = last - first
        elif self.convention == "centres":
            first = first - last / 2
        return np.asarray(np.concatenate([first, last], axis=1) * self._scale(size))

    def of_ltwh(self, ltwh: Floats, size: tuple[int, int] | None = None) -> Floats:
        """Convert boxes to numbers (N, 4) in this format; the inverse of `to_ltwh`.

        Args:
            ltwh: (N, 4) left, top, width, height, pixels.
            size: width and height of the image, pixels: pixels become shares in a normalised format. None: the unit stays.
        """
        ltwh = ltwh / self._scale(size)
        first, last = ltwh[:, :2], ltwh[:, 2:]
        if self.convention == "corners":
            last = first + last
        elif self.convention == "centres":
            first = first + last / 2
        return np.asarray(np.concatenate([first, last], axis=1))

    def _scale(self, size: tuple[int, int] | None) -> Floats:
        return np.tile(np.array(size if self.normalised and size is not None else (1, 1), dtype=np.float64), 2)


FORMATS = tuple(BoxFormat(convention, normalised) for normalised in (False, True) for convention in CONVENTIONS)
LTWH = BoxFormat()
"""Left, top, width, height in pixels: the format of Passerby's computations and output."""
