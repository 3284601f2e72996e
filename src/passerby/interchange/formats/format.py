"""What every format of other tools has in common: its readers and writers, its losses, and how its files are recognised.

A loss is whatever would make points project elsewhere, or drops a camera or a person: a lens that the format has no model for,
a camera without a pose where poses are needed. Sigmas and the verdict are no losses: no other tool knows them.

What a file holds beyond lenses and poses, such as residuals and dates, moves no point. It is not read, and one line lists it,
so that nothing is dropped without a word.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from passerby.common.errors import InputError
from passerby.common.text import shortened_text
from passerby.core.cameras import Lens
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.interchange.opencv_lens import LARGEST_BYTES
from passerby.interchange.storage.safe_parsing import NotParsed, file_bytes, parse_json, parse_safe_yaml, parse_toml, parse_xml

if TYPE_CHECKING:
    from pathlib import Path

    from passerby.core.cameras import Rig
    from passerby.core.observations import Boxes, Keypoints
    from passerby.core.trajectories import Trajectories

LISTED = 20
"""Things that are named on the line of what is not read."""
PARSERS: Mapping[str, Callable[[str], Any]] = {
    ".json": parse_json, ".toml": parse_toml, ".yml": parse_safe_yaml, ".yaml": parse_safe_yaml, ".xml": parse_xml,
    ".xcp": parse_xml, ".txt": parse_xml,
}  # fmt: skip
"""By the ending of a file's name; a .txt is Qualisys' XML or nothing that needs parsing."""


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


class Losses:
    """Gathers losses, so that all are reported at once."""

    def __init__(self) -> None:
        self._told: list[str] = []

    def add(self, what: str) -> None:
        """One loss: a sentence without full stop that names the camera, and how large the error is where that is known."""
        if what not in self._told:
            self._told.append(what)

    @property
    def told(self) -> tuple[str, ...]:
        """All of them, as they came."""
        return tuple(self._told)

    def forbid(self, place: str, format_name: str) -> None:
        """Raise `InputError` that tells all losses where there are any."""
        if self._told:
            raise InputError(
                f"{place}: format {format_name} cannot hold everything: {'; '.join(self._told)}: add --lossy to continue, or "
                f"choose a format that can (`passerby formats`)"
            )


class Unread:
    """Counts what readers find in a file and do not read, so that one line tells all of it."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, what: str) -> None:
        """One thing that is not read: a key, or a few words."""
        self._counts[what] += 1

    def keys(self, found: Iterable[object], read: Collection[object]) -> None:
        """The keys that are not among those that the reader knows; of a mapping, those with a value that says something."""
        for key in found:
            if key not in read and not (isinstance(found, Mapping) and _is_empty(found[key])):
                self.add(shortened_text(str(key)))

    @property
    def told(self) -> tuple[str, ...]:
        """One sentence that lists everything, as it came; none where all was read."""
        if not self._counts:
            return ()
        listed = [what if count == 1 else f"{what} ({count} times)" for what, count in self._counts.items()]
        more = f" and {len(listed) - LISTED} more" if len(listed) > LISTED else ""
        return (f"not read: {', '.join(listed[:LISTED])}{more}",)


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
class FileSample:
    """A file as formats look at it to recognise it."""

    path: Path
    data: bytes

    @property
    def name(self) -> str:
        """The file's name in small letters."""
        return self.path.name.lower()

    @property
    def suffix(self) -> str:
        """The ending of the name in small letters, with the dot."""
        return self.path.suffix.lower()

    @cached_property
    def content(self) -> Any:
        """What the file holds: the value of JSON, TOML or YAML, or the root of XML; None where it is none of them."""
        if self.suffix not in PARSERS:
            return None
        try:
            return PARSERS[self.suffix](self.data.decode("utf-8-sig").replace("\r\n", "\n"))
        except (NotParsed, UnicodeDecodeError, RecursionError):
            return None

    @property
    def table(self) -> dict[Any, Any]:
        """The content where it is a table; else an empty one."""
        return self.content if isinstance(self.content, dict) else {}

    @property
    def tag(self) -> str:
        """The name of the root element where the content is XML; else empty."""
        return getattr(self.content, "tag", "")

    def has_elements(self, place: str) -> bool:
        """Whether there is an element at that place below the root of XML."""
        return bool(self.tag) and self.content.find(place) is not None


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


def _is_empty(value: object) -> bool:
    """Whether a value is empty, or what tools write where they have none."""
    if isinstance(value, dict):
        return all(map(_is_empty, value.values()))
    if isinstance(value, (list, tuple)):
        return not value
    return value is None or (isinstance(value, (str, int, float)) and value in ("", "null", 0, False))


def sample_file(path: Path) -> FileSample | None:
    """A file to look at; None for what is no file, cannot be read, or is larger than calibrations are."""
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_BYTES:
            return None
        return FileSample(path, file_bytes(path, "a calibration"))
    except (OSError, ValueError, InputError):
        return None
