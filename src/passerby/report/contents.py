"""The input of the report: a calibration that was just made, or one that is read from its output folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf
from pathlib import Path

from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, adjusted
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.core.quarter_turns import turn_observations, turn_rig, turns_of
from passerby.core.solution import Verdict
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry
from passerby.interchange.coco import read_keypoints
from passerby.interchange.declared_scene import DeclaredCamera
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.output_folder import RIG_FILE, TRACKS_FOLDER, is_file_name, read_report
from passerby.interchange.rig_toml import read_rig
from passerby.perception.sources.files import VideoSource, WallSpan


@dataclass(frozen=True, eq=False)
class Contents:
    """All input of the report. Images are rotated so that people stand upright; all values refer to the rotated images."""

    document: CalibrationDocument
    """The content of `calibration.json`."""
    rig: Rig
    """All cameras, also those without a pose. Metres, world z up, ground at z = 0."""
    observations: Observations
    """Boxes and joints of all cameras. Identities are the same in all cameras; frames are numbered by each camera."""
    clocks: Mapping[str, Clock]
    """Each camera's clock; empty if the same frame number is the same instant in all cameras."""
    videos: Mapping[str, VideoSource]
    """The cameras' videos whose files exist."""

    @property
    def verdict(self) -> Verdict:
        """accepted, doubtful or refused."""
        return self.document.verdict

    @property
    def cameras(self) -> dict[str, CameraEntry]:
        """By camera, its entry of `calibration.json`; an empty entry if the file has none."""
        entries = self.document.entries
        return {name: entries.get(name) or CameraEntry(name=name) for name in self.rig.names}

    @property
    def figures(self) -> AdjustedFigures:
        """Figures of the method `people`; empty figures for another method, or without a rig."""
        return adjusted(self.document.figures)


def contents_from(out: Path) -> Contents:
    """Read the contents of an output folder, also of a refused calibration and of an older version of Passerby.

    Raises `InputError` for a folder that no calibration wrote, and for a broken file in it.
    """
    document = read_report(out)
    rig = read_rig(out / RIG_FILE)
    clocks = _clocks(document.entries, rig)
    seen = {name: CameraObservations(*_read_observations(out / TRACKS_FOLDER, name)) for name in rig.names}
    return turn_contents_upright(
        document, rig, Observations(seen, document.scene.scene.fps, clocks), clocks, _videos(document, rig)
    )


def turn_contents_upright(
    document: CalibrationDocument, rig: Rig, seen: Observations, clocks: Mapping[str, Clock], videos: Mapping[str, VideoSource]
) -> Contents:
    """Return the contents of a calibration whose values refer to the images as filmed, before any rotation."""
    turns = turns_of(rig)
    return Contents(document, turn_rig(rig, turns), turn_observations(seen, rig, turns), clocks, videos)


def _read_observations(folder: Path, name: str) -> tuple[Boxes, Keypoints]:
    """Read a camera's boxes and joints; none for a missing file."""
    if not is_file_name(name):
        return Boxes.empty(), Keypoints.empty()
    boxes, joints = folder / f"{name}.txt", folder / f"{name}.json"
    return (
        read_boxes(boxes) if boxes.is_file() else Boxes.empty(),
        read_keypoints(joints) if joints.is_file() else Keypoints.empty(),
    )


def _clocks(entries: Mapping[str, CameraEntry], rig: Rig) -> dict[str, Clock]:
    """Return each camera's clock; no clocks if one camera has none, because common instants need all clocks."""
    found = {name: Clock(entry.fps, entry.time_offset_s or 0.0) for name, entry in entries.items() if entry.fps is not None}
    return {name: found[name] for name in rig.names} if all(name in found for name in rig.names) else {}


def _videos(document: CalibrationDocument, rig: Rig) -> dict[str, VideoSource]:
    """Return the videos that the scene names and whose files are still where they were."""
    if document.scene_file is None:
        return {}
    return declared_videos(document, rig.names, Path(document.scene_file).parent)


def declared_videos(document: CalibrationDocument, names: Sequence[str], folder: Path) -> dict[str, VideoSource]:
    """Return, by camera, the videos that the scene of a document names relative to its folder, if their files exist."""
    found = {}
    for name in names:
        declared = document.scene.cameras.get(name)
        source = None if declared is None else _declared(document, declared, folder)
        if source is not None and (source.single is None or source.single.is_file()):
            found[name] = source
    return found


def _declared(document: CalibrationDocument, declared: DeclaredCamera, folder: Path) -> VideoSource | None:
    """Return a camera's video as the scene declares it; None if it declares none."""
    named = declared.video if isinstance(declared.video, tuple) else (declared.video,)
    paths = tuple(folder / path for path in named if path and "\0" not in path)
    if not paths:
        return None
    times = None if declared.video_times is None else folder / declared.video_times
    watched = declared.tracks is None and declared.detections is None and declared.keypoints is None
    stated = document.wall_clock_origin
    origin = _wall_seconds(stated) if watched and stated is not None else None
    first, last = (None if end is None else _wall_seconds(end) for end in document.wall_clock_span or (None, None))
    span = None if first is None and last is None else WallSpan(-inf if first is None else first, inf if last is None else last)
    return VideoSource(
        paths, declared.video_names, times, declared.fps or document.scene.scene.fps, span, origin, declared.rotate or 0
    )


def _wall_seconds(text: str) -> float:
    """Return an ISO 8601 time as seconds since 1970; a time without a zone is UTC."""
    time = datetime.fromisoformat(text)
    return (time if time.tzinfo is not None else time.replace(tzinfo=UTC)).timestamp()
