"""`monitor.json`, the results of `passerby monitor`, as dataclasses for the commands that read it again.

`passerby.monitoring.result` writes it. Only keys that are read again are declared here. Times are seconds by the rig's clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.interchange.storage.safe_parsing import NotParsed, parse_json, read_text
from passerby.interchange.storage.text_formats import check_version
from passerby.interchange.storage.transaction import recover

MONITOR_FILE = "monitor.json"
SCHEMA_VERSION = 1
"""Version of the file's keys. New keys need no new version: an older Passerby ignores keys that it does not know."""

_STRICT = ConfigDict(strict=True, allow_inf_nan=False, alias_generator=lambda name: name.removesuffix("_"))

Number = float | None
State = Literal["steady", "moved", "one of several moved", "cannot tell"]


@dataclass(frozen=True, kw_only=True)
class MonitoredCamera:
    """One entry of `cameras`."""

    name: str
    state: State
    windows: int = 0
    windows_told: int = 0
    """Number of windows with enough evidence to test this camera."""
    smallest_shift_m: Number = None
    smallest_turn_deg: Number = None
    """Detection limits of shift and turn in the middle of three principal directions."""
    worst_shift_m: Number = None
    worst_turn_deg: Number = None
    """Detection limits of shift and turn in the worst of three principal directions."""
    new_pose: bool = False
    """Whether `rig.toml` has a new pose of this camera."""
    fps: Annotated[float, Field(gt=0)] | None = None
    """Frame rate of its frame numbers; None in files of an older Passerby."""
    time_offset_s: Number = None
    """The rig's time at its frame 1; None in files of an older Passerby."""
    news: str | None = None
    """Digest of the camera's files that were read last; None in files of an older Passerby."""
    as_of: str | None = None
    """Time at which the newest of these files was written, ISO 8601; None in files of an older Passerby, and without files."""
    carried: bool = False
    """Whether this entry is of an earlier run, because the camera's files have not changed since."""


@dataclass(frozen=True, kw_only=True)
class MoveEntry:
    """One entry of `moves`, which are in the order of detection."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT
    camera: str
    or_: tuple[str, ...] = ()
    """Cameras that may have moved instead."""
    before_footage: bool = False
    seconds: Number = None
    from_s: Number = None
    until_s: Number = None
    """Earliest and latest possible time of the move."""
    noticed_s: float
    score: Number = None
    metres: Number = None
    metres_sigma: Number = None
    degrees: Number = None
    degrees_sigma: Number = None
    shift_m: tuple[Number, ...] | None = None
    turn_deg: tuple[Number, ...] | None = None
    rotation_matrix: tuple[tuple[float, ...], ...] | None = None
    centre_m: tuple[float, ...] | None = None
    carried: bool = False
    """Whether an earlier run noticed it; its times are those of that run's footage."""


@dataclass(frozen=True, kw_only=True)
class WindowCamera:
    """Test of a camera in one window."""

    score: Number = None
    """Score of the test; None if it is infinite."""
    told: bool = False
    """Whether the evidence suffices to test the camera."""


@dataclass(frozen=True, kw_only=True)
class WindowEntry:
    """One entry of `windows`."""

    from_s: float
    until_s: float
    cameras: Mapping[str, WindowCamera] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class MonitorDocument:
    """The keys of `monitor.json` that are read again."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT
    from_s: float
    until_s: float
    window_s: float
    threshold: float
    cameras: tuple[MonitoredCamera, ...]
    moves: tuple[MoveEntry, ...] = ()
    windows: tuple[WindowEntry, ...] = ()
    most_moved: tuple[str, ...] = ()
    by_joints: bool = False
    notes: tuple[str, ...] = ()
    scene_file: str | None = None
    """Absolute path of the scene file of the monitored footage. It and the next two are None in files of an older Passerby."""
    rig_file: str | None = None
    """Absolute path of the rig that was monitored."""
    calibration_scene_file: str | None = None
    """Absolute path of the scene that the rig was calibrated from; None also where no file beside the rig names it."""
    judged_by: str | None = None
    """Digest of the rig and the options of the test: states under another digest are not carried over. None in files of an
    older Passerby."""

    @property
    def entries(self) -> dict[str, MonitoredCamera]:
        """The cameras by name."""
        return {one.name: one for one in self.cameras}


@cache
def _documents() -> TypeAdapter[MonitorDocument]:
    """Return the validator of documents. It is built once, when the first file is read."""
    return TypeAdapter(MonitorDocument)


def read_monitor(folder: Path) -> MonitorDocument:
    """Read the `monitor.json` of a folder. Raises `InputError` with key and remedy where it is missing or malformed."""
    recover(folder, "reads the folder")
    path = folder / MONITOR_FILE
    if not path.is_file():
        raise InputError(f"{path}: no such file: name the folder that `passerby monitor RIG SCENE -o FOLDER` wrote")
    text = read_text(path, "what `passerby monitor` found (JSON)")
    try:
        content = parse_json(text)
        if not isinstance(content, dict):
            raise _describe_difference(path, "it is not a table")
        check_version(path, content, "schema_version", SCHEMA_VERSION)
        return _documents().validate_json(text)
    except NotParsed as error:
        raise InputError(f"{path}: is not JSON ({error}): monitor again") from None
    except ValidationError as error:
        fault: Any = error.errors(include_url=False)[0]
        key = ".".join(map(str, fault["loc"]))
        if fault["type"] == "missing":
            raise _describe_difference(path, f"it has no {key}") from None
        wanted = str(fault["msg"]).removeprefix("Input should be ")
        raise _describe_difference(path, f"{key} is {shortened(fault['input'])}, which should be {wanted}") from None


def _describe_difference(path: Path, why: str) -> InputError:
    return InputError(f"{path}: is not what `passerby monitor` writes: {why}: monitor again")
