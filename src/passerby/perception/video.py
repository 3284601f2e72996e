"""Videos as sequences of pictures: decoded in order, sampled at a rate, for a file of any length.

The choice of pictures depends on their timestamps alone, never on where the reading began. Only chosen pictures are converted
from the colours of the codec.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter

from passerby.common.errors import InputError
from passerby.perception.file_reading import SHORTFALL_S, Decoded, FileReading, IsWanted
from passerby.perception.pictures import Frame, Picture, VideoError
from passerby.perception.video_probe import GRID_TOLERANCE_S, Piece, VideoInfo, fit_of_size, open_video, probe

__all__ = ["Decoded", "VideoInfo", "VideoReader", "expected_count", "fit_of_size", "frames", "probe"]

# If more than the first of a piece is skipped, the piece is entered at a key frame. This is searched for the second before the
# first wanted picture, because the indices of containers may be off by a second.
SOUGHT_FROM_S, SOUGHT_BEFORE_S = 20.0, 2.0

# For rates below this, groups of pictures without a wanted one are not decoded.
SPARSE_RATE = 1.0

TURNS = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_CLOCKWISE}


class VideoReader:
    """The pictures of a video file, sampled: iterate over it, then read `decoded`.

    Args:
        video: the file, or the result of `probe`.
        rate: wanted pictures per second: the first one at or after each k / rate seconds is chosen. None, or the video's own
            rate or more: all of them.
        after: only pictures with a number above this one, the same as would follow it in a full reading.
        threads: number of threads of the decoder; the pictures do not depend on it.

    Raises:
        InputError: as `probe`; a rate that is not above 0; while iterating: the size of the pictures changes, or none decodes.
    """

    def __init__(self, video: VideoInfo | str | Path, rate: float | None = None, after: int = 0, threads: int = 1) -> None:
        self.info = video if isinstance(video, VideoInfo) else probe(video)
        if rate is not None and not (rate > 0 and math.isfinite(rate)):
            raise InputError(f"{self.info.path}: {rate} frames per second cannot be chosen: give a number above 0")
        self.rate = None if rate is None or _is_every_picture(self.info, rate) else rate
        self.after = after
        self.threads = threads
        self.decoded: Decoded | None = None
        """None until an iteration has reached the end of the file."""

    def __iter__(self) -> Iterator[Frame]:
        self.decoded = None
        is_wanted = self._chooser() if self.rate is not None and self.rate < SPARSE_RATE else None
        after = self.after if self.rate is None else 0
        reading = _Recording(self.info, self.threads, after, is_wanted) if self.info.pieces else None
        file = FileReading(self.info, is_wanted)
        pictures = _read_one_file(self.info, file, self.threads) if reading is None else reading.pictures()
        last_tick, yielded = -1, 0
        for number, seconds, picture in pictures:
            tick = self._tick(number, seconds)
            if tick <= last_tick:
                continue
            last_tick = tick
            if number > self.after:
                yielded += 1
                yield Frame(number, seconds, self._convert_frame(number, picture))
        self.decoded = file.summary(yielded) if reading is None else reading.summary(yielded)

    def _convert_frame(self, number: int, picture: Callable[[], Picture]) -> Picture:
        """Convert a picture. Raises `InputError` where a damaged header states an invalid pixel format."""
        try:
            return picture()
        except FFmpegError as error:
            raise InputError(
                f"{self.info.path}: picture {number} cannot be converted ({error.strerror}): copy or encode the video again"
            ) from None

    def _chooser(self) -> IsWanted:
        """Return a function that states for each picture in turn, before it is decoded, whether it will be chosen."""
        last_tick = -1

        def is_wanted(number: int, seconds: float) -> bool:
            nonlocal last_tick
            tick = self._tick(number, seconds)
            chosen = tick > last_tick
            last_tick = max(tick, last_tick)
            return chosen

        return is_wanted

    def _tick(self, number: int, seconds: float) -> int:
        """Return the last tick of the wanted rate that is at or before a picture."""
        if self.rate is None:
            return number
        if self.info.variable:
            return math.floor((seconds + GRID_TOLERANCE_S) * self.rate)
        return math.floor((number - 1) * self.rate / self.info.clock_fps + 1e-6)


Taken = tuple[int, float, Callable[[], Picture]]
"""Number and seconds of a picture, and the function that converts it when it is chosen."""


def _read_one_file(info: VideoInfo, reading: FileReading, threads: int, skipped_s: float = 0.0) -> Iterator[Taken]:
    """Read the pictures of one file; those of its first seconds may be skipped."""
    reformatter = VideoReformatter()
    with open_video(info.path) as (container, stream):
        stream.codec_context.thread_count = threads
        if skipped_s > 0:
            reading.skip(container, stream, skipped_s)
        for number, seconds, frame in reading.pictures(container, stream):
            yield number, seconds, partial(convert_upright, reformatter, frame, info.rotation)


class _Recording:
    """One pass over a recording in pieces, or over pictures; unreadable parts are left out and counted."""

    def __init__(self, info: VideoInfo, threads: int, after: int, is_wanted: IsWanted | None = None) -> None:
        self._info, self._threads, self._after, self._is_wanted = info, threads, after, is_wanted
        self._last, self._seconds, self._pictures = 0, 0.0, 0
        self._broken, self._cut, self._failed = 0, 0, 0
        self._first_broken_s: float | None = None
        self._why: str | None = None
        self._early: str | None = None

    def pictures(self) -> Iterator[Taken]:
        """Read the pictures in order of their numbers: where pieces overlap, pictures before the last one are left out."""
        first, last = self._info.used
        for piece in self._info.pieces:
            if piece.begin_s > last:
                break
            over = piece.begin_s + piece.seconds + SHORTFALL_S
            if over < max(first, (self._after - 1) / self._info.clock_fps):
                continue
            for number, seconds, picture in self._read_piece(piece):
                if seconds > last:
                    break
                if number <= self._last or seconds < first:
                    continue
                self._last, self._seconds = number, seconds
                self._pictures += 1
                yield number, seconds, picture
        if self._pictures == 0:
            raise VideoError(self._info.path, f"none of its files can be decoded ({self._why}): copy them again")

    def _read_piece(self, piece: Piece) -> Iterator[Taken]:
        """Read the pictures of a piece, with the numbers and seconds of the recording."""
        clock = self._info.clock_fps
        before = round(piece.begin_s * clock)
        if piece.info is None:
            picture = decode_picture(piece.path, self._info.size, self._info.rotation)
            if picture is None:
                self._fail(piece, "it is damaged or of another size")
            else:
                yield before + 1, before / clock, partial(np.asarray, picture)
            return
        reading = FileReading(piece.info, None if self._is_wanted is None else partial(self._is_wanted_of_piece, before))
        try:
            ahead = max(self._info.used[0], (self._after - 1) / clock) - piece.begin_s
            skipped_s = ahead - SOUGHT_BEFORE_S if ahead > SOUGHT_FROM_S else 0.0
            for number, seconds, make in _read_one_file(piece.info, reading, self._threads, skipped_s):
                yield before + number, before / clock + seconds, make
        except VideoError as error:
            self._fail(piece, error.what)
        found = reading.summary(0)
        self._broken += found.broken
        if found.first_broken_s is not None and self._first_broken_s is None:
            self._first_broken_s = before / clock + found.first_broken_s
        self._cut += found.ended_early is not None and found.pictures > 0
        self._early = self._early or found.ended_early

    def _is_wanted_of_piece(self, before: int, number: int, seconds: float) -> bool:
        """Check whether a picture of the piece after `before` numbers is wanted: those before the last picture are not."""
        assert self._is_wanted is not None
        number, seconds = before + number, before / self._info.clock_fps + seconds
        return number > self._last and seconds >= self._info.used[0] and self._is_wanted(number, seconds)

    def _fail(self, piece: Piece, why: str) -> None:
        self._failed += 1
        self._why = self._why or f"{piece.path.name}: {why}"

    def summary(self, yielded: int) -> Decoded:
        """Return the result of the pass. A stretch of one file ends early if the file does."""
        stretch = [piece.path for piece in self._info.pieces] == [self._info.path]
        counts = (self._early or self._why, 0, 0) if stretch else (None, self._cut, self._failed)
        return Decoded(self._pictures, yielded, self._seconds, self._broken, self._first_broken_s, *counts)


def decode_picture(path: Path, size: tuple[int, int], rotation: int = 0) -> Picture | None:
    """Read an image file as (H, W, 3) BGR, upright; None where it cannot be read or has another size.

    Args:
        path: the file.
        size: (width, height) of the upright picture.
        rotation: degrees counter-clockwise by which it is turned after the rotation stated in the file.
    """
    try:
        content = np.fromfile(path, dtype=np.uint8)
    except OSError:
        return None
    picture = cv2.imdecode(content, cv2.IMREAD_COLOR) if len(content) else None
    if picture is not None and rotation in TURNS:
        picture = cv2.rotate(picture, TURNS[rotation])
    if picture is None or (picture.shape[1], picture.shape[0]) != size:
        return None
    return np.asarray(picture, dtype=np.uint8)


def frames(video: VideoInfo | str | Path, rate: float | None = None, after: int = 0, threads: int = 1) -> VideoReader:
    """Read the pictures of a video, sampled at about `rate` per second: see `VideoReader`."""
    return VideoReader(video, rate, after, threads)


def expected_count(info: VideoInfo, rate: float | None = None) -> int | None:
    """Return about how many pictures a reading at `rate` gives, for a progress bar; None where the file states no length."""
    if rate is None or _is_every_picture(info, rate):
        return info.frames
    if info.pieces:
        # There are no pictures in gaps.
        return max(1, min(info.frames or 1, math.ceil(sum(list_covered_s(info)) * rate - 1e-6)))
    return None if info.seconds is None else max(1, math.ceil(info.seconds * rate - 1e-6))


def list_covered_s(info: VideoInfo) -> Iterator[float]:
    """Yield the seconds of each piece of a recording that are read."""
    first, last = info.used
    for piece in info.pieces:
        yield max(0.0, min(last, piece.begin_s + piece.seconds) - max(first, piece.begin_s))


def _is_every_picture(info: VideoInfo, rate: float) -> bool:
    """Check whether a rate is the video's own or above."""
    return rate >= (info.average_fps if info.variable else info.clock_fps) * (1 - 1e-3)


def convert_upright(reformatter: VideoReformatter, frame: VideoFrame, rotation: int) -> Picture:
    """Convert a frame to (H, W, 3) BGR, upright. One thread, so that cameras' processes do not compete for the cores."""
    picture = reformatter.reformat(frame, format="bgr24", threads=1).to_ndarray()
    return np.asarray(cv2.rotate(picture, TURNS[rotation]) if rotation in TURNS else picture, dtype=np.uint8)
