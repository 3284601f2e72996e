"""Embeddings of boxes: a numpy archive (npz) beside a file of boxes, one row a row of that file, in its order.

The archive holds `embeddings`, (N, D) of float16, float32 or float64, and, if one likes, `frame`, (N,) whole numbers, the frame
of each row, against which the boxes are checked. An archive with one two-dimensional array only may call it what it likes. The
length of a row says nothing: rows are brought to length one. A row of zeros is a box of whose looks nothing is known.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from passerby.common.arrays import Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened_text
from passerby.core.observations import Vectors
from passerby.interchange.storage.archives import Archive, is_single_array, open_archive
from passerby.interchange.storage.atomic import write_bytes
from passerby.interchange.storage.safe_parsing import NotParsed

EMBEDDINGS, FRAME = "embeddings", "frame"
KIND = 'a numpy archive (npz) with an array "embeddings"'


@dataclass(frozen=True, eq=False)
class Embeddings:
    """What a file of embeddings holds."""

    vectors: Vectors
    """(N, D) rows of length one, or of zeros where nothing is known; read-only."""
    frame: Ints | None = None
    """(N,) the frame of each row, where the file tells it."""

    def __len__(self) -> int:
        return len(self.vectors)


def read_embeddings(path: str | Path) -> Embeddings:
    """Read the embeddings of one camera's boxes.

    Raises `InputError` that names file, value and fix for: a file that is missing or no npz, pickled objects, no or more than
    one array that could be meant, numbers that are not finite floats, a `frame` that does not fit.
    """
    path = Path(path)
    try:
        if is_single_array(path, KIND):
            raise InputError(f"{path}: is a single numpy array, but {KIND} is needed: write it with `numpy.savez`")
        with open_archive(path, KIND) as archive:
            vectors = _vectors(path, archive)
            frame = _frame(path, archive.array(FRAME), len(vectors)) if FRAME in archive.names else None
    except NotParsed as error:
        raise InputError(f"{path}: cannot be read ({error}): {KIND} is needed: write it with `numpy.savez`") from None
    return Embeddings(vectors, frame)


def write_embeddings(path: str | Path, embeddings: ArrayLike, frame: ArrayLike | None = None) -> None:
    """Write embeddings in the order given, as float32 of the length given; the same input gives the same bytes.

    `write_boxes` sorts its rows by frame and identity: give the embeddings in that order.

    Args:
        path: of the npz file.
        embeddings: (N, D), one row a box.
        frame: (N,) the frame of each row.

    Raises:
        InputError: the arrays do not fit, or `path` is not writable.
    """
    vectors = np.asarray(embeddings, dtype=np.float32)
    if vectors.ndim != 2:
        raise InputError(f"{path}: embeddings of the shape {vectors.shape} cannot be written: (boxes, dimensions) is needed")
    arrays: dict[str, NDArray[Any]] = {EMBEDDINGS: vectors}
    if frame is not None:
        arrays[FRAME] = np.asarray(frame, dtype=np.int64)
        if arrays[FRAME].shape != (len(vectors),):
            raise InputError(f"{path}: {len(vectors)} embeddings and a frame of the shape {arrays[FRAME].shape} do not fit")
    archive = io.BytesIO()
    np.savez(archive, **arrays)  # type: ignore[arg-type]
    write_bytes(path, archive.getvalue())


def _vectors(path: Path, archive: Archive) -> Vectors:
    """(N, D) rows of length one."""
    name = EMBEDDINGS
    if EMBEDDINGS not in archive.names:
        tables = [name for name in archive.names if archive.dimensions(name) == 2]
        if len(tables) != 1:
            held = shortened_text(", ".join(archive.names)) or "nothing"
            raise InputError(
                f"{path}: which array is meant? It holds {held}: give one of (boxes, dimensions), or call it '{EMBEDDINGS}'"
            )
        name = tables[0]
    given = archive.array(name)
    if given.ndim != 2 or given.shape[1] == 0:
        raise InputError(f"{path}: {name} has the shape {np.shape(given)}: (boxes, dimensions) is needed, one row a box")
    if given.dtype.kind != "f" or given.dtype.itemsize > 8:
        raise InputError(f"{path}: {name} holds {given.dtype}: float16, float32 or float64 is needed")
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt(np.einsum("nd,nd->n", given, given, dtype=np.float64))
    broken = np.flatnonzero(~np.isfinite(length))
    if len(broken):
        raise InputError(
            f"{path}: row {broken[0] + 1} of {name} is not finite ({len(broken)} of {len(given)} rows): "
            "give zeros for a box of unknown appearance"
        )
    vectors = np.empty(given.shape, dtype=np.float32)
    np.divide(given, np.where(length > 0, length, 1.0)[:, None], out=vectors, casting="same_kind")
    vectors.setflags(write=False)
    return vectors


def _frame(path: Path, frame: NDArray[Any], rows: int) -> Ints:
    """(N,) the frames of the rows."""
    if np.shape(frame) != (rows,):
        raise InputError(f"{path}: {FRAME} has the shape {np.shape(frame)}, but there are {rows} embeddings: give one a row")
    whole = frame.dtype.kind in "iu" or (frame.dtype.kind == "f" and bool((frame == np.floor(frame)).all()))
    if not whole or (len(frame) and not float(np.abs(frame.astype(np.float64)).max()) <= 2.0**53):
        raise InputError(f"{path}: {FRAME} holds {frame.dtype} that are not whole numbers: give the frame of each row")
    return np.asarray(frame, dtype=np.int64)
