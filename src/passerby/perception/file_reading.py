"""One pass over the pictures of a video file, each with its number and time; groups without wanted pictures are skipped.

A group begins with a key frame. Pictures that come after a key frame and are shown before it may need the group before it. They
are left out where that group was not decoded; if one of them is wanted, that group is decoded.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field

from av.container import InputContainer
from av.error import EOFError as EndOfFile
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from passerby.perception.pictures import VideoError
from passerby.perception.video_probe import VideoInfo

# A file that ends this many seconds before its stated length was cut off; the second value is for a length of the whole file.
# Sound that lasts longer than the pictures, and lengths rounded to a second, stay below.
SHORTFALL_S = 0.5
SHORTFALL_OF_FILE_S = 2.0
# Number of failed reads in a row after which the rest of the file is given up.
FAILED_READS = 100
# Timestamps that go back by more than this belong to another recording behind the first, which is assumed to follow at once.
JUMP_BACK_S = 1.0
IsWanted = Callable[[int, float], bool]
"""Function of a picture's number and seconds."""
MOST_PACKETS = 3000
"""Largest group that is held back: where key frames are farther apart everything is decoded, so that memory is bounded."""


@dataclass(frozen=True)
class Decoded:
    """Result of reading a video to its end."""

    pictures: int
    """Number of pictures in the file, chosen or not."""
    yielded: int
    """Number of chosen pictures."""
    seconds: float
    """Timestamp of the last picture, seconds from the first."""
    broken: int
    """Number of packets that could not be decoded, and of pictures that were decoded with errors."""
    first_broken_s: float | None
    """Approximate time at which the first of these would have been shown."""
    ended_early: str | None
    """One sentence, where the file clearly ends before the length that it states; else None."""
    cut_pieces: int = 0
    """Number of pieces of a recording that end before the length that they state."""
    failed_pieces: int = 0
    """Number of pieces, or pictures, that could not be read."""


class FileReading:
    """One pass over the pictures of a file; counts errors on the way."""

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
        """Yield number, seconds and picture, in order of the numbers."""
        self._of_stream = stream.duration is not None
        packets = self._packets(container, stream)
        if container.format.name == "avi":
            # AVI packets have decoding times only: the time of a picture is not known before it is decoded.
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
        """Return the pictures that are still in the decoder, and reset it."""
        frames = self._decode(stream, None)
        stream.codec_context.flush_buffers()
        for frame in frames:
            if frame.time_base is None and stream.time_base is not None:
                frame.time_base = stream.time_base
        return frames

    def _is_wanted_at(self, time: float) -> bool | None:
        """Check whether the picture at a time of the stream will be chosen; None before the first picture."""
        if self._origin is None or self._is_wanted is None:
            return None
        seconds = self._info.taken_at(time - self._origin)
        return self._is_wanted(round(seconds * self._info.clock_fps) + 1, seconds)

    def _pass_over(self, time: float) -> None:
        """Advance number and time over pictures up to a time of the stream that are not decoded."""
        if self._origin is None:
            return
        seconds = self._info.taken_at(time - self._origin)
        number = round(seconds * self._info.clock_fps) + 1
        if number > self._number:
            self._number, self._seconds, self._shown_s = number, seconds, time - self._origin

    def skip(self, container: InputContainer, stream: VideoStream, seconds: float) -> None:
        """Seek the last key frame before a time in seconds, if the file has timestamps and allows it; else stay."""
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
        """Yield the packets, past unreadable places; None at the end of a file that breaks off."""
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
        """Return the pictures that a packet completes, or (None) those left in the decoder; none where the packet is broken."""
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
        """Set number and time of a picture by its timestamp or, without one, one step after the previous picture."""
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
        """Return the result of the pass."""
        promised = self._info.seconds
        end = self._seconds + 1.0 / self._info.average_fps
        early = None
        if promised is not None and promised - end > (SHORTFALL_S if self._of_stream else SHORTFALL_OF_FILE_S):
            early = f"the video ends after {end:.1f} s of the {promised:.1f} s that the file states: it was cut off"
        return Decoded(self._pictures, yielded, self._seconds, self._broken, self._first_broken_s, early)


@dataclass(frozen=True)
class PassedOver:
    """Pictures that are not decoded; the decoder is reset before the next packet."""

    last_s: float
    """Time of the last of them, in the stream's seconds."""


@dataclass(eq=False)
class _Group:
    """A key frame and the packets that follow it, in decoding order."""

    packets: list[Packet[VideoStream]] = field(default_factory=list)

    @property
    def key_s(self) -> float:
        return _time(self.packets[0])

    def times(self, *, leading: bool) -> list[float]:
        """Return the times of the pictures that are shown before the key frame (`leading`), or of the others, ascending."""
        shown = [_time(packet) for packet in self.packets if not packet.is_discard]
        return sorted(time for time in shown if (time < self.key_s) == leading)

    def decodable(self, *, continuous: bool) -> list[Packet[VideoStream]]:
        """Return all packets, without leading ones if the group before was not decoded."""
        return self.packets if continuous else [packet for packet in self.packets if _time(packet) >= self.key_s]

    def until(self, times: Collection[float], *, continuous: bool) -> list[Packet[VideoStream]]:
        """Return these packets up to the last one of some pictures, which do not need the packets after it."""
        rest = self.decodable(continuous=continuous)
        return rest[: 1 + max(number for number, packet in enumerate(rest) if _time(packet) in times)]


def _time(packet: Packet[VideoStream]) -> float:
    assert packet.pts is not None
    assert packet.time_base is not None
    return float(packet.pts * packet.time_base)


def sparse(
    packets: Iterator[Packet[VideoStream] | None], is_wanted: Callable[[float], bool | None]
) -> Iterator[Packet[VideoStream] | PassedOver | None]:
    """Yield the packets that are needed for the wanted pictures, and `PassedOver` for the pictures between them.

    Args:
        packets: packets of a file, in order; None at the end of one that breaks off.
        is_wanted: called with the time of each picture once, in the order in which they are shown. None where that is not known
            yet: the pictures so far are decoded, and it is called again.
    """
    held: _Group | None = None
    filling: _Group | None = None
    unasked: list[float] = []
    continuous = True
    early: list[float] = []
    """Wanted pictures that are shown before the key frame of the group that is settled next."""

    def asked(times: list[float]) -> list[float] | None:
        """Return the times that are wanted; None where that is not known yet."""
        unasked.extend(times)
        answers: list[float] = []
        while unasked:
            answer = is_wanted(unasked[0])
            if answer is None:
                return None
            time = unasked.pop(0)
            answers += [time] if answer else []
        return [time for time in answers if time in times]

    def settled(group: _Group, after: _Group | None) -> Iterator[Packet[VideoStream] | PassedOver]:
        nonlocal continuous, early
        own, early = early, []
        wanted = asked(group.times(leading=False))
        leading = asked(after.times(leading=True)) if after is not None else []
        early = leading or []
        if wanted is None or leading is None or leading:
            # The whole group, so that the next one can use it.
            yield from group.decodable(continuous=continuous)
            continuous = True
        elif own or wanted:
            yield from group.until([*own, *wanted], continuous=continuous)
            yield PassedOver(_find_last(group))
            continuous = False
        else:
            yield PassedOver(_find_last(group))
            continuous = False

    for packet in packets:
        if packet is None or packet.size == 0:
            for group, after in ((held, filling), (filling, None)):
                if group is not None:
                    yield from settled(group, after)
            held = filling = None
            yield packet
            continue
        if packet.pts is None or packet.time_base is None or (filling is not None and len(filling.packets) >= MOST_PACKETS):
            for group in (held, filling):
                if group is not None:
                    yield from group.decodable(continuous=continuous)
                    continuous = True
            yield packet
            yield from packets
            return
        if filling is None and not packet.is_keyframe:
            yield packet
            continue
        if packet.is_keyframe:
            if held is not None:
                yield from settled(held, filling)
            held, filling = filling, _Group()
        assert filling is not None
        filling.packets.append(packet)


def _find_last(group: _Group) -> float:
    return max(_time(packet) for packet in group.packets)
