"""Writing of pictures as an H.264 video that any player can play.

The same pictures give the same bytes: one encoder thread, no date in the file. A video appears under its name only when it is
complete.
"""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace, Interpolation
from numpy.typing import NDArray

from passerby.common.errors import InputError

CONTAINERS = {".mp4": "mp4", ".mov": "mov", ".mkv": "matroska"}

# Ticks per second of timestamps that the caller gives: MPEG's clock, which represents milliseconds and all usual rates.
TICKS_PER_SECOND = 90_000

# A player guesses the colour matrix from the size of the picture if the file does not state it. The file states
# ITU-R BT.601 in limited range (matrix coefficients 6 in ITU-T H.273).
BT601_IN_FILE = 6

# Without accurate rounding, swscale makes every picture darker by 3 of 255 levels.
ROUNDING = Interpolation.BILINEAR | Interpolation.ACCURATE_RND


class VideoWriter:
    """A writer of one video; a context manager.

    Example:
        with VideoWriter("a.mp4", (640, 480), fps=25) as video:
            for picture in pictures:
                video.write(picture)

    The pictures go to a temporary file beside `path`. If the block ends without an exception, the file is renamed to `path`,
    otherwise it is removed.

    Args:
        path: ends in .mp4, .mov or .mkv; missing folders are made; a file of this name is replaced.
        size: (width, height) in pixels, both even, as H.264 with halved colour resolution (yuv420p) requires.
        fps: pictures per second; an approximate rate if the caller gives timestamps.
        crf: x264's constant quality, 0 (lossless) to 51 (worst); 23 is its default.
        key_every: largest number of pictures from one key frame to the next.

    Raises:
        InputError: the size, rate, quality or name is invalid, or the folder cannot be written to.
    """

    def __init__(self, path: str | Path, size: tuple[int, int], fps: float, crf: int = 23, key_every: int = 250) -> None:
        self.path = Path(path)
        self.size = (int(size[0]), int(size[1]))
        self.fps = Fraction(fps).limit_denominator(1001) if np.isfinite(fps) else Fraction(0)
        self._check(crf)
        # With x264's macroblock tree, results for the same pictures vary; without it, files are an eighth larger.
        self._options = {"crf": str(crf), "preset": "veryfast", "threads": "1", "g": str(key_every), "x264-params": "mbtree=0"}
        self._written = 0
        self._last_pts = -1
        self._own_timestamps: bool | None = None

    def _check(self, crf: int) -> None:
        """Raise `InputError` for settings that x264 or the container would refuse."""
        width, height = self.size
        if min(self.size) < 2 or width % 2 or height % 2:
            raise InputError(f"{self.path}: H.264 needs an even width and height of at least 2 pixels, not {width} x {height}")
        if self.fps <= 0:
            raise InputError(f"{self.path}: the rate must be a number of frames per second above 0")
        if not 0 <= crf <= 51:
            raise InputError(f"{self.path}: crf {crf} is not a quality of x264: give 0 (lossless) to 51 (worst)")
        if self.path.suffix.lower() not in CONTAINERS:
            raise InputError(f"{self.path}: a video's name must end in one of {', '.join(CONTAINERS)}")

    def __enter__(self) -> Self:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            handle, self._part = tempfile.mkstemp(dir=self.path.parent, prefix=f".{self.path.name}.", suffix=".part")
            os.close(handle)
        except OSError as error:
            raise self._cannot_write(error) from error
        kind = CONTAINERS[self.path.suffix.lower()]
        muxing = {"fflags": "+bitexact"} | ({} if kind == "matroska" else {"movflags": "+faststart"})
        try:
            self._container = av.open(self._part, "w", format=kind, options=muxing)
            self._stream = self._container.add_stream("libx264", rate=self.fps, options=self._options)
        except BaseException:
            self._remove()
            raise
        self._stream.width, self._stream.height = self.size
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.colorspace = BT601_IN_FILE
        self._stream.codec_context.color_range = ColorRange.MPEG
        return self

    def write(self, picture: NDArray[np.uint8], seconds: float | None = None) -> None:
        """Append a picture.

        Args:
            picture: (H, W, 3) BGR, uint8, of the video's size.
            seconds: time of the picture from the start of the video, later than that of the previous one; None: the pictures
                follow each other at the video's rate. Either all pictures of a video have a time, or none has.

        Raises:
            InputError: the shape or type is wrong, the time is not later than the previous one, or the disk is full.
        """
        expected = (self.size[1], self.size[0], 3)
        if picture.shape != expected or picture.dtype != np.uint8:
            found = f"{picture.dtype} of the shape {picture.shape}"
            raise InputError(f"{self.path}: frame {self._written + 1} is {found}: uint8 of the shape {expected} is needed")
        self._set_clock(seconds is not None)
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="bgr24")
        frame = frame.reformat(
            format="yuv420p",
            dst_colorspace=Colorspace.ITU601,
            dst_color_range=ColorRange.MPEG,
            interpolation=ROUNDING,
            threads=1,
        )
        frame.pts = self._written if seconds is None else round(seconds * TICKS_PER_SECOND)
        frame.time_base = self._stream.codec_context.time_base
        if frame.pts <= self._last_pts:
            raise InputError(f"{self.path}: frame {self._written + 1} at {seconds} s does not come after the one before")
        self._last_pts = frame.pts
        self._written += 1
        self._mux(frame)

    def _set_clock(self, own_timestamps: bool) -> None:
        """Set the time base at the first picture: the video's rate or the caller's seconds. Check that later pictures agree."""
        if self._own_timestamps is None:
            self._own_timestamps = own_timestamps
            self._stream.codec_context.time_base = Fraction(1, TICKS_PER_SECOND) if own_timestamps else 1 / self.fps
        elif self._own_timestamps != own_timestamps:
            raise InputError(f"{self.path}: frame {self._written + 1}: either all frames have a time of their own, or none")

    def _mux(self, frame: av.VideoFrame | None) -> None:
        """Encode a frame into the file; None flushes the encoder."""
        try:
            self._container.mux(self._stream.encode(frame))
        except OSError as error:
            raise self._cannot_write(error) from error

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._finish()
            else:
                with suppress(OSError):  # an exception is already raised, and the file will be removed
                    self._container.close()
        finally:
            self._remove()

    def _finish(self) -> None:
        """Complete the file and rename it to its path."""
        if self._written == 0:
            with suppress(OSError):
                self._container.close()
            raise InputError(f"{self.path}: a video without frames cannot be written")
        self._mux(None)
        try:
            self._container.close()
            mask = os.umask(0o022)
            os.umask(mask)
            os.chmod(self._part, 0o666 & ~mask)
            os.replace(self._part, self.path)
        except OSError as error:
            raise self._cannot_write(error) from error

    def _remove(self) -> None:
        """Delete the temporary file if it exists."""
        Path(self._part).unlink(missing_ok=True)

    def _cannot_write(self, error: OSError) -> InputError:
        return InputError(f"{self.path}: cannot be written ({error.strerror or error}): choose a folder with space to write to")
