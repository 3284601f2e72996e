"""What every format of other tools has in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.interchange.formats.losses import Losses, Unread

if TYPE_CHECKING:
    from pathlib import Path

    from passerby.core.cameras import Rig
    from passerby.core.observations import Boxes, Keypoints
    from passerby.core.trajectories import Trajectories
    from passerby.interchange.formats.recognition import FileSample


@dataclass(frozen=True, eq=False)
class Export:
    """What is handed to another tool. World z up, ground at z = 0, metres."""

    rig: Rig
    name: str = "rig"
    """Of the scene, for formats that have a place for it. Untrusted text, like the cameras' names."""
    trajectories: Trajectories | None = None
    """People's trajectories, for formats that draw them."""

    def posed(self, losses: Losses) -> Rig:
        """The cameras with poses; the others are losses. Raises `InputError` where there is none."""
        posed = self.rig.posed()
        if not len(posed):
            raise InputError(f"none of the {len(self.rig)} cameras has a pose: there is nothing to export")
        for camera in self.rig:
            if camera.pose is None:
                losses.add(f"camera {camera.name} has no pose and is left out")
        return posed

    def with_lenses(self, losses: Losses) -> Rig:
        """All cameras, for formats that need no poses. One that has neither a pose nor a lens that anybody knows is a loss.

        Without a pose no lens was estimated: another tool would take the guess for intrinsics.
        Raises `InputError` where there is none.
        """
        known = [camera for camera in self.rig if camera.pose is not None or not _is_guess(camera.lens)]
        if not known:
            raise InputError(f"none of the {len(self.rig)} cameras has a pose or known intrinsics: there is nothing to export")
        for camera in self.rig:
            if camera not in known:
                losses.add(f"camera {camera.name} has neither a pose nor known intrinsics and is left out")
        return replace(self.rig, cameras=tuple(known))


def _is_guess(lens: Lens) -> bool:
    """Whether a focal length could be that of any camera."""
    return lens.focal_sd is not None and lens.focal_sd >= LARGEST_FOCAL_SD


@dataclass(frozen=True, eq=False)
class Given:
    """What a user says of a file where the file itself does not."""

    size: tuple[int, int] | None = None
    """(width, height) of the pictures, pixels."""
    metres_per_unit: float | None = None
    """Of lengths in the file; None: as the file says, or the format's own unit."""
    losses: Losses = field(default_factory=Losses)
    """What is in the file and cannot be kept."""
    unread: Unread = field(default_factory=Unread)
    """What is in the file beyond lenses and poses, and is not read: readers add to it."""

    def size_of(self, place: str) -> tuple[int, int]:
        """The size that the user gave. Raises `InputError`, beginning with `place`, where none was given."""
        if self.size is None:
            raise InputError(f"{place}: states no image size: give it with --size WIDTHxHEIGHT")
        return self.size


@dataclass(frozen=True, eq=False)
class People:
    """One camera's people as another tool found them."""

    boxes: Boxes
    keypoints: Keypoints
    notes: tuple[str, ...] = ()
    """What is odd about the file."""


@dataclass(frozen=True, eq=False)
class Format:
    """A format of another tool."""

    name: str
    """As `--format` takes it."""
    title: str
    """What it is, in a few words."""
    tools: tuple[str, ...]
    """Who opens it, or writes it."""
    target: Literal["file", "folder"]
    suffixes: tuple[str, ...] = ()
    """Endings that its file may have, the usual one first, with the dot; of a folder, those of the one
    file that may stand for it, or none."""
    conventions: str = ""
    """Axes, direction of the transform, unit, pixel centre, lens models: one or two sentences for the documentation."""
    write: Callable[[Export, Losses], Mapping[str, bytes]] | None = None
    """Pure: file name below the target -> content; "" is the target itself where that is a file. Losses are only added."""
    read: Callable[[Path, Given], Rig] | None = None
    """Cameras; a lens without a pose is a camera without a pose. Raises `InputError` (file, place, value, remedy)."""
    read_people: Callable[[Path, Given], People] | None = None
    """One camera's boxes or joints. Raises `InputError`."""
    recognises: Callable[[FileSample], bool] | None = None
    """Whether a file is a calibration of this format, or the part of it that has the intrinsics. Never raises."""
    companions: frozenset[str] = frozenset()
    """Of a folder: files below it that no reader takes for a camera, so that others of their kind may lie beside them."""
    draws_people: bool = False
    """Whether it is a picture of the rig that people's trajectories belong to: an output folder's go along without being asked
    for."""
    write_one: Callable[[Export, Losses], bytes] | None = None
    """Of a folder: the same in one file, for a target with one of the suffixes."""
