"""Lenses in OpenCV's own files (FileStorage: YAML, XML, JSON), one camera a file, under the names that are in use for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from passerby.cameras import Floats, Lens
from passerby.errors import InputError
from passerby.interchange.faults import read_text

ENDINGS = (".yml", ".yaml", ".xml", ".json")

LARGEST_BYTES = 1_000_000
"""A file with one lens has some kilobytes; joints and other recordings in JSON are larger and are not looked into."""

_MATRIX = ("cameramatrix", "intrinsicmatrix", "intrinsicsmatrix", "intrinsic", "intrinsics", "cammatrix", "matrix", "mtx", "k")
_DISTORTIONS = (
    "distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoefs", "distcoeff", "distcoef", "distortionparameters",
    "distortions", "distortion", "dist", "d",
)  # fmt: skip
_SIZE = ("imagesize", "size", "resolution", "imageresolution")
_WIDTH, _HEIGHT = ("imagewidth", "width"), ("imageheight", "height")
_MODEL = ("distortionmodel", "cameramodel", "model", "projectionmodel")
_FISHEYE = ("fisheyemodel", "fisheye", "isfisheye", "usefisheye")
_PINHOLE_MODELS = (
    "", "plumbbob", "pinhole", "radtan", "radialtangential", "rationalpolynomial", "opencv", "brown", "brownconrady",
)  # fmt: skip
_FISHEYE_MODELS = ("fisheye", "equidistant", "kannalabrandt", "opencvfisheye")


@dataclass(frozen=True, eq=False)
class StoredLens:
    """What a file says of a lens."""

    size: tuple[int, int] | None
    """(width, height) in pixels; None where the file does not say."""
    matrix: Floats
    """(3, 3), pixels."""
    distortions: Floats
    """(N,) OpenCV's coefficients."""
    fisheye: bool

    def lens(self, size: tuple[int, int]) -> Lens:
        """The lens, for pictures of `size`. Raises `InputError` for values that cannot be a lens."""
        return Lens(size, self.matrix, self.distortions, self.fisheye)


def read_opencv_lens(path: str | Path) -> StoredLens | None:
    """Read the lens in a file; None where the file is about something else (it holds no camera matrix).

    Raises `InputError` for a file that cannot be read, and for a camera matrix without distortions or with values
    that are no lens.
    """
    path = Path(path)
    return lens_in(path, read_values(path))


def lens_in(path: Path, content: Mapping[str, Any]) -> StoredLens | None:
    """The lens among a file's values, see `read_values`; None where they hold no camera matrix. Raises `InputError`."""
    matrix = first_value(content, _MATRIX)
    if matrix is None:
        return None
    distortions = first_value(content, _DISTORTIONS)
    if distortions is None:
        raise InputError(f"{path}: has a camera matrix, but no distortion coefficients: add them, zeros for a lens without")
    model = _plain(str(first_value(content, _MODEL) or ""))
    if model not in _PINHOLE_MODELS + _FISHEYE_MODELS:
        raise InputError(f"{path}: the lens model '{model}' is not known: OpenCV's pinhole and fisheye models are")
    flag = first_value(content, _FISHEYE)
    fisheye = model in _FISHEYE_MODELS or flag in (1, 1.0, True, "1", "true", "True")
    values = numbers_of(path, "the camera matrix", matrix)
    if values.size != 9:
        raise InputError(f"{path}: the camera matrix has {values.size} numbers: 3 x 3 are needed")
    stored = StoredLens(_size(path, content), values.reshape(3, 3), numbers_of(path, "the distortion", distortions), fisheye)
    try:
        stored.lens(stored.size or (1, 1))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return stored


def read_values(path: Path) -> dict[str, Any]:
    """The file's values by their keys in small letters without `_`, `-` and spaces; a matrix as a mapping with its `data`.

    Raises `InputError` for what OpenCV cannot read.
    """
    text = read_text(path, "a calibration (OpenCV's YAML, XML or JSON)")
    try:
        storage = cv2.FileStorage(text, cv2.FileStorage_READ | cv2.FileStorage_MEMORY)
        try:
            content = _value(storage.root())
        finally:
            storage.release()
    except (cv2.error, SystemError, UnicodeDecodeError):
        # The binding raises SystemError where the constructor fails.
        raise InputError(f"{path}: is not a file that OpenCV can read: is it another kind of file?") from None
    return content if isinstance(content, dict) else {}


def _value(node: Any) -> Any:
    """A node of the file as plain values; a matrix as the table of its `rows`, `cols` and `data`."""
    if node.isMap():
        return {_plain(key): _value(node.getNode(key)) for key in node.keys()}  # noqa: SIM118
    if node.isSeq():
        return [_value(node.at(index)) for index in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None


def _plain(key: str) -> str:
    return key.casefold().replace("_", "").replace("-", "").replace(" ", "")


def first_value(content: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    """The value under the first of some keys that there is; None where there is none of them."""
    return next((content[key] for key in keys if content.get(key) is not None), None)


def numbers_of(path: Path, what: str, value: Any) -> Floats:
    """(N,) the numbers of a matrix, or of lists in lists."""
    if isinstance(value, dict):
        value = value.get("data")
    try:
        array = np.array(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        array = np.array([np.nan])
    if not np.isfinite(array).all():
        raise InputError(f"{path}: {what} is {value!r}: finite numbers are needed")
    return array


def _size(path: Path, content: Mapping[str, Any]) -> tuple[int, int] | None:
    """(width, height) as far as the file says."""
    size = first_value(content, _SIZE)
    nested = size if isinstance(size, dict) and "data" not in size else content
    width, height = first_value(nested, _WIDTH), first_value(nested, _HEIGHT)
    if (width is None or height is None) and size is not None and nested is content:
        numbers = numbers_of(path, "the picture's size", size)
        width, height = numbers if numbers.size == 2 else (None, None)
    if width is None or height is None:
        return None
    numbers = numbers_of(path, "the picture's size", [width, height])
    if (numbers < 1).any() or (numbers != np.floor(numbers)).any():
        raise InputError(f"{path}: the picture's size is {numbers.tolist()}: whole numbers of pixels above 0 are needed")
    return int(numbers[0]), int(numbers[1])
