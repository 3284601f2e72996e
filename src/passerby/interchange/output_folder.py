"""What `passerby calibrate` left in its output folder, read again."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from passerby.common.errors import InputError
from passerby.core.cameras import Camera

if TYPE_CHECKING:
    pass

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeGuard

from passerby.common.display import html_of
from passerby.common.errors import EvidenceError
from passerby.common.text import shortened
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, Clock
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.faults import read_text
from passerby.interchange.storage.safe_parsing import NotParsed, parse_json
from passerby.interchange.storage.transaction import recover

RIG_FILE, CALIBRATION_FILE, TRACKS_FOLDER, REPORT_FILE = "rig.toml", "calibration.json", "tracks", "report.html"
FILES = "files"
"""Key of `calibration.json`: checksums of the files that it tells of."""


@dataclass(frozen=True, eq=False)
class OutputFolder:
    """A calibration that was not refused: the cameras that have poses, and what they saw."""

    path: Path
    report: Mapping[str, Any]
    """What `calibration.json` holds."""
    verdict: str
    """accepted or doubtful."""
    reasons: tuple[str, ...]
    rig: Rig
    """The cameras with poses, one or more."""
    all_cameras: int
    """Those without a pose too."""
    boxes: Mapping[str, Boxes]
    """Of each camera with a pose, with identities that are the same in all cameras."""
    clocks: Mapping[str, Clock]
    """Of each camera with a pose; empty where frames are counted alike and no frame rate was needed."""

    def __repr__(self) -> str:
        return f"OutputFolder({str(self.path)!r}: {self.verdict}, {len(self.rig)} of {self.all_cameras} cameras)"

    def _repr_html_(self) -> str | None:
        """In a notebook: the verdict with its reasons, the table of cameras and the rig from above."""
        return html_of(self)

    @property
    def fps(self) -> float | None:
        """The frame rate that the scene file tells of; None where it tells none."""
        scene = self.report.get("scene")
        table = scene.get("scene") if isinstance(scene, dict) else None
        fps = table.get("fps") if isinstance(table, dict) else None
        return float(fps) if _is_number(fps) and fps > 0 else None

    @property
    def identities_given(self) -> bool:
        """Whether somebody said who is who, so that the identities are those of the input."""
        found = self.report.get("association")
        return isinstance(found, dict) and found.get("mode") == "given"

    @property
    def person_height_m(self) -> float | None:
        """Mean standing height that the calibration assumed."""
        scene = self.report.get("scene")
        scale = scene.get("scale") if isinstance(scene, dict) else None
        height = scale.get("person_height_m") if isinstance(scale, dict) else None
        return float(height) if isinstance(height, int | float) and 0.5 <= height <= 2.5 else None


def read_output(out: Path) -> OutputFolder:
    """Read an output folder.

    Raises:
        InputError: something is missing, broken or not of the same calibration, with its name and its mend.
        EvidenceError: the calibration was refused, or no camera has a pose.
    """
    report = read_report(out)
    verdict, reasons = report.get("verdict"), report.get("reasons")
    told = tuple(map(str, reasons)) if isinstance(reasons, list) else ()
    if verdict not in ("accepted", "doubtful", "refused"):
        raise unlike(out, f"verdict is {shortened(verdict)}")
    if verdict == "refused":
        raise EvidenceError(f"{out}: the calibration was refused: {'; '.join(told) or 'it tells no reason'}", told)
    rig = read_rig(out / RIG_FILE)
    posed = rig.posed()
    if not len(posed):
        raise EvidenceError(f"{out / RIG_FILE}: none of its {len(rig)} cameras has a pose")
    cameras = camera_tables(out, report)
    missing = [name for name in posed.names if name not in cameras]
    if missing:
        raise unlike(out, f"it has no camera {missing[0]}, which {RIG_FILE} has")
    boxes = {name: _boxes(out, name, cameras[name]) for name in posed.names}
    return OutputFolder(out, report, verdict, told, posed, len(rig), boxes, _clocks(out, cameras, posed))


def read_rig_at(path: Path) -> Rig:
    """The rig of a rig file (TOML) or of a folder (`read_folder_rig`), all cameras. Raises `InputError`."""
    return read_folder_rig(path) if path.is_dir() else read_rig(path)


def read_folder_rig(out: Path) -> Rig:
    """The rig of a folder, all cameras; that of an output folder as its `calibration.json` tells of it.

    Raises `InputError` where it is missing, broken, or of another calibration.
    """
    if (out / CALIBRATION_FILE).is_file():
        read_report(out)
    return read_rig(out / RIG_FILE)


def read_report(out: Path) -> dict[str, Any]:
    """What `calibration.json` holds, once it is sure that rig and tracks beside it are those that it tells of.

    What a process that was killed has decided to write is put into its place before. Files that are missing are the business of
    those who need them; an older Passerby wrote no checksums.

    Raises `InputError` where it is missing or no table, or where a file beside it is of another calibration or was changed.
    """
    recover(out, "reads the folder")
    report = _report(out)
    told = report.get(FILES, {})
    if not isinstance(told, dict):
        raise unlike(out, f"{FILES} is no table")
    names = [RIG_FILE, *(f"{TRACKS_FOLDER}/{name}{end}" for name in camera_names(report) for end in (".txt", ".json"))]
    for name in [name for name in names if name in told or (name.startswith(TRACKS_FOLDER) and FILES in report)]:
        path = out / name
        if path.is_file() and _checksum(path) != told.get(name):
            raise InputError(
                f"{path}: is not the file that {CALIBRATION_FILE} beside it tells of: it was changed, is damaged, or is of "
                "another calibration: put the right one back, or calibrate again"
            )
    return report


def camera_names(report: Mapping[str, Any]) -> list[str]:
    """The cameras that `calibration.json` tells of, as far as their names are names of files: a file may hold any text."""
    cameras = report.get("cameras")
    names = [one.get("name") for one in cameras if isinstance(one, dict)] if isinstance(cameras, list) else []
    return [name for name in names if isinstance(name, str) and is_file_name(name)]


def is_file_name(name: str) -> bool:
    """Whether a camera's name stays within its folder."""
    return "\0" not in name and len(Path(name).parts) == 1 and Path(name).name == name and "\\" not in name


def _checksum(path: Path) -> str:
    """Of a file. Raises `InputError` where it cannot be read."""
    try:
        return checksum(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}): check the file and its permissions") from None


def _report(out: Path) -> dict[str, Any]:
    """What `calibration.json` holds."""
    path = out / CALIBRATION_FILE
    if not path.is_file():
        raise InputError(f"{path}: no such file: name the folder that `passerby calibrate SCENE -o FOLDER` wrote")
    try:
        report = parse_json(read_text(path, "what a calibration tells (JSON)"))
    except NotParsed as error:
        raise InputError(f"{path}: is not JSON ({error}): calibrate again") from None
    if not isinstance(report, dict):
        raise unlike(out, "it is no table")
    return report


def unlike(out: Path, why: str) -> InputError:
    """The error of a `calibration.json` that no calibration wrote."""
    return InputError(f"{out / CALIBRATION_FILE}: is not what `passerby calibrate` writes: {why}: calibrate again")


def camera_tables(out: Path, report: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras' tables by name."""
    cameras = report.get("cameras")
    if not isinstance(cameras, list) or not all(isinstance(one, dict) and "name" in one for one in cameras):
        raise unlike(out, "cameras is not a list of tables with names")
    return {str(one["name"]): one for one in cameras}


def _boxes(out: Path, name: str, camera: Mapping[str, Any]) -> Boxes:
    """A camera's tracks; without any, a camera that saw nobody has no file."""
    path = out / TRACKS_FOLDER / f"{name}.txt"
    if not path.is_file() and camera.get("boxes") == 0:
        return Boxes.empty()
    if not path.is_file():
        raise InputError(f"{path}: no such file: the tracks of camera {name} are needed: calibrate again")
    return read_boxes(path)


def _is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a finite number that a float holds."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _clocks(out: Path, cameras: Mapping[str, Mapping[str, Any]], rig: Rig) -> dict[str, Clock]:
    """Each camera's clock; none where none was told."""
    found = {}
    for name in rig.names:
        fps, offset = cameras[name].get("fps"), cameras[name].get("time_offset_s")
        if fps is None:
            continue
        if not (_is_number(fps) and fps > 0 and _is_number(offset or 0.0)):
            raise unlike(out, f"camera {name} has fps {shortened(fps)} and time_offset_s {shortened(offset)}")
        found[name] = Clock(float(fps), float(offset or 0.0))
    if found and len(found) < len(rig):
        without = next(name for name in rig.names if name not in found)
        raise unlike(out, f"camera {without} has no fps, though others have")
    return found


def checksums(folder: Path) -> dict[str, str]:
    """Of the rig and the tracks in a folder, by name: BLAKE2b of 16 bytes in hex, as `b2sum -l 128` prints it."""
    files = [folder / RIG_FILE, *sorted((folder / TRACKS_FOLDER).glob("*"))]
    return {path.relative_to(folder).as_posix(): checksum(path) for path in files}


def checksum(path: Path) -> str:
    """Of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def scene_file(scene: Path | None) -> str | None:
    """Where the scene file lies, for those who need its videos again; None for a scene that came from no file.

    The path is absolute, so that the output folder's own place changes no byte of what is written into it. Paths in a scene
    file count from the folder that it is named in: a link in place of the file itself stays one.
    """
    return None if scene is None else (scene.parent.resolve() / scene.name).as_posix()


def pose_figures(camera: Camera) -> dict[str, Any]:
    """Of a camera's table what depends on its pose, and so on the frame of the world."""
    pose, sigma = camera.pose, camera.sigma
    return {
        "registered": pose is not None,
        "centre_m": None if pose is None else pose.centre,
        "height_m": None if pose is None else pose.centre[2],
        "heading_deg": None if pose is None else pose.heading_deg,
        "tilt_deg": None if pose is None else pose.tilt_deg,
        "roll_deg": None if pose is None else pose.roll_deg,
        "rotation": None if pose is None else np.asarray(cv2.Rodrigues(np.array(pose.R_cw))[0]).ravel(),
        "translation_m": None if pose is None else pose.t_cw,
        "position_sigma_mm": None if sigma is None else 1000 * sigma.position_m,
        "orientation_sigma_deg": None if sigma is None else sigma.orientation_deg,
    }
