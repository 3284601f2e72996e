"""Storage in the output folder of tracklets, which a later run with the same boxes of a camera loads.

Finding tracklets takes most of the association's time. They depend on boxes, keypoints and frame rate alone, not on lengths,
heights or the world frame. The name of a file is a digest of all its inputs and of the code that finds tracklets. A damaged
file counts as missing.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import scipy

from passerby._version import __version__
from passerby.association.camera_tracklets import Tracked
from passerby.common.errors import InputError
from passerby.common.progress import Progress, tell_note
from passerby.core.observations import UNKNOWN, CameraObservations, Clock, Observations
from passerby.interchange.storage.archives import open_archive
from passerby.interchange.storage.atomic import write_bytes
from passerby.interchange.storage.safe_parsing import NotParsed

FOLDER = "association"
"""Name of the folder inside the output folder."""
KEPT_OF_CAMERA = 8
"""Largest number of files for each camera; beyond it, the files that were used longest ago are deleted. One run makes this many
at most: from the boxes as they are, without those from before or after a move of the camera, and with each corrected clock rate
(`MOST_CORRECTIONS`)."""
KEPT = 64
"""Number of files that is always allowed, so that runs of a few cameras with different options can share a folder."""
KEY_BYTES = 16
MADE_AGAIN = "the tracklets kept there are of other boxes or versions, and are made again"


@dataclass(frozen=True)
class KeptTracklets:
    """The kept tracklets of one output folder."""

    folder: Path
    cameras: int = 1
    """Number of cameras of the scene."""

    def has(self, seen: CameraObservations, fps: float) -> bool:
        """Check whether there is a file for these people, which may be damaged."""
        return self._path(seen, fps).is_file()

    def has_all(self, observations: Observations, clocks: Mapping[str, Clock]) -> bool:
        """Check whether there are files for all cameras."""
        return all(self.has(observations[name], clock.fps) for name, clock in clocks.items())

    def tell_of_others(self, observations: Observations, clocks: Mapping[str, Clock], tell: Progress) -> None:
        """Send a note if there are files, but none for any of these people: they are of an earlier run and of no use."""
        if any(self.folder.glob("*.npz")) and not any(self.has(observations[name], clocks[name].fps) for name in clocks):
            tell_note(tell, f"{self.folder}: {MADE_AGAIN}")

    def load(self, seen: CameraObservations, fps: float) -> Tracked | None:
        """Return the tracklets that `save` stored for these people; None without a usable file."""
        path = self._path(seen, fps)
        if not path.is_file():
            return None
        try:
            with open_archive(path, "kept tracklets") as archive:
                boxes, joints, ends, begins = (archive.array(name) for name in ("boxes", "joints", "ends", "begins"))
        except (InputError, NotParsed):
            return None
        for found, length in ((boxes, len(seen.boxes)), (joints, len(seen.keypoints)), (ends, len(begins))):
            if found.dtype != np.int64 or found.shape != (length,) or found.min(initial=0) < UNKNOWN:
                return None
        named = replace(seen, boxes=replace(seen.boxes, identity=boxes), keypoints=replace(seen.keypoints, identity=joints))
        with suppress(OSError):
            os.utime(path)  # marked as used now, so that the files that a run needs are not deleted for those that it makes
        return named, (ends, begins.astype(np.int64))

    def save(self, seen: CameraObservations, fps: float, tracked: Tracked) -> None:
        """Store the tracklets of these people; if the folder cannot be written, nothing is stored."""
        named, (ends, begins) = tracked
        content = io.BytesIO()
        np.savez(content, boxes=named.boxes.identity, joints=named.keypoints.identity, ends=ends, begins=begins)
        with suppress(InputError, OSError):
            write_bytes(self._path(seen, fps), content.getvalue())
            files = sorted(self.folder.glob("*.npz"), key=lambda path: path.stat().st_mtime_ns)
            for path in files[: -max(KEPT, KEPT_OF_CAMERA * self.cameras)]:
                path.unlink(missing_ok=True)

    def _path(self, seen: CameraObservations, fps: float) -> Path:
        return self.folder / f"{_key(seen, fps)}.npz"


def _key(seen: CameraObservations, fps: float) -> str:
    """Return the digest of the people, the frame rate and the code that finds tracklets."""
    digest = hashlib.blake2b(f"{_code()} {float(fps)!r} {seen.keypoints.joints}".encode(), digest_size=KEY_BYTES)
    boxes, joints = seen.boxes, seen.keypoints
    for array in (boxes.frame, boxes.identity, boxes.ltwh, boxes.score, boxes.embedding, joints.frame, joints.identity,
                  joints.xy, joints.score):  # fmt: skip
        if array is None:
            digest.update(b"none")
            continue
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


@cache
def _code() -> str:
    """Return the digest of the code that tracklets depend on, and of the libraries' versions."""
    digest = hashlib.blake2b(f"{__version__} {np.__version__} {scipy.__version__}".encode(), digest_size=KEY_BYTES)
    package = Path(__file__).parents[1]
    for room in ("association", "core", "geometry", "common"):
        for path in sorted((package / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
