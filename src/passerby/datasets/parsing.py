"""Reading of the files of published sets, including MATLAB's, with errors that name file, place, value and remedy."""

from __future__ import annotations

import math
import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.io import loadmat

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.interchange.numbers import NotNumbers, finite_numbers
from passerby.interchange.storage.safe_parsing import NotParsed, check_is_file, parse_json, parse_xml, read_text

PICTURES = (".png", ".jpg", ".jpeg", ".bmp")


def read_json(path: Path, kind: str) -> Any:
    """Read the content of a JSON file. Raises `InputError` for any other file; `kind` describes the expected file."""
    text = read_text(path, kind)
    try:
        return parse_json(text)
    except NotParsed as error:
        raise InputError(f"{path}: is not JSON ({error}): {kind} is needed; was the download cut short?") from None


def numbers(value: Any, shape: tuple[int, ...], place: str, meaning: str) -> Floats:
    """Return the finite numbers of nested lists, reshaped to `shape`; (-1,) accepts any count.

    `place` is file and key, `meaning` describes the expected value. Raises `InputError` for any other value or count.
    """
    try:
        return finite_numbers(value, shape)
    except NotNumbers as fault:
        wanted = "its numbers must be finite" if fault.infinite else f"{meaning} are needed"
        raise InputError(f"{place} is {shortened(value)}: {wanted}") from None


def read_whole_number(value: Any, place: str, least: int = 0) -> int:
    """Return a whole number of at least `least`. Raises `InputError` for any other value."""
    if type(value) is not int or value < least:
        raise InputError(f"{place} is {shortened(value)}: a whole number from {least} on is needed")
    return value


def real(value: Any, place: str) -> float:
    """Return a finite number. Raises `InputError` for any other value."""
    if type(value) not in (int, float) or not math.isfinite(value):
        raise InputError(f"{place} is {shortened(value)}: a finite number is needed")
    return float(value)


def entry(table: Any, key: str, place: str) -> Any:
    """Return `table[key]`. Raises `InputError` if `table` is not an object or lacks the key."""
    if not isinstance(table, dict) or key not in table:
        raise InputError(f"{place}: '{key}' is missing: was the file changed? Take it from the set again")
    return table[key]


def xml_numbers(path: Path, key: str, shape: tuple[int, ...], needed: bool = True) -> Floats:
    """Read the numbers of one entry of an OpenCV storage (XML): a matrix with `<data>`, or the bare text of the entry.

    A missing entry that is not `needed` gives an empty array. Raises `InputError` for a file that is missing or not XML, and
    for a needed entry that is missing, or one of another size or not finite.
    """
    try:
        root = parse_xml(read_text(path, "an OpenCV storage (XML)"))
    except NotParsed as error:
        raise InputError(f"{path}: is not XML ({error}): take the file from the set again") from None
    node = root.find(key)
    if node is None and not needed:
        return np.zeros(0)
    if node is None:
        raise InputError(f"{path}: <{key}> is missing: take the file from the set again")
    data = node.find("data")
    text = ((node if data is None else data).text or "").split()
    return numbers(
        _parse_words(text), shape, f"{path}: <{key}>", "numbers" if shape == (-1,) else f"{math.prod(shape)} numbers"
    )


def text_matrix(path: Path) -> Floats:
    """Read the projection matrix (3, 4) of a text file with numbers separated by commas or spaces.

    Raises `InputError` if the file is missing or has any other content.
    """
    words = read_text(path, "a projection matrix (3 rows of 4 numbers)").replace(",", " ").split()
    return numbers(_parse_words(words), (3, 4), f"{path}: the matrix", "3 rows of 4 numbers")


def index_by_number(folder: Path, suffixes: tuple[str, ...] = PICTURES) -> dict[int, Path]:
    """Return the files of a folder by the last number in their names, ascending; empty if the folder does not exist.

    Raises `InputError` for two files with the same number.
    """
    found: dict[int, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        digits = re.findall(r"\d+", path.stem)
        if path.suffix.lower() not in suffixes or not digits or path.name.startswith("."):
            continue
        number = int(digits[-1])
        if number in found:
            raise InputError(f"{path}: has the number {number} of {found[number].name}: keep one of the two")
        found[number] = path
    return dict(sorted(found.items()))


def picture_size(path: Path) -> tuple[int, int]:
    """Return (width, height) of a picture. Raises `InputError` if it cannot be read."""
    picture = cv2.imread(str(path))
    if picture is None:
        raise InputError(f"{path}: cannot be read as an image: was the download cut short?")
    return picture.shape[1], picture.shape[0]


def check_size(path: Path, size: tuple[int, int]) -> None:
    """Check that a picture has the size of its calibration. Raises `InputError` if it has another size."""
    found = picture_size(path)
    if found != size:
        raise InputError(
            f"{path}: is an image of {found[0]} x {found[1]}, but the set's calibration is of {size[0]} x {size[1]}: "
            "give the images as published, not resized"
        )


def _parse_words(words: list[str]) -> list[Any]:
    """Convert words to numbers; if one of them is not a number, return the words."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return list(words)


def mat_variable(path: Path, key: str) -> Any:
    """Read a variable of a MATLAB file: an array of numbers, or of objects for cells. Raises `InputError` if it is missing."""
    if not path.is_file():
        raise InputError(f"{path}: no such file: a MATLAB file with the variable {key} is needed here")
    try:
        content: Any = _load_variables(path)
    except NotImplementedError:
        content = _hdf5_content(path)
    except Exception as error:  # SciPy raises many kinds of exceptions for damaged files
        told = shortened_text(" ".join(str(error).split()) or type(error).__name__, 200)
        raise InputError(f"{path}: cannot be read as a MATLAB file ({told}): take it from the set again") from None
    if key not in content:
        names = shortened_text(", ".join(name for name in content if not name.startswith("__"))) or "none"
        raise InputError(f"{path}: has no variable {key} (it has {names}): take the file from the set again")
    return content[key]


def _load_variables(path: Path) -> Any:
    """Read the variables in a separate process, because SciPy 1.17 ends its process at some damaged files."""
    check_is_file(path, "a MATLAB file")
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(loadmat, path).result()


def mat_matrix(path: Path, key: str, shape: tuple[int, ...]) -> Floats:
    """Read a variable that is a matrix of finite numbers. Raises `InputError` if it is not."""
    value = np.asarray(mat_variable(path, key))
    if value.dtype.kind not in "fiu" or value.shape != shape:
        raise InputError(
            f"{path}: {key} has the shape {value.shape}: a matrix of {' x '.join(map(str, shape))} numbers is needed"
        )
    if not np.isfinite(value).all():
        raise InputError(f"{path}: {key} is {shortened(value.tolist())}: its numbers must be finite")
    return np.asarray(value, dtype=np.float64)


def _hdf5_content(path: Path) -> dict[str, Any]:
    """Read the matrices of a file of version 7.3, which HDF5 stores transposed. Raises `InputError` if it cannot be read."""
    try:
        h5py: Any = import_module("h5py")
    except ImportError:
        raise InputError(
            f"{path}: is a MATLAB file of version 7.3 (HDF5): install h5py, or save it as version 7 (save -v7), or as text "
            f"beside it ({path.stem}.txt, one row per line)"
        ) from None
    try:
        with h5py.File(path, "r") as file:
            return {name: np.asarray(value).T for name, value in file.items() if isinstance(value, h5py.Dataset)}
    except OSError as error:
        raise InputError(f"{path}: cannot be read as a MATLAB file ({error}): take it from the set again") from None
