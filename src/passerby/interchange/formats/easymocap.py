"""EasyMocap: `intri.yml` and `extri.yml` in one folder, OpenCV's FileStorage (YAML 1.0).

`names` lists the cameras. For each NAME, `intri.yml` has `K_NAME` (3 x 3, pixels), `dist_NAME` (1 x 5: k1 k2 p1 p2 k3 of
OpenCV's pinhole), `H_NAME` and `W_NAME` (picture size; older files have none); `extri.yml` has `R_NAME` (rotation vector,
3 x 1), `Rot_NAME` (the same as a matrix) and `T_NAME` (3 x 1): world to camera, `x_c = R X + T`, OpenCV's axes (x right,
y down, z forward), metres. Pixels are OpenCV's: 0 is the centre of the first one. EasyMocap's world has z up, as here.

Source: `read_camera` and `write_camera` in easymocap/mytools/camera_utils.py (github.com/zju3dv/EasyMocap). EasyMocap
projects with `K` and undistorts with `dist` by OpenCV's pinhole; its files cannot hold a fisheye.

A NAME is part of keys and of the names of EasyMocap's folders: it has ASCII letters, digits, `_` and `-` here. If names have
to change, the list `passerby_names` in `intri.yml`, which EasyMocap ignores, keeps the true ones.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import natural_key, shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.geometry.rotations import log_rotation
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import RADTAN_5, express_lens
from passerby.interchange.formats.values import (
    load_yaml,
    matrix_data,
    numbers,
    padded,
    rotation,
    table,
    tame_names,
)
from passerby.interchange.numbers import rotation_of
from passerby.interchange.storage.safe_parsing import NotParsed, parse_json

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"
NAMES, TRUE_NAMES = "names", "passerby_names"
LENS, POSE = ("K", "dist", "D", "H", "W"), ("R", "Rot", "T")
"""Prefixes of a camera's keys, before its name."""
HEAD = "%YAML:1.0\n---\n"
"""A first line that all versions of OpenCV read; OpenCV 5 itself writes %YAML 1.2."""
FORBIDDEN = re.compile(r"[^A-Za-z0-9_-]")


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write `intri.yml` and `extri.yml`."""
    rig = export.posed(losses)
    lenses = {camera.name: express_lens(camera, (RADTAN_5,), losses)[0] for camera in rig}
    names = tame_names(rig.names, FORBIDDEN)
    # With quotes, which OpenCV's own writer omits: its reader would take a name such as 1e5 for a number.
    head = f"{HEAD}{NAMES}:\n" + "".join(f'  - "{name}"\n' for name in names.values())
    intrinsics, extrinsics = [head], [head]
    if any(name != tame for name, tame in names.items()):
        intrinsics.append(f"{TRUE_NAMES}: {json.dumps(json.dumps(list(names)))}\n")
    for camera in rig:
        assert camera.pose is not None
        name, lens = names[camera.name], lenses[camera.name]
        intrinsics += [
            _matrix_text(f"K_{name}", lens.matrix),
            _matrix_text(f"dist_{name}", np.array([padded(lens.distortions, 5)])),
            f"H_{name}: {lens.size[1]}\n",
            f"W_{name}: {lens.size[0]}\n",
        ]
        extrinsics += [
            _matrix_text(f"R_{name}", log_rotation(camera.pose.R_cw)[:, None]),
            _matrix_text(f"Rot_{name}", camera.pose.R_cw),
            _matrix_text(f"T_{name}", camera.pose.t_cw[:, None]),
        ]
    return {INTRINSICS: "".join(intrinsics).encode(), EXTRINSICS: "".join(extrinsics).encode()}


def _matrix_text(key: str, values: Floats) -> str:
    """Format a matrix as OpenCV's YAML, with all digits."""
    data = ", ".join(map(repr, values.ravel().tolist()))
    return f"{key}: !!opencv-matrix\n  rows: {values.shape[0]}\n  cols: {values.shape[1]}\n  dt: d\n  data: [ {data} ]\n"


def read(path: Path, given: Given) -> Rig:
    """Read the cameras of `intri.yml`, with the poses in `extri.yml` beside it. The path is `intri.yml` or its folder."""
    intrinsics = path / INTRINSICS if path.is_dir() else path
    values = _content(intrinsics)
    listed = values.get(NAMES)
    # Numbers are read as texts, as in EasyMocap.
    names = [str(name) for name in listed if isinstance(name, (str, int))] if isinstance(listed, list) else []
    if not names:
        raise InputError(f"{intrinsics}: has no list `names`: is it another kind of file?")
    extrinsics = intrinsics.with_name(EXTRINSICS)
    poses = _content(extrinsics) if extrinsics.is_file() else {}
    given.unread.keys(values, (NAMES, TRUE_NAMES, *(f"{key}_{name}" for key in LENS for name in names)))
    given.unread.keys(poses, (NAMES, *(f"{key}_{name}" for key in POSE for name in names)))
    cameras = []
    for name, true_name in zip(names, _read_true_names(values.get(TRUE_NAMES), names), strict=True):
        lens = _lens(f"{intrinsics}: camera {name}", values, name, given)
        cameras.append(
            Camera(true_name, lens, _pose(f"{extrinsics}: camera {name}", poses, name, given.metres_per_unit or 1.0))
        )
    _check_names(extrinsics, poses, names)
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{intrinsics}: {error}") from None


def _check_names(path: Path, poses: dict[Any, Any], names: list[str]) -> None:
    """Raise `InputError` for poses of cameras that are not in `intri.yml`: they would be lost."""
    keys = (str(key).partition("_") for key, value in poses.items() if isinstance(value, dict))
    others = sorted({name for key, _, name in keys if key in POSE and name not in names}, key=natural_key)
    if others:
        raise InputError(
            f"{path}: has poses of cameras {shortened_text(', '.join(others))}, but {INTRINSICS} has cameras "
            f"{shortened_text(', '.join(names))}: give each camera the same name in both files"
        )


def _content(path: Path) -> dict[Any, Any]:
    """Read a file's values as YAML, not by OpenCV: `FileNode.mat` of OpenCV 5.0 writes beyond a matrix that lacks `cols`."""
    return table(str(path), load_yaml(path, "EasyMocap's calibration"), "table of OpenCV's matrices")


def _read_true_names(told: Any, names: list[str]) -> list[str]:
    """Return the cameras' true names; `names` if the file does not state them."""
    try:
        found = parse_json(told) if isinstance(told, str) else None
    except NotParsed:
        return names
    if isinstance(found, list) and len(found) == len(names) and all(isinstance(name, str) and name for name in found):
        return found
    return names


def _lens(place: str, values: dict[Any, Any], name: str, given: Given) -> Lens:
    """Read a camera's lens. In older files, the key of the distortion is `D_NAME`, or there is none."""
    matrix = _matrix(place, values, f"K_{name}", (3, 3))
    if matrix is None:
        raise InputError(f"{place}: K_{name} is missing: a 3 x 3 camera matrix is needed")
    found = (_matrix(place, values, f"{key}_{name}", (-1,)) for key in ("dist", "D"))
    distortions = next((coefficients for coefficients in found if coefficients is not None), np.zeros(5))
    sized = all(isinstance(values.get(f"{side}_{name}"), int) and values[f"{side}_{name}"] > 0 for side in "WH")
    size = (values[f"W_{name}"], values[f"H_{name}"]) if sized else given.size_of(place)
    try:
        return Lens(size, matrix, distortions)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _pose(place: str, values: dict[Any, Any], name: str, metres: float) -> Pose | None:
    """Read a camera's pose; None if the file has none. As in EasyMocap, the rotation vector has priority over the matrix."""
    vector, matrix = _matrix(place, values, f"R_{name}", (3,)), _matrix(place, values, f"Rot_{name}", (3, 3))
    translation = _matrix(place, values, f"T_{name}", (3,))
    if vector is None and matrix is None and translation is None:
        return None
    if translation is None or (vector is None and matrix is None):
        raise InputError(f"{place}: R_{name} or T_{name} is missing: give both, or neither for a camera without a pose")
    R = rotation_of(vector, f"{place}: R_{name}: ") if vector is not None else rotation(place, np.asarray(matrix))
    return Pose(R, metres * translation)


def _matrix(place: str, values: dict[Any, Any], key: str, shape: tuple[int, ...]) -> Floats | None:
    """Read the numbers of a matrix; None if there is none. Raises `InputError` if they do not fit `shape`."""
    return None if values.get(key) is None else numbers(place, {key: matrix_data(values, key)}, key, shape)


def _recognises(sample: FileSample) -> bool:
    table = sample.table
    return sample.suffix in (".yml", ".yaml") and NAMES in table and any(str(key).startswith("K_") for key in table)


FORMAT = Format(
    name="easymocap",
    title="EasyMocap's intri.yml and extri.yml",
    tools=("EasyMocap",),
    target="folder",
    conventions="World to camera (rotation vector and translation), OpenCV's axes and pixels, metres; pinhole with k1 k2 p1 p2 "
    "k3.",
    write=write,
    read=read,
    recognises=_recognises,
)
