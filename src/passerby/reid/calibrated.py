"""What `passerby calibrate` left in its output folder, as far as a network learns from it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from passerby.cameras import Rig
from passerby.errors import EvidenceError, InputError
from passerby.interchange.faults import read_text
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.observations import Boxes, Clock
from passerby.perception.video import probe
from passerby.results import CALIBRATION_FILE, RIG_FILE, TRACKS_FOLDER
from passerby.scene import Scene


@dataclass(frozen=True, eq=False)
class CalibratedScene:
    """A calibrated scene: the cameras that have poses, and what they saw."""

    scene: Scene
    rig: Rig
    """The cameras with poses, two or more."""
    boxes: Mapping[str, Boxes]
    """Of each of them, with identities that are the same in all cameras."""
    clocks: Mapping[str, Clock]
    verdict: str
    videos: Mapping[str, Path]
    """Of those of them that have one."""


def read_calibrated(out: Path, scene: Path | None = None) -> CalibratedScene:
    """Read an output folder.

    Args:
        out: the folder.
        scene: its scene file; None: where `calibration.json` says that it lies.

    Raises:
        InputError: something is missing or broken, with its name and its mend.
        EvidenceError: the calibration was refused, or registered fewer than two cameras.
    """
    report = _report(out)
    verdict = report.get("verdict")
    if verdict not in ("accepted", "doubtful", "refused"):
        raise _unlike(out, f"verdict is {verdict!r}")
    if verdict == "refused":
        reasons = report.get("reasons")
        told = tuple(map(str, reasons)) if isinstance(reasons, list) else ()
        raise EvidenceError(f"{out}: the calibration was refused: {'; '.join(told) or 'it tells no reason'}", told)
    rig = read_rig(out / RIG_FILE)
    posed = rig.posed()
    if len(posed) < 2:
        raise EvidenceError(
            f"{out / RIG_FILE}: {len(posed)} of {len(rig)} cameras have a pose: who is who is told by two cameras or more"
        )
    loaded = Scene.load(_scene_path(out, report, scene))
    for camera in posed:
        if camera.name not in loaded.cameras:
            raise InputError(
                f"{loaded.place}: has no [cameras.{camera.name}], which {out / RIG_FILE} has: give the scene file that was "
                "calibrated"
            )
    videos = {
        name: loaded.resolve(table.video) for name, table in loaded.cameras.items() if table.video and name in posed.names
    }
    if not videos:
        raise InputError(f"{loaded.place}: no calibrated camera has a video: crops of people are cut out of videos")
    cameras = _cameras(out, report)
    missing = [name for name in posed.names if name not in cameras]
    if missing:
        raise _unlike(out, f"it has no camera {missing[0]}, which {RIG_FILE} has")
    boxes = {name: _boxes(out, name, cameras[name]) for name in posed.names}
    return CalibratedScene(loaded, posed, boxes, _clocks(out, cameras, loaded, posed, videos), verdict, videos)


def _report(out: Path) -> dict[str, Any]:
    """What `calibration.json` holds."""
    path = out / CALIBRATION_FILE
    if not path.is_file():
        raise InputError(f"{path}: no such file: name the folder that `passerby calibrate SCENE -o FOLDER` wrote")
    try:
        report = json.loads(read_text(path, "what a calibration tells (JSON)"))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: is not JSON ({error}): calibrate again") from None
    if not isinstance(report, dict):
        raise _unlike(out, "it is no table")
    return report


def _unlike(out: Path, why: str) -> InputError:
    return InputError(f"{out / CALIBRATION_FILE}: is not what `passerby calibrate` writes: {why}: calibrate again")


def _scene_path(out: Path, report: Mapping[str, Any], given: Path | None) -> Path:
    """The scene file."""
    if given is not None:
        return given
    told = report.get("scene_file")
    if not isinstance(told, str):
        raise InputError(f"{out / CALIBRATION_FILE}: does not say where the scene file lies (scene_file): name it")
    path = out / told
    if not path.is_file():
        raise InputError(f"{path}: no such file: {out} was made from it: name the scene file's new place")
    return path


def _cameras(out: Path, report: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras' tables by name."""
    cameras = report.get("cameras")
    if not isinstance(cameras, list) or not all(isinstance(one, dict) and "name" in one for one in cameras):
        raise _unlike(out, "cameras is not a list of tables with names")
    return {str(one["name"]): one for one in cameras}


def _boxes(out: Path, name: str, camera: Mapping[str, Any]) -> Boxes:
    """A camera's tracks; without any, a camera that saw nobody has no file."""
    path = out / TRACKS_FOLDER / f"{name}.txt"
    if not path.is_file() and camera.get("boxes") == 0:
        return Boxes.empty()
    if not path.is_file():
        raise InputError(f"{path}: no such file: the tracks of camera {name} are needed: calibrate again")
    return read_boxes(path)


def _clocks(
    out: Path, cameras: Mapping[str, Mapping[str, Any]], scene: Scene, rig: Rig, videos: Mapping[str, Path]
) -> dict[str, Clock]:
    """Each camera's clock. Where none was told the frames are counted alike, at the rate of the scene or of a video."""
    found = {}
    for name in rig.names:
        fps, offset = cameras[name].get("fps"), cameras[name].get("time_offset_s")
        if fps is None:
            continue
        if not (isinstance(fps, int | float) and fps > 0 and isinstance(offset or 0.0, int | float)):
            raise _unlike(out, f"camera {name} has fps {fps!r} and time_offset_s {offset!r}")
        found[name] = Clock(float(fps), float(offset or 0.0))
    if found and len(found) < len(rig):
        without = next(name for name in rig.names if name not in found)
        raise _unlike(out, f"camera {without} has no fps, though others have")
    if found:
        return found
    rates = [scene.fps_of(name) for name in rig.names]
    rate = next((rate for rate in rates if rate), None) or probe(next(iter(videos.values()))).clock_fps
    return {name: Clock(rate) for name in rig.names}
