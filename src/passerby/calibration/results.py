"""The output folder of a calibration: `rig.toml`, `calibration.json`, `tracks/` and `report.html`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from passerby._version import __version__
from passerby.association.result import Association
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.core.observations import UNKNOWN, CameraObservations
from passerby.evaluation.reprojection import median_residuals
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import forget_halves, write_text
from passerby.interchange.storage.json_text import plain, to_json
from passerby.interchange.storage.transaction import together, working_in

if TYPE_CHECKING:
    from passerby.calibration.pipeline import Calibration
    from passerby.common.progress import Progress

RIG_FILE, CALIBRATION_FILE, TRACKS_FOLDER, REPORT_FILE = "rig.toml", "calibration.json", "tracks", "report.html"
FILES = "files"
"""Key of `calibration.json`: checksums of the files that it tells of."""
WORK = "passerby calibrate"
WHOLE = "all other results in {0} are whole and can be used; `passerby report {0}` makes the report again"
COMPUTING_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "poselib", "av", "onnxruntime")
"""Whose versions can change a figure."""


def write_calibration(calibration: Calibration, folder: Path, *, report: bool = True, progress: Progress | None = None) -> None:
    """Write a calibration as `write_results` does, alone in its folder.

    Raises `InputError` where the folder is not writable, or another process works in it.
    """
    with working_in(folder, WORK):
        write_results(calibration, folder, report=report, progress=progress)


def write_results(calibration: Calibration, folder: Path, *, report: bool = True, progress: Progress | None = None) -> None:
    """Write a calibration into a folder that is locked for this process.

    Rig, tracks and `calibration.json`, which has the checksums of the others, change together: all or none. The report comes
    last and can be made again from them; one of an earlier run does not stay beside new figures. The same input, seed and
    libraries give the same bytes. Raises `InputError` where the folder is not writable.
    """
    seen = {camera.name: calibration.observations[camera.name] for camera in calibration.rig}
    with together(folder, [REPORT_FILE, *_earlier_tracks(folder, seen)]) as new:
        for name, people in seen.items():
            _write_seen(new / TRACKS_FOLDER, name, people)
        write_rig(new / RIG_FILE, calibration.rig)
        content = {"scene_file": scene_file(calibration.scene.path), FILES: checksums(new)} | calibration_dict(calibration)
        write_text(new / CALIBRATION_FILE, to_json(content))
        forget_halves(folder / REPORT_FILE)
    if report:
        from passerby.report.contents import contents_of
        from passerby.report.page import write_report

        try:
            write_report(contents_of(calibration), folder / REPORT_FILE, progress)
        except InputError as error:
            raise InputError(f"{error}; {WHOLE.format(folder)}") from error
        except Exception as error:
            error.add_note(WHOLE.format(folder))
            raise


def checksums(folder: Path) -> dict[str, str]:
    """Of the rig and the tracks in a folder, by name: BLAKE2b of 16 bytes in hex, as `b2sum -l 128` prints it."""
    files = [folder / RIG_FILE, *sorted((folder / TRACKS_FOLDER).glob("*"))]
    return {path.relative_to(folder).as_posix(): checksum(path) for path in files}


def checksum(path: Path) -> str:
    """Of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _write_seen(folder: Path, name: str, seen: CameraObservations) -> None:
    """A camera's boxes and joints, where there are any."""
    if len(seen.boxes):
        write_boxes(folder / f"{name}.txt", seen.boxes)
    if len(seen.keypoints):
        write_keypoints(folder / f"{name}.json", seen.keypoints)


def _earlier_tracks(folder: Path, cameras: Iterable[str]) -> list[str]:
    """The tracks of an earlier run: of these cameras, and those that its `calibration.json` tells of."""
    ours = [f"{TRACKS_FOLDER}/{name}{ending}" for name in cameras for ending in (".txt", ".json")]
    try:
        told = json.loads((folder / CALIBRATION_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # none, or one that is broken
        return ours
    files = told.get(FILES) if isinstance(told, dict) else None
    return ours + [name for name in files or () if name.startswith(f"{TRACKS_FOLDER}/") and name.count("/") == 1]


def scene_file(scene: Path | None) -> str | None:
    """Where the scene file lies, for those who need its videos again; None for a scene that came from no file.

    The path is absolute, so that the output folder's own place changes no byte of what is written into it. Paths in a scene
    file count from the folder that it is named in: a link in place of the file itself stays one.
    """
    return None if scene is None else (scene.parent.resolve() / scene.name).as_posix()


def calibration_dict(calibration: Calibration) -> dict[str, Any]:
    """A calibration as plain values for JSON, without wall times."""
    scene, association, residual_px = calibration.scene, calibration.association, _residuals(calibration)
    content: dict[str, Any] = plain(
        {
            "name": scene.name,
            "passerby": __version__,
            "versions": {name: _version(name) for name in COMPUTING_LIBRARIES},
            "verdict": calibration.verdict,
            "reasons": calibration.reasons,
            "findings": calibration.findings,
            "cameras": [
                _camera(camera, calibration.observations[camera.name])
                | {"median_residual_px": residual_px.get(camera.name)}
                | _clock(calibration.association, camera.name)
                for camera in calibration.rig
            ],
            **({"perception": calibration.perception} if calibration.perception else {}),
            "association": {"mode": scene.association.mode} | (association.figures if association else {}),
            "method": scene.solver.method,
            "seed": calibration.seed,
            "options": calibration.options,
            "scene": scene.model_dump(mode="json", exclude_none=True),
            "figures": calibration.figures,
            **({"world": calibration.world} if calibration.world else {}),
        }
    )
    return content


def _camera(camera: Camera, seen: CameraObservations) -> dict[str, Any]:
    people = np.unique(np.concatenate([seen.boxes.identity, seen.keypoints.identity]))
    return {
        "name": camera.name,
        **pose_figures(camera),
        "people": len(people[people > UNKNOWN]),
        "boxes": len(seen.boxes),
        "keypoints": len(seen.keypoints),
    }


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


def _residuals(calibration: Calibration) -> dict[str, float]:
    """By camera: what the solver tells, or else the median reprojection error of box centres or joints, pixels."""
    told = {one["name"]: one.get("median_residual_px") for one in calibration.figures.get("cameras", ())}
    missing = [camera.name for camera in calibration.rig.posed() if told.get(camera.name) is None]
    found = median_residuals(calibration.rig, calibration.instants) if missing else {}
    return found | {name: value for name, value in told.items() if value is not None}


def _clock(association: Association | None, name: str) -> dict[str, Any]:
    """Frame f shows the world at (f - 1) / fps + time_offset_s, by the clock of the first registered camera."""
    clock = association.clocks.get(name) if association else None
    sigma = association.sigma_s.get(name) if association else None
    return {
        "fps": None if clock is None else clock.fps,
        "time_offset_s": None if clock is None else clock.offset_s,
        "time_offset_sigma_s": sigma,
    }


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
