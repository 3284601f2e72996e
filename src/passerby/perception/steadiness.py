"""Detection of a camera that moves or zooms, from the motion of its background in one picture every second or two.

Each picture is compared with a reference: the first picture, in which hidden or changed parts are replaced later.

Small textured patches are tracked from a reference to a picture, after local contrast was normalised so that light changes have
no effect. As long as enough patches are found at their places, the camera stands still, even if people hide many others. Only
if they are not, a similarity that most patches agree on (RANSAC) is a motion of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.perception.pictures import Frame, Picture

# Pictures are reduced by a whole factor, which is fast, so that their longer side has about this many pixels. The background of
# a standing camera is located to 0.05 of these pixels, and 0.5 % of a portrait picture's width is still 1.3.
THUMBNAIL_PX = 480
# A camera that is this far from its place, as a share of the picture's width, has lost its calibration.
MOVED_PART = 0.005
LASTING_S = 5.0
# A reference that is lost before it was recognised this many times was unsuitable, full of people or dark: a new one is taken.
KNOWN_AFTER = 3
# Thumbnail pixels: a patch's cell, distance of its corner from the cell's border, compared window, neighbourhood for contrast.
CELL = 32
MARGIN = 8
WINDOW = (15, 15)
NORMALISING_PX = 21
# Contrast below this many grey levels is noise and compression; it is not amplified.
NOISE_GREY = 4.0
CONTRAST = 40.0
# Largest mean difference of a patch found again, in the normalised picture; that of unrelated ones is 1.1 * CONTRAST.
LARGEST_DIFFERENCE = 18.0
LEAST_CORNER = 1e-3
# A patch agrees with a motion if it is within this many thumbnail pixels of it.
AGREEMENT_PX = 0.7
# Least number of patches, and least share of all, that prove that the camera stands still, and that prove a motion. For a
# standing camera there must also be at least half as many as agree on any other motion.
STANDING_COUNT, STANDING_PART = 10, 0.08
MOTION_COUNT, MOTION_PART = 14, 0.12
# Least change of the logarithm of the background's scale for a zoom: the first value where scaling leaves at most the second,
# as a share, of the shift; the third where the camera was turned as well. A turn by 20 degrees scales parts of a picture by 3
# %.
LEAST_ZOOM, ZOOM_LEAVES, TURNED_ZOOM = 0.01, 0.4, 0.1
# A scale outside of these limits is no zoom and no motion: RANSAC tends to shrink all patches to one point.
SCALES = 0.3, 3.5
# For a camera within this many thumbnail pixels of its place, no other motion is searched for.
NEAR_PX = 2.0
# Number of landmarks that are searched for all over a picture when a camera is not near its place.
LANDMARKS = 600
# A patch that was not found in this many pictures is replaced by what is seen there now.
STALE_AFTER = 12


@dataclass(frozen=True)
class Move:
    """A camera that left its place."""

    seconds: float
    """Timestamp of the first picture that shows it."""
    until: float | None
    """Timestamp of the first picture with the camera in its place again, after a bump; None: it stayed in the new place."""
    pixels: float | None
    """Median shift of the background, in pixels of the whole picture; None: no part of the earlier background is recognised."""
    zoom: float = 1.0
    """Scale of the background after a zoom over that before; 1 where the camera only moved."""


@dataclass(frozen=True)
class Steadiness:
    """Motion of a camera during a recording."""

    moves: tuple[Move, ...]
    """The moves, in order of time."""
    largest_shake_px: float
    """Largest shift of the background that was no move, in pixels of the whole picture."""
    pictures: int
    """Number of pictures that were compared."""
    recognised: int
    """Number of pictures in which the background was recognised."""

    @property
    def lasting(self) -> tuple[Move, ...]:
        """The moves after which the camera stayed elsewhere: one calibration is not valid before and after."""
        return tuple(move for move in self.moves if move.until is None)


@dataclass(frozen=True, eq=False)
class _Departure:
    """A camera away from its place, until it is known whether it comes back."""

    seconds: float
    last_seconds: float
    shifts: tuple[float, ...]
    zooms: tuple[float, ...]


def scale_of(size: tuple[int, int]) -> int:
    """Return the whole factor by which pictures of a size (width, height) are reduced."""
    return max(1, round(max(size) / THUMBNAIL_PX))


def centre_of(size: tuple[int, int]) -> Floats:
    """Return the middle (2,) of pictures of a size (width, height), thumbnail pixels."""
    return np.array(size, dtype=np.float64) / (2 * scale_of(size))


class SteadinessWatcher:
    """Detects the motion of one camera: call `look` with a frame every second or two, in order of time, then `result`.

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
        """Evaluate a frame; its picture must have the stated size."""
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
        """The camera's view from its first place, a grey thumbnail of normalised contrast; None before the first frame."""
        return None if self._reference is None else self._reference.view

    def result(self) -> Steadiness:
        """Return the result so far."""
        moves = list(self._moves)
        away = self._departure
        if away is not None:
            stayed = len(away.shifts) > 1 or self._lost is not None
            moves.append(Move(away.seconds, None if stayed else away.last_seconds, float(np.median(away.shifts)), _zoom(away)))
        elif self._lost is not None and self._lost[1] - self._lost[0] > LASTING_S:
            moves.append(Move(self._lost[0], None, None))
        return Steadiness(tuple(moves), self._largest_shake, self._pictures, self._recognised)

    def _judge(self, seconds: float, motion: Floats, shift: float, zoom: float) -> None:
        """Evaluate one shift from the camera's place: a shake, the end of a bump, or a new place."""
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
        """Handle a picture without the background. A view that itself stands still from here to the end is another place.

        A person in front of the lens goes away again, and a dark room shows no patches that could stand still.
        """
        standing = self._lost_view is not None and self._lost_view.mostly_stands_in(view)
        self._lost_view = Reference(view)
        if not standing:
            self._lost = (seconds, seconds) if self._lost_view.is_rich else None
        elif self._lost is not None:
            self._lost = (self._lost[0], seconds)


def _zoom(away: _Departure) -> float:
    """Return the zoom of a camera that is away: the median over its pictures."""
    return float(np.median(away.zooms))


@dataclass(frozen=True, eq=False)
class Motion:
    """Position of a view's background relative to the reference."""

    motion: Floats
    """(2, 3) similarity from the reference to the view, thumbnail pixels."""
    points: Floats
    """(N, 2) positions of the reference's patches."""
    agreeing: float
    """Share of the patches that agree."""

    def shift_from(self, rest: Floats) -> float:
        """Return the median distance of the patches between another motion and this one, thumbnail pixels."""
        return float(np.median(np.linalg.norm(_apply(self.motion, self.points) - _apply(rest, self.points), axis=1)))

    def zoom_from(self, rest: Floats, centre: Floats) -> float:
        """Return the scale of the background relative to another motion, where that is a zoom; else 1.

        A zoom scales it about the picture's centre (2,), thumbnail pixels; a turn has little effect on the scale.
        """
        scale = float(np.sqrt(np.linalg.det(self.motion[:, :2]) / np.linalg.det(rest[:, :2])))
        zoomed = centre + scale * (_apply(rest, self.points) - centre)
        left = float(np.median(np.linalg.norm(_apply(self.motion, self.points) - zoomed, axis=1)))
        explained = left < ZOOM_LEAVES * self.shift_from(rest)
        least = LEAST_ZOOM if explained else TURNED_ZOOM
        return scale if abs(np.log(scale)) > least else 1.0


class Reference:
    """The camera's view from its place, and the patches by which it is recognised."""

    def __init__(self, view: NDArray[np.uint8]) -> None:
        self.view = view.copy()
        rows, columns = max(1, view.shape[0] // CELL), max(1, view.shape[1] // CELL)
        self._cells = np.array([(x * CELL, y * CELL) for y in range(rows) for x in range(columns)])
        self._unseen = np.zeros(len(self._cells), dtype=int)
        self._points = _corners(view, self._cells)

    @property
    def is_rich(self) -> bool:
        """Whether there are enough patches to be tracked."""
        return int(np.isfinite(self._points[:, 0]).sum()) >= MOTION_COUNT

    def motion_to(self, view: NDArray[np.uint8], rest: Floats) -> Motion | None:
        """Estimate the motion of the background from the reference to a view; `rest` is the last one. None if uncertain."""
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
        """Check whether at least half of the patches are at their places."""
        found = self.motion_to(view, np.eye(2, 3))
        return found is not None and found.agreeing >= 0.5 and found.shift_from(np.eye(2, 3)) <= AGREEMENT_PX

    def _refresh(self, view: NDArray[np.uint8], found: NDArray[np.intp], motion: Floats) -> None:
        """Replace cells that were not found for a long time by their present content, moved to the reference's place."""
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
    """Return a grey thumbnail with equal mean and contrast in all neighbourhoods, (H // scale, W // scale) of uint8."""
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
    """Find the strongest corner (Shi and Tomasi 1994) in the middle of each cell, (N, 2); NaN where there is none."""
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
    """Track patches (pyramidal Lucas and Kanade; Bouguet 2000): positions (N, 2), and whether each looks the same (N,)."""
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
    """Find the similarity that most patches agree on, and which agree (N,); None and none if too few for a motion.

    OpenCV's RANSAC uses a seed of its own, always the same.
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
    """Estimate the motion of a camera near its place, and which patches agree (N,).

    It is the median shift of the patches, so that a few patches in one corner cannot tilt it. They are tracked without the
    coarse levels of the pyramid, on which a hidden neighbour would affect them.
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
    """Estimate a motion of any size from landmarks that look alike (ORB; Rublee et al. 2011); None with too few of them."""
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
    """Count the points that are inside of the picture after a motion."""
    moved = _apply(motion, points)
    return int(((moved >= 0) & (moved < view.shape[::-1])).all(axis=1).sum())


def _apply(motion: Floats, points: Floats) -> Floats:
    """Apply a motion (2, 3) to points (N, 2)."""
    return np.asarray(points @ motion[:, :2].T + motion[:, 2])
