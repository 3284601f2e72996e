"""OpenCap's calibration: `cameraIntrinsicsExtrinsics.pickle`, one file a camera.

A pickled dict of numpy arrays: `intrinsicMat` (3 x 3, pixels), `distortion` (1 x 5: k1 k2 p1 p2 k3 of OpenCV's pinhole),
`imageSize` (2 x 1: height, then width), `rotation` (3 x 3) and `translation` (3 x 1, millimetres): world to camera,
`x_c = R X + t`, OpenCV's axes; `rotation_EulerAngles` is the same rotation as a vector. A file of intrinsics alone has neither.
The file is not unpickled: `storage.archives.parse_pickled_arrays` reads the arrays and runs no code.

The world is that of the calibration board, which is usually upright. The vertical direction is in the session's metadata, not
in these files. OpenCap stores them as `Videos/Cam0/cameraIntrinsicsExtrinsics.pickle`: the folder is the camera's name.

Source: `saveCameraParameters` and `calcExtrinsics` in utilsChecker.py of github.com/stanfordnmbl/opencap-core.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import natural_key, shortened
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.formats.values import rotation
from passerby.interchange.numbers import gather_rig
from passerby.interchange.storage.archives import parse_pickled_arrays
from passerby.interchange.storage.safe_parsing import NotParsed, file_bytes

METRES = 1e-3
SUFFIX, OWN_NAME = ".pickle", "cameraIntrinsics"
"""Ending of the files, and beginning of their names in OpenCap's own folders."""
PLACES = ("*.pickle", "*/cameraIntrinsics*.pickle", "Videos/*/cameraIntrinsics*.pickle")
"""Patterns of the files in a folder; the first pattern that finds files is used."""
READ = ("intrinsicMat", "distortion", "imageSize", "rotation", "translation")
SAME_AGAIN = ("rotation_EulerAngles",)


def read(path: Path, given: Given) -> Rig:
    """Read the camera of a file, or those of all files of a folder or of a session, in the order of their names."""
    files = [path]
    if path.is_dir():
        found = next((found for pattern in PLACES if (found := list(path.glob(pattern)))), [])
        files = sorted(found, key=lambda file: natural_key(str(file)))
    if not files:
        raise InputError(f"{path}: holds no {OWN_NAME}Extrinsics{SUFFIX}: give the folder of a session, or one of the files")
    return gather_rig(path, ((_place(file, path), partial(_camera, file, given)) for file in files))


def _place(file: Path, path: Path) -> str:
    return "the file" if file == path else str(file.relative_to(path))


def _camera(file: Path, given: Given) -> Camera:
    """Read the camera of a file. Raises `InputError`."""
    try:
        values = parse_pickled_arrays(file_bytes(file, "a calibration of OpenCap (.pickle)"))
    except NotParsed as error:
        raise InputError(f"is not a calibration of OpenCap: {error}") from None
    if not isinstance(values, dict) or "intrinsicMat" not in values:
        raise InputError("is not a calibration of OpenCap: a dict with intrinsicMat, distortion and imageSize is needed")
    name = file.parent.name if file.name.startswith(OWN_NAME) else file.stem
    given.unread.keys(values, (*READ, *SAME_AGAIN))
    height, width = _numbers(values, "imageSize", 2)
    if (width, height) != (int(width), int(height)):
        raise InputError(f"imageSize is {[height, width]}: whole numbers of pixels are needed")
    lens = Lens((int(width), int(height)), _numbers(values, "intrinsicMat", 9).reshape(3, 3), _numbers(values, "distortion", 5))
    present = [key for key in ("rotation", "translation") if key in values]
    if not present:
        return Camera(name, lens)
    if len(present) == 1:
        raise InputError(f"has {present[0]} alone: rotation and translation are needed, or neither")
    R = rotation("rotation", _numbers(values, "rotation", 9).reshape(3, 3))
    return Camera(name, lens, Pose(R, (given.metres_per_unit or METRES) * _numbers(values, "translation", 3)))


def _numbers(values: dict[Any, Any], key: str, count: int) -> Floats:
    """Return the finite numbers (count,) of an array. Raises `InputError`."""
    found = values.get(key)
    array = np.asarray(found, dtype=np.float64).ravel() if isinstance(found, np.ndarray) else np.zeros(0)
    if array.size != count or not np.isfinite(array).all():
        told = "missing" if found is None else shortened(array.tolist())
        raise InputError(f"{key} is {told}: an array of {count} finite numbers is needed")
    return array


def _recognises(sample: FileSample) -> bool:
    if sample.suffix not in (SUFFIX, ".pkl"):
        return False
    try:
        content = parse_pickled_arrays(sample.data)
    except NotParsed:
        return False
    return isinstance(content, dict) and {"intrinsicMat", "distortion", "imageSize"} <= content.keys()


FORMAT = Format(
    name="opencap",
    title="OpenCap's cameraIntrinsicsExtrinsics.pickle",
    tools=("OpenCap", "Pose2Sim"),
    target="file",
    suffixes=(SUFFIX,),
    conventions=(
        "Read only: one file, a folder of them, or a session's folder. World to camera (3 x 3 and translation), OpenCV's axes"
        " and pixels, millimetres; imageSize is height, width; pinhole with k1 k2 p1 p2 k3. The world is that of the "
        "calibration board; the file does not say which way is up (`passerby align`). The file is never unpickled: only "
        "arrays are read from it."
    ),
    read=read,
    recognises=_recognises,
)
