"""What an earlier run found, for cameras that have no news since.

Which cameras have news since an earlier run: files that are not those that were read then. No file is opened for it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.findings.finding import Finding, notice
from passerby.interchange.monitor_json import MONITOR_FILE, MonitorDocument, MonitoredCamera, MoveEntry, read_monitor
from passerby.interchange.output_folder import RIG_FILE
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.versions import LaterVersionError
from passerby.monitoring.given_rig import GivenRig
from passerby.monitoring.watched import WatchOptions
from passerby.perception.pictures import VideoError
from passerby.perception.sources.files import VideoSource, list_files
from passerby.scene.scene import Scene
from passerby.scene.tables import CameraTable

DIGEST_BYTES = 16


@dataclass(frozen=True, eq=False)
class Carried:
    """What an earlier run found of a camera."""

    entry: MonitoredCamera
    moves: tuple[MoveEntry, ...] = ()
    pose: Camera | None = None
    """The camera with its new pose; None where it has that of its calibration."""


@dataclass(frozen=True, eq=False)
class EarlierRun:
    """All that it found."""

    cameras: Mapping[str, Carried] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def has_read(self, camera: str, digest: str) -> bool:
        """Whether these files of a camera were read, and its state is known."""
        known = self.cameras.get(camera)
        return known is not None and known.entry.news == digest

    def of(self, cameras: Collection[str]) -> dict[str, Carried]:
        """What is known of some cameras, in the order of that run."""
        return {name: one for name, one in self.cameras.items() if name in cameras}


def read_earlier(folder: Path | None, judged_by: str) -> EarlierRun:
    """The run that was written into a folder; nothing where there is none, or where it was about another rig.

    Args:
        folder: with `monitor.json`, and `rig.toml` with the poses of cameras that moved.
        judged_by: see `news.judged_by`.

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
    """The files of one camera."""

    digest: str
    """Another one where a file was written, replaced or renamed, or is read otherwise."""
    as_of: str | None
    """When the newest of them was written, ISO 8601; None where there is none."""


def news_of(scene: Scene, name: str) -> News:
    """The files of a camera as they are now, by size and time of the last change."""
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


def judged_by(given: GivenRig, options: WatchOptions, *, in_step: bool) -> str:
    """What a camera's state depends on beside its footage: the rig, and how it is tested."""

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
    """What a camera's people are read from."""
    named = [table.tracks or table.detections, table.keypoints, table.embeddings, table.video_times]
    found = [scene.resolve(path).absolute() for path in named if path is not None]
    videos = tuple(scene.resolve(path).absolute() for path in table.videos)
    if videos:
        try:
            found += list_files(VideoSource(videos)).paths
        except VideoError:
            # A stream, or what reading will tell of.
            found += videos
    return found


def _digest(value: object) -> str:
    return hashlib.blake2b(json.dumps(value, sort_keys=True).encode(), digest_size=DIGEST_BYTES).hexdigest()
