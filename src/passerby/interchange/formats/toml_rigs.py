"""Anipose's calibration.toml, Pose2Sim's Calib.toml and Caliscope's camera_array.toml.

All three have, as a rig file of Passerby, one table for each camera with `size` [width, height], `matrix` and `distortions`
of OpenCV, `rotation` (a Rodrigues vector) and `translation` of x_c = R X_w + t, OpenCV's camera axes and pixels, and
`fisheye`. They differ in names, in units and in the way that their tools use them:

- Anipose (aniposelib 0.8.0, `cameras.py`: `CameraGroup.load`): tables `cam_0`, `cam_1`, sorted by their names as text; a
  pose is needed; the unit is that of the calibration board, often millimetres, and the file does not state it. Passerby
  writes metres and states them in `[metadata] units`. Anipose projects with `cv2.projectPoints`, or with
  `cv2.fisheye.projectPoints` where `fisheye` is true.
- Pose2Sim (0.10.49, `common.py`: `retrieve_calib_params`): tables in the order of the file, which must be that of the
  folders of joints; `metadata`, `capture_volume`, `charuco` and `checkerboard` are not cameras; a pose is needed; metres,
  z up. It ignores `fisheye` and always projects with `cv2.projectPoints`, so a fisheye lens is a loss.
- Caliscope (0.11.8, `cameras/camera_array.py`: `CameraArray.from_toml`): tables `[cameras.0]` by number, the N of its videos'
  names cam_N.mp4; metres; cameras without a pose are permitted; earlier versions had tables `[cam_0]` and rotations of 3 x 3
  numbers, which are read too.

None of them uses a skew in the matrix: OpenCV's pinhole functions have none, and the fisheye's are called without `alpha`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import (
    FISHEYE,
    RATIONAL_8,
    TILTED_14,
    LensModel,
    express_lens,
    trim_coefficients,
)
from passerby.interchange.formats.values import tame_names
from passerby.interchange.numbers import gather_rig
from passerby.interchange.rig_toml import CAMERA_KEYS, METADATA, METRES_PER_UNIT, camera_of, table_of
from passerby.interchange.storage.safe_parsing import read_toml

OTHER_TABLES = (METADATA, "capture_volume", "charuco", "checkerboard", "cameras")
"""Tables that are not a camera for Pose2Sim, and Caliscope's table of all cameras."""

NUMBERS = ("cam_id", "rotation_count")
"""Keys of Caliscope's tables: the camera's number again, and the rotation of its video on the screen."""

OPENCV_MODELS = (RATIONAL_8, TILTED_14, FISHEYE)
PINHOLE_MODELS = (RATIONAL_8, TILTED_14)

_NOT_BARE = re.compile(r"[^A-Za-z0-9_-]")
"""Characters that would need quotes in the name of a TOML table."""
_NUMBERED = re.compile(r"cam_(0|[1-9]\d{0,8})")


def _write_anipose(export: Export, losses: Losses) -> Mapping[str, bytes]:
    rig = export.posed(losses)
    digits = len(str(len(rig) - 1))
    tables = {f"cam_{index:0{digits}}": _table(camera, OPENCV_MODELS, losses, 5) for index, camera in enumerate(rig)}
    return _toml({**tables, METADATA: {"adjusted": False, "error": 0.0, "units": "m"}})


def _write_pose2sim(export: Export, losses: Losses) -> Mapping[str, bytes]:
    rig = export.posed(losses)
    keys = list(tame_names(rig.names, _NOT_BARE).values())
    for index, key in enumerate(keys):
        while key in OTHER_TABLES or key in keys[:index] + keys[index + 1 :]:
            key += "_"
        keys[index] = key
    tables = {key: _table(camera, PINHOLE_MODELS, losses, 4) for key, camera in zip(keys, rig, strict=True)}
    return _toml({**tables, METADATA: {"adjusted": False, "error": 0.0}})


def _write_caliscope(export: Export, losses: Losses) -> Mapping[str, bytes]:
    rig = export.with_lenses(losses)
    numbered = [_NUMBERED.fullmatch(name) for name in rig.names]
    numbers = [int(found[1]) for found in numbered if found]
    if len(numbers) < len(rig):
        numbers = list(range(len(rig)))
    tables = {
        str(number): {
            "cam_id": number,
            "rotation_count": 0,
            **_table(camera, OPENCV_MODELS, losses, 4 if camera.lens.fisheye else 5),
        }
        for number, camera in zip(numbers, rig, strict=True)
    }
    return _toml({"cameras": tables})


def _table(camera: Camera, models: Sequence[LensModel], losses: Losses, fewest: int) -> dict[str, Any]:
    """Return the table of a camera, with its lens in one of `models` and at least `fewest` coefficients (fisheye: 4)."""
    lens, _ = express_lens(camera, models, losses)
    distortions = trim_coefficients(lens.distortions, lens.fisheye, 4 if lens.fisheye else fewest)
    return table_of(replace(camera, lens=Lens(lens.size, lens.matrix, distortions, lens.fisheye), sigma=None))


def _toml(content: Mapping[str, Any]) -> Mapping[str, bytes]:
    return {"": tomli_w.dumps(content).encode()}


def _read_anipose(path: Path, given: Given) -> Rig:
    content = read_toml(path, "Anipose's calibration (TOML)")
    _note_unread(content, given)
    metadata = content.get(METADATA, {})
    units = metadata.get("units") if isinstance(metadata, dict) else None
    metres = given.metres_per_unit or METRES_PER_UNIT.get(units if isinstance(units, str) else "")
    found = _camera_tables(content)
    tables = {key: found[key] for key in sorted(found)}
    if metres is None and any("translation" in table for table in tables.values()):
        raise InputError(
            f"{path}: does not state the unit of its lengths, which is that of the calibration board: give it, as in --units mm"
        )
    return _rig(path, tables, given, metres or 1.0)


def _read_pose2sim(path: Path, given: Given) -> Rig:
    content = read_toml(path, "Pose2Sim's calibration (TOML)")
    _note_unread(content, given)
    return _rig(path, _camera_tables(content), given, given.metres_per_unit or 1.0)


def _read_caliscope(path: Path, given: Given) -> Rig:
    content = read_toml(path, "Caliscope's camera_array.toml")
    cameras = content.get("cameras")
    tables = _camera_tables(cameras) if isinstance(cameras, dict) else _camera_tables(content)
    _note_unread(cameras if isinstance(cameras, dict) else content, given)
    if isinstance(cameras, dict):
        given.unread.keys(content, ("cameras",))
    named: dict[str, dict[str, Any]] = {}
    for key, table in tables.items():
        filled = {name: value for name, value in table.items() if value != "null"}
        name = str(filled.get("name", f"cam_{key}" if key.isdecimal() else key))
        if filled.get("matrix") is None or filled.get("distortions") is None:
            given.losses.add(f"camera {name} has no lens yet and is left out")
        else:
            named[key] = {**filled, "name": name}
    return _rig(path, named, given, given.metres_per_unit or 1.0)


def _note_unread(content: Mapping[str, Any], given: Given) -> None:
    """Report the content of a file that is neither a camera's table nor the unit as not read."""
    tables = _camera_tables(content)
    metadata = content.get(METADATA)
    given.unread.keys({key: value for key, value in content.items() if key not in tables}, (METADATA,))
    given.unread.keys(metadata if isinstance(metadata, dict) else {}, ("units", "format_version", "verdict"))
    for table in tables.values():
        given.unread.keys(table, (*CAMERA_KEYS, *NUMBERS))


def _camera_tables(content: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables that may describe a camera: those with at least two of its main keys."""
    wanted = {"matrix", "distortions", "size", "rotation", "translation"}
    return {
        key: table
        for key, table in content.items()
        if key not in OTHER_TABLES and isinstance(table, dict) and len(wanted & table.keys()) > 1
    }


def _rig(path: Path, tables: Mapping[str, dict[str, Any]], given: Given, metres_per_unit: float) -> Rig:
    """Read the cameras of all tables. Raises `FileFaults` with all tables that cannot be a camera."""
    if not tables:
        raise InputError(f"{path}: holds no camera: one table per camera with size, matrix and distortions is needed")
    return gather_rig(
        path, ((f"[{key}]", partial(_camera, key, table, given, metres_per_unit)) for key, table in tables.items())
    )


def _camera(key: str, table: dict[str, Any], given: Given, metres_per_unit: float) -> Camera:
    """Read the camera of a table. Raises `InputError` without the place."""
    flat = dict(table)
    for name in ("distortions", "translation", "rotation"):
        if name in table and not (name == "rotation" and _is_square(table[name])):
            flat[name] = _flatten(table[name])
    if flat.get("size") is None:
        flat["size"] = list(given.size_of("the table"))
    return camera_of(key, flat, metres_per_unit)


def _is_square(value: Any) -> bool:
    """Check whether a rotation is given as three rows of three numbers."""
    return isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) and len(row) == 3 for row in value)


def _flatten(value: Any) -> Any:
    """Flatten nested lists: files have vectors as rows or as columns."""
    if isinstance(value, Iterable) and not isinstance(value, (str, Mapping)):
        return [inner for item in value for inner in (_flatten(item) if isinstance(item, list) else [item])]
    return value


def _recognises_caliscope(sample: FileSample) -> bool:
    cameras = sample.table.get("cameras")
    return sample.suffix == ".toml" and isinstance(cameras, dict) and bool(_camera_tables(cameras))


def _recognises_pose2sim(sample: FileSample) -> bool:
    return _is_rig(sample) and sample.name.startswith("calib") and sample.path.stem.lower() != "calibration"


def _recognises_anipose(sample: FileSample) -> bool:
    return _is_rig(sample) and all(re.fullmatch(r"cam_\d+", key) for key in _camera_tables(sample.table))


def _is_rig(sample: FileSample) -> bool:
    """Check whether a file has tables of cameras, and is not Passerby's own, which states its version."""
    metadata = sample.table.get(METADATA)
    own = isinstance(metadata, dict) and "format_version" in metadata
    return sample.suffix == ".toml" and not own and bool(_camera_tables(sample.table))


_SHARED = "Poses are world to camera (Rodrigues vector and translation), OpenCV's axes, pixels and distortions."

FORMATS: Mapping[str, Format] = {
    "anipose": Format(
        "anipose",
        "Anipose's calibration.toml",
        ("Anipose", "aniposelib"),
        "file",
        (".toml",),
        f"{_SHARED} Tables cam_0, cam_1, ... in the rig's order. Written in metres; a file of Anipose is in the unit of "
        "its board, which --units states. Pinhole of up to 14 coefficients, fisheye.",
        _write_anipose,
        _read_anipose,
        recognises=_recognises_anipose,
    ),
    "pose2sim": Format(
        "pose2sim",
        "Pose2Sim's Calib.toml",
        ("Pose2Sim",),
        "file",
        (".toml",),
        f"{_SHARED} Metres, z up. The file belongs in the folder `calibration`; the order of the cameras is that of the "
        "folders of keypoints. Pinhole of up to 14 coefficients; Pose2Sim has no fisheye model, although its files have the "
        "flag.",
        _write_pose2sim,
        _read_pose2sim,
        recognises=_recognises_pose2sim,
    ),
    "caliscope": Format(
        "caliscope",
        "Caliscope's camera_array.toml",
        ("Caliscope",),
        "file",
        (".toml",),
        f"{_SHARED} Metres. Cameras are numbered as in their names if all are named cam_N, otherwise from 0. Pinhole of up "
        "to 14 coefficients, fisheye; cameras without a pose are kept.",
        _write_caliscope,
        _read_caliscope,
        recognises=_recognises_caliscope,
    ),
}
