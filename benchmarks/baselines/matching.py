"""What a matcher is, what it finds, and what several of them share."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.solver.geopose.correspondences import ImagePoints, numbered_points

SAME_PX = 0.01  # matches whose places in the reference's picture agree to this are of one keypoint


def pooled_points(rig: Rig, reference: str, moments: Sequence[Mapping[str, Matches]], sigma_px: float = 1.0) -> ImagePoints:
    """Matches of the reference with other cameras, at several moments of cameras that stand still, as points.

    The same keypoint of the reference's picture at the same moment is the same point, in whichever cameras it was matched. A
    place of a picture is used once: the surer match wins.

    Args:
        rig: names and lenses.
        reference: the camera whose pictures are the first of every pair.
        moments: for each moment, camera -> the matches of the reference's picture with that camera's.
        sigma_px: standard deviation of every place.

    Raises:
        InputError: a camera that the rig lacks.
    """
    seen: dict[str, list[tuple[Ints, Floats]]] = {reference: []}
    count = 0
    for pairs in moments:
        kept = {name: _single(matches) for name, matches in pairs.items()}
        places = [np.round(matches.xy_a / SAME_PX).astype(np.int64) for matches in kept.values()]
        keys, first, number = np.unique(
            np.concatenate([np.zeros((0, 2), dtype=np.int64), *places]), axis=0, return_index=True, return_inverse=True
        )
        xy = np.concatenate([np.zeros((0, 2)), *(matches.xy_a for matches in kept.values())])
        seen[reference].append((count + np.arange(len(keys)), xy[first]))
        ends = np.cumsum([0, *(len(matches) for matches in kept.values())])
        for (name, matches), begin, end in zip(kept.items(), ends[:-1], ends[1:], strict=True):
            seen.setdefault(name, []).append((count + number.reshape(-1)[begin:end], matches.xy_b))
        count += len(keys)
    sightings = {
        name: (np.concatenate([numbers for numbers, _ in parts]), np.concatenate([pixels for _, pixels in parts]))
        for name, parts in seen.items()
        if parts
    }
    return numbered_points(rig, sightings, sigma_px)


def _single(matches: Matches) -> Matches:
    """The surest match of every place, in either picture."""
    order = np.argsort(-matches.score, kind="stable")
    for ends in (matches.xy_a, matches.xy_b):
        cells = np.round(ends[order] / SAME_PX)
        order = order[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    return matches.take(np.sort(order))


Picture = NDArray[np.uint8]  # (H, W) grey levels or (H, W, 3) BGR, 0 to 255

MAX_FEATURES = 2048
"""Features of a picture, the strongest: what SuperGlue's and LightGlue's authors use for outdoor pictures. The same for all."""
ROWS_AT_ONCE = 2048
TRIED = 10  # so many nearest features are looked through for one that shows another place; if none does, the nearest is safe
KEPT_PICTURES = 16  # a star of pairs needs the reference's features again and again, and those of a few moments


class Unavailable(Exception):
    """A matcher that cannot run here. The message is one line that says what is missing and how to get it."""


@dataclass(frozen=True, eq=False)
class Matches:
    """N pairs of places in two pictures that may show the same point."""

    xy_a: Floats  # (N, 2) pixels in the first picture, as OpenCV counts them: the middle of the first pixel is 0, 0
    xy_b: Floats  # (N, 2) in the second
    score: Floats  # (N,) how sure the matcher is, by its own measure; more is better

    def __len__(self) -> int:
        return len(self.xy_a)

    @classmethod
    def none(cls) -> Matches:
        """No matches."""
        return cls(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))

    def take(self, rows: NDArray[np.generic]) -> Matches:
        """The matches of the given rows (indices or a mask)."""
        return Matches(self.xy_a[rows], self.xy_b[rows], self.score[rows])


class Matcher(Protocol):
    """Finds matches between two pictures; the same pictures give the same matches."""

    def __call__(self, a: Picture, b: Picture) -> Matches:
        """Matches between two pictures, in their pixels."""


@dataclass(frozen=True, eq=False)
class Features:
    """N places of a picture and what they look like."""

    xy: Floats  # (N, 2) pixels
    descriptor: NDArray[np.float32]  # (N, D) unit vectors

    def __len__(self) -> int:
        return len(self.xy)


Seen = TypeVar("Seen")


class Remembered(Generic[Seen]):
    """A function of a picture that keeps its last answers."""

    def __init__(self, function: Callable[[Picture], Seen]) -> None:
        self._function = function
        self._kept: dict[bytes, Seen] = {}

    def __call__(self, picture: Picture) -> Seen:
        """The answer to this picture."""
        key = hashlib.blake2b(picture.tobytes(), digest_size=16).digest() + str(picture.shape).encode()
        if key not in self._kept:
            while len(self._kept) >= KEPT_PICTURES:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = self._function(picture)
        return self._kept[key]


class BruteForce:
    """Matches each picture's features by their nearest neighbours, mutually."""

    def __init__(self, describe: Callable[[Picture], Features], ratio: float | None) -> None:
        self._describe = Remembered(describe)
        self._ratio = ratio

    def __call__(self, a: Picture, b: Picture) -> Matches:
        """See `Matcher`."""
        return nearest_matches(self._describe(a), self._describe(b), self._ratio)


def nearest_matches(a: Features, b: Features, ratio: float | None, apart_px: float = 0.0) -> Matches:
    """Features that are each other's nearest, by the angle of their descriptors.

    Args:
        a: of one picture.
        b: of the other.
        ratio: the nearest must be nearer than so many times the second nearest (Lowe, IJCV 2004); None: no such test.
        apart_px: features this close together show one place: the second nearest is the first that shows another (Mishkin,
            Matas, Perdoch, CVIU 2015, section 3.3). 0: every feature is a place of its own.

    Returns:
        The matches; the score is the cosine of the angle.
    """
    if not len(a) or not len(b):
        return Matches.none()
    near = _nearest(a, b, apart_px)
    good = np.linalg.norm(a.xy[near.back[near.index]] - a.xy, axis=1) <= apart_px
    if ratio is not None:
        # Of unit vectors: |x - y|^2 = 2 - 2 cosine.
        good &= (1 - near.first) < ratio**2 * (1 - near.second)
    rows = np.flatnonzero(good)
    return Matches(a.xy[rows], b.xy[near.index[rows]], near.first[rows].astype(np.float64))


@dataclass(frozen=True, eq=False)
class _Nearest:
    first: NDArray[np.float32]  # (N,) cosine with the nearest feature of the other picture
    second: NDArray[np.float32]  # (N,) with the nearest that shows another place
    index: Ints  # (N,) the nearest
    back: Ints  # (M,) the nearest feature of this picture of each of the other's


def _nearest(a: Features, b: Features, apart_px: float) -> _Nearest:
    """Nearest neighbours in both directions, from one table of cosines that is made a stretch at a time."""
    first, second, index = [], [], []
    back, back_cosine = np.zeros(len(b), dtype=np.int64), np.full(len(b), -2, dtype=np.float32)
    for start in range(0, len(a), ROWS_AT_ONCE):
        cosine = a.descriptor[start : start + ROWS_AT_ONCE] @ b.descriptor.T
        column = cosine.argmax(axis=0)
        better = cosine[column, np.arange(len(b))] > back_cosine
        back[better], back_cosine[better] = start + column[better], cosine[column, np.arange(len(b))][better]
        best, row = cosine.argmax(axis=1), np.arange(len(cosine))
        index.append(best)
        first.append(cosine[row, best])
        if apart_px == 0:
            cosine[row, best] = -1
            second.append(cosine.max(axis=1))
            continue
        tried = np.argpartition(-cosine, min(TRIED, len(b) - 1), axis=1)[:, :TRIED]
        elsewhere = np.linalg.norm(b.xy[tried] - b.xy[best][:, None], axis=2) > apart_px
        second.append(np.where(elsewhere, np.take_along_axis(cosine, tried, axis=1), -1).max(axis=1))
    return _Nearest(np.concatenate(first), np.concatenate(second), np.concatenate(index), back)


def grey(picture: Picture) -> Picture:
    """(H, W) grey levels."""
    return picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def bgr(picture: Picture) -> Picture:
    """(H, W, 3)."""
    return picture if picture.ndim == 3 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
