"""Results of stages kept in the output folder, so that a stopped run continues, and checks that their videos are unchanged.

A stage's results are in a folder whose name has a key of everything that determines them: input, options, network and library
versions. They are written in parts, each completely or not at all, and a summary states that there are no more parts. Each file
has a digest; a damaged file counts as missing and is made again.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.interchange.storage.atomic import PART, cannot_write, write_bytes, write_text
from passerby.perception.video_probe import VideoInfo

LEAST_SAMPLES = 2
"""Least number of samples of each piece's content: the size, beginning and end identify a piece of ten seconds."""


try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


Arrays = dict[str, NDArray[Any]]
SUMMARY = "summary.txt"
"""Its content is a line of JSON, and the digest of that."""
KEY_LENGTH = 20
DIGEST_BYTES = 16
SAMPLES, SAMPLE_BYTES = 64, 1 << 16
"""A file is identified by its size and by this number of evenly spread samples of its content: a hash of the whole content
would take minutes for the recordings of a day."""


@dataclass(frozen=True)
class StageCache:
    """The kept results of one stage of one camera."""

    folder: Path
    key: str

    @classmethod
    def of(cls, shelf: Path, stage: str, identity: Mapping[str, Any]) -> StageCache:
        """Return the stage with this identity on a camera's shelf."""
        key = key_of(identity)
        return cls(shelf / f"{stage}-{key}", key)

    def load(self, part: int) -> Arrays | None:
        """Return the arrays of a part; None where it is missing or damaged."""
        try:
            content = self._path(part).read_bytes()
        except OSError:
            return None
        archive, digest = content[:-DIGEST_BYTES], content[-DIGEST_BYTES:]
        if _digest(archive) != digest:
            return None
        with np.load(io.BytesIO(archive), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}

    def save(self, part: int, arrays: Arrays) -> None:
        """Keep a part, completely or not at all. Raises `InputError` where the folder cannot be written."""
        archive = io.BytesIO()
        np.savez(archive, **arrays)  # type: ignore[arg-type]
        # The archive's own checksums do not include its directory and headers. Readers ignore data after the archive.
        write_bytes(self._path(part), archive.getvalue() + _digest(archive.getvalue()))

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the summary: all parts are there. Raises `InputError` where the folder cannot be written."""
        text = json.dumps(summary)
        write_text(self.folder / SUMMARY, f"{text}\n{_digest(text.encode()).hex()}\n")

    def summary(self) -> dict[str, Any] | None:
        """Return the argument of `finish`; None where the stage is not finished."""
        try:
            text, digest = (self.folder / SUMMARY).read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            return None
        if _digest(text.encode()).hex() != digest:
            return None
        content: dict[str, Any] = json.loads(text)
        return content

    def _path(self, part: int) -> Path:
        return self.folder / f"{part:06d}.npz"


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()


@contextmanager
def cache_lock(shelf: Path) -> Iterator[None]:
    """Lock a camera's shelf for this process; another run in the same folder waits, and then finds the kept results.

    A lock ends with its process, even if that is killed. Where the system has no such locks, two runs are not separated.
    Raises `InputError` where the folder cannot be made.
    """
    try:
        shelf.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(shelf, error) from error
    if fcntl is None:
        yield
        return
    handle = os.open(shelf, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def key_of(identity: Mapping[str, Any]) -> str:
    """Return a key that changes with everything that determines a stage's results."""
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=KEY_LENGTH // 2).hexdigest()


def fingerprint(path: Path, samples: int = SAMPLES) -> dict[str, Any]:
    """Return size and digest of samples, which identify a file's content independent of its path."""
    size = path.stat().st_size
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        for start in np.linspace(0, max(size - SAMPLE_BYTES, 0), samples).astype(np.int64).tolist():
            file.seek(start)
            digest.update(file.read(SAMPLE_BYTES))
    return {"bytes": size, "digest": digest.hexdigest()}


def hash_of_arrays(*arrays: NDArray[Any]) -> str:
    """Return a digest of the content of arrays."""
    digest = hashlib.blake2b(digest_size=16)
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def forget_others(shelf: Path, used: set[Path]) -> None:
    """Delete the stages of a camera's shelf that are not in `used`, and incomplete files of killed runs."""
    for folder in sorted(shelf.iterdir()) if shelf.is_dir() else ():
        if folder.is_dir() and folder not in used:
            shutil.rmtree(folder, ignore_errors=True)
    for half in sorted(shelf.glob(f"*/.*{PART}")):
        half.unlink(missing_ok=True)


def video_identity(info: VideoInfo) -> dict[str, Any]:
    """Return what determines the pictures of a video and their numbers, as plain values: its content, not its path."""
    if not info.pieces:
        if not info.frame_times:
            return fingerprint(info.path)
        times = hashlib.blake2b(json.dumps(info.frame_times).encode(), digest_size=16).hexdigest()
        return {**fingerprint(info.path), "frame_times": times}
    samples = max(LEAST_SAMPLES, SAMPLES // len(info.pieces))
    digest, size = hashlib.blake2b(digest_size=16), 0
    for piece in info.pieces:
        content = fingerprint(piece.path, samples)
        size += content["bytes"]
        digest.update(json.dumps([round(piece.begin_s, 6), content], sort_keys=True).encode())
    return {
        "bytes": size,
        "digest": digest.hexdigest(),
        "clock": info.clock_fps,
        "used": [str(end) for end in info.used],
    }


class VideoFilesState:
    """State of the files of a video when the reading began, to detect changes."""

    def __init__(self, info: VideoInfo) -> None:
        self._begins = [piece.begin_s for piece in info.pieces] or [0.0]
        self._files = info.files
        self._states = [_state(path) for path in self._files]
        self._single, self._next = not info.pieces, 0

    def grown(self, path: Path) -> bool:
        """Check whether a changed file is the same one, longer: it is still being written."""
        (node, size, _), (before, shorter, _) = _state(path), self._states[self._files.index(path)]
        return node == before and size > shorter > 0

    def changed(self, seconds: float) -> Path | None:
        """Return the first file written or replaced since, of those that begin by this second and were not checked before."""
        if self._single:
            return self._files[0] if _state(self._files[0]) != self._states[0] else None
        # The present piece is checked again when it is over.
        while self._next < len(self._files) and self._begins[self._next] <= seconds:
            if _state(self._files[self._next]) != self._states[self._next]:
                return self._files[self._next]
            self._next += 1
        self._next = max(0, self._next - 1)
        return None


def _state(path: Path) -> tuple[int, ...]:
    """Return what changes when a file is written or replaced; zeros where it is missing, which the reader of it reports."""
    try:
        found = path.stat()
    except OSError:
        return (0, 0, 0)
    return found.st_ino, found.st_size, found.st_mtime_ns
