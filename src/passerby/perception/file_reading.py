"""One pass over the pictures of a video file: decoded one after the other, each with its number and time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from av.container import InputContainer
from av.error import EOFError as EndOfFile
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from passerby.perception.sparse_packets import PassedOver, sparse
from passerby.perception.video_error import VideoError
from passerby.perception.video_probe import VideoInfo

# A file that ends this much before the length it tells, and this part of it, was cut off. Sound that lasts longer than the
# pictures, where only a common length is stated, and lengths rounded to a second stay below.
SHORTFALL_S = 0.5
SHORTFALL_OF_FILE_S = 2.0

# So many reads in a row may fail before the rest of the file is given up.
FAILED_READS = 100

# Timestamps that fall back by more belong to another recording behind the first: it is taken to follow at once.
JUMP_BACK_S = 1.0

IsWanted = Callable[[int, float], bool]
"""Of a picture's number and seconds."""


@dataclass(frozen=True)
class Decoded:
    """What became of a video that was read to its end."""

    pictures: int
    """Pictures that the file gave, chosen or not."""
    yielded: int
    """Pictures that were chosen."""
    seconds: float
    """Timestamp of the last picture, from the first."""
    broken: int
    """Packets that could not be decoded, and pictures that were decoded with errors."""
    first_broken_s: float | None
    """When the first of these would have been shown, about."""
    ended_early: str | None
    """Where the file ends clearly before the length that it tells: one sentence about it."""
    cut_pieces: int = 0
    """Pieces of a recording that end before the length that they tell."""
    failed_pieces: int = 0
    """Pieces, or pictures, that could not be read after all."""


class FileReading:
    """One pass over the pictures of a file, and what was noticed on the way."""

    def __init__(self, info: VideoInfo, is_wanted: IsWanted | None = None) -> None:
        self._info, self._is_wanted = info, is_wanted
        self._origin: float | None = None
        self._size: tuple[int, int] | None = None
        self._number = 0
        self._seconds = 0.0
        self._shown_s = 0.0
        self._pictures = 0
        self._broken = 0
        self._first_broken_s: float | None = None
        self._of_stream = True

    def pictures(self, container: InputContainer, stream: VideoStream) -> Iterator[tuple[int, float, VideoFrame]]:
        """Number, seconds and picture, the numbers ascending."""
        self._of_stream = stream.duration is not None
        packets = self._packets(container, stream)
        if container.format.name == "avi":
            # Its packets have times of decoding only: a picture's own is not known before.
            self._is_wanted = None
        for packet in packets if self._is_wanted is None else sparse(packets, self._is_wanted_at):
            for frame in self._drained(stream) if isinstance(packet, PassedOver) else self._decode(stream, packet):
                self._check_size(frame)
                self._pictures += 1
                previous = self._number
                self._count(frame)
                if frame.is_corrupt:
                    self._note_broken()
                if self._number > previous:
                    yield self._number, self._seconds, frame
            if isinstance(packet, PassedOver):
                self._pass_over(packet.last_s)
        if self._pictures == 0:
            raise VideoError(self._info.path, "nothing of it can be decoded: copy the video again")

    def _drained(self, stream: VideoStream) -> list[VideoFrame]:
        """The pictures that the decoder still holds; it begins anew afterwards."""
        frames = self._decode(stream, None)
        stream.codec_context.flush_buffers()
        for frame in frames:
            if frame.time_base is None and stream.time_base is not None:
                frame.time_base = stream.time_base
        return frames

    def _is_wanted_at(self, time: float) -> bool | None:
        """Whether the picture of a time of the stream will be chosen; None before the first picture."""
        if self._origin is None or self._is_wanted is None:
            return None
        seconds = self._info.taken_at(time - self._origin)
        return self._is_wanted(round(seconds * self._info.clock_fps) + 1, seconds)

    def _pass_over(self, time: float) -> None:
        """Count pictures up to a time of the stream that are not decoded."""
        if self._origin is None:
            return
        seconds = self._info.taken_at(time - self._origin)
        number = round(seconds * self._info.clock_fps) + 1
        if number > self._number:
            self._number, self._seconds, self._shown_s = number, seconds, time - self._origin

    def skip(self, container: InputContainer, stream: VideoStream, seconds: float) -> None:
        """Go to the last key frame before so many seconds, where the file has timestamps and can seek; else stay."""
        try:
            first = next((frame for packet in container.demux(stream) for frame in packet.decode()), None)
        except FFmpegError:
            first = None
        begin = None if first is None or first.pts is None or first.time_base is None else first.pts * first.time_base
        target = 0.0 if begin is None else float(begin) + seconds
        try:
            container.seek(int(target * 1_000_000), backward=True)
        except (FFmpegError, OverflowError):
            container.seek(0)
        self._origin = None if begin is None else float(begin)

    def _packets(self, container: InputContainer, stream: VideoStream) -> Iterator[Packet[VideoStream] | None]:
        """The packets, past places where the file cannot be read; None at the end of one that breaks off."""
        failed = 0
        while failed < FAILED_READS:
            try:
                for packet in container.demux(stream):
                    failed = 0
                    yield packet
                return
            except EndOfFile:
                break
            except FFmpegError:
                failed += 1
                self._note_broken()
        yield None

    def _decode(self, stream: VideoStream, packet: Packet[VideoStream] | None) -> list[VideoFrame]:
        """The pictures that a packet completes, or (None) that the decoder still holds; none where the packet is broken."""
        try:
            return stream.decode(packet)
        except FFmpegError:
            self._note_broken()
            return []

    def _note_broken(self) -> None:
        self._broken += 1
        if self._first_broken_s is None:
            self._first_broken_s = self._seconds

    def _check_size(self, frame: VideoFrame) -> None:
        """Raise `InputError` when a picture has another size than the first."""
        size = (frame.width, frame.height)
        if self._size is None:
            self._size = size
        if size != self._size:
            raise VideoError(
                self._info.path,
                f"the frames change from {self._size[0]} x {self._size[1]} to {size[0]} x {size[1]} after"
                f" {self._seconds:.2f} s: cut the video there and keep the part that the intrinsics are for",
            )

    def _count(self, frame: VideoFrame) -> None:
        """Number and time of a picture by its timestamp or, without one, one step after the picture before."""
        clock = self._info.clock_fps
        if frame.pts is None or frame.time_base is None:
            step = clock / self._info.average_fps
            self._number += max(1, round(step)) if self._pictures > 1 else 1
            self._seconds = self._shown_s = (self._number - 1) / clock
            return
        time = float(frame.pts * frame.time_base)
        if self._origin is None:
            self._origin = time - self._shown_s
        if time - self._origin < self._shown_s - JUMP_BACK_S:
            self._note_broken()
            self._origin = time - self._shown_s - 1.0 / (self._info.stored_fps or self._info.average_fps)
        seconds = self._info.taken_at(time - self._origin)
        number = round(seconds * clock) + 1
        if number > self._number:
            self._number, self._seconds, self._shown_s = number, seconds, time - self._origin

    def summary(self, yielded: int) -> Decoded:
        """What the pass came to."""
        promised = self._info.seconds
        end = self._seconds + 1.0 / self._info.average_fps
        early = None
        if promised is not None and promised - end > (SHORTFALL_S if self._of_stream else SHORTFALL_OF_FILE_S):
            early = f"the video ends after {end:.1f} s of the {promised:.1f} s that the file states: it was cut off"
        return Decoded(self._pictures, yielded, self._seconds, self._broken, self._first_broken_s, early)
