"""`monitor.json`: what `passerby monitor` found, as values, for those who read it again.

`passerby.monitoring.result` writes it. Keys that are not read again are not declared here. Times are seconds, the rig's clock.
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
"""Version of its keys. New keys need no new version: an older Passerby leaves alone what it does not know."""

_STRICT = ConfigDict(strict=True, allow_inf_nan=False, alias_generator=lambda name: name.removesuffix("_"))

Number = float | None
State = Literal["steady", "moved", "one of several moved", "cannot tell"]


@dataclass(frozen=True, kw_only=True)
class MonitoredCamera:
    """One of `cameras`."""

    name: str
    state: State
    windows: int = 0
    windows_told: int = 0
    """Windows in which something can be said of it."""
    smallest_shift_m: Number = None
    smallest_turn_deg: Number = None
    """Detection limits in the middle one of three directions,"""
    worst_shift_m: Number = None
    worst_turn_deg: Number = None
    """and in the worst one."""
    new_pose: bool = False
    """Whether `rig.toml` has a new pose of it."""
    fps: Annotated[float, Field(gt=0)] | None = None
    """Of its frame numbers; None in files of an older Passerby."""
    time_offset_s: Number = None
    """The rig's time at its frame 1; None likewise."""
    news: str | None = None
    """What tells the files that were read last from later ones; None likewise."""
    as_of: str | None = None
    """When the newest of these files was written, ISO 8601; None likewise, and for what came from no file."""
    carried: bool = False
    """Whether all this is of an earlier run, because there was no news since."""


@dataclass(frozen=True, kw_only=True)
class MoveEntry:
    """One of `moves`, in the order in which they were noticed."""

    __pydantic_config__: ClassVar[ConfigDict] = _STRICT
    camera: str
    or_: tuple[str, ...] = ()
    """Cameras that may have moved instead."""
    before_footage: bool = False
    seconds: Number = None
    from_s: Number = None
    until_s: Number = None
    """What the moment lies between."""
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
    """A camera in one window."""

    score: Number = None
    """None for an infinite one."""
    told: bool = False
    """Whether something can be said of it."""


@dataclass(frozen=True, kw_only=True)
class WindowEntry:
    """One of `windows`."""

    from_s: float
    until_s: float
    cameras: Mapping[str, WindowCamera] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class MonitorDocument:
    """All of `monitor.json` that is read again."""

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
    """Of the monitored footage, absolute; this and the next two are None in files of an older Passerby."""
    rig_file: str | None = None
    """The rig that was monitored, absolute."""
    calibration_scene_file: str | None = None
    """The scene that the rig was calibrated from, absolute; None where nothing beside the rig names it."""
    judged_by: str | None = None
    """What tells rig and options from others: states of another rig are not carried over. None in files of an older
    Passerby."""

    @property
    def entries(self) -> dict[str, MonitoredCamera]:
        """The cameras by name."""
        return {one.name: one for one in self.cameras}


@cache
def _documents() -> TypeAdapter[MonitorDocument]:
    """Built once, and only where a file is read."""
    return TypeAdapter(MonitorDocument)


def read_monitor(folder: Path) -> MonitorDocument:
    """Read the `monitor.json` of a folder. Raises `InputError` with key and remedy where it is missing or no such file."""
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
