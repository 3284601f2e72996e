"""Whether a camera stays where it is, and does not zoom: seen from a picture every second or two.

Each picture is compared with a reference: the first one, in which what was hidden or has changed is filled in later.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.background_motion import Reference, normalise_contrast
from passerby.perception.pictures import Frame

# Pictures are shrunk by a whole factor, which is quick, so that their longer side has about this many pixels. The background
# of a standing camera is located to 0.05 pixels of that, and 0.5 % of a portrait picture's width are still 1.3.
THUMBNAIL_PX = 480

# A camera that stands this far from its place, in parts of the picture's width, has lost its calibration.
MOVED_PART = 0.005
LASTING_S = 5.0

# A reference that is lost before it was recognised so many times was a bad one, full of people or dark: the next one is taken.
KNOWN_AFTER = 3


@dataclass(frozen=True)
class Move:
    """A camera that left its place."""

    seconds: float
    """Timestamp of the first picture that shows it."""
    until: float | None
    """Of the first picture that shows the camera in its place again, after a bump; None: it stayed in the new place."""
    pixels: float | None
    """Median shift of the background, in pixels of the whole picture; None: it shows nothing now that it showed before."""
    zoom: float = 1.0
    """How many times larger the background is than before, where the camera zoomed; 1 where it only moved."""


@dataclass(frozen=True)
class Steadiness:
    """How a camera stood."""

    moves: tuple[Move, ...]
    """In order of time."""
    largest_shake_px: float
    """Largest shift of the background that was no move, in pixels of the whole picture."""
    pictures: int
    """How many were looked at."""
    recognised: int
    """In how many of them the background was recognised."""

    @property
    def lasting(self) -> tuple[Move, ...]:
        """The moves after which the camera stood elsewhere: one calibration does not hold before and after."""
        return tuple(move for move in self.moves if move.until is None)


@dataclass(frozen=True, eq=False)
class _Departure:
    """A camera away from its place, as long as it is not known whether it comes back."""

    seconds: float
    last_seconds: float
    shifts: tuple[float, ...]
    zooms: tuple[float, ...]


class SteadinessWatcher:
    """Watches one camera: `look` at a frame every second or two, in order of time, then ask for the `result`.

    Args:
        size: (width, height) of the pictures, pixels.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._scale = max(1, round(max(size) / THUMBNAIL_PX))
        self._moved_px = MOVED_PART * size[0]
        self._centre = np.array(size, dtype=np.float64) / (2 * self._scale)
        self._reference: Reference | None = None
        self._rest = np.eye(2, 3)
        self._departure: _Departure | None = None
        self._lost: tuple[float, float] | None = None
        self._lost_view: Reference | None = None
        self._moves: list[Move] = []
        self._largest_shake = 0.0
        self._pictures = 0
        self._recognised = 0

    def look(self, frame: Frame) -> None:
        """Take a frame into account; its picture has the size that was promised."""
        self._pictures += 1
        view = normalise_contrast(frame.picture, self._scale)
        found = None if self._reference is None else self._reference.motion_to(view, self._rest)
        if found is None and self._recognised < KNOWN_AFTER:
            self._reference = Reference(view)
            self._recognised = 1
            return
        if found is None:
            self._lose(view, frame.seconds)
            return
        self._recognised += 1
        self._judge(
            frame.seconds, found.motion, found.shift_from(self._rest) * self._scale, found.zoom_from(self._rest, self._centre)
        )

    def result(self) -> Steadiness:
        """What was seen so far."""
        moves = list(self._moves)
        away = self._departure
        if away is not None:
            stayed = len(away.shifts) > 1 or self._lost is not None
            moves.append(Move(away.seconds, None if stayed else away.last_seconds, float(np.median(away.shifts)), _zoom(away)))
        elif self._lost is not None and self._lost[1] - self._lost[0] > LASTING_S:
            moves.append(Move(self._lost[0], None, None))
        return Steadiness(tuple(moves), self._largest_shake, self._pictures, self._recognised)

    def _judge(self, seconds: float, motion: Floats, shift: float, zoom: float) -> None:
        """One more shift against the camera's place: a shake, a bump that is over, or a new place."""
        if shift <= self._moved_px:
            self._lost = self._lost_view = None
            if self._departure is not None:
                self._moves.append(Move(self._departure.seconds, seconds, max(self._departure.shifts), _zoom(self._departure)))
                self._departure = None
            self._largest_shake = max(self._largest_shake, shift)
            return
        left = seconds if self._lost is None else self._lost[0]
        away = self._departure or _Departure(left, seconds, (), ())
        self._departure = _Departure(away.seconds, seconds, (*away.shifts, shift), (*away.zooms, zoom))
        if seconds - away.seconds > LASTING_S:
            self._moves.append(Move(away.seconds, None, float(np.median(self._departure.shifts)), _zoom(self._departure)))
            self._departure = self._lost = self._lost_view = None
            self._rest = motion

    def _lose(self, view: NDArray[np.uint8], seconds: float) -> None:
        """The background is not to be seen. A view that itself stands still from here to the end is another place.

        Someone before the lens goes away again, and a dark room shows nothing that could stand still.
        """
        standing = self._lost_view is not None and self._lost_view.mostly_stands_in(view)
        self._lost_view = Reference(view)
        if not standing:
            self._lost = (seconds, seconds) if self._lost_view.is_rich else None
        elif self._lost is not None:
            self._lost = (self._lost[0], seconds)


def _zoom(away: _Departure) -> float:
    """Of a camera that is away: the median of what its pictures show."""
    return float(np.median(away.zooms))
