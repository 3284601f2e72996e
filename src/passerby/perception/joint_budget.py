"""Which people's keypoints are measured where not everybody's are: all of those who are seen well, at few time steps.

A joint is a point in space only where two cameras see it at one time. So whole time steps are chosen, the same ones in all
cameras, and not people by themselves: a quarter of all boxes at times drawn alike gave 9.6 mm 0.042 degrees, a quarter drawn
box by box 17.5 mm 0.161 degrees, and none 33.8 mm 0.329 degrees (rendered terrace, seed 700, networks, MoveNet lightning).

The choice depends on the boxes and the clock alone, never on measured speed: a run that goes on where another was killed, or
that takes the boxes from what is kept, chooses the same.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.observations import inside_picture

CROPS_PER_S = 3.0
"""Crops a second of video, on average. MoveNet thunder takes 25 ms a crop, lightning 7 ms; YOLOX-nano with the re-ID network
takes about 120 ms for the five images of a second with five people in them."""
CROPS_AT_LEAST = 250.0
"""Crops beyond that, whatever a video's length: a recording of ten seconds with five people in view, looked at five times a
second, gives keypoints at all its times; cameras are registered by these where people barely walk."""
SLOT_S, SLOT_SHIFT_S = 0.4, 0.05
"""Time is cut into slots, of which all images are taken or none. So long, cameras whose clocks differ by a part of a step have
two samples next to each other to interpolate between. The shift keeps a slot's ends away from the times of usual frame
rates."""

MIN_HEIGHT_PX = 40.0
"""Below this, a joint of a person is as uncertain as a joint's distance from its neighbour."""
MOST_COVERED = 0.3
"""The share of a box that the box of a nearer person may cover: legs are hidden behind more of it, and a network finds the
neighbour's."""
MIN_SCORE = 0.4


@dataclass(eq=False)
class JointBudget:
    """Chooses boxes, image after image, as they come."""

    per_s: float
    """Crops a second of video."""
    rate: float
    """Images a second of video."""
    images: int | None
    """How many there will be; None where the video does not tell its length."""
    _seen: int = field(default=0, init=False)
    """Images so far,"""
    _worth: int = field(default=0, init=False)
    """people in them whose keypoints are worth it,"""
    _used: int = field(default=0, init=False)
    """and those of them that were chosen."""

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the choice, the boxes aside."""
        return {"budget": 1, "per_s": self.per_s, "at_least": CROPS_AT_LEAST, "rate": self.rate, "images": self.images}

    def choose(self, seconds: float, ltwh: Floats, score: Floats, size: tuple[int, int]) -> Ints:
        """The rows of the boxes to measure keypoints in.

        Args:
            seconds: time of the image by the video's clock; later than that of the call before.
            ltwh: (N, 4) boxes, pixels.
            score: (N,) their confidence.
            size: width and height of the image, pixels.
        """
        rows = np.flatnonzero(worth_keypoints(ltwh, score, size))
        self._seen += 1
        self._worth += len(rows)
        allowed = CROPS_AT_LEAST + self.per_s * self._seen / self.rate
        if not len(rows) or _draw(seconds) >= self._share() or self._used + len(rows) > allowed:
            return rows[:0]
        self._used += len(rows)
        return rows

    def _share(self) -> float:
        """The share of all slots that the budget lasts for, with as many people in each image as there were so far."""
        per_image = self.per_s / self.rate + (CROPS_AT_LEAST / self.images if self.images else 0.0)
        return per_image * self._seen / self._worth


def worth_keypoints(ltwh: Floats, score: Floats, size: tuple[int, int]) -> Bools:
    """(N,) the people of an image that are large, found with confidence, not hidden behind another, and whole.

    Those whom the image's border cuts off count where no person is whole.

    Args:
        ltwh: (N, 4) boxes, pixels.
        score: (N,) confidence.
        size: width and height of the image, pixels.
    """
    good = (ltwh[:, 3] >= MIN_HEIGHT_PX) & (score >= MIN_SCORE) & (_covered(ltwh) <= MOST_COVERED)
    whole = good & inside_picture(ltwh, size)
    return whole if whole.any() else good


def _covered(ltwh: Floats) -> Floats:
    """(N,) the largest share of each box that one box of a nearer person, whose feet are lower in the image, covers."""
    low, high = ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]
    common = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    area = np.maximum(common, 0.0).prod(axis=2)
    nearer = high[None, :, 1] > high[:, None, 1]
    return np.asarray(np.where(nearer, area, 0.0).max(axis=1, initial=0.0) / np.maximum(ltwh[:, 2:].prod(axis=1), 1e-9))


def _draw(seconds: float) -> float:
    """A number from 0 to 1 for a time, the same in all cameras and without any period.

    Of slots at even distances, cameras whose clocks differ by an unlucky offset would have none in common.
    """
    slot = int((seconds + SLOT_SHIFT_S) // SLOT_S)
    return int.from_bytes(hashlib.blake2b(str(slot).encode(), digest_size=6).digest(), "big") / 2**48
