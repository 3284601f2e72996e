"""Properties of a video file, known before all of it is decoded.

Frame numbers count from 1 at the first picture. At a constant rate they count the video's own pictures (a missing picture
leaves out its number). At a variable rate they count hundredths of a second, so that timestamps are kept within 5 ms.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened_text
from passerby.perception.pictures import VideoError
from passerby.perception.pieces import JOIN_PICTURES, why_a_pattern_is_no_video, why_no_video_is_there
from passerby.perception.video_camera import FileClock, RecordingCamera, read_file_clock, read_recording_camera

VARIABLE_CLOCK_FPS = 100.0

# Largest errors of timestamps at a constant rate: what a variable rate's clock would lose, and a quarter of a frame.
GRID_TOLERANCE_S = 0.005
GRID_TOLERANCE_FRAMES = 0.25

# Number of packets whose timestamps are read: 2 minutes at 25 frames per second, some tens of megabytes to read.
PROBED_PACKETS = 3000

# Packets that are tried before a video counts as undecodable: a part of a stream may begin 10 s before a key frame.
TRIED_PACKETS = 600

# H.264 codes whole blocks of this size; a video hides less than one block of the last columns and rows.
MACROBLOCK = 16

# Containers of videos. Other containers of FFmpeg open further files or addresses that their text names (playlists, lists of
# pieces, session descriptions) or devices. A scene file names a video, and only that file is read.
VIDEO_CONTAINERS = (
    "mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts", "mpeg", "mpegvideo", "m4v", "h264",
    "hevc", "vvc", "obu", "ivf", "av1", "mjpeg", "mjpeg_2000", "mpjpeg", "flv", "asf", "ogg", "mxf", "gxf", "dv", "dhav",
    "nut", "rm", "wtv", "swf", "nuv", "nsv", "avs2", "avs3", "cavsvideo", "vc1", "vc1test", "h261", "h263", "dirac",
    "dnxhd", "yuv4mpegpipe", "gif", "apng", "ismv", "ipmovie", "ser", "lmlm4", "xmv", "pva", "ty", "viv", "vivo", "cine",
    "roq", "smjpeg", "kux", "live_flv", "evc",
)  # fmt: skip
# Opened only to state their kind in messages: they open no other file.
OTHER_KINDS = (
    "wav", "mp3", "flac", "aac", "ac3", "eac3", "dts", "aiff", "au", "caf", "amr", "srt", "ass", "webvtt", "tty",
    "png_pipe", "jpeg_pipe", "jpegls_pipe", "bmp_pipe", "tiff_pipe", "webp_pipe", "gif_pipe", "j2k_pipe", "ppm_pipe",
    "pgm_pipe", "psd_pipe", "pcx_pipe", "exr_pipe", "dpx_pipe", "qoi_pipe", "sgi_pipe", "sunrast_pipe", "xpm_pipe",
    "svg_pipe", "jpegxl_pipe", "webp",
)  # fmt: skip

MOST_PIXELS = 1 << 26
"""Largest number of pixels of a picture: 8K has half as many. A head of a few bytes may state more than fits into memory."""

TOLERANT: dict[str, Any] = {"metadata_errors": "replace"} if int(av.__version__.split(".")[0]) < 19 else {}
"""Names in a file that are not UTF-8 are accepted; PyAV 19, which needs Python 3.12, always does that."""
OPTIONS = {
    "protocol_whitelist": "file",
    "format_whitelist": ",".join(VIDEO_CONTAINERS + OTHER_KINDS),
    "max_pixels": str(MOST_PIXELS),
}

REMEDY = "convert it, for example with `ffmpeg -i {name} -c:v libx264 converted.mp4`, or remove it from the scene"


@dataclass(frozen=True)
class Piece:
    """One file of a recording in several files."""

    path: Path
    begin_s: float
    """Time of its first picture: seconds of the recording, whose frame 1 is at 0."""
    info: VideoInfo | None = None
    """The properties of a video; None for one picture."""
    seconds: float = 0.0
    """Its length."""


@dataclass(frozen=True)
class WallTime:
    """A wall time."""

    seconds: float
    """Seconds since 1970, by the clock with which the files' names are written."""
    utc: bool
    """Whether that clock is known to be UTC."""

    @property
    def text(self) -> str:
        """The time in ISO 8601, with the time zone where it is known."""
        time = datetime.fromtimestamp(self.seconds, UTC)
        plain = time if self.utc else time.replace(tzinfo=None)
        return plain.isoformat(timespec="seconds" if time.microsecond == 0 else "milliseconds")


@dataclass(frozen=True)
class VideoInfo:
    """A video: one file, pieces of one recording, or pictures."""

    path: Path
    """The file; for pieces and pictures the folder or pattern that messages name."""
    size: tuple[int, int]
    """(width, height), pixels, upright: after the rotation that the file requests from players, as in the pictures."""
    codec: str
    clock_fps: float
    """Frame numbers per second: the video's rate, or 100 for a variable one. Frame f shows second (f - 1) / clock_fps."""
    variable: bool
    average_fps: float
    """Average number of pictures per second."""
    frames: int | None
    """Number of pictures that the file states, or that follows from its length."""
    seconds: float | None
    """Length that the file states."""
    rotation: int = 0
    """Degrees counter-clockwise, 0, 90, 180 or 270, by which the stored pictures are turned to stand upright."""
    camera: RecordingCamera = field(default_factory=RecordingCamera)
    """The camera according to the video's metadata."""
    pieces: tuple[Piece, ...] = ()
    """The files of a recording in pieces, or its pictures, in order of time; none for the single file `path`."""
    wall: WallTime | None = None
    """Wall time of frame 1, where the files state it."""
    clock: FileClock = field(default_factory=FileClock)
    """Time of the recording according to the file; for pieces, according to the first of them."""
    stored_fps: float | None = None
    """Frames per second that the file states, where a table beside it has the times of its frames."""
    frame_times: tuple[float, ...] = ()
    """The times of this table, seconds from the first frame, ascending."""
    used: tuple[float, float] = (-math.inf, math.inf)
    """Seconds of the recording that are read, both ends included; pictures outside are skipped."""

    def turned(self, degrees: int) -> VideoInfo:
        """Return the video with its pictures turned clockwise by a multiple of 90 degrees, after the file's own rotation."""
        if degrees % 360 == 0:
            return self
        pieces = tuple(replace(piece, info=None if piece.info is None else piece.info.turned(degrees)) for piece in self.pieces)
        size = self.size if degrees % 180 == 0 else (self.size[1], self.size[0])
        return replace(self, size=size, rotation=(self.rotation - degrees) % 360, pieces=pieces)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files from which it is read."""
        return tuple(piece.path for piece in self.pieces) or (self.path,)

    def taken_at(self, stored_s: float) -> float:
        """Return the time at which the frame was taken that the file shows at `stored_s`, seconds from the first frame."""
        if not self.frame_times or self.stored_fps is None:
            return stored_s
        number = max(0, round(stored_s * self.stored_fps))
        last = len(self.frame_times) - 1
        return self.frame_times[min(number, last)] + max(0, number - last) / self.average_fps

    @property
    def begin_s(self) -> float:
        """Time of the first picture that is read, seconds from frame 1."""
        return max(self.used[0], self.pieces[0].begin_s) if self.pieces else 0.0

    @property
    def end_s(self) -> float | None:
        """End of the recording, seconds from frame 1; None where it is not known."""
        if not self.pieces:
            return self.seconds
        return min(self.used[1], max(piece.begin_s + piece.seconds for piece in self.pieces))


def probe(path: str | Path) -> VideoInfo:
    """Read a video's head, the timestamps of its first packets, and its first picture.

    Raises:
        InputError: no such file, a folder, an empty file, no video, a codec that cannot be decoded, or no picture at all.
    """
    path = Path(path)
    with open_video(path) as (container, stream):
        seconds = _duration(container, stream)
        timestamps, cut = _timestamps(container, stream)
        camera = read_recording_camera(path, container)
    with open_video(path) as (container, stream):
        first = _decode_first_picture(path, container, stream)
        rate, variable = _rate(stream, timestamps)
        if not variable and (rate is None or rate <= 0):
            raise VideoError(path, f"the file does not state its frames per second: {_remedy(path)}")
        average = _average(timestamps) if variable or rate is None else rate
        rotation = first.rotation % 360 if first.rotation % 90 == 0 else 0
        held = stream.frames - cut if stream.frames > cut else 0
        return VideoInfo(
            path=path,
            size=(first.height, first.width) if rotation in (90, 270) else (first.width, first.height),
            codec=stream.codec_context.name,
            clock_fps=VARIABLE_CLOCK_FPS if variable or rate is None else rate,
            variable=variable,
            average_fps=average,
            frames=held or (None if seconds is None else max(1, round(seconds * average))),
            seconds=seconds if seconds is not None else (held / average if held else None),
            rotation=rotation,
            camera=camera,
            clock=read_file_clock(container, average),
        )


@contextmanager
def open_video(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a video file and its first video stream.

    Raises:
        InputError: no such file, a folder, an empty file, no video, or a codec that cannot be decoded here.
    """
    _check_file(path)
    try:
        # An absolute path, so that no name is taken for that of a protocol.
        container = av.open(str(path.absolute()), options=OPTIONS, **TOLERANT)
    except (FFmpegError, OSError) as error:
        if "moov atom" in str(getattr(error, "log", "")) or _is_unfinished_mp4(path):
            raise VideoError(
                path,
                "the recording was cut off before its index (moov) was written: copy the file again, or repair it,"
                " for example with untrunc",
            ) from error
        if isinstance(error, PermissionError):
            raise VideoError(path, "cannot be read: you have no permission to read it") from error
        raise VideoError(path, f"is not a video that can be read ({error.strerror or error}): {_remedy(path)}") from error
    with container:
        yield container, _video_stream(path, container)


def _check_file(path: Path) -> None:
    """Raise `InputError` unless `path` is a file that is not empty; a pipe or a device might never end."""
    try:
        kind = path.stat()
    except FileNotFoundError:
        if join := why_a_pattern_is_no_video(path):
            raise VideoError(path, join) from None
        raise VideoError(path, "no such file: a video is needed here; check the path and its spelling") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{shortened_text(str(path), 1000)}: cannot be read ({why}): a video is needed here") from None
    if stat.S_ISDIR(kind.st_mode):
        raise VideoError(path, why_no_video_is_there(path))
    if not stat.S_ISREG(kind.st_mode):
        raise VideoError(path, "is a pipe or a device: name a video file")
    if kind.st_size == 0:
        raise VideoError(path, "holds 0 bytes: copy the video again, or remove it from the scene")


def _is_unfinished_mp4(path: Path) -> bool:
    """Check whether the file begins like an MP4 (ISO 14496-12: a box `ftyp`) and has no index."""
    with path.open("rb") as file:
        head = file.read(12)
        if head[4:8] != b"ftyp":
            return False
        file.seek(0)
        tail = b""
        while block := file.read(1 << 20):
            if b"moov" in tail + block:
                return False
            tail = block[-3:]
    return True


def _video_stream(path: Path, container: InputContainer) -> VideoStream:
    """Return the first real video stream; a still picture, the cover of a piece of music and text are none."""
    kind = container.format.name
    streams = [s for s in container.streams.video if not s.disposition & av.stream.Disposition.attached_pic]
    if kind.endswith("_pipe") or kind == "image2":
        raise VideoError(
            path, f"is not a video ({container.format.long_name}), but a single image: {JOIN_PICTURES}, and name that file"
        )
    if kind == "tty":
        raise VideoError(path, f"is not a video ({container.format.long_name}): name a video file")
    if not streams:
        kinds = ", ".join(sorted({s.type for s in container.streams})) or "nothing"
        raise VideoError(path, f"has no video stream, only {kinds}: name a file with video")
    stream = streams[0]
    if stream.codec_context is not None:
        stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
    else:
        raise VideoError(path, f"its video codec is unknown and cannot be decoded: {_remedy(path)}")
    return stream


def _remedy(path: Path) -> str:
    """Return the remedy for a file that cannot be decoded."""
    return REMEDY.format(name=path.name)


def _decode_first_picture(path: Path, container: InputContainer, stream: VideoStream) -> VideoFrame:
    """Return the first picture that can be decoded."""
    reason = "no frame in it"
    try:
        for packet in islice(container.demux(stream), TRIED_PACKETS):
            try:
                for frame in packet.decode():
                    return frame
            except FFmpegError as error:
                reason = error.strerror or str(error)
    except FFmpegError as error:
        reason = error.strerror or str(error)
    raise VideoError(path, f"nothing of it can be decoded ({stream.codec_context.name}: {reason}): {_remedy(path)}")


def _duration(container: InputContainer, stream: VideoStream) -> float | None:
    """Return the length of the video in seconds, from the stream or else from the whole file.

    The head of an AVI has the number of pictures. Its length is estimated from the size of the file, which does not show a cut.
    """
    if container.format.name == "avi" and stream.frames and stream.average_rate:
        return float(stream.frames / stream.average_rate)
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    return None if container.duration is None else container.duration / av.time_base


def _timestamps(container: InputContainer, stream: VideoStream) -> tuple[Floats, int]:
    """Return the times (N,), seconds, ascending, of the first packets that are shown, empty without timestamps; and the number
    of packets that an edit list leaves out.
    """
    shown: list[int] = []
    cut = 0
    try:
        for packet in islice(container.demux(stream), PROBED_PACKETS):
            cut += packet.is_discard
            if packet.pts is not None and not packet.is_discard:
                shown.append(packet.pts)
    except FFmpegError:
        pass  # the packets read so far are used; decoding the pictures will show the fault
    if stream.time_base is None:
        return np.zeros(0), cut
    # Packets come in decoding order: the last few may belong before others that were not read, and are dropped.
    ticks = np.unique(np.array(shown, dtype=np.int64))[: max(2, len(shown) - 32) if len(shown) == PROBED_PACKETS else None]
    return np.asarray(ticks * float(stream.time_base)), cut


def _rate(stream: VideoStream, timestamps: Floats) -> tuple[float | None, bool]:
    """Return pictures per second and False; or, where no rate fits the timestamps, None and True."""
    candidates = [float(r) for r in (stream.average_rate, stream.base_rate, stream.guessed_rate) if r]
    if len(timestamps) < 3:
        return (candidates[0] if candidates else None), False
    candidates.append(1.0 / float(np.median(np.diff(timestamps))))
    for rate in candidates:
        if _fits(rate, timestamps):
            return rate, False
    return None, True


def _fits(rate: float, timestamps: Floats) -> bool:
    """Check whether the timestamps are on a grid of this rate, most of them one step from the next."""
    position = (timestamps - timestamps[0]) * rate
    steps = np.diff(np.round(position))
    off = np.abs(position - np.round(position))
    close = bool((off <= min(GRID_TOLERANCE_FRAMES, GRID_TOLERANCE_S * rate)).all())
    return close and bool(np.median(steps) == 1) and bool((steps >= 1).all())


def _average(timestamps: Floats) -> float:
    """Return the pictures per second over all timestamps."""
    return float((len(timestamps) - 1) / (timestamps[-1] - timestamps[0]))


def fit_of_size(video_size: tuple[int, int], lens_size: tuple[int, int], rotation: int = 0) -> Literal["same", "cropped"]:
    """Check whether a video's pictures are those for which a lens was calibrated.

    A lens whose size is rounded up to whole macroblocks of H.264 (1088 for 1080) was calibrated on the coded picture: the video
    shows it without its last columns and rows, and the origin is the same.

    Args:
        video_size: (width, height), pixels, upright.
        lens_size: (width, height), pixels.
        rotation: degrees by which the file's metadata rotate its frames.

    Returns:
        "same", or "cropped": up to 15 columns or rows are missing at the right or at the bottom.

    Raises:
        InputError: any other difference. The message states a probable cause; the caller adds the file and the camera in front.
    """
    if video_size == lens_size:
        return "same"
    missing = (lens_size[0] - video_size[0], lens_size[1] - video_size[1])
    if all(0 <= m < MACROBLOCK for m in missing):
        return "cropped"
    told = f"its frames are {video_size[0]} x {video_size[1]}, its intrinsics are for {lens_size[0]} x {lens_size[1]}"
    factors = (video_size[0] / lens_size[0], video_size[1] / lens_size[1])
    if video_size == lens_size[::-1] and rotation in (90, 270):
        raise InputError(
            f"{told}: the file's metadata rotate its frames by 90 degrees, and the upright frames are used; give the "
            "intrinsics of the upright frames, for example from a video that the same device took in the same position"
        )
    if video_size == lens_size[::-1]:
        raise InputError(
            f"{told}: the video is rotated by 90 degrees; rotate it back, or give the intrinsics of the rotated frames"
        )
    if abs(video_size[0] - lens_size[0] * factors[1]) <= 1 or abs(video_size[1] - lens_size[1] * factors[0]) <= 1:
        raise InputError(
            f"{told}: the video is scaled by {factors[0]:.4g}; multiply the image size and the first two rows of the camera "
            f"matrix by that, or give the video in the size of the calibration"
        )
    raise InputError(f"{told}: give the intrinsics of this video, or the video that the intrinsics belong to")
