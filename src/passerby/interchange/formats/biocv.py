"""BioCV's calibrations: one text file a camera, `00.calib` or without a suffix.

Numbers in this order: width and height; the camera matrix (3 x 3, pixels); world to camera as a 4 x 4 matrix `[R t; 0 1]`,
millimetres; the distortion (k1 k2 p1 p2 k3 of OpenCV's pinhole). Blank lines separate them.

Source: `calib_biocv_fun` of Pose2Sim (github.com/perfanalytics/pose2sim), which reads these lines so; the data set is
"BioCV Motion Capture Dataset" of the University of Bath (doi.org/10.15125/BATH-01258).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import natural_key, shortened
from passerby.core.cameras import PINHOLE_DISTORTION_LENGTHS, Camera, Lens, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.formats.values import rigid
from passerby.interchange.numbers import gather_rig
from passerby.interchange.storage.safe_parsing import read_text

METRES = 1e-3
SUFFIX = ".calib"
BEFORE = 2 + 9 + 16
"""Count of the numbers before the distortion."""


def read(path: Path, given: Given) -> Rig:
    """Read the camera of a file, or those of all .calib files of a folder, in the order of their names."""
    files = [path]
    if path.is_dir():
        files = sorted(path.glob(f"*{SUFFIX}"), key=lambda file: natural_key(file.name))
    if not files:
        raise InputError(f"{path}: holds no {SUFFIX} file: give the folder of the calibrations, or one of them")
    return gather_rig(path, ((file.name if path.is_dir() else "the file", partial(_camera, file, given)) for file in files))


def calib_numbers(text: str) -> Floats | None:
    """Parse the numbers (N,) of a file; None where it is no calibration of BioCV."""
    words = text.split()
    if len(words) - BEFORE not in PINHOLE_DISTORTION_LENGTHS:
        return None
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return None


def _camera(file: Path, given: Given) -> Camera:
    """Read the camera of a file. Raises `InputError`."""
    values = calib_numbers(read_text(file, f"a calibration of BioCV ({SUFFIX})"))
    if values is None:
        raise InputError("holds no width, height, 3 x 3 matrix, 4 x 4 matrix and distortion: is it another kind of file?")
    if not np.isfinite(values).all():
        raise InputError(f"holds {shortened(values[~np.isfinite(values)].tolist())}: finite numbers are needed")
    size, matrix, transform = values[:2], values[2:11].reshape(3, 3), values[11:BEFORE].reshape(4, 4)
    if (size < 1).any() or (size != np.floor(size)).any():
        raise InputError(f"its size is {size.tolist()}: whole numbers of pixels are needed")
    lens = Lens((int(size[0]), int(size[1])), matrix, values[BEFORE:])
    return Camera(file.stem, lens, rigid("the 4 x 4 matrix", transform, given.metres_per_unit or METRES))


def _recognises(sample: FileSample) -> bool:
    return sample.suffix == SUFFIX and calib_numbers(sample.data.decode("utf-8", errors="replace")) is not None


FORMAT = Format(
    name="biocv",
    title="BioCV's calibrations (.calib)",
    tools=("BioCV Motion Capture Dataset", "Pose2Sim"),
    target="file",
    suffixes=(SUFFIX,),
    conventions=(
        "Read only: one file, or a folder of them; a camera is named after its file. World to camera (4 x 4), OpenCV's axes "
        "and pixels, millimetres; pinhole with k1 k2 p1 p2 k3."
    ),
    read=read,
    recognises=_recognises,
)
