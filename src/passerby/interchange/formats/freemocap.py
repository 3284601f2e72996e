"""FreeMoCap's camera calibration TOML: Anipose's format with the cameras' positions in the world added.

Each table has `name`, `size` [width, height], `matrix`, `distortions` (OpenCV's; a fisheye where `fisheye` is true),
`rotation` (Rodrigues vector) and `translation`: world to camera, `x_c = R X + t`, OpenCV's axes (x right, y down, z forward)
and pixels; and `world_orientation` (3 x 3) and `world_position`: camera to world, the camera's axes and centre in the world.
Lengths are millimetres: FreeMoCap takes the unit of `charuco_square_size` in `[metadata]`, and asks for millimetres.
`groundplane_calibration` there states whether z is up from the floor; if not, the world is the first camera's frame.

Source: freemocap 1.8.2, core_processes/capture_volume_calibration/anipose_camera_calibration/: `Camera`, `FisheyeCamera` and
`CameraGroup` in freemocap_anipose.py, `get_real_world_matrices` in anipose_camera_calibrator.py. By the same source, FreeMoCap
assigns the tables, in the alphabetical order of their keys, to the videos, in the alphabetical order of their names; the names
of the cameras have no effect. Therefore cameras are written in the order of their names in lower case, as `cam_0` to `cam_9`,
or `cam_00` to `cam_99` if there are more than ten.

The unit of a file in which the board's square has length 1 is unknown: the user states it with `--units`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Lens, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import FISHEYE, RATIONAL_8, TILTED_14, express_lens
from passerby.interchange.formats.values import padded
from passerby.interchange.numbers import gather_rig
from passerby.interchange.rig_toml import CAMERA_KEYS, METADATA, METRES_PER_UNIT, camera_of, table_of
from passerby.interchange.storage.safe_parsing import read_toml

MILLIMETRES = 1000.0
SAME_AGAIN = ("world_orientation", "world_position")
"""Keys of a camera that repeat its pose, from camera to world."""
READ_METADATA = ("units", "charuco_square_size", "groundplane_calibration")
LEAST_COEFFICIENTS = 5
"""Least number of coefficients that are written: FreeMoCap's own pinholes have five."""


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as a FreeMoCap calibration file."""
    cameras = sorted(export.posed(losses), key=lambda camera: (camera.name.lower(), camera.name))
    digits = len(str(len(cameras) - 1))
    content: dict[str, Any] = {f"cam_{index:0{digits}d}": _table(camera, losses) for index, camera in enumerate(cameras)}
    content[METADATA] = {"groundplane_calibration": True, "units": "mm"}
    return {"": tomli_w.dumps(content).encode("utf-8")}


def _table(camera: Camera, losses: Losses) -> dict[str, Any]:
    """Return the table of a camera."""
    assert camera.pose is not None
    lens, _ = express_lens(camera, (RATIONAL_8, TILTED_14, FISHEYE), losses)
    if not lens.fisheye:
        coefficients = padded(lens.distortions, max(LEAST_COEFFICIENTS, lens.distortions.size))
        lens = Lens(lens.size, lens.matrix, np.array(coefficients))
    table = table_of(replace(camera, lens=lens, sigma=None))
    table["translation"] = (MILLIMETRES * camera.pose.t_cw).tolist()
    table["world_orientation"] = camera.pose.R_cw.T.tolist()
    table["world_position"] = (MILLIMETRES * camera.pose.centre).tolist()
    return table


def read(path: Path, given: Given) -> Rig:
    """Read the cameras in FreeMoCap's order, the alphabetical order of their keys."""
    content = read_toml(path, "a calibration of FreeMoCap (TOML)")
    tables = {key: content[key] for key in sorted(content) if key != METADATA}
    if not tables or not all(isinstance(table, dict) and "matrix" in table for table in tables.values()):
        raise InputError(
            f"{path}: is not a calibration of FreeMoCap: each table but [metadata] is a camera with a matrix there"
        )
    metadata = content.get(METADATA)
    for camera in tables.values():
        given.unread.keys(camera, (*CAMERA_KEYS, *SAME_AGAIN))
    given.unread.keys(metadata if isinstance(metadata, dict) else {}, READ_METADATA)
    metres = given.metres_per_unit or _metres_per_unit(path, metadata if isinstance(metadata, dict) else {})
    return gather_rig(path, ((f"[{key}]", partial(camera_of, key, table, metres)) for key, table in tables.items()))


def _metres_per_unit(path: Path, metadata: dict[str, Any]) -> float:
    """Return the unit of length in metres, by default millimetres. Raises `InputError` if the unit is the board's square."""
    if metadata.get("charuco_square_size") == 1:
        raise InputError(
            f"{path}: lengths are in squares of the board (charuco_square_size = 1): state the unit, as in --units mm"
        )
    units = metadata.get("units", "mm")
    if units not in METRES_PER_UNIT:
        raise InputError(f"{path}: [{METADATA}] units is {shortened(units)}: write one of {', '.join(METRES_PER_UNIT)}")
    return METRES_PER_UNIT[units]


def _recognises(sample: FileSample) -> bool:
    metadata = sample.table.get(METADATA)
    own = ("charuco_square_size", "groundplane_calibration")
    tables = [table for table in sample.table.values() if isinstance(table, dict)]
    return sample.suffix == ".toml" and (
        (isinstance(metadata, dict) and any(key in metadata for key in own))
        or any("world_orientation" in table for table in tables)
    )


FORMAT = Format(
    name="freemocap",
    title="FreeMoCap's camera calibration",
    tools=("FreeMoCap",),
    target="file",
    suffixes=(".toml",),
    conventions="World to camera (Rodrigues vector and translation), OpenCV's axes and pixels, millimetres; OpenCV's pinhole "
    "or fisheye.",
    write=write,
    read=read,
    recognises=_recognises,
)
