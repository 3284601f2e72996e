"""Lenses in OpenCV's own files (FileStorage: YAML, XML, JSON), one camera a file, under the keys that are in common use."""

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
"""OpenCV writes \\' within double quotes, which is not valid in YAML."""

LARGEST_BYTES = 1_000_000
"""Largest file that is searched for a lens. A file with one lens has a few kilobytes; joints and other recordings in JSON are
larger."""

DEEPEST = 8
"""Depth of nested tables that are searched: a lens is in the first or the second."""

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
"""All keys from which a lens is read."""
_PINHOLE_MODELS = (
    "", "plumbbob", "pinhole", "radtan", "radialtangential", "rationalpolynomial", "opencv", "brown", "brownconrady",
)  # fmt: skip
_FISHEYE_MODELS = ("fisheye", "equidistant", "kannalabrandt", "opencvfisheye")


@dataclass(frozen=True, eq=False)
class StoredLens:
    """A lens as its file states it."""

    size: tuple[int, int] | None
    """(width, height) in pixels; None where the file does not state it."""
    matrix: Floats
    """(3, 3), pixels."""
    distortions: Floats
    """(N,) distortion coefficients in OpenCV's order."""
    fisheye: bool

    def lens(self, size: tuple[int, int]) -> Lens:
        """Return the lens for pictures of `size`. Raises `InputError` for values that cannot be a lens."""
        return Lens(size, self.matrix, self.distortions, self.fisheye)


def read_opencv_lens(path: str | Path) -> StoredLens | None:
    """Read the lens in a file. Return None where the file holds no camera matrix, and so is another kind of file.

    Raises `InputError` for a file that cannot be read, and for a camera matrix without distortions or with values
    that cannot be a lens.
    """
    path = Path(path)
    return lens_in(path, read_values(path))


def lens_in(path: Path, content: Mapping[str, Any]) -> StoredLens | None:
    """Return the lens among a file's values (`read_values`), or None where they hold no camera matrix. Raises `InputError`."""
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
    """Read the values of a file by key. Keys become lower case without `_`, `-` and spaces; a matrix is a mapping with `data`.

    Raises `InputError` for a file in none of OpenCV's formats.
    """
    text = read_text(path, "a calibration (OpenCV's YAML, XML or JSON)")
    try:
        content = _parse_text(text)
        return content if isinstance(content, dict) else {}
    except (NotParsed, RecursionError):
        raise InputError(f"{path}: is not a file that OpenCV can read: is it another kind of file?") from None


def _parse_text(text: str) -> Any:
    """Parse a text in the format that its first characters show, as OpenCV does. Raises `NotParsed`."""
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
    """Convert an element of OpenCV's XML: elements `<_>` to a list, other elements to a table, words to numbers or a text."""
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
    """Return a value with simplified keys. Values deeper than `levels` become None, since a YAML value can contain itself."""
    if levels == 0:
        return None
    if isinstance(value, dict):
        return {_strip_quotes(str(key)): simplify_keys(inner, levels - 1) for key, inner in value.items()}
    return value


def _strip_quotes(key: str) -> str:
    return key.casefold().replace("_", "").replace("-", "").replace(" ", "")


def find_first_value(content: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    """Return the value of the first of some keys that is present; None if all are missing."""
    return next((content[key] for key in keys if content.get(key) is not None), None)


def numbers_of(path: Path, what: str, value: Any) -> Floats:
    """Return the numbers (N,) of a matrix or of nested lists. Raises `InputError` where they are not finite numbers."""
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
    """Return the image size (width, height), or None where the file does not state it."""
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
