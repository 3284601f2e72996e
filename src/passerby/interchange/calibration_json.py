"""`calibration.json`: its tables as dataclasses. The file is read and written only here.

The tables of the solver's stages are in `passerby.core.figures`, those of association in `passerby.core.association_figures`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import cv2
import numpy as np
from pydantic import ConfigDict, Discriminator, Field, Tag, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from passerby.common.arrays import ABSENT
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.association_figures import AssociationFigures
from passerby.core.cameras import Camera
from passerby.core.figures import AdjustedFigures, SolverFigures, StarFigures
from passerby.core.solution import Verdict
from passerby.interchange.declared_scene import OPEN_TABLE, DeclaredScene
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import NotParsed, parse_json, read_text
from passerby.interchange.storage.text_formats import check_version, to_json

CALIBRATION_FILE = "calibration.json"
SCHEMA_VERSION = 1
"""Version of the file's tables. A file without a version was written when there was only this one."""


def _name_key(name: str) -> str:
    """Return the key in the file of a field: its name without the `_` that follows a word that Python reserves."""
    return name.removesuffix("_")


_STRICT = ConfigDict(strict=True, allow_inf_nan=False, alias_generator=_name_key)

_LONG_NUMBER = re.compile(r"[0-9]{300}")
"""A number that is larger than any float. No value of the file has so many digits."""

Number = float | None
Entry = TypeVar("Entry")


@dataclass(frozen=True, kw_only=True)
class CameraEntry:
    """One entry of `cameras`. Values of the pose are in the file's world frame: metres, z up."""

    name: str
    registered: bool | None = None
    centre_m: tuple[float, float, float] | None = None
    height_m: Number = None
    heading_deg: Number = None
    tilt_deg: Number = None
    roll_deg: Number = None
    rotation: tuple[float, float, float] | None = None
    """Rodrigues vector, world to camera."""
    translation_m: tuple[float, float, float] | None = None
    position_sigma_mm: Number = None
    orientation_sigma_deg: Number = None
    points_sigma_mm: Number = None
    """Median sigma of points where people walked that this camera and others see, mm."""
    ground_sigma_mm: Number = None
    """Median sigma of positions on the ground that this camera alone measures, mm."""
    people: int | None = None
    """Number of identities that this camera saw."""
    boxes: int | None = None
    keypoints: int | None = None
    median_residual_px: Number = None
    fps: Annotated[float, Field(gt=0)] | None = None
    time_offset_s: Number = None
    """Offset of its clock to the clock of the first registered camera."""
    time_offset_sigma_s: Number = None

    def with_pose(self, camera: Camera) -> CameraEntry:
        """Return this entry with the pose and the sigmas of a camera."""
        pose, sigma = camera.pose, camera.sigma
        return replace(
            self,
            registered=pose is not None,
            centre_m=None if pose is None else _three(pose.centre),
            height_m=None if pose is None else float(pose.centre[2]),
            heading_deg=None if pose is None else _drop_undefined(pose.heading_deg),
            tilt_deg=None if pose is None else _drop_undefined(pose.tilt_deg),
            roll_deg=None if pose is None else _drop_undefined(pose.roll_deg),
            rotation=None if pose is None else _three(np.asarray(cv2.Rodrigues(np.array(pose.R_cw))[0]).ravel()),
            translation_m=None if pose is None else _three(pose.t_cw),
            position_sigma_mm=None if sigma is None else _drop_undefined(1000 * sigma.position_m),
            orientation_sigma_deg=None if sigma is None else _drop_undefined(sigma.orientation_deg),
            points_sigma_mm=None if sigma is None or sigma.points_m is None else 1000 * sigma.points_m,
            ground_sigma_mm=None if sigma is None or sigma.ground_m is None else 1000 * sigma.ground_m,
        )


def _drop_undefined(value: float | None) -> float | None:
    """Return a number, or None where it is infinite or undefined."""
    return None if value is None or not np.isfinite(value) else float(value)


def _three(values: Any) -> tuple[float, float, float]:
    """Return a vector (3,) as three Python floats."""
    x, y, z = map(float, values)
    return x, y, z


@dataclass(frozen=True, kw_only=True)
class DiagnosticEntry:
    """A finding with its texts."""

    code: str
    severity: str
    cameras: tuple[str, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""
    remedy: str = ""
    explained_by: str | None = field(default=None, metadata=ABSENT)
    """Code of the finding that it follows from."""


@dataclass(frozen=True, kw_only=True)
class NetworkEntry:
    """A network that was used."""

    network: str
    sha256: str | None = None
    licence: str | None = None


@dataclass(frozen=True, kw_only=True)
class VideoMove:
    """A movement of a camera away from its place; times are seconds."""

    seconds: float
    until: Number
    """Time at which the camera was back in its place; None if it did not return."""
    pixels: Number


@dataclass(frozen=True, kw_only=True)
class VideoEntry:
    """Numbers of pictures and boxes in a camera's video, and its faults."""

    pictures: int
    boxes: int
    ended_early: str | None = None
    broken: int | None = None
    first_broken_s: Number = None
    cut_pieces: int | None = field(default=None, metadata=ABSENT)
    """Number of files, of a recording in pieces, that end before the length that they state."""
    failed_pieces: int | None = field(default=None, metadata=ABSENT)
    """Number of files, of a recording in pieces, that could not be read."""
    moves: tuple[VideoMove, ...] = ()
    shake_px: Number = None


@dataclass(frozen=True, kw_only=True)
class PerceptionEntry:
    """The methods that found people in the videos: each a word or a network."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT
    detector: str | NetworkEntry | None = None
    embedder: str | NetworkEntry | None = None
    keypoints: str | NetworkEntry | None = None
    cameras: Mapping[str, VideoEntry] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ResidualEntry:
    """Distance of a camera, or of a point that it saw, from its known position. Only keys that are read again are declared."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    point: str | None = field(default=None, metadata=ABSENT)
    camera: str | None = field(default=None, metadata=ABSENT)
    off_m: Number = None
    used: bool = True
    stated_m: tuple[float, float] | None = field(default=None, metadata=ABSENT)
    """Position at which the user placed it on a plan: x and y in the world; None without a plan."""
    found_m: tuple[float, float] | None = field(default=None, metadata=ABSENT)
    """Its position by the rig: x and y in the world; None without a plan, and above the horizon."""


@dataclass(frozen=True, kw_only=True)
class PlanEntry:
    """The floor plan that defines the world frame."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    image: str
    """Path of the picture: relative to the scene file's folder, or absolute."""
    metres_per_pixel: Annotated[float, Field(gt=0)]
    origin: tuple[float, float]
    """Pixel of the plan at the world's origin."""


@dataclass(frozen=True, kw_only=True)
class WorldEntry:
    """Placement of the world by `[world]` or `passerby align`. Only keys that are read again are declared."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    by: str
    scale: Number = None
    scale_fitted: bool | None = field(default=None, metadata=ABSENT)
    turn_sigma_deg: Number = field(default=None, metadata=ABSENT)
    place_sigma_mm: Number = field(default=None, metadata=ABSENT)
    plan: PlanEntry | None = field(default=None, metadata=ABSENT)
    residuals: tuple[ResidualEntry, ...] | None = field(default=None, metadata=ABSENT)
    notes: tuple[str, ...] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class GroupEntry:
    """A further group of cameras: a separate calibration, which shares no people with this one."""

    group: int
    """Number of the group: 2, 3, ...; the main rig is group 1."""
    folder: str
    """Its output folder, relative to the folder of this file."""
    verdict: Verdict
    registered: int
    """Number of cameras with a pose."""
    cameras: tuple[str, ...]


def _kind_of_figures(value: Any) -> str:
    """Return the tag in `_TAGS` of a table of figures."""
    if isinstance(value, Mapping):
        return "star" if "reference" in value else "adjusted" if "scale" in value or "cameras" in value else "none"
    return {AdjustedFigures: "adjusted", StarFigures: "star"}.get(type(value), "none")


_TAGS = ("adjusted", "star", "none")
Figures = Annotated[
    Annotated[AdjustedFigures, Tag("adjusted")] | Annotated[StarFigures, Tag("star")] | Annotated[SolverFigures, Tag("none")],
    Discriminator(_kind_of_figures),
]


@dataclass(frozen=True, kw_only=True)
class CalibrationDocument:
    """All of `calibration.json`. A value is None where it is unknown, does not apply, or an older Passerby did not write it."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT
    schema_version: int = SCHEMA_VERSION
    scene_file: str | None = None
    """Absolute path of the scene file; None for a scene that came from no file."""
    files: Mapping[str, str] | None = field(default=None, metadata=ABSENT)
    """Checksums of rig and tracks, by file name; None in files of an older Passerby."""
    name: str | None = None
    """Name of the scene."""
    passerby: str | None = None
    versions: Mapping[str, str | None] = field(default_factory=dict)
    """Versions of the numerical libraries, by name."""
    verdict: Verdict
    reasons: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    diagnostics: tuple[DiagnosticEntry, ...] | None = field(default=None, metadata=ABSENT)
    cameras: tuple[CameraEntry, ...]
    perception: PerceptionEntry | None = field(default=None, metadata=ABSENT)
    association: AssociationFigures = field(default_factory=AssociationFigures)
    method: str = "people"
    seed: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    scene: DeclaredScene = field(default_factory=DeclaredScene)
    figures: Figures = field(default_factory=SolverFigures)
    wall_clock_origin: str | None = field(default=None, metadata=ABSENT)
    """Wall time of frame 1 of recordings whose files state their times, ISO 8601. Frame f was taken (f - 1) / fps later, by the
    recording's own clock."""
    wall_clock_span: tuple[str | None, str | None] | None = field(default=None, metadata=ABSENT)
    """Span of wall time that was used, ISO 8601; None for an end that the user did not state."""
    world: WorldEntry | None = field(default=None, metadata=ABSENT)
    group: int | None = field(default=None, metadata=ABSENT)
    """Number of the group (2, 3, ...) if this is a further group of a scene, else None."""
    groups: tuple[GroupEntry, ...] | None = field(default=None, metadata=ABSENT)
    """The further groups of the scene, in the file of the main rig; None if there are none."""

    @property
    def entries(self) -> dict[str, CameraEntry]:
        """The cameras by name."""
        return {one.name: one for one in self.cameras}

    def entry(self, name: str) -> CameraEntry:
        """Return the entry of a camera, or an empty entry if the camera is unknown."""
        return self.entries.get(name) or CameraEntry(name=name)


def entry_of(kind: type[Entry], table: Mapping[str, Any]) -> Entry:
    """Convert a table of plain values to an entry of a document. Raises `ValueError` where it does not fit."""
    return TypeAdapter(kind).validate_json(to_json(table))


@cache
def _documents() -> TypeAdapter[CalibrationDocument]:
    """Return the validator of documents. It is built once, when the first file is read."""
    return TypeAdapter(CalibrationDocument)


def unlike(path: Path, why: str) -> InputError:
    """Return the error for a `calibration.json` that `passerby calibrate` cannot have written."""
    return InputError(f"{path}: is not what `passerby calibrate` writes: {why}: calibrate again")


def read_document(folder: Path) -> CalibrationDocument:
    """Read the `calibration.json` of a folder.

    Raises `InputError` with key, value and remedy where the file is missing, is not a calibration, or is of a later schema.
    """
    path = folder / CALIBRATION_FILE
    if not path.is_file():
        raise InputError(f"{path}: no such file: name the folder that `passerby calibrate SCENE -o FOLDER` wrote")
    return parse_document(read_text(path, "a calibration (JSON)"), path)


def parse_document(text: str, path: Path = Path(CALIBRATION_FILE)) -> CalibrationDocument:
    """Parse the document in a text. Errors name `path` as the file. Raises `InputError` as `read_document` does."""
    try:
        content = parse_json(text)
    except NotParsed as error:
        raise InputError(f"{path}: is not JSON ({error}): calibrate again") from None
    if not isinstance(content, dict):
        raise unlike(path, "it is not a table")
    if _LONG_NUMBER.search(text):
        raise unlike(path, "it holds a number of 300 digits")
    check_version(path, content, "schema_version", SCHEMA_VERSION)
    try:
        return _documents().validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        if fault["type"] == "json_invalid":  # half a surrogate pair, which is not valid text
            raise InputError(f"{path}: is not JSON ({fault['ctx']['error']}): calibrate again") from None
        raise unlike(path, _explained(fault, content)) from None


def _explained(fault: ErrorDetails, content: dict[str, Any]) -> str:
    """Describe a fault of validation: its key, the value there and the value that is needed."""
    *place, last = [part for part in fault["loc"] if part not in _TAGS] or [""]
    owner = "it"
    if len(place) > 1 and place[0] == "cameras":
        table = content["cameras"][int(place[1])]
        owner, place = f"camera {shortened_text(str(table.get('name', f'number {int(place[1]) + 1}')))}", place[2:]
    key = ".".join(map(str, (*place, last)))
    if fault["type"] == "missing":
        return f"{owner} has no {key}"
    wanted = str(fault["msg"]).removeprefix("Input should be ").replace("an object", "a table").replace("array", "list")
    stands = f"{key} is {shortened(fault['input'])}" if owner == "it" else f"{owner} has {key} {shortened(fault['input'])}"
    return f"{stands}, which should be {wanted}"


def write_document(folder: Path, document: CalibrationDocument) -> None:
    """Write the `calibration.json` of a folder. Raises `InputError` where it cannot be written."""
    write_text(folder / CALIBRATION_FILE, to_json(document))
