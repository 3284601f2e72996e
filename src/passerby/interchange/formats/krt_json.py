"""K, R and t as JSON: `krt-json`, the layouts that research code uses, and `panoptic`, the calibration of CMU Panoptic.

`krt-json` reads one table for each camera, in a mapping by name or in a list, at the top level or under `cameras`: K (3 x 3, or
fx fy cx cy), R (3 x 3, or a rotation vector) and t (or T), or RT (3 x 4), world to camera, `x_c = R X + t`; the distortion
(OpenCV's coefficients) and the image size under the keys that are in common use. Nested lists are flattened. The unit is that
of `unit` or `units`, in the file or in a table; else the user states it. It writes the layout of 4DAssociation, `{"0": {"K": [9
numbers], "R": [9], "T": [3], "RT": [12], "distCoeff": [5], "imgSize": [width, height], "rectifyAlpha": 0}}`, in metres, with
`"unit": "m"` for readers that use it.

VoxelPose's files for Campus and Shelf have fx, fy, cx, cy, k (k1 k2 k3) and p (p1 p2), millimetres; T is the camera's centre:
`x_c = R (X - T)` (its `world_to_camera_frame`). A table with fx, k and p is read so.

`panoptic` is `calibration_SEQUENCE.json` of the panoptic-toolbox (github.com/CMU-Perceptual-Computing-Lab/panoptic-toolbox):
`cameras`, a list of tables with `name`, `type`, `resolution`, `panel`, `node`, `K`, `distCoef` (k1 k2 p1 p2 k3), `R`, `t`,
centimetres. Its world has y down: (x, y, z) becomes (x, z, -y) here.

All have OpenCV's camera axes and pixels.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import RADTAN_5, express_lens
from passerby.interchange.formats.values import load_json, padded, rotation
from passerby.interchange.numbers import gather_rig, rotation_of
from passerby.interchange.opencv_lens import (
    DISTORTION_NAMES,
    LENS_NAMES,
    MATRIX_NAMES,
    find_first_value,
    lens_in,
    numbers_of,
    simplify_keys,
)
from passerby.interchange.rig_toml import METRES_PER_UNIT

Y_DOWN_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
CENTIMETRES, MILLIMETRES = 0.01, 0.001
SAME_RT = 1e-6
"""Largest difference of R and T from those in RT, as a share: files repeat them with all digits."""
NAMES = ("name", "cameraname", "camname", "id")
ROTATION = ("r", "rotation", "rotationmatrix", "rvec", "rot")
TRANSLATION = ("t", "translation", "tvec", "trans")
UNITS = ("unit", "units")
FOCAL = ("fx", "fy", "cx", "cy")
VOXELPOSE = ("fx", "fy", "cx", "cy", "k", "p", "r", "t")
PANOPTIC_ONLY = ("panel", "node")
"""Keys that CMU Panoptic's tables have, and that no other tables have. They repeat the name (`00_03`)."""
READ = frozenset({
    *NAMES, *ROTATION, *TRANSLATION, *UNITS, *FOCAL, *LENS_NAMES, "rt", "p", "rectifyalpha",
})  # fmt: skip


def _write_krt(export: Export, losses: Losses) -> Mapping[str, bytes]:
    tables = {}
    for camera in export.posed(losses):
        assert camera.pose is not None
        lens, _ = express_lens(camera, (RADTAN_5,), losses)
        R, t = camera.pose.R_cw, camera.pose.t_cw
        tables[camera.name] = {
            "K": lens.matrix.ravel().tolist(),
            "R": R.ravel().tolist(),
            "T": t.tolist(),
            "RT": np.column_stack([R, t]).ravel().tolist(),
            "distCoeff": padded(lens.distortions, 5),
            "imgSize": list(lens.size),
            "rectifyAlpha": 0.0,
            "unit": "m",
        }
    return {"": _text(tables)}


def _write_panoptic(export: Export, losses: Losses) -> Mapping[str, bytes]:
    tables = []
    for index, camera in enumerate(export.posed(losses)):
        assert camera.pose is not None
        lens, _ = express_lens(camera, (RADTAN_5,), losses)
        tables.append(
            {
                "name": camera.name,
                "type": "hd",
                "resolution": list(lens.size),
                "panel": 0,
                "node": index,
                "K": lens.matrix.tolist(),
                "distCoef": padded(lens.distortions, 5),
                "R": (camera.pose.R_cw @ Y_DOWN_TO_Z_UP).tolist(),
                "t": [[value / CENTIMETRES] for value in camera.pose.t_cw.tolist()],
            }
        )
    return {"": _text({"cameras": tables})}


def _text(value: Any) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode("ascii")


def read_krt(path: Path, given: Given) -> Rig:
    """Read the cameras in the order of the file. The unit is stated in the file or by the user."""
    content, tables = _tables(path, given)
    if any(key in table for _, table in tables for key in PANOPTIC_ONLY):
        raise InputError(f"{path}: is a calibration of CMU Panoptic, in centimetres: import it with --format panoptic")
    stated = find_first_value(content, UNITS) if isinstance(content, dict) else None
    return _gather_rig(path, tables, partial(_read_krt_camera, path, stated, given))


def read_panoptic(path: Path, given: Given, kinds: tuple[str, ...] | None = None) -> Rig:
    """Read the cameras of CMU Panoptic into a world with z up; only those of `kinds` (vga, hd, kinect-color), if not None."""
    _, tables = _tables(path, given)
    if kinds is not None:
        tables = [(name, table) for name, table in tables if table.get("type") in kinds]
        if not tables:
            raise InputError(f"{path}: no camera is of the type {' or '.join(kinds)}: take the file from the set again")
    return _gather_rig(path, tables, partial(_panoptic_camera, path, given))


def _gather_rig(path: Path, tables: list[tuple[str, dict[str, Any]]], camera: Callable[..., Camera]) -> Rig:
    """Gather the rig of the cameras that the function `camera` makes from names and tables. Raises `FileFaults` by camera."""

    def read(name: str, table: dict[str, Any]) -> Camera:
        try:
            return camera(name, table)
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{path}: ")) from None

    return gather_rig(path, ((f"camera {shortened_text(name)}", partial(read, name, table)) for name, table in tables))


def camera_tables(content: Any) -> Iterator[tuple[str, Any]]:
    """Generate candidates for the cameras' tables, with names: in a mapping or a list, at the top level or under `cameras`."""
    inner = content.get("cameras") if isinstance(content, dict) and "cameras" in content else content
    if isinstance(inner, dict):
        yield from ((str(key), value) for key, value in inner.items())
    elif isinstance(inner, list):
        yield from ((str(index), value) for index, value in enumerate(inner))


def is_krt(table: Any) -> bool:
    """Check whether a table (with simplified keys) has a camera matrix, a rotation and a translation."""
    if not isinstance(table, dict):
        return False
    matrix = find_first_value(table, MATRIX_NAMES) is not None or all(key in table for key in FOCAL)
    pose = find_first_value(table, ROTATION) is not None and find_first_value(table, TRANSLATION) is not None
    return matrix and (pose or table.get("rt") is not None)


def simplify_tables(content: Any) -> list[tuple[str, Any]]:
    """Return candidates for the cameras' tables by name, their keys in lower case without `_`, `-` and spaces."""
    return [(name, simplify_keys(value, 4)) for name, value in camera_tables(content)]


def _tables(path: Path, given: Given) -> tuple[Any, list[tuple[str, dict[str, Any]]]]:
    """Read the content of a file, and its cameras' tables. Other content is reported as not read. Raises `InputError`."""
    content = load_json(path, "cameras' K, R and t")
    found = simplify_tables(content)
    tables = []
    for name, value in found:
        if isinstance(value, dict) and (
            find_first_value(value, MATRIX_NAMES) is not None or all(key in value for key in FOCAL)
        ):
            named = find_first_value(value, NAMES)
            title = str(named) if isinstance(named, (str, int)) and str(named) else name
            tables.append((title, value))
        elif name not in UNITS:
            given.unread.add(shortened_text(name))
    if isinstance(content, dict) and "cameras" in content:
        given.unread.keys(content, ("cameras", *UNITS))
    if not tables:
        raise InputError(f"{path}: holds no camera: a table per camera with K, R and t is needed: is it another kind of file?")
    return content, tables


def _read_krt_camera(path: Path, stated: Any, given: Given, name: str, table: dict[str, Any]) -> Camera:
    """Read one camera. Raises `InputError` without the place."""
    given.unread.keys(table, READ)
    voxelpose = all(key in table for key in VOXELPOSE)
    lens = _lens(path, name, table, given)
    R, t = _rotation_and_translation(path, table)
    if R is None or t is None:
        return Camera(name, lens)
    unit = find_first_value(table, UNITS) or stated
    if unit is not None and (not isinstance(unit, str) or unit not in METRES_PER_UNIT):
        raise InputError(f"unit is {shortened(unit)}: write one of {', '.join(METRES_PER_UNIT)}")
    metres = given.metres_per_unit or (METRES_PER_UNIT[unit] if unit else MILLIMETRES if voxelpose else None)
    if metres is None:
        raise InputError("does not state the unit of its translation: give it, as in --units mm")
    return Camera(name, lens, Pose.from_centre(R, metres * t) if voxelpose else Pose(R, metres * t))


def _panoptic_camera(path: Path, given: Given, name: str, table: dict[str, Any]) -> Camera:
    """Read one camera of CMU Panoptic. Raises `InputError` without the place."""
    given.unread.keys(table, {*READ, *PANOPTIC_ONLY, "type"})
    if not isinstance(table.get("name"), str) or not table["name"].strip():
        raise InputError(f"name is {shortened(table.get('name'))}: a text is needed; take the file from the set again")
    lens = _lens(path, name, table, given)
    R, t = _rotation_and_translation(path, table)
    if R is None or t is None:
        raise InputError("has no R and t: take the file from the set again")
    return Camera(name, lens, Pose(R @ Y_DOWN_TO_Z_UP.T, (given.metres_per_unit or CENTIMETRES) * t))


def _lens(path: Path, name: str, table: dict[str, Any], given: Given) -> Lens:
    """Read the lens. If the file states no distortion, none is assumed, which is reported."""
    values = dict(table)
    if find_first_value(values, MATRIX_NAMES) is None or all(key in values for key in FOCAL):
        fx, fy, cx, cy = (float(_numbers(path, key, values.get(key), 1)[0]) for key in FOCAL)
        radial, tangential = (values.pop(key, None) for key in ("k", "p"))
        values["matrix"] = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
        if radial is not None and tangential is not None:
            k = _numbers(path, "k", radial, 3)
            values["distortion"] = [k[0], k[1], *_numbers(path, "p", tangential, 2), k[2]]
    if find_first_value(values, DISTORTION_NAMES) is None:
        given.unread.add(f"camera {shortened_text(name)} states no distortion: none is assumed")
        values["distortion"] = [0.0] * 4
    values |= {key: str(value) for key, value in values.items() if key == "model"}
    stored = lens_in(path, values)
    assert stored is not None
    return stored.lens(stored.size or given.size_of("the camera"))


def _rotation_and_translation(path: Path, table: dict[str, Any]) -> tuple[Floats | None, Floats | None]:
    """Read rotation (3, 3) and translation (3,) in the file's unit; both None if the table has neither. Raises `InputError`."""
    turned, moved = find_first_value(table, ROTATION), find_first_value(table, TRANSLATION)
    both = None if table.get("rt") is None else _numbers(path, "RT", table["rt"], 12).reshape(3, 4)
    if both is not None:
        turned, moved = both[:, :3].tolist() if turned is None else turned, both[:, 3].tolist() if moved is None else moved
    if turned is None and moved is None:
        return None, None
    if turned is None or moved is None:
        raise InputError(f"has no {'R' if turned is None else 't'}: give R and t, or neither for a camera without a pose")
    t, R = _numbers(path, "t", moved, 3), numbers_of(path, "R", turned)
    if R.size not in (3, 9):
        raise InputError(f"R has {R.size} numbers: a 3 x 3 rotation, or a rotation vector, is needed")
    R = rotation("R", R.reshape(3, 3)) if R.size == 9 else rotation_of(R, "R: ")
    if both is not None and np.abs(np.column_stack([R, t]) - both).max() > 1e-3 + SAME_RT * np.abs(both).max():
        raise InputError("R and T are not those in RT: delete what is wrong")
    return R, t


def _numbers(path: Path, key: str, value: Any, count: int) -> Floats:
    """Return finite numbers (count,) of a list, nested or not. Raises `InputError`."""
    found = np.zeros(0) if value is None else numbers_of(path, key, value)
    if found.size != count:
        raise InputError(f"{key} is {shortened(value)}: {count} number{'s are' if count > 1 else ' is'} needed")
    return found


def _recognises_krt(sample: FileSample) -> bool:
    tables = _find_krt_tables(sample)
    return bool(tables) and not any(key in table for table in tables for key in PANOPTIC_ONLY)


def _recognises_panoptic(sample: FileSample) -> bool:
    return any(key in table for table in _find_krt_tables(sample) for key in PANOPTIC_ONLY)


def _find_krt_tables(sample: FileSample) -> list[dict[str, Any]]:
    """Return the tables of cameras with K, R and t in a JSON file."""
    return [table for _, table in simplify_tables(sample.content) if is_krt(table)] if sample.suffix == ".json" else []


FORMATS: Mapping[str, Format] = {
    "krt-json": Format(
        name="krt-json",
        title="K, R and t of each camera as JSON",
        tools=("4DAssociation", "VoxelPose", "research code"),
        target="file",
        suffixes=(".json",),
        conventions=(
            "World to camera, x_c = R X + t, OpenCV's axes and pixels. Reads a table per camera, by name or in a list, with "
            "K, R and t (or T, or RT), OpenCV's distortion and the image size under the usual names; the unit is that of "
            "`unit` in the file, or of --units. VoxelPose's files (fx, fy, cx, cy, k, p; T is the camera's centre) are "
            "millimetres. Writes 4DAssociation's layout with `unit` m; pinhole with k1 k2 p1 p2 k3."
        ),
        write=_write_krt,
        read=read_krt,
        recognises=_recognises_krt,
    ),
    "panoptic": Format(
        name="panoptic",
        title="CMU Panoptic's calibration_SEQUENCE.json",
        tools=("CMU Panoptic", "panoptic-toolbox", "MMPose"),
        target="file",
        suffixes=(".json",),
        conventions=(
            "World to camera (3 x 3 and translation), OpenCV's axes and pixels, centimetres. The world has y down there and z"
            " up here: (x, y, z) becomes (x, z, -y). Pinhole with k1 k2 p1 p2 k3. All types of cameras are read; cameras are "
            "written as type hd, panel 0."
        ),
        write=_write_panoptic,
        read=read_panoptic,
        recognises=_recognises_panoptic,
    ),
}
