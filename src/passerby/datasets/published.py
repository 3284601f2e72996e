"""What a published data set holds, in Passerby's terms: metres, z up, people's feet at z = 0, OpenCV's lenses and pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Boxes, Keypoints


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """Where the people truly stood."""

    frame: Ints
    """(N,) instants, counted as in the boxes."""
    identity: Ints
    """(N,) true person ids, the same as in the boxes."""
    xy: Floats
    """(N, 2) metres on the ground, in the world of the rig."""

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

    Frames are whole numbers from 1 on, the same number is the same instant in all cameras. Where there are videos, frame f is
    picture f of the video; where there are pictures, `picture_frames` tells which frame each is.
    """

    name: str
    """What the scene is called: letters, digits, spaces and _ . -"""
    rig: Rig
    """All cameras: lenses, and true poses where the set knows them (`pose` None where it does not). Metres, z up; the ground is
    z = 0 where the set knows it."""
    fps: float | None
    """Frames per second of the frame numbers; None if unknown."""
    boxes: Mapping[str, Boxes] = field(default_factory=dict)
    """By camera; the identity is the true person id, or -1 where unknown. A camera that saw no person has none, or is
    left out."""
    keypoints: Mapping[str, Keypoints] = field(default_factory=dict)
    """By camera; identities as in the boxes."""
    videos: Mapping[str, Path] = field(default_factory=dict)
    """By camera; existing files."""
    pictures: Mapping[str, tuple[Path, ...]] = field(default_factory=dict)
    """By camera; existing files in the order of time."""
    picture_frames: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """By camera, the frame of each picture, ascending. A camera that is left out has its pictures counted 1, 2, 3, ..."""
    ground: GroundTruth | None = None
    notes: tuple[str, ...] = ()
    """What the set does not tell, or what was assumed: whole sentences for the user."""

    def __post_init__(self) -> None:
        for what in ("boxes", "keypoints", "videos", "pictures", "picture_frames"):
            strange = set(getattr(self, what)) - set(self.rig.names)
            if strange:
                raise ValueError(f"{what} of {sorted(strange)}, who are no cameras of the rig")
        for camera, frames in self.picture_frames.items():
            if len(frames) != len(self.pictures.get(camera, ())):
                raise ValueError(f"camera {camera} has {len(frames)} numbers for {len(self.pictures.get(camera, ()))} images")

    def frames_of_pictures(self, camera: str) -> tuple[int, ...]:
        """The frame of each picture of a camera."""
        return self.picture_frames.get(camera) or tuple(range(1, len(self.pictures.get(camera, ())) + 1))

    @property
    def identities_known(self) -> bool:
        """Whether the boxes and joints have identities, in at least two cameras."""
        known = {camera for camera, boxes in self.boxes.items() if (boxes.identity > UNKNOWN).any()}
        known |= {camera for camera, joints in self.keypoints.items() if (joints.identity > UNKNOWN).any()}
        return len(known) >= 2

    @property
    def people(self) -> int:
        """How many people are distinguished."""
        columns = [boxes.identity for boxes in self.boxes.values()]
        columns += [joints.identity for joints in self.keypoints.values()]
        columns += [self.ground.identity] if self.ground is not None else []
        known = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *columns]))
        return int((known > UNKNOWN).sum())
