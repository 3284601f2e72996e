"""Variables of MATLAB files, by SciPy; files of version 7.3, which are HDF5, by h5py where that is installed."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.interchange.storage.safe_parsing import check_is_file


def mat_variable(path: Path, key: str) -> Any:
    """One variable: an array of numbers, or one of objects for cells. Raises `InputError` where there is none."""
    if not path.is_file():
        raise InputError(f"{path}: no such file: a MATLAB file with the variable {key} is needed here")
    try:
        content: Any = _loaded(path)
    except NotImplementedError:
        content = _hdf5_content(path)
    except Exception as error:  # what SciPy raises for bytes that mean something else has no end
        told = shortened_text(" ".join(str(error).split()) or type(error).__name__, 200)
        raise InputError(f"{path}: cannot be read as a MATLAB file ({told}): take it from the set again") from None
    if key not in content:
        names = shortened_text(", ".join(name for name in content if not name.startswith("__"))) or "none"
        raise InputError(f"{path}: has no variable {key} (it has {names}): take the file from the set again")
    return content[key]


def _loaded(path: Path) -> Any:
    """The variables, read in a process of its own: SciPy 1.17 ends its process at some damaged files."""
    check_is_file(path, "a MATLAB file")
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(loadmat, path).result()


def mat_matrix(path: Path, key: str, shape: tuple[int, ...]) -> Floats:
    """A variable that is a matrix of finite numbers. Raises `InputError` where it is not."""
    value = np.asarray(mat_variable(path, key))
    if value.dtype.kind not in "fiu" or value.shape != shape:
        raise InputError(
            f"{path}: {key} has the shape {value.shape}: a matrix of {' x '.join(map(str, shape))} numbers is needed"
        )
    if not np.isfinite(value).all():
        raise InputError(f"{path}: {key} is {shortened(value.tolist())}: its numbers must be finite")
    return np.asarray(value, dtype=np.float64)


def _hdf5_content(path: Path) -> dict[str, Any]:
    """The matrices of a file of version 7.3, whose columns HDF5 has as rows. Raises `InputError` where it cannot be read."""
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
