"""Reading of the output folder of `passerby calibrate`."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.errors import EvidenceError, InputError
from passerby.common.text import html_of
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, Clock, Keypoints, extents_of
from passerby.interchange.calibration_json import (
    CALIBRATION_FILE,
    CalibrationDocument,
    CameraEntry,
    read_document,
    unlike,
)
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.safe_parsing import NotParsed, parse_toml, read_text
from passerby.interchange.storage.text_formats import plain
from passerby.interchange.storage.transaction import recover

RIG_FILE, TRACKS_FOLDER, REPORT_FILE = "rig.toml", "tracks", "report.html"
GROUPS_FOLDER = "groups"
REPORT_STAMP = re.compile("[0-9a-f]{16}")
"""Stamp of the content of a report's files. It is the name of their folder."""


@dataclass(frozen=True, eq=False)
class OutputFolder:
    """A calibration that was not refused: the cameras with poses, and their boxes."""

    path: Path
    document: CalibrationDocument
    """Content of `calibration.json`."""
    verdict: str
    """accepted or doubtful."""
    reasons: tuple[str, ...]
    rig: Rig
    """The cameras with poses, one or more."""
    all_cameras: int
    """Number of cameras, including those without a pose."""
    boxes: Mapping[str, Boxes]
    """Boxes of each camera with a pose, with identities that are the same in all cameras."""
    clocks: Mapping[str, Clock]
    """Clock of each camera with a pose; empty if all cameras count frames alike and no frame rate was needed."""

    def __repr__(self) -> str:
        return f"OutputFolder({str(self.path)!r}: {self.verdict}, {len(self.rig)} of {self.all_cameras} cameras)"

    def _repr_html_(self) -> str | None:
        """Return the display in a notebook: the verdict with its reasons, the table of cameras and the rig from above."""
        return html_of(self)

    @property
    def tracks(self) -> Mapping[str, Boxes]:
        """Boxes of each camera with a pose, with identities that are the same in all cameras, as `Calibration.tracks`."""
        return self.boxes

    @property
    def report(self) -> Mapping[str, Any]:
        """Content of `calibration.json` as plain values."""
        held: Mapping[str, Any] = plain(self.document)
        return held

    @property
    def fps(self) -> float | None:
        """Frame rate that the scene file states, in frames per second; None if it states none."""
        return self.document.scene.scene.fps

    @property
    def identities_given(self) -> bool:
        """Whether the input stated the identities, so that they are unchanged."""
        return self.document.association.mode == "given"

    @property
    def person_height_m(self) -> float | None:
        """Mean standing height that the calibration assumed, metres; None if it is not stated, or not from 0.5 to 2.5 m."""
        height = self.document.scene.scale.person_height_m
        return height if height is not None and 0.5 <= height <= 2.5 else None


def read_output(out: Path) -> OutputFolder:
    """Read an output folder.

    Raises:
        InputError: a file is missing, damaged or of another calibration; the message names it and the remedy.
        EvidenceError: the calibration was refused, or no camera has a pose.
    """
    document = read_report(out)
    reasons = document.reasons
    if document.verdict == "refused":
        raise EvidenceError(f"{out}: the calibration was refused: {'; '.join(reasons) or 'no reason is given'}", reasons)
    rig = read_rig(out / RIG_FILE)
    posed = rig.posed()
    if not len(posed):
        raise EvidenceError(f"{out / RIG_FILE}: none of its {len(rig)} cameras has a pose")
    cameras = entries_of(out, document, posed)
    boxes = {name: _boxes(out, cameras[name]) for name in posed.names}
    return OutputFolder(out, document, document.verdict, reasons, posed, len(rig), boxes, _clocks(out, cameras, posed))


def entries_of(out: Path, document: CalibrationDocument, rig: Rig) -> dict[str, CameraEntry]:
    """Return the entries of a document by camera. Raises `InputError` where a camera of the rig has none."""
    entries = document.entries
    missing = [name for name in rig.names if name not in entries]
    if missing:
        raise unlike(out / CALIBRATION_FILE, f"it has no camera {missing[0]}, which {RIG_FILE} has")
    return entries


def read_rig_at(path: Path) -> Rig:
    """Read the rig, with all cameras, of a rig file (TOML) or of a folder (`read_folder_rig`). Raises `InputError`."""
    return read_folder_rig(path) if path.is_dir() else read_rig(path)


def read_tracks_at(path: Path) -> dict[str, Boxes]:
    """Read the boxes by camera of an output folder, or of its folder `tracks`; where there are none, those around keypoints.

    Raises `InputError` where there are neither.
    """
    folder = path / TRACKS_FOLDER if (path / TRACKS_FOLDER).is_dir() else path
    boxes = {file.stem: read_boxes(file, doubles=True) for file in sorted(folder.glob("*.txt"))}
    for file in sorted(folder.glob("*.json")):
        if file.stem not in boxes and file.name != CALIBRATION_FILE:
            boxes[file.stem] = _around(read_keypoints(file, doubles=True))
    if not boxes:
        raise InputError(
            f"{path}: holds no boxes and no keypoints: give an output folder, or its folder {TRACKS_FOLDER} with one file per "
            "camera"
        )
    return boxes


def _around(keypoints: Keypoints) -> Boxes:
    """Return the boxes around the found joints."""
    extents = extents_of(keypoints)
    ltwh = np.column_stack([extents[:, :2], extents[:, 2:] - extents[:, :2]])
    whole = (ltwh[:, 2:] > 0).all(axis=1)
    return Boxes(keypoints.frame, keypoints.identity, ltwh, np.ones(len(ltwh))).take(np.flatnonzero(whole))


def read_folder_rig(out: Path) -> Rig:
    """Read the rig, with all cameras, of a folder. If the folder has a `calibration.json`, check the files against it.

    Raises `InputError` where the rig is missing, damaged, or of another calibration.
    """
    if (out / CALIBRATION_FILE).is_file():
        read_report(out)
    return read_rig(out / RIG_FILE)


def read_report(out: Path, *, tracks: bool = True) -> CalibrationDocument:
    """Read `calibration.json`, and verify that the rig and the tracks beside it are those that it describes.

    If a killed process left a decided transaction, it is completed first (`recover`). Missing files are no error here. Without
    checksums, in the files of an older Passerby, nothing is verified. Without `tracks`, only the rig is verified.

    Raises `InputError` where it is missing or damaged, or where a file beside it is of another calibration or was changed.
    """
    recover(out, "reads the folder")
    document = read_document(out)
    if document.files is None:
        return document
    cameras = [one.name for one in document.cameras if tracks and is_file_name(one.name)]
    paths = [f"{TRACKS_FOLDER}/{name}{end}" for name in cameras for end in (".txt", ".json")]
    for name in [*([RIG_FILE] if RIG_FILE in document.files else []), *paths]:
        path = out / name
        if path.is_file() and _checksum(path) != document.files.get(name):
            raise InputError(
                f"{path}: is not the file that {CALIBRATION_FILE} beside it describes: it was changed, is damaged, or is of "
                "another calibration: put the right one back, or calibrate again"
            )
    return document


def is_file_name(name: str) -> bool:
    """Check whether a camera's name is a plain file name, which cannot lead out of its folder."""
    return "\0" not in name and len(Path(name).parts) == 1 and Path(name).name == name and "\\" not in name


def _checksum(path: Path) -> str:
    """Compute the checksum of a file. Raises `InputError` where it cannot be read."""
    try:
        return checksum(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): check the file and its permissions") from None


def _boxes(out: Path, camera: CameraEntry) -> Boxes:
    """Read the tracks of a camera. A camera that saw no person needs no file."""
    path = out / TRACKS_FOLDER / f"{camera.name}.txt"
    if not path.is_file() and camera.boxes == 0:
        return Boxes.empty()
    if not path.is_file():
        raise InputError(f"{path}: no such file: the tracks of camera {camera.name} are needed: calibrate again")
    return read_boxes(path)


def _clocks(out: Path, cameras: Mapping[str, CameraEntry], rig: Rig) -> dict[str, Clock]:
    """Return the clock of each camera; empty if no camera has a frame rate."""
    found = {
        name: Clock(fps, cameras[name].time_offset_s or 0.0) for name in rig.names if (fps := cameras[name].fps) is not None
    }
    if found and len(found) < len(rig):
        without = next(name for name in rig.names if name not in found)
        raise unlike(out / CALIBRATION_FILE, f"camera {without} has no fps, though others have")
    return found


def report_folder(page: Path) -> Path:
    """Return the folder of the parts that a report of many cameras loads on demand. It is named as browsers name theirs."""
    return page.with_name(f"{page.stem}_files")


def report_files(page: Path) -> list[Path]:
    """List the existing files of a report: the page, and the files of its folder that have names of this package."""
    parts = [path for path in report_folder(page).glob("*/*.js") if REPORT_STAMP.fullmatch(path.parent.name)]
    return [path for path in (page, *sorted(parts)) if path.is_file()]


def remove_report_parts(page: Path, but: str = "") -> None:
    """Delete the parts of a report except those with the stamp `but`, then the folders that are empty.

    Files that cannot be deleted stay: no page uses them.
    """
    for path in report_files(page):
        if path != page and path.parent.name != but:
            with suppress(OSError):
                path.unlink()
    stamped = [folder for folder in report_folder(page).glob("*") if REPORT_STAMP.fullmatch(folder.name)]
    for folder in (*stamped, report_folder(page)):
        with suppress(OSError):  # not empty
            folder.rmdir()


def group_folder(number: int) -> str:
    """Return the folder of a further group of cameras, relative to the output folder of the main rig."""
    return f"{GROUPS_FOLDER}/{number}"


def checksums(folder: Path) -> dict[str, str]:
    """Compute checksums of the rig and the tracks in a folder, by name: BLAKE2b of 16 bytes in hex, as of `b2sum -l 128`."""
    files = [folder / RIG_FILE, *sorted((folder / TRACKS_FOLDER).glob("*"))]
    return {path.relative_to(folder).as_posix(): checksum(path) for path in files}


def checksum(path: Path) -> str:
    """Compute the checksum of a file: BLAKE2b of 16 bytes in hex. Raises `OSError`."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def scene_of(out: Path, document: CalibrationDocument, remedy: str) -> Path:
    """Find the scene file of an output folder: at the stated path, or in a folder above, if both were moved together.

    An output folder that was copied with its scene file still states the path of the original. The two scene files may differ
    by now, so the user has to name one.

    Args:
        out: the output folder.
        document: its `calibration.json`.
        remedy: how to name a scene file, for the messages.

    Raises:
        InputError: its path is not stated, it does not exist, or a folder above has another one with the same cameras.
    """
    if document.scene_file is None:
        raise InputError(f"{out / CALIBRATION_FILE}: does not state the path of the scene file (scene_file): {remedy}")
    stated, above = out / document.scene_file, out.resolve().parents
    if stated.is_file() and stated.resolve().parent in above:
        return stated
    near = next((folder / stated.name for folder in above if _is_scene_of(folder / stated.name, document)), None)
    if stated.is_file() and near is not None and not near.samefile(stated):
        raise InputError(
            f"{out}: was made from {stated}, but {near} has the same cameras: the folder seems to be a copy: name the one "
            f"to use: {remedy}"
        )
    if stated.is_file() or near is not None:
        return near or stated
    raise InputError(f"{stated}: no such file: {out} was made from this scene file: {remedy}")


def _is_scene_of(path: Path, document: CalibrationDocument) -> bool:
    """Check whether a file is a scene file with the document's cameras."""
    try:
        cameras = parse_toml(read_text(path, "a scene file (TOML)")).get("cameras") if path.is_file() else None
    except (InputError, NotParsed):
        return False
    return isinstance(cameras, dict) and set(cameras) == set(document.scene.cameras)


def scene_file(scene: Path | None) -> str | None:
    """Return the absolute path of the scene file, by which its videos are found again; None for a scene that came from no file.

    Because the path is absolute, the files of an output folder are the same bytes wherever the folder is. Paths in a scene file
    are relative to the folder in which it was named. Therefore a symbolic link in place of the file is not resolved.
    """
    return None if scene is None else (scene.parent.resolve() / scene.name).as_posix()
