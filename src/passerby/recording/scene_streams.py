"""Streams as the videos of a scene: the folders into which they are recorded, and the scene file of the recording.

The scene that is calibrated names folders of the recording, never an address.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.common.text import ADDRESS, remove_all_credentials
from passerby.findings.finding import Finding, notice
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import NotParsed, parse_toml, read_text
from passerby.interchange.storage.text_formats import check_version, relative, to_json, to_toml
from passerby.recording.capture import SCHEMA_VERSION, CaptureOptions, Ended, Recording, record
from passerby.recording.settings import DEVICE, SCHEMES, RecordingPlan, Stream, check_streams_differ, read_secrets, stream_of
from passerby.scene.inputs import check_files
from passerby.scene.scene import Scene

RECORDING_FOLDER = "recording"
"""Folder of the recording in the output folder of a calibration."""
RECORDING_FILE = "recording.json"
"""File that is written when a recording has ended: a folder with this file is used again."""
SCENE_FILE = "scene.toml"
TABLES = ("scene", "association", "sites", "scale", "solver")
"""Tables of a file of cameras that are copied into the scene file: they name no files."""


@dataclass(frozen=True, eq=False, repr=False)
class StreamedScene:
    """A scene file that has streams in place of videos."""

    path: Path
    streams: tuple[Stream, ...]
    plain: Scene
    """The same scene with the cameras' folders in `recording` as videos; these folders do not exist yet."""
    content: Mapping[str, Any]
    """Content of the file, without the addresses."""
    folder: Path | None
    """Folder of the recording that the scene file names; None if it names none."""
    seconds: float
    without_missing: bool

    def folder_for(self, out: Path) -> Path:
        """Return the folder of the recording, which may not exist yet, for the output folder `out`."""
        return self.folder or out / RECORDING_FOLDER

    def findings(self, folder: Path | None) -> list[Finding]:
        """Return a notice for each stream that will be recorded, for `passerby check`.

        `folder` is None if it depends on the output folder.
        """
        place = f"{RECORDING_FOLDER}/ in the output folder" if folder is None else str(folder)
        return [
            notice(
                "stream_unrecorded", stream.camera, place=str(self.path), stream=stream.shown, seconds=self.seconds,
                folder=place,
            )
            for stream in self.streams
        ]  # fmt: skip


def read_streamed(path: Path, environment: Mapping[str, str] | None = None) -> StreamedScene | None:
    """Read the streams of a scene file; None if it has none, does not state the duration to record, or cannot be read.

    Raises `InputError` (`FileFaults`) for all faults of a scene with streams; the message does not repeat an address.
    """
    try:
        content = parse_toml(read_text(path, "a scene file (TOML)"))
    except (InputError, NotParsed):
        return None
    cameras, wanted = content.get("cameras"), content.get("recording")
    if not isinstance(cameras, dict) or not isinstance(wanted, dict) or "seconds" not in wanted:
        return None
    named = [name for name, table in cameras.items() if isinstance(table, dict) and _is_stream(table.get("video"))]
    if not named:
        return None
    secrets = wanted.get("secrets")
    known = dict(os.environ if environment is None else environment)
    if isinstance(secrets, str):
        known |= read_secrets(path.parent / secrets)
    streams = tuple(stream_of(path, name, cameras[name], known, key="video") for name in named)
    check_streams_differ(path, streams, key="video")
    others = {
        **content,
        "cameras": {
            name: {**table, "video": f"{RECORDING_FOLDER}/{name}"} if name in named else table
            for name, table in cameras.items()
        },
    }
    plain = Scene.of_content(others, path, unrecorded=named)
    table = plain.recording
    assert table is not None
    folder = None if table.folder is None else plain.resolve(table.folder)
    return StreamedScene(path, streams, plain, others, folder, table.seconds, table.without_missing)


def _is_stream(video: Any) -> bool:
    if not isinstance(video, str):
        return False
    found = ADDRESS.match(video)
    return DEVICE.fullmatch(video) is not None or (found is not None and found[1].split(":")[0].lower() in SCHEMES)


def make_recorded_scene(streamed: StreamedScene, folder: Path) -> Scene:
    """Return the scene with the recordings in `folder` as videos.

    Raises `InputError` if a camera was not recorded. A camera that could not be reached is left out if the scene allows that.
    """
    known = _find_recorded_cameras(folder)
    names = [stream.camera for stream in streamed.streams]
    missing = [name for name in names if name not in known]
    if missing:
        raise InputError(
            f"{folder}: a recording without camera {missing[0]} is there: to record anew, remove that folder or name another "
            "one (-o, or [recording] folder)"
        )
    empty = [name for name in names if not known[name]]
    if empty and not streamed.without_missing:
        raise InputError(
            f"{folder}: nothing was recorded of camera {empty[0]}: remove that folder to record anew, or delete "
            f"[cameras.{empty[0]}] from {streamed.path}"
        )
    content = dict(streamed.content)
    content["cameras"] = {
        name: {**table, "video": relative(folder / name, streamed.path)} if name in names else table
        for name, table in content["cameras"].items()
        if name not in empty
    }
    return Scene.of_content(content, streamed.path)


def is_recorded(folder: Path) -> bool:
    """Return whether a folder contains a finished recording."""
    return (folder / RECORDING_FILE).is_file()


def record_scene(streamed: StreamedScene, folder: Path, tell: Progress = silent, stop: threading.Event | None = None) -> Ended:
    """Record the streams of a scene and return why the recording ended. A stopped recording does not count as finished.

    Raises `InputError` as `record` does, and for faults of the scene's other files, before anything is recorded.
    """
    check_files(streamed.plain)
    allowed = f"with without_missing = true under [recording] in {streamed.path}"
    options = CaptureOptions(streamed.seconds, without_missing=streamed.without_missing, to_go_on=allowed)
    found = record(streamed.streams, folder, options, tell, stop)
    if found.ended != "stopped":
        write_recording(found, folder)
    return found.ended


def write_recording(found: Recording, folder: Path) -> None:
    """Write the list of a recording, with its times and gaps."""
    write_text(folder / RECORDING_FILE, to_json(found.to_dict()))


def _find_recorded_cameras(folder: Path) -> dict[str, bool]:
    """Return, by camera, whether it has any recorded piece. Raises `InputError` if the file is not the list of a recording."""
    path = folder / RECORDING_FILE
    try:
        content = json.loads(read_text(path, "the list of a recording (JSON)"))
        check_version(path, content, "schema_version", SCHEMA_VERSION)
        return {str(camera["name"]): bool(camera["pieces"]) for camera in content["cameras"]}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{path}: is not the list of a recording: remove {folder} to record anew") from None


def write_scene_file(plan: RecordingPlan, folder: Path) -> Path:
    """Write the scene file of a recording into its folder, before anything is recorded. A file that exists already stays.

    Raises `InputError` (`FileFaults`) for keys that no scene has, or that contradict each other, so that they are found before
    the recording.
    """
    path = folder / SCENE_FILE
    if path.exists():
        known = set(Scene.load(path).cameras)
        missing = [stream.camera for stream in plan.streams if stream.camera not in known]
        if missing:
            raise InputError(f"{path}: is there already, without camera {missing[0]}: record into another folder")
        return path
    for table in plan.tables:
        if table not in TABLES:
            raise InputError(f"{plan.place}: [{table}] has no place here: add it to {path} when that is written")
    cameras: dict[str, dict[str, Any]] = {}
    for name, given in plan.cameras.items():
        cameras[name] = {"video": name, **given}
        if isinstance(given.get("intrinsics"), str):
            cameras[name]["intrinsics"] = str((plan.place.parent / given["intrinsics"]).resolve())
    content = remove_all_credentials({**plan.tables, "cameras": cameras})
    Scene.of_content(content, plan.place)
    write_text(path, f"# Recorded by passerby record.\n\n{to_toml(content)}")
    return path
