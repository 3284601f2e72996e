"""Search of a user's folder for the videos, one per camera, and for the files of boxes and joints that belong to them.

The videos are taken from the first of these places that holds two or more: the folder itself; its subfolder named `video` or
`videos`; its subfolders. In the last case, each subfolder with videos is a camera of the same name, unless there is only one.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.text import natural_key
from passerby.perception.pieces import PICTURE_ENDINGS, VIDEO_ENDINGS, files_below
from passerby.perception.sources.frame_times import apply_times, find_frame_times, read_frame_times
from passerby.perception.video_probe import VideoInfo, WallTime
from passerby.scene.start.recordings import (
    COMPANIONS,
    Look,
    camera_names,
    companions_note,
    find_chapters,
    find_named_alike,
    is_numbered_series,
    match_names,
    pieces_among,
    set_aside_small_copies,
)
from passerby.scene.start.recordings_found import (
    VIDEO_FOLDERS,
    FoundRecording,
    ProposedSpan,
    RecordingSurvey,
    find_recordings,
    propose_span,
    seconds_of,
    survey_recording,
)

SOURCES = {
    "tracks": (("tracks", "tracklets"), ".txt"),
    "detections": (("detections",), ".txt"),
    "keypoints": (("keypoints",), ".json"),
    "embeddings": (("embeddings",), ".npz"),
}
"""Key of the scene file -> the subfolders that are searched, and the ending of the files."""

JOINT_FOLDERS, JOINTS_HEAD = ("pose", "openpose", "keypoints", "json"), 4096
"""Beginnings of the names of folders that hold a folder of keypoints per camera; number of bytes that are read to recognise
the file of a frame."""

Probe = Callable[[Path], VideoInfo]


@dataclass(eq=False)
class FoundCamera:
    """One camera as it is found in the folder."""

    name: str
    video: Path | None = None
    info: VideoInfo | None = None
    """Metadata of the video."""
    files: dict[str, Path] = field(default_factory=dict)
    """Key of the scene file (`tracks`, ...) -> file."""
    times: Path | None = None
    """A table of the times of the video's frames."""
    recording: RecordingSurvey | None = None
    """Survey of a video in pieces, or of images; `video` is then their folder or pattern."""
    fault: str | None = None
    """Reason why the video cannot be read; it still counts as a camera, so that the fault is noticed."""


@dataclass(eq=False)
class Survey:
    """The cameras that were found, and notes about them, one line each."""

    cameras: list[FoundCamera]
    notes: list[str]
    span: ProposedSpan | None = None
    """The part of long recordings that is proposed."""


def survey(folder: Path, probe: Probe) -> Survey:
    """Find the cameras in a folder.

    Raises `InputError` if there are fewer than two, or if there are pieces of a recording that are not separate cameras.
    """
    notes: list[str] = []
    _entries(folder)  # raises if the folder cannot be read

    @cache
    def look(path: Path) -> VideoInfo | None:
        try:
            return probe(path)
        except InputError:
            return None

    recorded = _find_recorded(folder, notes, probe, look)
    if recorded:
        return Survey(recorded, notes, propose_span([one.recording for one in recorded if one.recording is not None]))
    clips = [clip for clip in _clips(folder, notes, look) if not _is_text(clip[1], notes)]
    names = camera_names([text for text, _ in clips])
    cameras = [_open_camera(name, path, probe) for name, (_, path) in zip(names, clips, strict=True)]
    readable = [camera for camera in cameras if camera.fault is None]
    for camera in readable:
        _add_times(camera, notes)
    if len(readable) < 2:
        notes += [f"left out: {camera.fault}" for camera in cameras if camera.fault is not None]
        cameras = readable
    _add_files(folder, cameras, notes)
    if not cameras:
        _refuse_deeper(folder)
    if len(cameras) < 2:
        raise InputError(_describe_too_few(folder, cameras, notes))
    return Survey(cameras, notes)


def _is_text(path: Path, notes: list[str]) -> bool:
    """Return whether a file with the ending of a video is text, such as TypeScript (.ts); note that it is left out."""
    try:
        with path.open("rb") as file:
            head = file.read(1024)
    except OSError:
        return False
    text = bool(head) and all(byte >= 32 or byte in b"\t\n\r\f" for byte in head)
    notes += [f"left out: {path}: is text, not a video"] if text else []
    return text


def _open_camera(name: str, video: Path, probe: Probe) -> FoundCamera:
    try:
        return FoundCamera(name, video, probe(video))
    except InputError as error:
        return FoundCamera(name, video, fault=str(error))


def _add_times(camera: FoundCamera, notes: list[str]) -> None:
    """Add the table of the times of a video's frames, if there is one beside it, and a note about it."""
    path = None if camera.video is None else find_frame_times(camera.video)
    if path is None or camera.info is None:
        return
    try:
        camera.info = apply_times(camera.info, read_frame_times(path, 1.0 / camera.info.average_fps))
    except InputError as error:
        notes.append(f"not used: {error}")
        return
    camera.times = path
    notes.append(f"camera {camera.name}: the times of its frames are those of {path.name}")


def _find_recorded(folder: Path, notes: list[str], probe: Probe, look: Look) -> list[FoundCamera]:
    """Find the cameras whose videos are in pieces, or are images; empty if fewer than two can be read."""
    found = find_recordings(folder, look, notes)
    names = camera_names([one.text for one in found])
    cameras = [_survey_camera(name, one, probe) for name, one in zip(names, found, strict=True)]
    if sum(camera.fault is None for camera in cameras) < 2:
        notes.clear()
        return []
    notes += [
        f"camera {camera.name}: {survey.files} {'images' if survey.info.pieces else 'pieces'}"
        + (f", from {_wall(survey, 0)} to {_wall(survey, -1)}" if survey.begins else "")
        for camera in cameras
        if (survey := camera.recording) is not None
    ]
    return cameras


def _survey_camera(name: str, one: FoundRecording, probe: Probe) -> FoundCamera:
    if one.video.is_file():
        return _open_camera(name, one.video, probe)
    try:
        survey = survey_recording(one.video, probe)
    except InputError as error:
        return FoundCamera(name, one.video, fault=str(error))
    return FoundCamera(name, one.video, survey.info, recording=survey)


def _wall(survey: RecordingSurvey, which: int) -> str:
    return WallTime(round(survey.begins[which]), survey.utc).text


def visible_folders(folder: Path) -> list[Path]:
    """List the subfolders that are not hidden, cam2 before cam10."""
    return [path for path in _entries(folder) if path.is_dir()]


def visible_files(folder: Path, endings: tuple[str, ...] | None = None) -> list[Path]:
    """List the files that are not hidden, all or those with one of the endings (in any case), cam2 before cam10."""
    return [path for path in _entries(folder) if (endings is None or path.suffix.lower() in endings) and path.is_file()]


def _entries(folder: Path) -> list[Path]:
    """List the entries of a folder that are not hidden. Raises `InputError` if it cannot be read."""
    try:
        found = [path for path in folder.iterdir() if not path.name.startswith(".")]
    except FileNotFoundError:
        raise InputError(f"{folder}: no such folder: give the folder that holds the videos") from None
    except NotADirectoryError:
        raise InputError(f"{folder}: is a file: give the folder that holds the videos") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error}): give a folder that you may read") from None
    return sorted(found, key=lambda path: (natural_key(path.name), path.name))


def _refuse_pieces(folder: Path, pieces: list[Path]) -> None:
    """Raise `InputError` for pieces of a recording, if there are any."""
    if pieces:
        told = ", ".join(str(path.relative_to(folder)) for path in pieces[:2])
        raise InputError(
            f"{folder}: holds pieces of one camera's recording ({told}, ..., {len(pieces)} in a row): give the folder that "
            "holds the pieces of all cameras, each camera's in a folder of its own; if each is another camera, remove the "
            "times, or numbers of chapters, from their names"
        )


def _refuse_deeper(folder: Path) -> None:
    """Raise `InputError` for a folder without videos that has pieces of one recording, or only images, in deeper folders."""
    videos = files_below(folder, VIDEO_ENDINGS)
    if is_numbered_series(videos):
        _refuse_pieces(folder, videos)
    pictures = files_below(folder, PICTURE_ENDINGS)
    if len(pictures) > 1 and not videos:
        raise InputError(
            f"{folder}: holds {len(pictures)} images of one camera ({pictures[0].relative_to(folder)}, ...) and no video: give "
            "the folder that holds the images of all cameras, each camera's in a folder of its own"
        )


def _clips(folder: Path, notes: list[str], look: Look) -> list[tuple[str, Path]]:
    """Find the videos, each with the text that gives its camera's name. Raises `InputError` for pieces of recordings."""
    own = _videos(folder, notes)
    held = {inner: found for inner in visible_folders(folder) if (found := _videos(inner, notes))}
    named = next((inner for inner in held if inner.name.lower() in VIDEO_FOLDERS and len(held[inner]) > 1), None)
    inside = [named] if named is not None else list(held)
    if len(own) > 1 or not held:
        chosen, others = own, list(held)
    elif len(inside) == 1:
        chosen, others = held[inside[0]], [inner for inner in held if inner != inside[0]]
        if len(chosen) + len(own) == 2:
            chosen, own = own + chosen, []
        notes += [f"left out: {path}: the videos are taken from {inside[0]}" for path in own]
    else:
        notes += [f"left out: {path}: the cameras are assumed to be the subfolders" for path in own]
        for inner, (first, *more) in held.items():
            _refuse_pieces(folder, held[inner] if is_numbered_series(held[inner]) else _pieces_among(held[inner], look))
            if more:
                notes.append(
                    f"left out: {', '.join(path.name for path in more)} in {inner}: a camera has one video, and "
                    f"{first.name} is the first; if the cameras' videos lie together in one folder, give that folder"
                )
        return [(inner.name, found[0]) for inner, found in held.items()]
    _refuse_pieces(folder, _pieces_among(chosen, look))
    notes += _note_chapters(chosen)
    notes += [f"left out: the videos in {inner}: those in {chosen[0].parent} are taken" for inner in others]
    return [(path.stem, path) for path in _drop_copies(chosen, notes)]


def _pieces_among(videos: list[Path], look: Look) -> list[Path]:
    """Find the pieces of one recording among videos of one folder; empty if there are none."""
    chapters = find_chapters(videos, look, one_camera=False)
    return list(chapters[0].paths) if chapters else pieces_among(videos, seconds_of(look))


def _note_chapters(videos: list[Path]) -> list[str]:
    """Return a note if there are several groups of videos whose names differ by a counter that may number chapters."""
    groups = [paths for names, paths in find_named_alike(videos) if not names[0].numbers_cameras]
    if len(groups) < 2:
        return []
    first, second = (path.name for path in groups[0][:2])
    return [
        f"each video is assumed to be a camera: if {first} and {second} are chapters of one recording, put the files of each "
        "camera into a folder of its own"
    ]


def _videos(folder: Path, notes: list[str]) -> list[Path]:
    """List the videos in a folder; those whose name cannot be written into a scene file are left out with a note."""
    try:
        found = [path for path in folder.iterdir() if path.suffix.lower() in VIDEO_ENDINGS and path.is_file()]
    except OSError as error:
        notes.append(f"left out: {folder}: cannot be read ({error.strerror or error})")
        return []
    hidden = sum(path.name.startswith(".") for path in found)
    if hidden:
        notes.append(f"left out: {hidden} hidden video{'s' * (hidden > 1)} in {folder}")
    usable = []
    for path in visible_files(folder, VIDEO_ENDINGS):
        try:
            str(path).encode()
            usable.append(path)
        except UnicodeEncodeError:
            notes.append(f"left out: {path.name!a} in {folder}: its name is not UTF-8 text: rename it")
    usable, copies = set_aside_small_copies(usable)
    notes += companions_note(visible_files(folder, COMPANIONS), copies)
    return usable


def _drop_copies(paths: list[Path], notes: list[str]) -> list[Path]:
    """Leave out videos that differ from an earlier one only in the ending of the name: one camera must not be used twice."""
    kept: dict[tuple[Path, str], Path] = {}
    for path in paths:
        first = kept.setdefault((path.parent, path.stem), path)
        if first != path:
            notes.append(f"left out: {path}: taken to be a copy of {first.name}; rename it if it is another camera")
    return list(kept.values())


def _add_files(folder: Path, cameras: list[FoundCamera], notes: list[str]) -> None:
    """Add the files of boxes and joints to the cameras; if there are fewer than two videos, these files define cameras."""
    by_name = {camera.name.casefold(): camera for camera in cameras}
    make = len(cameras) < 2
    for key, (places, ending) in SOURCES.items():
        found = [
            (path.stem, path)
            for inner in visible_folders(folder)
            if inner.name.lower() in places
            for path in visible_files(inner, (ending,))
        ]
        found += _folders_of_joints(folder) if key == "keypoints" else []
        texts = [text for text, _ in found]
        pairs = {} if make else match_names([camera.name for camera in cameras], [[text] for text in texts])
        matched = {other: cameras[index] for index, other in pairs.items()}
        for number, (text, path) in enumerate(found):
            camera = by_name.get(text.casefold()) or matched.get(number)
            if camera is None and make and key != "embeddings":
                camera = FoundCamera(camera_names([text])[0])
                cameras.append(camera)
                by_name[text.casefold()] = camera
            if camera is not None:
                camera.files.setdefault(key, path)
            elif path.is_dir():
                notes.append(f"not used: {path}: its keypoints belong to none of the cameras by its name")
    cameras.sort(key=lambda camera: natural_key(camera.name))
    if not make and any(camera.files for camera in cameras):
        notes.append("boxes or keypoints were found beside the videos: their lines in the scene file are commented out")


def _folders_of_joints(folder: Path) -> list[tuple[str, Path]]:
    """Find the folders with a JSON file of people per frame, each with the text that gives its camera's name.

    OpenPose and Pose2Sim write such folders: `cam01_json` in the folder itself, or in a folder such as `pose`.
    """
    places = [folder, *(inner for inner in visible_folders(folder) if inner.name.lower().startswith(JOINT_FOLDERS))]
    found = [inner for place in places for inner in visible_folders(place) if _has_joints(inner)]
    return [(re.sub(r"(?i)[_-](json|keypoints|pose)$", "", inner.name), inner) for inner in found]


def _has_joints(folder: Path) -> bool:
    first = next(iter(visible_files(folder, (".json",))), None)
    try:
        return first is not None and b'"people"' in first.read_bytes()[:JOINTS_HEAD]
    except OSError:
        return False


def _describe_too_few(folder: Path, cameras: list[FoundCamera], notes: list[str]) -> str:
    endings = ", ".join(ending[1:] for ending in VIDEO_ENDINGS)
    more = f" ({'; '.join(notes)})" if notes else ""
    if not cameras:
        return f"{folder}: neither it nor a folder in it holds a video that can be read ({endings}): give another{more}"
    only = cameras[0].video or next(iter(cameras[0].files.values()))
    return f"{folder}: holds only one camera ({only}): a calibration needs two or more that saw the same people{more}"
