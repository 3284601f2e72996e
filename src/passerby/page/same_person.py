"""The person at a pixel in the other cameras, as the last calibration identified people: so that one can see if it is right."""

from __future__ import annotations

import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.core.observations import Boxes, CameraObservations, Clock
from passerby.core.pointing import find_pointed, nearest_frame
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.output_folder import OutputFolder, read_output

MOST_SHOWN = 12
"""Other cameras whose pictures are shown at once: each is a picture to be decoded."""


@dataclass(frozen=True)
class SeenPerson:
    """The person in one camera, at the moment nearest to that of the click."""

    camera: str
    frame: int
    box: tuple[float, float, float, float]
    """Left, top, width, height, pixels."""
    size: tuple[int, int]
    """Of the whole picture, pixels."""
    late_s: float | None
    """After the moment of the click, seconds; None where frames are counted alike and have no times."""
    late_frames: int
    """The same in frames of that camera."""


@dataclass(frozen=True)
class SamePerson:
    """One identity of the last calibration."""

    identity: int | None
    """None if no identified person is at the pixel."""
    seen: tuple[SeenPerson, ...] = ()
    """The camera of the click first, then others, those of the nearest moments first; at most `MOST_SHOWN` others."""
    further: tuple[str, ...] = ()
    """Cameras that saw the person as well."""
    unseen: tuple[str, ...] = ()
    """Cameras that never saw the person."""

    def to_dict(self) -> dict[str, object]:
        """As plain values for JSON."""
        return asdict(self)


@dataclass(eq=False)
class IdentifiedPeople:
    """Everybody whom the calibration of a folder identified; read once for each calibration."""

    out: Path
    _read: tuple[tuple[int, int], OutputFolder] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def find(self, camera: str, frame: int, at: tuple[float, float]) -> SamePerson:
        """The person at a pixel of a camera's frame.

        Raises `InputError` where there is no calibration, or the camera has no pose in it.
        """
        folder = self._folder()
        if camera not in folder.boxes:
            raise InputError(
                f"camera {camera} has no pose in the last calibration, so it has no identified people: solve again"
            )
        return find_same_person(folder, camera, frame, at)

    def _folder(self) -> OutputFolder:
        """The calibration as it is now."""
        with self._lock:
            try:
                stat = (self.out / CALIBRATION_FILE).stat()
            except OSError:
                raise InputError("no person is identified yet: calibrate first") from None
            stamp = stat.st_mtime_ns, stat.st_size
            if self._read is None or self._read[0] != stamp:
                self._read = stamp, read_output(self.out)
            return self._read[1]


def find_same_person(folder: OutputFolder, camera: str, frame: int, at: tuple[float, float]) -> SamePerson:
    """The person at a pixel of a camera's frame, in all cameras.

    The frame of the camera is the one that a known height at this pixel is looked for in; pixels are OpenCV's.
    """
    own, clock = folder.boxes[camera], folder.clocks.get(camera)
    near = nearest_frame(CameraObservations(own), frame, None if clock is None else clock.fps)
    pointed = None if near is None else find_pointed(CameraObservations(own), near, at)
    if near is None or pointed is None:
        return SamePerson(None)
    row = pointed[1]
    identity = int(own.identity[row])
    first = _seen(folder, camera, own, row, near, clock)
    others, unseen = [], []
    for name in folder.rig.names:
        found = None if name == camera else _nearest(folder, name, identity, near, clock)
        if found is not None:
            others.append(found)
        elif name != camera:
            unseen.append(name)
    others.sort(key=lambda one: abs(one.late_frames if one.late_s is None else one.late_s))
    further = tuple(one.camera for one in others[MOST_SHOWN:])
    return SamePerson(identity, (first, *others[:MOST_SHOWN]), further, tuple(unseen))


def _nearest(folder: OutputFolder, name: str, identity: int, frame: int, clock: Clock | None) -> SeenPerson | None:
    """An identity in another camera, when it is nearest in time to a frame of the camera whose clock this is."""
    boxes, other = folder.boxes[name], folder.clocks.get(name)
    rows = np.flatnonzero(boxes.identity == identity)
    if not len(rows):
        return None
    wanted = float(frame)
    if clock is not None and other is not None:
        wanted = float(other.frames(clock.seconds(np.array([frame])))[0])
    row = int(rows[np.argmin(np.abs(boxes.frame[rows] - wanted))])
    return _seen(folder, name, boxes, row, wanted, other)


def _seen(folder: OutputFolder, name: str, boxes: Boxes, row: int, wanted: float, clock: Clock | None) -> SeenPerson:
    """A row of a camera's boxes, against the frame that it should have."""
    late = float(boxes.frame[row]) - wanted
    left, top, width, height = (round(float(value), 1) for value in boxes.ltwh[row])
    late_s = None if clock is None else round(late / clock.fps, 3)
    return SeenPerson(name, int(boxes.frame[row]), (left, top, width, height), folder.rig[name].lens.size, late_s, round(late))
