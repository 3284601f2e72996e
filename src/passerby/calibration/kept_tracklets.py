"""Tracklets that an earlier run found in the same boxes of a camera, kept in its output folder.

They take most of association's time, and depend on boxes, keypoints and frame rate alone, not on lengths, heights or the world
frame. A file is named by a key of all that decides it, the code that finds them too; one that is damaged counts as missing.
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
"""In the output folder."""
KEPT_OF_CAMERA = 8
"""Files for each camera; beyond that, those are deleted that were used longest ago. One run makes this many at most: from the
boxes as they are, without what was seen from another place, and with each corrected clock rate (`MOST_CORRECTIONS`)."""
KEPT = 64
"""Files in any case: runs of a few cameras with other options beside one another."""
KEY_BYTES = 16
MADE_AGAIN = "the tracklets kept there are of other boxes or versions, and are made again"


@dataclass(frozen=True)
class KeptTracklets:
    """The kept tracklets of one output folder."""

    folder: Path
    cameras: int = 1
    """Of the scene."""

    def has(self, seen: CameraObservations, fps: float) -> bool:
        """Whether there is a file for these people, which may be damaged."""
        return self._path(seen, fps).is_file()

    def has_all(self, observations: Observations, clocks: Mapping[str, Clock]) -> bool:
        """Whether there are files for all cameras."""
        return all(self.has(observations[name], clock.fps) for name, clock in clocks.items())

    def tell_of_others(self, observations: Observations, clocks: Mapping[str, Clock], tell: Progress) -> None:
        """Tell where there are files, but none for any of these people: of an earlier run that cannot be gone on with."""
        if any(self.folder.glob("*.npz")) and not any(self.has(observations[name], clocks[name].fps) for name in clocks):
            tell_note(tell, f"{self.folder}: {MADE_AGAIN}")

    def load(self, seen: CameraObservations, fps: float) -> Tracked | None:
        """What `save` was given for these people; None where it was not."""
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
            os.utime(path)  # used now: what a run needs is not deleted for what it makes
        return named, (ends, begins.astype(np.int64))

    def save(self, seen: CameraObservations, fps: float, tracked: Tracked) -> None:
        """Keep what was found in these people; where the folder cannot be written, nothing is kept."""
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
    """Of people and the frame rate, and of what finds tracklets in them."""
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
    """Digest of the code that tracklets depend on, and of the libraries' versions."""
    digest = hashlib.blake2b(f"{__version__} {np.__version__} {scipy.__version__}".encode(), digest_size=KEY_BYTES)
    package = Path(__file__).parents[1]
    for room in ("association", "core", "geometry", "common"):
        for path in sorted((package / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
