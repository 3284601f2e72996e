"""Whether a camera moves or zooms, by the motion of its background in one picture every second or two.

Each picture is compared with a reference: the first one, in which what was hidden or has changed is filled in later.

Small textured patches are followed from a reference to a picture, after local contrast is normalised so that lights do not
matter. As long as enough patches are found where they were, the camera stands, even if many others are hidden by people.
Only where they are not, a similarity that most patches agree on (RANSAC) is a motion of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.pictures import Frame, Picture

# Pictures are shrunk by a whole factor, which is quick, so that their longer side has about this many pixels. The background
# of a standing camera is located to 0.05 pixels of that, and 0.5 % of a portrait picture's width are still 1.3.
THUMBNAIL_PX = 480
# A camera that stands this far from its place, in parts of the picture's width, has lost its calibration.
MOVED_PART = 0.005
LASTING_S = 5.0
# A reference that is lost before it was recognised so many times was a bad one, full of people or dark: the next one is taken.
KNOWN_AFTER = 3
# Thumbnail pixels: a patch's cell, its corner's distance from the border of that, what is compared, contrast's neighbourhood.
CELL = 32
MARGIN = 8
WINDOW = (15, 15)
NORMALISING_PX = 21
# Contrast below this many grey levels is noise and compression; it is not blown up.
NOISE_GREY = 4.0
CONTRAST = 40.0
# Mean difference of a patch that was found again, in units of the normalised picture; unrelated ones differ by 1.1 * CONTRAST.
LARGEST_DIFFERENCE = 18.0
LEAST_CORNER = 1e-3
# A patch agrees with a motion within this many thumbnail pixels.
AGREEMENT_PX = 0.7
# Patches that prove that the camera stands, and that prove a motion: no less than so many, and no less than this part of all,
# and for standing no less than half of those that agree on any other motion.
STANDING_COUNT, STANDING_PART = 10, 0.08
MOTION_COUNT, MOTION_PART = 14, 0.12
# A zoom changes the logarithm of the background's scale by more than this where scaling leaves no more than such a part of its
# shift, and by more than that where the camera was turned as well: a turn by 20 degrees scales parts of a picture by 3 %.
LEAST_ZOOM, ZOOM_LEAVES, TURNED_ZOOM = 0.01, 0.4, 0.1
# A scale beyond these is no zoom and no motion: RANSAC likes to shrink all patches onto one spot.
SCALES = 0.3, 3.5
# A camera within this many thumbnail pixels of its place is measured without looking further.
NEAR_PX = 2.0
# Landmarks that are sought all over a picture when a camera is not near its place.
LANDMARKS = 600
# A patch that was not found for so many pictures is replaced by what is seen there now.
STALE_AFTER = 12


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


def scale_of(size: tuple[int, int]) -> int:
    """By what whole factor pictures of a size (width, height) are shrunk."""
    return max(1, round(max(size) / THUMBNAIL_PX))


def centre_of(size: tuple[int, int]) -> Floats:
    """(2,) middle of pictures of a size (width, height), thumbnail pixels."""
    return np.array(size, dtype=np.float64) / (2 * scale_of(size))


class SteadinessWatcher:
    """Watches one camera: `look` at a frame every second or two, in order of time, then ask for the `result`.

    Args:
        size: (width, height) of the pictures, pixels.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._scale = scale_of(size)
        self._moved_px = MOVED_PART * size[0]
        self._centre = centre_of(size)
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

    @property
    def view(self) -> NDArray[np.uint8] | None:
        """What the camera sees from its first place, a grey thumbnail of normalised contrast; None before the first frame."""
        return None if self._reference is None else self._reference.view

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


@dataclass(frozen=True, eq=False)
class Motion:
    """How the background of a view lies against the reference."""

    motion: Floats
    """(2, 3) similarity from the reference to the view, thumbnail pixels."""
    points: Floats
    """(N, 2) the reference's patches."""
    agreeing: float
    """Part of the patches that agree."""

    def shift_from(self, rest: Floats) -> float:
        """Median way of the patches between another motion and this one, thumbnail pixels."""
        return float(np.median(np.linalg.norm(_apply(self.motion, self.points) - _apply(rest, self.points), axis=1)))

    def zoom_from(self, rest: Floats, centre: Floats) -> float:
        """How many times larger the background is than by another motion, where that is a zoom; else 1.

        A zoom scales it about the picture's centre (2,), thumbnail pixels; a turn barely scales it.
        """
        scale = float(np.sqrt(np.linalg.det(self.motion[:, :2]) / np.linalg.det(rest[:, :2])))
        zoomed = centre + scale * (_apply(rest, self.points) - centre)
        left = float(np.median(np.linalg.norm(_apply(self.motion, self.points) - zoomed, axis=1)))
        explained = left < ZOOM_LEAVES * self.shift_from(rest)
        least = LEAST_ZOOM if explained else TURNED_ZOOM
        return scale if abs(np.log(scale)) > least else 1.0


class Reference:
    """What the camera sees from its place, and the patches by which that is known again."""

    def __init__(self, view: NDArray[np.uint8]) -> None:
        self.view = view.copy()
        rows, columns = max(1, view.shape[0] // CELL), max(1, view.shape[1] // CELL)
        self._cells = np.array([(x * CELL, y * CELL) for y in range(rows) for x in range(columns)])
        self._unseen = np.zeros(len(self._cells), dtype=int)
        self._points = _corners(view, self._cells)

    @property
    def is_rich(self) -> bool:
        """Whether enough patches can be followed."""
        return int(np.isfinite(self._points[:, 0]).sum()) >= MOTION_COUNT

    def motion_to(self, view: NDArray[np.uint8], rest: Floats) -> Motion | None:
        """Motion of the background from the reference to a view, `rest` being where it was lately; None: nothing is certain."""
        usable = np.flatnonzero(np.isfinite(self._points[:, 0]))
        if len(usable) < STANDING_COUNT:
            return None
        points = self._points[usable]
        near, agreeing = _find_near_motion(self.view, view, points, rest)
        other, others = (None, agreeing) if agreeing.mean() > 0.5 else _find_consensus(self.view, view, points, rest)
        if agreeing.sum() >= max(STANDING_COUNT, STANDING_PART * len(points), 0.5 * others.sum()):
            self._refresh(view, usable[agreeing], near)
            return Motion(near, points, float(agreeing.mean()))
        if other is None and (guess := _find_far_motion(self.view, view)) is not None:
            other, others = _find_consensus(self.view, view, points, guess)
        return None if other is None else Motion(other, points, float(others.mean()))

    def mostly_stands_in(self, view: NDArray[np.uint8]) -> bool:
        """Whether at least half of the patches are where they were."""
        found = self.motion_to(view, np.eye(2, 3))
        return found is not None and found.agreeing >= 0.5 and found.shift_from(np.eye(2, 3)) <= AGREEMENT_PX

    def _refresh(self, view: NDArray[np.uint8], found: NDArray[np.intp], motion: Floats) -> None:
        """Replace cells that have not been found for long by what they show now, moved into the reference's place."""
        self._unseen += 1
        self._unseen[found] = 0
        stale = np.flatnonzero(self._unseen >= STALE_AFTER)
        if len(stale) == 0:
            return
        placed = cv2.warpAffine(view, motion, (view.shape[1], view.shape[0]), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        for x, y in self._cells[stale]:
            self.view[y : y + CELL, x : x + CELL] = placed[y : y + CELL, x : x + CELL]
        self._points[stale] = _corners(self.view, self._cells[stale])
        self._unseen[stale] = 0


def normalise_contrast(picture: Picture, scale: int) -> NDArray[np.uint8]:
    """A grey thumbnail with the mean and the contrast of each neighbourhood alike, (H // scale, W // scale) of uint8."""
    height, width = picture.shape[0] // scale, picture.shape[1] // scale
    whole = picture[: height * scale, : width * scale]
    small = whole if scale == 1 else cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(np.float32)
    window = (NORMALISING_PX, NORMALISING_PX)
    mean = cv2.boxFilter(grey, cv2.CV_32F, window)
    variance = cv2.boxFilter(grey * grey, cv2.CV_32F, window) - mean * mean
    level = (grey - mean) / (np.sqrt(np.maximum(variance, 0.0)) + NOISE_GREY) * CONTRAST + 128.0
    return np.clip(level, 0, 255).astype(np.uint8)


def _corners(view: NDArray[np.uint8], cells: NDArray[np.int64]) -> Floats:
    """(N, 2) the strongest corner (Shi and Tomasi 1994) in the middle of each cell; NaN where there is none."""
    strength = cv2.cornerMinEigenVal(view, 5, ksize=3)
    inner = CELL - 2 * MARGIN
    corners = np.full((len(cells), 2), np.nan)
    for row, (x, y) in enumerate(cells):
        part = strength[y + MARGIN : y + CELL - MARGIN, x + MARGIN : x + CELL - MARGIN]
        best = int(part.argmax())
        if part.flat[best] > LEAST_CORNER:
            corners[row] = x + MARGIN + best % inner, y + MARGIN + best // inner
    return corners


def _follow(
    reference: NDArray[np.uint8], view: NDArray[np.uint8], points: Floats, start: Floats, coarsest: int
) -> tuple[Floats, NDArray[np.bool_]]:
    """Where patches arrive (pyramidal Lucas and Kanade; Bouguet 2000), (N, 2), and (N,) which look the same there."""
    before = np.ascontiguousarray(points, dtype=np.float32).reshape(-1, 1, 2)
    guess = np.ascontiguousarray(start, dtype=np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)
    arrived, status, difference = cv2.calcOpticalFlowPyrLK(
        reference,
        view,
        before,
        guess,
        winSize=WINDOW,
        maxLevel=coarsest,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    good = (status.ravel() == 1) & (difference.ravel() <= LARGEST_DIFFERENCE)
    return arrived.reshape(-1, 2).astype(np.float64), good


def _find_consensus(
    reference: NDArray[np.uint8], view: NDArray[np.uint8], points: Floats, guess: Floats
) -> tuple[Floats | None, NDArray[np.bool_]]:
    """The similarity that most patches agree on, and (N,) which do; None and none where they are too few for a motion.

    OpenCV's RANSAC draws from a seed of its own, always the same.
    """
    nobody = np.zeros(len(points), dtype=bool)
    arrived, good = _follow(reference, view, points, _apply(guess, points), coarsest=1)
    if good.sum() < MOTION_COUNT:
        return None, nobody
    motion, inliers = cv2.estimateAffinePartial2D(
        points[good], arrived[good], method=cv2.RANSAC, ransacReprojThreshold=AGREEMENT_PX, maxIters=300, confidence=0.99
    )
    if motion is None:
        return None, nobody
    similarity = np.asarray(motion, dtype=np.float64)
    if not SCALES[0] < np.sqrt(np.linalg.det(similarity[:, :2])) < SCALES[1]:
        return None, nobody
    if inliers.sum() < max(MOTION_COUNT, MOTION_PART * _count_inside(similarity, points, view)):
        return None, nobody
    agreeing = nobody.copy()
    agreeing[np.flatnonzero(good)[inliers.ravel() == 1]] = True
    return similarity, agreeing


def _find_near_motion(
    reference: NDArray[np.uint8], view: NDArray[np.uint8], points: Floats, rest: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """The motion of a camera near its place, and (N,) which patches agree.

    It is their median way, which few patches in one corner cannot tilt. They are followed
    without the coarse levels of the pyramid, into which a neighbour that is hidden would reach.
    """
    there = _apply(rest, points)
    arrived, good = _follow(reference, view, points, there, coarsest=0)
    way = arrived - there
    near = good & (np.linalg.norm(way, axis=1) <= NEAR_PX)
    motion = rest.copy()
    if near.any():
        motion[:, 2] += np.median(way[near], axis=0)
    return motion, near & (np.linalg.norm(arrived - _apply(motion, points), axis=1) <= AGREEMENT_PX)


def _find_far_motion(reference: NDArray[np.uint8], view: NDArray[np.uint8]) -> Floats | None:
    """A motion of any size, by landmarks that look alike (ORB; Rublee et al. 2011); None where there are too few."""
    finder = cv2.ORB.create(nfeatures=LANDMARKS, fastThreshold=10)
    before, words_before = finder.detectAndCompute(reference, None)
    after, words_after = finder.detectAndCompute(view, None)
    if words_before is None or words_after is None:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(words_before, words_after)
    if len(pairs) < MOTION_COUNT:
        return None
    source = np.array([before[pair.queryIdx].pt for pair in pairs])
    target = np.array([after[pair.trainIdx].pt for pair in pairs])
    motion, _ = cv2.estimateAffinePartial2D(
        source, target, method=cv2.RANSAC, ransacReprojThreshold=2.0, maxIters=2000, confidence=0.999
    )
    return None if motion is None else np.asarray(motion, dtype=np.float64)


def _count_inside(motion: Floats, points: Floats, view: NDArray[np.uint8]) -> int:
    """How many points a motion leaves in the picture."""
    moved = _apply(motion, points)
    return int(((moved >= 0) & (moved < view.shape[::-1])).all(axis=1).sum())


def _apply(motion: Floats, points: Floats) -> Floats:
    """(N, 2) points after a (2, 3) motion."""
    return np.asarray(points @ motion[:, :2].T + motion[:, 2])
