"""Results of stages that are kept in the output folder, so that a run that was stopped goes on where it was.

A stage's results lie in a folder that is named by a key of all that decides them: its input, its options, its network and the
versions of the libraries. They come in parts, each written whole or not at all, and a summary says that there will be no more.
A part that cannot be read (the npz archives carry checksums) counts as missing and is made again.
"""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.interchange.atomic import write_bytes, write_text

Arrays = dict[str, NDArray[Any]]

SUMMARY = "summary.json"
KEY_LENGTH = 20
SAMPLES, SAMPLE_BYTES = 64, 1 << 16
"""A file is known by its size and by so many evenly spread samples of its content: a hash of all of it would take minutes for
the recordings of a day."""


@dataclass(frozen=True)
class KeptStage:
    """One stage of one camera."""

    folder: Path
    key: str

    @classmethod
    def of(cls, shelf: Path, stage: str, identity: Mapping[str, Any]) -> KeptStage:
        """The stage of this identity on a camera's shelf."""
        key = key_of(identity)
        return cls(shelf / f"{stage}-{key}", key)

    def load(self, part: int) -> Arrays | None:
        """The arrays of a part; None where it is not there or damaged."""
        try:
            with np.load(self._path(part), allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
            return None

    def save(self, part: int, arrays: Arrays) -> None:
        """Keep a part, whole or not at all. Raises `InputError` where the folder cannot be written."""
        archive = io.BytesIO()
        np.savez(archive, **arrays)  # type: ignore[arg-type]
        write_bytes(self._path(part), archive.getvalue())

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Say that all parts are there. Raises `InputError` where the folder cannot be written."""
        write_text(self.folder / SUMMARY, json.dumps(summary, sort_keys=True) + "\n")

    def summary(self) -> dict[str, Any] | None:
        """What `finish` was given; None where the stage is not finished."""
        try:
            content = json.loads((self.folder / SUMMARY).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return content if isinstance(content, dict) else None

    def _path(self, part: int) -> Path:
        return self.folder / f"{part:06d}.npz"


def key_of(identity: Mapping[str, Any]) -> str:
    """A key that differs where anything differs that decides a stage's results."""
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=KEY_LENGTH // 2).hexdigest()


def fingerprint(path: Path) -> dict[str, Any]:
    """What tells a file's content from another's, wherever it lies."""
    size = path.stat().st_size
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        for start in np.linspace(0, max(size - SAMPLE_BYTES, 0), SAMPLES).astype(np.int64).tolist():
            file.seek(start)
            digest.update(file.read(SAMPLE_BYTES))
    return {"bytes": size, "digest": digest.hexdigest()}


def hash_of_arrays(*arrays: NDArray[Any]) -> str:
    """A digest of the content of arrays."""
    digest = hashlib.blake2b(digest_size=16)
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def forget_others(shelf: Path, used: set[Path]) -> None:
    """Delete the stages of a camera's shelf that are not among those used."""
    for folder in sorted(shelf.iterdir()) if shelf.is_dir() else ():
        if folder.is_dir() and folder not in used:
            shutil.rmtree(folder, ignore_errors=True)
