"""The rig that is monitored, with its clocks and the uncertainty of its shape, and the results of an earlier run.

For cameras without news, the results of the earlier run are used. A camera has news if its files are not those that were read
in the earlier run. This is tested without opening the files.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.figures import adjusted
from passerby.findings.finding import Finding, notice
from passerby.geometry.rotations import log_rotation
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.monitor_json import MONITOR_FILE, MonitorDocument, MonitoredCamera, MoveEntry, read_monitor
from passerby.interchange.output_folder import RIG_FILE, read_report
from passerby.interchange.rig_toml import METADATA, METRES_PER_UNIT, RIG, RIG_FORMAT, SIGMA_KEYS, read_rig, table_of
from passerby.interchange.storage.safe_parsing import read_toml
from passerby.interchange.storage.text_formats import LaterVersionError
from passerby.interchange.storage.transaction import recover
from passerby.monitoring.watched import WatchOptions
from passerby.perception.pictures import VideoError
from passerby.perception.sources.files import VideoSource, list_files
from passerby.scene.scene import Scene
from passerby.scene.tables import CameraTable

DIGEST_BYTES = 16


@dataclass(frozen=True, eq=False)
class GivenRig:
    """A rig as it was calibrated."""

    rig: Rig
    offsets_s: Mapping[str, float] = field(default_factory=dict)
    """Offset of each camera's clock, seconds."""
    shape_sigma_m: Mapping[str, float] = field(default_factory=dict)
    """One sigma of each camera's place within the rig, metres, without the error of the common scale."""
    path: Path | None = None
    """Path of the rig file."""
    calibration_scene_file: str | None = None
    """Absolute path of the scene that it was calibrated from; None if no file beside the rig names it."""


def read_given(path: Path) -> GivenRig:
    """Read a rig file, or that of an output folder, with the calibration beside it if there is one.

    Raises `InputError` if either cannot be read.
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
    """Return the calibration's scene file for a rig that `passerby monitor` wrote; None if it is unknown.

    It is only displayed: a broken file of an earlier run does not prevent monitoring.
    """
    if file.name != RIG_FILE or not (file.parent / MONITOR_FILE).is_file():
        return None
    try:
        return read_monitor(file.parent).calibration_scene_file
    except InputError:
        return None


def rig_text(given: GivenRig, new: Rig, changed: tuple[str, ...]) -> str:
    """Return the text of a rig file with new poses of some cameras; all other tables and numbers are those of the given file.

    Raises `InputError` if the file can no longer be read.
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


@dataclass(frozen=True, eq=False)
class Carried:
    """Result of an earlier run for a camera."""

    entry: MonitoredCamera
    moves: tuple[MoveEntry, ...] = ()
    pose: Camera | None = None
    """The camera with its new pose; None if it has that of its calibration."""


@dataclass(frozen=True, eq=False)
class EarlierRun:
    """Results of an earlier run, by camera."""

    cameras: Mapping[str, Carried] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def has_read(self, camera: str, digest: str) -> bool:
        """Check whether a camera's files with this digest were read, and its state is known."""
        known = self.cameras.get(camera)
        return known is not None and known.entry.news == digest

    def of(self, cameras: Collection[str]) -> dict[str, Carried]:
        """Return the results for some cameras, in the order of that run."""
        return {name: one for name, one in self.cameras.items() if name in cameras}


def read_earlier(folder: Path | None, judged_by: str) -> EarlierRun:
    """Read the run that was written into a folder; empty if there is none, or if its rig or its test differs.

    Args:
        folder: folder with `monitor.json`, and `rig.toml` with the poses of cameras that moved.
        judged_by: see `describe_test`.

    Raises `LaterVersionError` for files of a later Passerby, which this run would replace.
    """
    if folder is None or not (folder / MONITOR_FILE).is_file():
        return EarlierRun()
    try:
        document = read_monitor(folder)
        if document.judged_by != judged_by:
            return EarlierRun()
        rig = read_rig(folder / RIG_FILE)
        moved = [one.name for one in document.cameras if one.new_pose]
        poses = {name: rig[name] for name in moved if name in rig.names and rig[name].pose is not None}
    except LaterVersionError:
        raise
    except InputError:
        return EarlierRun(findings=(notice("earlier_run_broken", place=str(folder)),))
    return EarlierRun({
        one.name: Carried(replace(one, carried=True), _moves(document, one.name), poses.get(one.name))
        for one in document.cameras
        if one.news is not None and (not one.new_pose or one.name in poses)
    })  # fmt: skip


def _moves(document: MonitorDocument, name: str) -> tuple[MoveEntry, ...]:
    return tuple(replace(one, carried=True) for one in document.moves if one.camera == name)


@dataclass(frozen=True)
class News:
    """State of the files of one camera."""

    digest: str
    """Digest that changes if a file is written, replaced or renamed, or if it is read with other settings."""
    as_of: str | None
    """Time of the last change of the newest file, ISO 8601; None without files."""


def news_of(scene: Scene, name: str) -> News:
    """Return the present state of a camera's files, by size and time of the last change."""
    table = scene.cameras[name]
    states: list[tuple[str, int | None, int | None]] = []
    newest: int | None = None
    for path in _files(scene, table):
        try:
            found = path.stat()
        except OSError:
            states.append((path.as_posix(), None, None))
            continue
        states.append((path.as_posix(), found.st_size, found.st_mtime_ns))
        newest = max(newest or 0, found.st_mtime_ns)
    used = table.model_dump(mode="json", exclude={"intrinsics", "lens"})
    perception = scene.perception.model_dump(mode="json") if table.video is not None else None
    mode = scene.association.mode, scene.fps_of(name), scene.scene.model_dump(mode="json", exclude={"name"})
    as_of = None if newest is None else datetime.fromtimestamp(newest // 10**9, UTC).isoformat()
    return News(_digest([used, perception, mode, states]), as_of)


def describe_test(given: GivenRig, options: WatchOptions, *, in_step: bool) -> str:
    """Return a digest of the rig and the options of the test, on which a camera's state depends in addition to its footage."""

    def numbers(values: Floats | None) -> list[float] | None:
        return None if values is None else values.ravel().tolist()

    cameras = [
        [
            camera.name, camera.lens.size, camera.lens.fisheye, numbers(camera.lens.matrix), numbers(camera.lens.distortions),
            None if camera.pose is None else [numbers(camera.pose.R_cw), numbers(camera.pose.centre)],
            None if camera.sigma is None else [camera.sigma.position_m, camera.sigma.orientation_deg],
            None if camera.sigma is None else numbers(camera.sigma.covariance),
        ]
        for camera in given.rig
    ]  # fmt: skip
    return _digest([
        cameras, dict(given.offsets_s), dict(given.shape_sigma_m), options.every_s, options.threshold, options.budget_s, in_step
    ])  # fmt: skip


def _files(scene: Scene, table: CameraTable) -> list[Path]:
    """Return the files from which a camera's people are read."""
    named = [table.tracks or table.detections, table.keypoints, table.embeddings, table.video_times]
    found = [scene.resolve(path).absolute() for path in named if path is not None]
    videos = tuple(scene.resolve(path).absolute() for path in table.videos)
    if videos:
        try:
            found += list_files(VideoSource(videos)).paths
        except VideoError:
            # A stream, or a fault that is reported when the video is read.
            found += videos
    return found


def _digest(value: object) -> str:
    return hashlib.blake2b(json.dumps(value, sort_keys=True).encode(), digest_size=DIGEST_BYTES).hexdigest()
