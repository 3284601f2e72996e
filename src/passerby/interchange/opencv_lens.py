"""Lenses in OpenCV's own files (FileStorage: YAML, XML, JSON), one camera a file, under the names that are in use for them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Lens
from passerby.interchange.storage.safe_parsing import NotParsed, leaves, parse_json, parse_safe_yaml, parse_xml, read_text

ENDINGS = (".yml", ".yaml", ".xml", ".json")

ESCAPED_QUOTE = re.compile(r"(?<!\\)((?:\\\\)*)\\'")
"""OpenCV writes \\' within double quotes, which YAML does not know."""

LARGEST_BYTES = 1_000_000
"""A file with one lens has some kilobytes; joints and other recordings in JSON are larger and are not looked into."""

DEEPEST = 8
"""Tables in tables that are looked into: a lens lies in the first or the second."""

MATRIX_NAMES = (
    "cameramatrix",
    "intrinsicmatrix",
    "intrinsicsmatrix",
    "intrinsic",
    "intrinsics",
    "cammatrix",
    "matrix",
    "mtx",
    "k",
)
DISTORTION_NAMES = (
    "distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoefs", "distcoeff", "distcoef", "distortionparameters",
    "distortions", "distortion", "dist", "d",
)  # fmt: skip
SIZE_NAMES = ("imagesize", "imgsize", "size", "resolution", "imageresolution")
_WIDTH, _HEIGHT = ("imagewidth", "width"), ("imageheight", "height")
_MODEL = ("distortionmodel", "cameramodel", "model", "projectionmodel")
_FISHEYE = ("fisheyemodel", "fisheye", "isfisheye", "usefisheye")
LENS_NAMES = frozenset({*MATRIX_NAMES, *DISTORTION_NAMES, *SIZE_NAMES, *_WIDTH, *_HEIGHT, *_MODEL, *_FISHEYE})
"""All keys that a lens is read from."""
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
    matrix = find_first_value(content, MATRIX_NAMES)
    if matrix is None:
        return None
    distortions = find_first_value(content, DISTORTION_NAMES)
    if distortions is None:
        raise InputError(f"{path}: has a camera matrix, but no distortion coefficients: add them, zeros for a lens without")
    model = _strip_quotes(str(find_first_value(content, _MODEL) or ""))
    if model not in _PINHOLE_MODELS + _FISHEYE_MODELS:
        raise InputError(f"{path}: the lens model {shortened(model)} is not known: OpenCV's pinhole and fisheye models are")
    flag = find_first_value(content, _FISHEYE)
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

    Raises `InputError` for what is none of OpenCV's formats.
    """
    text = read_text(path, "a calibration (OpenCV's YAML, XML or JSON)")
    try:
        content = _parse_text(text)
        return content if isinstance(content, dict) else {}
    except (NotParsed, RecursionError):
        raise InputError(f"{path}: is not a file that OpenCV can read: is it another kind of file?") from None


def _parse_text(text: str) -> Any:
    """The values of a text in the format that its first characters show, as OpenCV tells formats apart. Raises `NotParsed`."""
    head = text.lstrip()[:20]
    if head.startswith("<"):
        root = parse_xml(text)
        if root.tag != "opencv_storage":
            raise NotParsed("its first element is not <opencv_storage>")
        return _read_xml(root)
    found = parse_json(text) if head.startswith(("{", "[")) else parse_safe_yaml(ESCAPED_QUOTE.sub(r"\1'", text))
    if not isinstance(found, dict | list):
        raise NotParsed("holds one value only")
    return simplify_keys(found, DEEPEST)


def _read_xml(element: ElementTree.Element) -> Any:
    """An element of OpenCV's XML: `<_>` are entries of a list, other elements those of a table, words numbers or a text."""
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_read_xml(child) for child in children]
    if children:
        return {_strip_quotes(child.tag): _read_xml(child) for child in children}
    text = (element.text or "").strip()
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return text.strip('"')
    return values[0] if len(values) == 1 else values


def simplify_keys(value: Any, levels: int) -> Any:
    """The same, its keys plain; what lies deeper than so many levels is left out, since YAML can hold itself."""
    if levels == 0:
        return None
    if isinstance(value, dict):
        return {_strip_quotes(str(key)): simplify_keys(inner, levels - 1) for key, inner in value.items()}
    return value


def _strip_quotes(key: str) -> str:
    return key.casefold().replace("_", "").replace("-", "").replace(" ", "")


def find_first_value(content: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    """The value under the first of some keys that there is; None where there is none of them."""
    return next((content[key] for key in keys if content.get(key) is not None), None)


def numbers_of(path: Path, what: str, value: Any) -> Floats:
    """(N,) the numbers of a matrix, or of lists in lists."""
    if isinstance(value, dict):
        value = value.get("data")
    try:
        array = np.array([float(number) for number in leaves(value)])
    except (TypeError, ValueError, OverflowError):
        array = np.array([np.nan])
    if not np.isfinite(array).all():
        raise InputError(f"{path}: {what} is {shortened(value)}: finite numbers are needed")
    return array


def _size(path: Path, content: Mapping[str, Any]) -> tuple[int, int] | None:
    """(width, height) as far as the file says."""
    size = find_first_value(content, SIZE_NAMES)
    nested = size if isinstance(size, dict) and "data" not in size else content
    width, height = find_first_value(nested, _WIDTH), find_first_value(nested, _HEIGHT)
    if (width is None or height is None) and size is not None and nested is content:
        numbers = numbers_of(path, "the image size", size)
        width, height = numbers if numbers.size == 2 else (None, None)
    if width is None or height is None:
        return None
    numbers = numbers_of(path, "the image size", [width, height])
    if numbers.size != 2 or (numbers < 1).any() or (numbers != np.floor(numbers)).any():
        raise InputError(f"{path}: the image size is {shortened(numbers.tolist())}: whole numbers of pixels above 0 are needed")
    return int(numbers[0]), int(numbers[1])
