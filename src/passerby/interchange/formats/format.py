"""Common parts of the formats of other tools: readers and writers, losses, and the recognition of files.

A loss is a difference by which points project to other pixels, or the omission of a camera or a person. Examples are a lens
for which the format has no model, and a camera without a pose where poses are needed. Missing sigmas and a missing verdict are
no losses: no other tool has them.

Other content of a file, such as residuals and dates, moves no point. It is not read, and one line lists it, so that nothing is
dropped silently.
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
"""Largest number of items on the line that lists unread content."""
PARSERS: Mapping[str, Callable[[str], Any]] = {
    ".json": parse_json, ".toml": parse_toml, ".yml": parse_safe_yaml, ".yaml": parse_safe_yaml, ".xml": parse_xml,
    ".xcp": parse_xml, ".txt": parse_xml,
}  # fmt: skip
"""Ending of a file's name -> its parser. A .txt is Qualisys' XML, or a file that needs no parsing to be recognised."""


@dataclass(frozen=True, eq=False)
class Export:
    """A rig to export to another tool. World z up, ground at z = 0, metres."""

    rig: Rig
    name: str = "rig"
    """Name of the scene, for formats that store it. Untrusted text, as are the cameras' names."""
    trajectories: Trajectories | None = None
    """People's trajectories, for formats that draw them."""

    def posed(self, losses: Losses) -> Rig:
        """Return the cameras with poses; the others are losses. Raises `InputError` if no camera has a pose."""
        posed = self.rig.posed()
        if not len(posed):
            raise InputError(f"none of the {len(self.rig)} cameras has a pose: there is nothing to export")
        for camera in self.rig:
            if camera.pose is None:
                losses.add(f"camera {camera.name} has no pose and is left out")
        return posed

    def with_lenses(self, losses: Losses) -> Rig:
        """Return the cameras with a pose or a known lens, for formats that need no poses. The others are losses.

        The lens of a camera without a pose was not estimated: another tool would use a guessed lens as intrinsics.
        Raises `InputError` if no camera is left.
        """
        known = [camera for camera in self.rig if camera.pose is not None or not _is_guess(camera.lens)]
        if not known:
            raise InputError(f"none of the {len(self.rig)} cameras has a pose or known intrinsics: there is nothing to export")
        for camera in self.rig:
            if camera not in known:
                losses.add(f"camera {camera.name} has neither a pose nor known intrinsics and is left out")
        return replace(self.rig, cameras=tuple(known))


def _is_guess(lens: Lens) -> bool:
    """Check whether a focal length is a guess that could be that of any camera."""
    return lens.focal_sd is not None and lens.focal_sd >= LARGEST_FOCAL_SD


class Losses:
    """The losses of an export or import, gathered so that all are reported together."""

    def __init__(self) -> None:
        self._told: list[str] = []

    def add(self, what: str) -> None:
        """Add a loss: a sentence without full stop that names the camera and, if it is known, the size of the error."""
        if what not in self._told:
            self._told.append(what)

    @property
    def told(self) -> tuple[str, ...]:
        """All losses, in the order in which they were added."""
        return tuple(self._told)

    def forbid(self, place: str, format_name: str) -> None:
        """Raise `InputError` that lists all losses, if there are any."""
        if self._told:
            raise InputError(
                f"{place}: format {format_name} cannot hold everything: {'; '.join(self._told)}: add --lossy to continue, or "
                f"choose a format that can (`passerby formats`)"
            )


class Unread:
    """Counts of the content of a file that readers do not read, for one line that lists it."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, what: str) -> None:
        """Count one item that is not read: a key, or a few words."""
        self._counts[what] += 1

    def keys(self, found: Iterable[object], read: Collection[object]) -> None:
        """Count the keys in `found` that are not in `read`. If `found` is a mapping, keys with an empty value do not count."""
        for key in found:
            if key not in read and not (isinstance(found, Mapping) and _is_empty(found[key])):
                self.add(shortened_text(str(key)))

    @property
    def told(self) -> tuple[str, ...]:
        """One sentence that lists all unread items in the order in which they were added; empty if everything was read."""
        if not self._counts:
            return ()
        listed = [what if count == 1 else f"{what} ({count} times)" for what, count in self._counts.items()]
        more = f" and {len(listed) - LISTED} more" if len(listed) > LISTED else ""
        return (f"not read: {', '.join(listed[:LISTED])}{more}",)


@dataclass(frozen=True, eq=False)
class Given:
    """Values that the user states because the file does not, and the reports of the reader."""

    size: tuple[int, int] | None = None
    """(width, height) of the pictures, pixels."""
    metres_per_unit: float | None = None
    """Unit of lengths in the file, metres; None: the unit that the file states, or the format's own."""
    losses: Losses = field(default_factory=Losses)
    """Content of the file that cannot be kept. Readers add to it."""
    unread: Unread = field(default_factory=Unread)
    """Content of the file beyond lenses and poses, which is not read. Readers add to it."""

    def size_of(self, place: str) -> tuple[int, int]:
        """Return the image size that the user stated. Raises `InputError`, which begins with `place`, if there is none."""
        if self.size is None:
            raise InputError(f"{place}: states no image size: give it with --size WIDTHxHEIGHT")
        return self.size


@dataclass(frozen=True, eq=False)
class People:
    """People that another tool found in one camera."""

    boxes: Boxes
    keypoints: Keypoints
    notes: tuple[str, ...] = ()
    """Irregularities of the file, one sentence each."""


@dataclass(frozen=True, eq=False)
class FileSample:
    """A file that formats examine to recognise it."""

    path: Path
    data: bytes

    @property
    def name(self) -> str:
        """The file's name in lower case."""
        return self.path.name.lower()

    @property
    def suffix(self) -> str:
        """The ending of the name in lower case, with the dot."""
        return self.path.suffix.lower()

    @cached_property
    def content(self) -> Any:
        """The parsed content: the value of JSON, TOML or YAML, or the root of XML; None if it is none of them."""
        if self.suffix not in PARSERS:
            return None
        try:
            return PARSERS[self.suffix](self.data.decode("utf-8-sig").replace("\r\n", "\n"))
        except (NotParsed, UnicodeDecodeError, RecursionError):
            return None

    @property
    def table(self) -> dict[Any, Any]:
        """The content if it is a table, else an empty table."""
        return self.content if isinstance(self.content, dict) else {}

    @property
    def tag(self) -> str:
        """The name of the root element if the content is XML, else empty."""
        return getattr(self.content, "tag", "")

    def has_elements(self, place: str) -> bool:
        """Check whether there is an element at a path below the root of XML."""
        return bool(self.tag) and self.content.find(place) is not None


@dataclass(frozen=True, eq=False)
class Format:
    """A format of another tool."""

    name: str
    """Name of the format for the option `--format`."""
    title: str
    """Description in a few words."""
    tools: tuple[str, ...]
    """Tools that open or write the format."""
    target: Literal["file", "folder"]
    suffixes: tuple[str, ...] = ()
    """Endings that its file may have, with the dot, the usual one first. For a folder, endings of a single file that may
    replace the folder; empty if there is no such file."""
    conventions: str = ""
    """Axes, direction of the transform, unit, pixel centre, lens models: one or two sentences for the documentation."""
    write: Callable[[Export, Losses], Mapping[str, bytes]] | None = None
    """Pure function that returns file name below the target -> content; "" is the target itself if it is a file. It adds
    losses."""
    read: Callable[[Path, Given], Rig] | None = None
    """Reads cameras; a lens without a pose is a camera without a pose. Raises `InputError` (file, place, value, remedy)."""
    read_people: Callable[[Path, Given], People] | None = None
    """Reads one camera's boxes or joints. Raises `InputError`."""
    recognises: Callable[[FileSample], bool] | None = None
    """Checks whether a file is a calibration of this format, or the part of it with the intrinsics. Never raises."""
    companions: frozenset[str] = frozenset()
    """For a folder: files below it that no reader takes for a camera. Other files of the same kind may be beside them."""
    draws_people: bool = False
    """Whether the format shows the rig with people's trajectories. The trajectories of an output folder are then exported
    without an option."""
    write_one: Callable[[Export, Losses], bytes] | None = None
    """For a folder: writes the same content as one file, for a target with one of the suffixes."""


def _is_empty(value: object) -> bool:
    """Check whether a value is empty, or one that tools write in place of an unknown value."""
    if isinstance(value, dict):
        return all(map(_is_empty, value.values()))
    if isinstance(value, (list, tuple)):
        return not value
    return value is None or (isinstance(value, (str, int, float)) and value in ("", "null", 0, False))


def sample_file(path: Path) -> FileSample | None:
    """Read a file that formats may recognise; None if it is no file, cannot be read, or is too large for a calibration."""
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_BYTES:
            return None
        return FileSample(path, file_bytes(path, "a calibration"))
    except (OSError, ValueError, InputError):
        return None
