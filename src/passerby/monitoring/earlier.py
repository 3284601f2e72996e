"""What an earlier run found, for cameras that have no news since."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.findings.finding import Finding, notice
from passerby.interchange.monitor_json import MONITOR_FILE, MonitorDocument, MonitoredCamera, MoveEntry, read_monitor
from passerby.interchange.output_folder import RIG_FILE
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.versions import LaterVersionError


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
