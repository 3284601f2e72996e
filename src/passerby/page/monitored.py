"""A folder of `passerby monitor`: the state of each camera, and its earlier and later pictures. It is only read here."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Any, Literal

from passerby.common.errors import InputError
from passerby.core.figures import adjusted
from passerby.core.observations import Clock
from passerby.interchange.calibration_json import CALIBRATION_FILE, read_document
from passerby.interchange.monitor_json import MONITOR_FILE, MonitorDocument, MonitoredCamera, MoveEntry, read_monitor
from passerby.interchange.storage.text_formats import plain
from passerby.page.pictures import PictureStore
from passerby.page.requests import remove_folders
from passerby.page.scene_edits import version_of
from passerby.scene.scene import Scene

Source = Literal["calibration", "footage"]
HIDDEN = ("scene_file", "rig_file", "calibration_scene_file")
"""Keys with paths: the browser receives only the names of these files."""


@dataclass(eq=False)
class Footage:
    """The scene file of a recording, and pictures of the recording."""

    scene_file: Path
    pictures: PictureStore = field(default_factory=PictureStore)

    def scene(self, camera: str) -> tuple[Scene, str]:
        """Read the scene and its version. Raises `InputError` if the file is missing or broken, or has no such camera."""
        version, scene = version_of(self.scene_file), Scene.load(self.scene_file)
        if camera not in scene.cameras:
            raise InputError(f"{self.scene_file}: has no camera {camera}")
        return scene, version

    def frames(self, camera: str) -> tuple[int, int]:
        """Return the first and last frame of a camera's video that a calibration uses. Raises `InputError` without a video."""
        scene, version = self.scene(camera)
        table = scene.cameras[camera]
        with self.pictures.turn:
            info = self.pictures.video(scene, version, camera)
        fps = scene.fps_of(camera) or info.clock_fps
        first = max(1 + round(info.begin_s * info.clock_fps), 1 + ceil((table.from_s or 0.0) * fps))
        last = round((info.end_s or 0.0) * info.clock_fps)
        last = last if table.until_s is None else min(last, 1 + int(table.until_s * fps))
        return first, max(first, last)


@dataclass(frozen=True)
class Shown:
    """A picture for comparison; `side` says whether it is the earlier or the later one."""

    source: Source
    frame: int
    label: str
    side: Literal["then", "now"]


@dataclass(eq=False)
class MonitoredSession:
    """A folder of `passerby monitor`, for any number of browsers. Its cameras are those of `monitor.json`."""

    folder: Path
    _stores: dict[Path, Footage] = field(default_factory=dict)

    def document(self) -> MonitorDocument:
        """Read the results of monitoring. Raises `InputError` if the file is missing or broken."""
        return read_monitor(self.folder)

    def state(self) -> dict[str, Any]:
        """Return the results of monitoring as plain values, with a version that changes when monitoring runs again."""
        found = self.document()
        told = {key: value for key, value in plain(found).items() if key not in HIDDEN}
        told |= {"version": version_of(self.folder / MONITOR_FILE), "name": self.folder.absolute().name}
        told["footage"] = None if found.scene_file is None else Path(found.scene_file).name
        told["rig"] = None if found.rig_file is None else "/".join(Path(found.rig_file).parts[-2:])
        told["notes"] = [self.public(one) for one in found.notes]
        return told

    def views(self, name: str) -> dict[str, Any]:
        """Return the pictures of a camera for comparison as an overlay, and notes on missing pictures.

        The page begins with the first picture of each side. Raises `InputError` for a camera that was not monitored.
        """
        found = self.document()
        camera = self._camera(found, name)
        notes: list[str] = []
        try:
            first, last = self.footage("footage").frames(name)
        except InputError as error:
            return {"pictures": [], "notes": [f"There are no pictures: {self.public(str(error))}"]}
        shown = _list_pictures(found, camera, first, last)
        try:
            begin, end = self._find_longest_part(found, name, *self.footage("calibration").frames(name))
            shown.insert(0, Shown("calibration", (begin + end) // 2, "at the calibration", "then"))
        except InputError as error:
            notes.append(
                f"There is no picture of the calibration ({self.public(str(error))}): the earliest picture of the monitored "
                "footage is shown instead"
            )
            shown.insert(0, Shown("footage", first, "at the beginning of the monitored footage", "then"))
        return {"pictures": [plain(one) for one in shown], "notes": notes}

    def footage(self, source: Source) -> Footage:
        """Return a recording. Raises `InputError` if the folder does not name it."""
        found = self.document()
        named = found.scene_file if source == "footage" else found.calibration_scene_file
        if named is None:
            what = "of the monitored footage" if source == "footage" else "that the rig was calibrated from"
            raise InputError(f"{MONITOR_FILE} does not name the scene file {what}")
        return self._stores.setdefault(Path(named), Footage(Path(named)))

    def checked_name(self, name: str) -> str:
        """Return the name if a camera of this name was monitored. Raises `InputError` for any other name."""
        return self._camera(self.document(), name).name

    def public(self, text: str) -> str:
        """Return a message without the folders of this machine."""
        folders = [self.folder, self.folder.parent, *(one.parent for one in self._stores)]
        return remove_folders(text, folders)

    def _find_longest_part(self, found: MonitorDocument, name: str, first: int, last: int) -> tuple[int, int]:
        """Return the first and last frame of the longest part in which a camera had the pose of its calibration."""
        folder = None if found.rig_file is None else Path(found.rig_file).parent
        if folder is None or not (folder / CALIBRATION_FILE).is_file():
            return first, last
        parts = [(first, last)]
        for one in (one for one in adjusted(read_document(folder).figures).moved if one.camera == name):
            early, late = (first, one.frames[0] - 1), (one.frames[1] + 1, last)
            kept = {"before": [late], "after": [early], "between": [early, late]}[one.left_out]
            parts = [(max(low, begin), min(high, end)) for low, high in parts for begin, end in kept]
        parts = [part for part in parts if part[0] <= part[1]]
        return max(parts, key=lambda part: part[1] - part[0], default=(first, last))

    def _camera(self, found: MonitorDocument, name: str) -> MonitoredCamera:
        if name not in found.entries:
            raise InputError("there is no such camera")
        return found.entries[name]


def _list_pictures(found: MonitorDocument, camera: MonitoredCamera, first: int, last: int) -> list[Shown]:
    """List pictures of the monitored footage: at its end, and before and after each move."""
    shown = [Shown("footage", last, "at the end of the monitored footage", "now")]
    if camera.fps is None:  # written by an older version of Passerby, which wrote no clocks
        return shown
    clock = Clock(camera.fps, camera.time_offset_s or 0.0)

    def frame(seconds: float) -> int:
        return min(max(round(float((seconds - clock.offset_s) * clock.fps)) + 1, first), last)

    for move in reversed(_list_dated_moves(found, camera.name)):
        assert move.from_s is not None
        assert move.until_s is not None
        shown.append(Shown("footage", frame(move.from_s), f"before the move at {_clock_time(move)}", "then"))
        shown.append(Shown("footage", frame(move.until_s), f"after the move at {_clock_time(move)}", "now"))
    return shown


def _list_dated_moves(found: MonitorDocument, name: str) -> list[MoveEntry]:
    """List the moves with known time of a camera, including moves of either this camera or others."""
    own = [one for one in found.moves if one.camera == name or name in one.or_]
    return [one for one in own if None not in (one.seconds, one.from_s, one.until_s)]


def _clock_time(move: MoveEntry) -> str:
    """Write the time of a move in the footage as 00:05:12."""
    whole = max(0, round(move.seconds or 0.0))
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}"
