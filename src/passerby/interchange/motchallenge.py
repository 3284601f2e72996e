"""Boxes as MOTChallenge text, one a row, and their embeddings as numpy archives beside it.

The four numbers of a box may be in another `BoxFormat`.

Frames are whole numbers from 0 on, in ascending order; identities are whole numbers, -1 where unknown. Pixels follow OpenCV's
convention. Numpy parses a valid file as a whole. Only a faulty file is read a second time, line by line, to find its faults.

The archive holds `embeddings`, (N, D) of float16, float32 or float64, and optionally `frame`, (N,) whole numbers, the frame of
each row, with which the boxes are checked. If the archive has only one two-dimensional array, the array may have any name. Rows
are scaled to length one; their original length has no meaning. A row of zeros is a box of unknown appearance.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.observations import LTWH, UNKNOWN, Boxes, BoxFormat, Vectors
from passerby.interchange.storage.archives import Archive, is_single_array, open_archive
from passerby.interchange.storage.atomic import write_bytes, write_text
from passerby.interchange.storage.safe_parsing import FileFaults, NotParsed, read_text

MIN_COLUMNS, MAX_COLUMNS = 7, 10
LARGEST_WHOLE = 2**53
"""Above this value, a float64 no longer distinguishes whole numbers."""
EMBEDDINGS, FRAME = "embeddings", "frame"
KIND = 'a numpy archive (npz) with an array "embeddings"'


def read_boxes(path: str | Path, *, doubles: bool = False, box_format: BoxFormat = LTWH) -> Boxes:
    """Read the boxes of one camera. A file without rows is that of a camera that saw no person.

    Boxes in another `box_format` become left, top, width, height; normalised boxes stay in shares of the image.

    With `doubles`, a row that occurs twice and an identity that occurs twice in a frame are no fault: all rows of the file are
    returned, and `passerby.scene.used_rows.remove_duplicates` removes the duplicates later.

    Raises `FileFaults` (an `InputError`) that names file, line, value and fix for: rows without 7 to 10 columns, fields that
    are not finite numbers, a width or height not above 0, frames negative, broken or out of order, identities broken or below
    -1, a row that occurs twice, an identity twice in one frame.
    """
    text = read_text(path, "a text file of boxes (MOTChallenge)")
    rows = _parse(text)
    if rows is None or not _is_sound(rows, doubles, box_format):
        faults = list(_faults(Path(path), text, doubles, box_format))
        raise FileFaults(faults or [f"{path}: is not a MOTChallenge text of boxes"])
    return Boxes(rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64), box_format.to_ltwh(rows[:, 2:6]), rows[:, 6])


def write_boxes(path: str | Path, boxes: Boxes) -> None:
    """Write boxes, sorted by frame and identity, to nine significant digits. Raises `InputError` if `path` is not writable."""
    order = np.lexsort((boxes.identity, boxes.frame))
    lines = [
        f"{frame},{identity},{left:.9g},{top:.9g},{width:.9g},{height:.9g},{score:.9g},-1,-1,-1\n"
        for frame, identity, (left, top, width, height), score in zip(
            boxes.frame[order].tolist(),
            boxes.identity[order].tolist(),
            boxes.ltwh[order].tolist(),
            boxes.score[order].tolist(),
            strict=True,
        )
    ]
    write_text(path, "".join(lines))


def _parse(text: str) -> Floats | None:
    """Parse the first seven numbers of each row (N, 7); None where the text is not a table of 7 to 10 numbers a row."""
    if not text.strip():
        return np.zeros((0, 7))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            table = np.loadtxt(io.StringIO(text), delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    return np.asarray(table[:, :7], dtype=np.float64) if MIN_COLUMNS <= table.shape[1] <= MAX_COLUMNS else None


def _is_sound(rows: Floats, doubles: bool, box_format: BoxFormat) -> bool:
    if len(rows) == 0:
        return True
    if not np.isfinite(rows).all() or not (box_format.to_ltwh(rows[:, 2:6])[:, 2:] > 0).all():
        return False
    frame, identity = rows[:, 0], rows[:, 1]
    whole = (rows[:, :2] == np.floor(rows[:, :2])).all() and np.abs(rows[:, :2]).max() <= LARGEST_WHOLE
    if not whole or frame.min() < 0 or identity.min() < UNKNOWN or (np.diff(frame) < 0).any():
        return False
    if doubles:
        return True
    known = rows[identity > UNKNOWN][:, :2]
    return len(np.unique(known, axis=0)) == len(known) and len(np.unique(rows, axis=0)) == len(rows)


def _faults(path: Path, text: str, doubles: bool, box_format: BoxFormat) -> Iterator[str]:
    """Generate all faults of the file, in the order of its lines."""
    columns = 0
    last_frame = -1.0
    seen_rows: dict[tuple[float, ...], int] = {}
    seen_people: dict[tuple[float, float], int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        place = f"{path}: line {number}"
        fields = line.split(",")
        columns = columns or len(fields)
        try:
            row = _row(fields, columns, box_format)
        except InputError as error:
            yield f"{place}: {error}"
            continue
        frame, identity = row[0], row[1]
        if frame < last_frame:
            yield (
                f"{place}: frame {frame:.0f} comes after frame {last_frame:.0f}: sort the rows by frame "
                f"(`sort -t, -k1,1n -k2,2n {path.name}`)"
            )
        last_frame = max(last_frame, frame)
        if doubles:
            continue
        person = (frame, identity)
        if row in seen_rows:
            yield f"{place}: repeats line {seen_rows[row]} ({line.strip()[:80]}): delete one of the two"
        elif identity > UNKNOWN and person in seen_people:
            yield (
                f"{place}: identity {identity:.0f} occurs a second time in frame {frame:.0f} (first on line "
                f"{seen_people[person]}): one camera sees a person once in a frame; delete one box or give it another identity"
            )
        seen_rows.setdefault(row, number)
        seen_people.setdefault(person, number)


def _row(fields: list[str], columns: int, box_format: BoxFormat) -> tuple[float, ...]:
    """Parse the first seven numbers of a row. Raises `InputError`, whose message does not name the file and the line."""
    named = ("frame", "identity", *box_format.columns, "score")
    if not MIN_COLUMNS <= len(fields) <= MAX_COLUMNS:
        raise InputError(
            f"{len(fields)} columns instead of {MIN_COLUMNS} to {MAX_COLUMNS}: write {','.join(named)}[,-1,-1,-1], separated "
            "by commas"
        )
    if len(fields) != columns:
        raise InputError(f"{len(fields)} columns, but the first row has {columns}: give all rows the same columns")
    names = (*named, "column 8", "column 9", "column 10")
    numbers = tuple(_number(field, name) for field, name in zip(fields, names, strict=False))
    for value, name in zip(numbers[:7], names, strict=False):
        if not math.isfinite(value):
            raise InputError(f"{name} is {value}: delete the row or give a finite number")
    for value, name, lowest in ((numbers[0], "frame", 0), (numbers[1], "identity", UNKNOWN)):
        if value != math.floor(value) or not lowest <= value <= LARGEST_WHOLE:
            unknown = " (-1 for unknown)" if name == "identity" else ""
            raise InputError(f"{name} is {value:.12g}: a whole number from {lowest} on is needed{unknown}")
    corners = box_format.convention == "corners"
    for edge, value, first, before in zip(named[4:6], numbers[4:6], numbers[2:4], named[2:4], strict=True):
        if value <= (first if corners else 0):
            least = f"{before}, {first:.12g}" if corners else "0"
            raise InputError(f"{edge} is {value:.12g}: it must be above {least} (columns 3 to 6 are {', '.join(named[2:6])})")
    return numbers[:7]


def _number(field: str, name: str) -> float:
    try:
        if "_" in field:  # Python reads 1_000 as a number, other tools do not.
            raise ValueError
        return float(field)
    except ValueError:
        raise InputError(f"{name} is {shortened(field.strip())}: a number is needed; delete headers and comments") from None


@dataclass(frozen=True, eq=False)
class Embeddings:
    """The content of a file of embeddings."""

    vectors: Vectors
    """(N, D) rows of length one, or of zeros where the appearance is unknown; read-only."""
    frame: Ints | None = None
    """(N,) the frame of each row; None where the file does not state it."""

    def __len__(self) -> int:
        return len(self.vectors)


def read_embeddings(path: str | Path) -> Embeddings:
    """Read the embeddings of one camera's boxes.

    Raises `InputError` that names file, value and fix for: a file that is missing or not an npz, pickled objects, no candidate
    for the array of embeddings or more than one, numbers that are not finite floats, a `frame` that does not fit the rows.
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
    """Write embeddings as float32, in their order and with their lengths unchanged. The same input gives the same bytes.

    `write_boxes` sorts its rows by frame and identity: give the embeddings in that order.

    Args:
        path: path of the npz file.
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
    """Read the embeddings (N, D) of an archive, scaled to rows of length one; rows of zeros stay."""
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
    """Check the frames (N,) of the rows, and return them as integers."""
    if np.shape(frame) != (rows,):
        raise InputError(f"{path}: {FRAME} has the shape {np.shape(frame)}, but there are {rows} embeddings: give one a row")
    whole = frame.dtype.kind in "iu" or (frame.dtype.kind == "f" and bool((frame == np.floor(frame)).all()))
    if not whole or (len(frame) and not float(np.abs(frame.astype(np.float64)).max()) <= 2.0**53):
        raise InputError(f"{path}: {FRAME} holds {frame.dtype} that are not whole numbers: give the frame of each row")
    return np.asarray(frame, dtype=np.int64)
