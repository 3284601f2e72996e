"""What the report tells of: a calibration as it was made, or as its output folder keeps it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.output_folder import (
    RIG_FILE,
    TRACKS_FOLDER,
    camera_tables,
    is_file_name,
    read_report,
    unlike,
)
from passerby.interchange.rig_toml import read_rig

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, eq=False)
class Contents:
    """All that the report is made from."""

    told: Mapping[str, Any]
    """What `calibration.json` holds."""
    rig: Rig
    """All cameras, also those without a pose. Metres, world z up, ground at z = 0."""
    observations: Observations
    """Boxes and joints of all cameras, with identities that hold over the rig, frames as each camera counts them."""
    clocks: Mapping[str, Clock]
    """Each camera's clock; empty where the same frame number is the same instant in all cameras."""
    videos: Mapping[str, Path]
    """The cameras' videos, as far as the files exist."""

    @property
    def verdict(self) -> str:
        """accepted, doubtful or refused."""
        return str(self.told.get("verdict"))

    @property
    def cameras(self) -> dict[str, Mapping[str, Any]]:
        """By camera, its table of `calibration.json`; empty tables for cameras that it does not tell of."""
        found = self.told.get("cameras")
        tables = {str(one.get("name")): one for one in found if isinstance(one, dict)} if isinstance(found, list) else {}
        return {name: tables.get(name, {}) for name in self.rig.names}


def contents_from(out: Path) -> Contents:
    """The contents of an output folder, also of a refused calibration and of one that an older Passerby wrote.

    Raises `InputError` for a folder that no calibration wrote, or a file in it that is broken.
    """
    told = read_report(out)
    if told.get("verdict") not in ("accepted", "doubtful", "refused"):
        raise unlike(out, f"verdict is {told.get('verdict')!r}")
    rig = read_rig(out / RIG_FILE)
    tables = camera_tables(out, told)
    clocks = _clocks(tables, rig)
    fps = _positive(_table(_table(told.get("scene")).get("scene")).get("fps"))
    seen = {name: CameraObservations(*_seen(out / TRACKS_FOLDER, name)) for name in rig.names}
    return Contents(told, rig, Observations(seen, fps, clocks), clocks, _videos(told, rig))


def _seen(folder: Path, name: str) -> tuple[Boxes, Keypoints]:
    """A camera's boxes and joints; none where there is no file of them."""
    if not is_file_name(name):
        return Boxes.empty(), Keypoints.empty()
    boxes, joints = folder / f"{name}.txt", folder / f"{name}.json"
    return (
        read_boxes(boxes) if boxes.is_file() else Boxes.empty(),
        read_keypoints(joints) if joints.is_file() else Keypoints.empty(),
    )


def _clocks(tables: Mapping[str, Mapping[str, Any]], rig: Rig) -> dict[str, Clock]:
    """Each camera's clock; none at all where one camera has none, since instants need all."""
    found = {}
    for name in rig.names:
        table = tables.get(name, {})
        fps, offset = _positive(table.get("fps")), table.get("time_offset_s")
        if fps is None:
            return {}
        found[name] = Clock(fps, float(offset) if isinstance(offset, int | float) and math.isfinite(offset) else 0.0)
    return found


def _videos(told: Mapping[str, Any], rig: Rig) -> dict[str, Path]:
    """The videos that the scene names, as far as they lie where they lay."""
    scene_path, tables = told.get("scene_file"), _table(_table(told.get("scene")).get("cameras"))
    if not isinstance(scene_path, str):
        return {}
    found = {}
    for name in rig.names:
        video = _table(tables.get(name)).get("video")
        if isinstance(video, str) and video and "\0" not in video and (path := Path(scene_path).parent / video).is_file():
            found[name] = path
    return found


def _table(value: Any) -> Mapping[str, Any]:
    """`value` where it is a table, else an empty one."""
    return value if isinstance(value, Mapping) else {}


def _positive(value: Any) -> float | None:
    """A finite number above 0, else None."""
    sound = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and value > 0
    return float(value) if sound else None
