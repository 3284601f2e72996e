"""The rig that is watched, with what its calibration knew beside: clocks, and the uncertainty of its shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.geometry.rotations import log_rotation
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.monitor_json import MONITOR_FILE, read_monitor
from passerby.interchange.output_folder import RIG_FILE, read_report
from passerby.interchange.rig_toml import METADATA, METRES_PER_UNIT, RIG, RIG_FORMAT, SIGMA_KEYS, read_rig, table_of
from passerby.interchange.storage.faults import read_toml
from passerby.interchange.storage.transaction import recover


@dataclass(frozen=True, eq=False)
class GivenRig:
    """A rig as it was calibrated."""

    rig: Rig
    offsets_s: Mapping[str, float] = field(default_factory=dict)
    """Of each camera's clock, seconds."""
    shape_sigma_m: Mapping[str, float] = field(default_factory=dict)
    """One sigma of a camera's place within the rig, but for the scale of all of it."""
    path: Path | None = None
    """Of the rig file."""
    calibration_scene_file: str | None = None
    """Absolute path of the scene that it was calibrated from, where a file beside the rig names it."""


def read_given(path: Path) -> GivenRig:
    """Read a rig file, or that of an output folder, with the calibration beside it where there is one.

    Raises `InputError` where either cannot be read.
    """
    file = path / RIG_FILE if path.is_dir() else path
    recover(file.parent, "reads the folder")
    rig = read_rig(file)
    if file.name != RIG_FILE or not (file.parent / CALIBRATION_FILE).is_file():
        return GivenRig(rig, path=file, calibration_scene_file=_monitored_from(file))
    document = read_report(file.parent, tracks=False)
    offsets = {entry.name: entry.time_offset_s or 0.0 for entry in document.cameras}
    shapes = {one.name: (one.shape_position_sigma_mm or 0.0) / 1000 for one in adjusted(document.figures).cameras}
    return GivenRig(rig, offsets, {name: sigma for name, sigma in shapes.items() if sigma > 0}, file, document.scene_file)


def _monitored_from(file: Path) -> str | None:
    """The scene that a rig which `passerby monitor` wrote was calibrated from.

    Only for showing: a broken file of an earlier run does not prevent monitoring.
    """
    if file.name != RIG_FILE or not (file.parent / MONITOR_FILE).is_file():
        return None
    try:
        return read_monitor(file.parent).calibration_scene_file
    except InputError:
        return None


def rig_text(given: GivenRig, new: Rig, changed: tuple[str, ...]) -> str:
    """A rig file in which some cameras have new poses; all other tables and numbers are those of the file that was read.

    Raises `InputError` where the file cannot be read any more.
    """
    if given.path is None:
        content: dict[str, Any] = {camera.name: table_of(camera) for camera in new}
        verdict = {} if new.verdict is None else {"verdict": new.verdict}
        return tomli_w.dumps({**content, METADATA: {"format_version": RIG_FORMAT, "units": "m", **verdict, **new.metadata}})
    content = read_toml(given.path, RIG)
    metadata = content.get(METADATA)
    unit = METRES_PER_UNIT.get(metadata.get("units", "m"), 1.0) if isinstance(metadata, dict) else 1.0
    for key, table in content.items():
        if not isinstance(table, dict) or key == METADATA or str(table.get("name", key)) not in changed:
            continue
        camera = new[str(table.get("name", key))]
        assert camera.pose is not None
        fresh = table_of(camera)
        table["rotation"] = log_rotation(camera.pose.R_cw).tolist()
        table["translation"] = (np.asarray(camera.pose.t_cw) / unit).tolist()
        for name in SIGMA_KEYS:
            table.pop(name, None)
            if name in fresh:
                table[name] = fresh[name]
    return tomli_w.dumps(content)
