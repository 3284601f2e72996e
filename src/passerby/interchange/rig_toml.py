"""Rigs as TOML: the tables of Anipose, Caliscope and Pose2Sim, so that those tools open a Passerby rig unchanged.

One table a camera: `name`, `size` [width, height], `matrix`, `distortions`, `rotation` (Rodrigues vector, world to camera),
`translation` (metres), `fisheye`. `[metadata]` holds `format_version`, `units` and the `verdict`. Keys and tables of other
tools are ignored.
Passerby's own extra keys are `position_sigma_mm`, `orientation_sigma_deg` and `covariance` (6 x 6: centre in metres, world;
then rotation vector in radians, camera frame), `complete_covariance` (10 x 10: the same six, the logarithm of the focal length,
the principal point in pixels and the first distortion coefficient), `points_sigma_mm` and `ground_sigma_mm` (of points and of
ground positions that the rig measures where people walked), `focal_sd_percent` (one standard deviation of a guessed focal
length), `uncalibrated` (the lens is unknown: its matrix is a placeholder, to be estimated), and `rotate` (degrees clockwise by
which the camera's images are to be turned so that people stand upright; all numbers are of the images as filmed). A sigma
that is infinite, because no evidence constrains the pose, is left out.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import list_names, shortened
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.lens import INTRINSICS, LARGEST_FOCAL_SD, QUARTER_TURNS
from passerby.geometry.rotations import log_rotation
from passerby.interchange.numbers import NotNumbers, finite_numbers, gather_rig, rotation_of
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import leaves, read_toml
from passerby.interchange.storage.text_formats import check_version

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001}
METADATA = "metadata"
RIG_FORMAT = 1
"""Version of the tables, written under `[metadata]`; files without a version are of the first."""
RIG = "a rig file (TOML)"
FOCAL_SD = "focal_sd_percent"
UNCALIBRATED = "uncalibrated"
ROTATE = "rotate"
COMPLETE = "complete_covariance"
POINTS_SIGMA, GROUND_SIGMA = "points_sigma_mm", "ground_sigma_mm"
SIGMA_KEYS = ("position_sigma_mm", "orientation_sigma_deg", POINTS_SIGMA, GROUND_SIGMA, "covariance", COMPLETE)
"""Keys of a camera's uncertainty, which a calibration writes."""
ROUNDING, LARGEST_VARIANCE = 1e-3, 1e12
"""Limits of a stated covariance: its rounding errors, as a share after scaling by the variances (other tools round to a few
digits), and its largest number."""
CAMERA_KEYS = frozenset({
    "name", "size", "matrix", "distortions", "rotation", "translation", "fisheye", *SIGMA_KEYS, FOCAL_SD, UNCALIBRATED,
})  # fmt: skip
"""Keys of a camera's table that are read."""
UNFILLED = ("FX", "FY", "CX", "CY")
"""Placeholders that `passerby init` writes for unknown numbers of a matrix."""


def read_rig(path: str | Path) -> Rig:
    """Read the cameras of a rig file, in the order of the file. A camera without rotation and translation has no pose.

    Raises `FileFaults` (an `InputError`) that names file, table, key, value and fix for each table that cannot be a camera.
    """
    content = read_toml(path, RIG)
    metadata = _metadata(content)
    check_version(path, metadata, "format_version", RIG_FORMAT, f"[{METADATA}] ")
    metres = _metres_per_unit(Path(path), metadata)
    tables = _camera_tables(Path(path), content)
    texts = {key: value for key, value in metadata.items() if isinstance(value, str) and key not in ("units", "verdict")}
    verdict = metadata.get("verdict")
    cameras = ((f"[{key}]", partial(camera_of, key, table, metres)) for key, table in tables.items())
    return gather_rig(path, cameras, verdict if isinstance(verdict, str) else None, texts)


def read_lens(path: str | Path, camera: str) -> Lens:
    """Read size, matrix and distortions of one camera: the table `[camera]`, or else the table whose `name` is `camera`.

    Caliscope's tables are numbered and are in `[cameras]`; `[cameras.0]` is also camera `cam_0`, as Caliscope names its videos.
    Poses and all other tables are ignored. Raises `InputError` where there is no such table or it cannot be a lens.
    """
    content = read_toml(path, RIG)
    check_version(path, _metadata(content), "format_version", RIG_FORMAT, f"[{METADATA}] ")
    tables = _camera_tables(Path(path), content)
    called = {key: names_of_table(key, table) for key, table in tables.items()}
    key = min(
        (key for key, names in called.items() if camera in names), key=lambda key: called[key].index(camera), default=None
    )
    if key is None:
        raise InputError(
            f"{path}: no table [{camera}]: camera {camera} needs one with size, matrix and distortions "
            f"(the file has {list_names(list(tables))})"
        )
    try:
        return _lens(tables[key])
    except InputError as error:
        raise InputError(f"{path}: [{key}]: {error}") from None


def write_rig(path: str | Path, rig: Rig) -> None:
    """Write a rig, as a whole or not at all. Raises `InputError` where `path` is not writable."""
    content: dict[str, Any] = {}
    for camera in rig:
        if camera.name == METADATA:
            raise InputError(f"{path}: a camera cannot be called {METADATA} in a rig file: rename it")
        content[camera.name] = table_of(camera)
    verdict = {} if rig.verdict is None else {"verdict": rig.verdict}
    content[METADATA] = {"format_version": RIG_FORMAT, "units": "m", **verdict, **rig.metadata}
    write_text(path, tomli_w.dumps(content))


def _metadata(content: dict[str, Any]) -> dict[str, Any]:
    """Return the table `[metadata]` of a file; empty if there is none."""
    metadata = content.get(METADATA, {})
    return metadata if isinstance(metadata, dict) else {}


def names_of_table(key: str, table: dict[str, Any]) -> tuple[str, ...]:
    """Return the names of a camera's table: its key, its `name` and, if the key is a number, Caliscope's name of that video."""
    names = [key, str(table.get("name", key)), *([f"cam_{key}"] if key.isdecimal() else [])]
    return tuple(dict.fromkeys(names))


def tables_of_cameras(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables with a matrix or distortions, which describe a camera: of the file, else of Caliscope's `[cameras]`."""
    for tables in (content, content.get("cameras")):
        found = {
            key: table
            for key, table in (tables.items() if isinstance(tables, dict) else ())
            if key != METADATA and isinstance(table, dict) and {"matrix", "distortions"} & table.keys()
        }
        if found:
            return found
    return {}


def _camera_tables(path: Path, content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables that describe a camera. Raises `InputError` where there are none."""
    tables = tables_of_cameras(content)
    if not tables:
        raise InputError(f"{path}: holds no camera: one table per camera with size, matrix and distortions is needed")
    return tables


def _metres_per_unit(path: Path, metadata: dict[str, Any]) -> float:
    units = metadata.get("units", "m")
    if not isinstance(units, str) or units not in METRES_PER_UNIT:
        raise InputError(f"{path}: [{METADATA}] units is {shortened(units)}: write one of {', '.join(METRES_PER_UNIT)}")
    return METRES_PER_UNIT[units]


def camera_of(key: str, table: dict[str, Any], metres_per_unit: float = 1.0) -> Camera:
    """Read a camera from its table. Its name is `key` if the table has none. Raises `InputError` without the place."""
    name = table.get("name", key)
    if not isinstance(name, (str, int)) or name == "":
        raise InputError(f"name is {shortened(name)}: give the camera's name in quotes")
    return Camera(str(name), _lens(table), _pose(table, metres_per_unit), _sigma(table))


def _lens(table: dict[str, Any]) -> Lens:
    size = _numbers(table, "size", (2,), "[width, height] in pixels")
    unfilled = [text for text in leaves(table.get("matrix")) if text in UNFILLED]
    if unfilled:
        raise InputError(
            f"matrix still says {' and '.join(unfilled)}: put the lens's numbers there, as the file states at its top"
        )
    matrix = _numbers(table, "matrix", (3, 3), "three rows of three numbers")
    fisheye = table.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise InputError(f"fisheye is {shortened(fisheye)}: write true or false")
    if (size != np.floor(size)).any():
        raise InputError(f"size is {size.tolist()}: whole numbers of pixels are needed")
    distortions = _numbers(table, "distortions", (-1,), "a list of OpenCV's coefficients")
    uncalibrated = table.get(UNCALIBRATED, False)
    if not isinstance(uncalibrated, bool):
        raise InputError(f"{UNCALIBRATED} is {shortened(uncalibrated)}: write true or false")
    focal_sd = _focal_sd(table)
    if uncalibrated and focal_sd is None:
        focal_sd = LARGEST_FOCAL_SD
    rotate = table.get(ROTATE, 0)
    if isinstance(rotate, bool) or rotate not in QUARTER_TURNS:
        raise InputError(f"{ROTATE} is {shortened(rotate)}: write 90, 180 or 270 (degrees clockwise), or delete it")
    return Lens((int(size[0]), int(size[1])), matrix, distortions, fisheye, focal_sd, uncalibrated, rotate=int(rotate))


def _focal_sd(table: dict[str, Any]) -> float | None:
    """Return the stated standard deviation of the focal length as a share of it; None if it is not stated."""
    if FOCAL_SD not in table:
        return None
    percent = float(_numbers(table, FOCAL_SD, (), "one number, per cent of the focal length"))
    if not 0 < percent <= 100 * LARGEST_FOCAL_SD:
        raise InputError(
            f"{FOCAL_SD} is {percent:g}: give a number above 0, up to {100 * LARGEST_FOCAL_SD:g}, or delete it for a lens that "
            "was calibrated"
        )
    return percent / 100


def _pose(table: dict[str, Any], metres: float) -> Pose | None:
    present = [key for key in ("rotation", "translation") if table.get(key) not in (None, [])]
    if not present:
        return None
    if len(present) == 1:
        missing = "translation" if present == ["rotation"] else "rotation"
        raise InputError(f"has a {present[0]} but no {missing}: give both, or neither for a camera without a pose")
    translation = _numbers(table, "translation", (3,), "three numbers")
    if isinstance(table["rotation"], list) and any(isinstance(row, list) for row in table["rotation"]):
        return Pose(_rotation(_numbers(table, "rotation", (3, 3), "a Rodrigues vector")), metres * translation)
    vector = _numbers(table, "rotation", (3,), "a Rodrigues vector of three numbers")
    return Pose(rotation_of(vector), metres * translation)


def _rotation(matrix: Floats) -> Floats:
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) or np.linalg.det(matrix) < 0:
        raise InputError(f"rotation {matrix.tolist()} is not a rotation: give its Rodrigues vector")
    return matrix


def _sigma(table: dict[str, Any]) -> PoseSigma | None:
    """Return the stated sigmas. One that is missing is infinite, and there is no covariance then; None if both are missing."""
    stated = [key for key in ("position_sigma_mm", "orientation_sigma_deg") if key in table]
    if not stated:
        return None
    position, orientation = (
        _numbers(table, key, (), "one number") if key in stated else np.inf
        for key in ("position_sigma_mm", "orientation_sigma_deg")
    )
    for key in stated:
        if table[key] < 0:
            raise InputError(f"{key} is {table[key]:g}: give a number from 0 on, or delete it")
    whole = len(stated) == 2
    covariance = _covariance(table, "covariance", 6) if "covariance" in table else None
    complete = _covariance(table, COMPLETE, 6 + INTRINSICS) if COMPLETE in table else None
    points, ground = (_metres(table, key) for key in (POINTS_SIGMA, GROUND_SIGMA))
    return PoseSigma(
        float(position) / 1000, float(orientation), covariance if whole else None, complete if whole else None, points, ground
    )


def _metres(table: dict[str, Any], key: str) -> float | None:
    """Convert a stated sigma from millimetres to metres; None if it is not stated."""
    if key not in table:
        return None
    millimetres = float(_numbers(table, key, (), "one number"))
    if millimetres < 0:
        raise InputError(f"{key} is {millimetres:g}: give a number from 0 on, or delete it")
    return millimetres / 1000


def _covariance(table: dict[str, Any], key: str, size: int) -> Floats:
    """Return a stated covariance (size, size). Raises `InputError` unless it is symmetric and positive up to rounding."""
    found = _numbers(table, key, (size, size), f"{size} rows of {size} numbers")
    most = float(np.abs(found[:6, :6]).max())
    if most > LARGEST_VARIANCE:
        raise InputError(f"{key} has a value of {most:g}: delete it, or restore the file")
    unit = (
        1.0 / np.sqrt(np.maximum(np.abs(np.diag(found)), 1e-30)) if size > 6 else np.full(size, 1.0 / np.sqrt(max(most, 1e-30)))
    )
    scaled = found * unit[:, None] * unit  # units differ (pixels, metres): each number has its own rounding error
    skew = float(np.abs(scaled - scaled.T).max())
    if skew > ROUNDING:
        raise InputError(f"{key} is not symmetric (by {skew * most:g}): delete it, or restore the file")
    least = float(np.linalg.eigvalsh(scaled)[0])
    if least < -ROUNDING:
        raise InputError(f"{key} has a negative variance ({least * most:g}): delete it, or restore the file")
    return found


def _numbers(table: dict[str, Any], key: str, shape: tuple[int, ...], meaning: str) -> Floats:
    """Return the finite numbers under `key` as an array of a shape; (-1,) takes a list of any length."""
    if key not in table:
        raise InputError(f"{key} is missing: give {meaning}")
    value = table[key]
    try:
        return finite_numbers(value, shape, nested=True)
    except NotNumbers as fault:
        wanted = "its numbers must be finite" if fault.infinite else f"give {meaning}"
        raise InputError(f"{key} is {shortened(value)}: {wanted}") from None


def table_of(camera: Camera) -> dict[str, Any]:
    """Convert a camera to a table, without rotation and translation if it has no pose."""
    lens = camera.lens
    # Other tools require coefficients. Zeros describe the same lens as no coefficients.
    distortions = lens.distortions if lens.distortions.size else np.zeros(4 if lens.fisheye else 5)
    table: dict[str, Any] = {
        "name": camera.name,
        "size": list(lens.size),
        "matrix": lens.matrix.tolist(),
        "distortions": distortions.tolist(),
    }
    if camera.pose is not None:
        table["rotation"] = log_rotation(camera.pose.R_cw).tolist()
        table["translation"] = camera.pose.t_cw.tolist()
    table["fisheye"] = lens.fisheye
    if lens.focal_sd is not None:
        table[FOCAL_SD] = 100 * lens.focal_sd
    if lens.uncalibrated:
        table[UNCALIBRATED] = True
    if lens.rotate:
        table[ROTATE] = lens.rotate
    if camera.sigma is not None:
        if np.isfinite(camera.sigma.position_m):
            table["position_sigma_mm"] = 1000 * camera.sigma.position_m
        if np.isfinite(camera.sigma.orientation_deg):
            table["orientation_sigma_deg"] = camera.sigma.orientation_deg
        if camera.sigma.covariance is not None and np.isfinite(camera.sigma.covariance).all():
            table["covariance"] = np.asarray(camera.sigma.covariance).tolist()
        if camera.sigma.complete is not None and np.isfinite(camera.sigma.complete).all():
            table[COMPLETE] = np.asarray(camera.sigma.complete).tolist()
        for key, metres in ((POINTS_SIGMA, camera.sigma.points_m), (GROUND_SIGMA, camera.sigma.ground_m)):
            if metres is not None:
                table[key] = 1000 * metres
    return table
