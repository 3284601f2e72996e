"""Whether the files of a video are still what they were, and what tells their content from others'."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from passerby.perception.kept import SAMPLES, fingerprint
from passerby.perception.video_probe import VideoInfo

LEAST_SAMPLES = 2
"""Of each piece's content; a piece of ten seconds is known by its size, beginning and end."""


def video_identity(info: VideoInfo) -> dict[str, Any]:
    """What decides the pictures of a video and their numbers, as plain values: its content, wherever it lies."""
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
    """The files of a video as they were when the reading began."""

    def __init__(self, info: VideoInfo) -> None:
        self._begins = [piece.begin_s for piece in info.pieces] or [0.0]
        self._files = info.files
        self._states = [_state(path) for path in self._files]
        self._single, self._next = not info.pieces, 0

    def grown(self, path: Path) -> bool:
        """Whether a file that has changed is the same one, longer: it is still being written."""
        (node, size, _), (before, shorter, _) = _state(path), self._states[self._files.index(path)]
        return node == before and size > shorter > 0

    def changed(self, seconds: float) -> Path | None:
        """The first file that was written or replaced since, of those that begin by this second and were not checked before."""
        if self._single:
            return self._files[0] if _state(self._files[0]) != self._states[0] else None
        # The piece at hand is looked at again when it is over.
        while self._next < len(self._files) and self._begins[self._next] <= seconds:
            if _state(self._files[self._next]) != self._states[self._next]:
                return self._files[self._next]
            self._next += 1
        self._next = max(0, self._next - 1)
        return None


def _state(path: Path) -> tuple[int, ...]:
    """What changes when a file is written or replaced; zeros where it is gone, which those tell of who read it."""
    try:
        found = path.stat()
    except OSError:
        return (0, 0, 0)
    return found.st_ino, found.st_size, found.st_mtime_ns
