"""A writer of the packets of one connection into complete files (pieces), and the wall time of packets.

Pieces are Matroska files, which hold every codec of network cameras unchanged. Their names are their wall times, in UTC.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import av
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from passerby.interchange.storage.atomic import PART, cannot_write, sync_folder

ENDING = ".mkv"
LONGEST = 3.0
"""Multiple of the length of a piece after which it ends without a key frame: some cameras send none for minutes."""
Source = Literal["sender", "arrival"]
SIGMA_S: dict[Source, float] = {"sender": 0.05, "arrival": 0.5}
"""Standard deviations of the wall times: network cameras set their clocks by NTP; encoders and networks delay pictures for up
to a second."""
MOST_APART_S = 60.0
"""A sender whose clock differs by more than this from the clock of this computer has not been set."""


@dataclass(frozen=True)
class Piece:
    """A file that was written completely."""

    path: Path
    begin_s: float
    """Seconds since 1970."""
    seconds: float
    """Length from its first packet to the end of its last, seconds."""
    packets: int
    """Number of packets with pictures."""
    size_bytes: int


class PieceWriter:
    """Writes the packets of one connection.

    Args:
        folder: folder of the camera.
        streams: streams of the connection: pictures, and sound if there is any.
        length_s: length of a piece, seconds.
        wall: returns the wall time of the connection; called when a piece ends.
        ended: called for each finished piece.
    """

    def __init__(
        self, folder: Path, streams: list[VideoStream | AudioStream], length_s: float, wall: Callable[[], WallTime | None],
        ended: Callable[[Piece], None],
    ) -> None:  # fmt: skip
        self._folder, self._streams, self._length_s, self._wall, self._ended = folder, streams, length_s, wall, ended
        self._part = folder / f".recording-{os.getpid()}{PART}"
        self._out: OutputContainer | None = None
        self._begin_s = self._end_s = 0.0
        self._last: dict[int, int] = {}
        self._packets = 0

    def write(self, packet: Packet[VideoStream] | Packet[AudioStream]) -> None:
        """Add a packet. Packets before the first key frame with a known picture size, and those without a time, are left out.

        Raises `InputError` if the file cannot be written, and `ValueError` if a Matroska file cannot hold the packets.
        """
        if packet.pts is None or packet.time_base is None or packet.size == 0:
            return
        stream = self._streams.index(packet.stream)
        seconds = float(packet.pts * packet.time_base)
        if stream == 0 and self._out is not None:
            lasted = seconds - self._begin_s
            jumped = seconds < self._end_s - 1.0
            if jumped or lasted >= LONGEST * self._length_s or (packet.is_keyframe and lasted >= self._length_s - 0.02):
                self.end()
        try:
            if self._out is None:
                if stream or not packet.is_keyframe or not self._size_known(packet):
                    return
                self._begin(seconds)
            self._mux(packet, stream)
        except (av.error.ArgumentError, av.error.InvalidDataError) as error:
            self.drop()
            raise ValueError(f"sends what a Matroska file cannot hold ({error.strerror})") from None
        except (OSError, av.error.FFmpegError) as error:
            raise cannot_write(self._part, OSError(error.errno, error.strerror or "no reason given")) from None
        if stream == 0:
            self._packets += 1
            self._end_s = max(seconds + float((packet.duration or 0) * packet.time_base), self._end_s)

    def _size_known(self, packet: Packet[Any]) -> bool:
        """Return whether the size of the pictures is known; if necessary, decode this packet to find it.

        A file cannot be begun without the size. It is unknown if a camera sent nothing for long after the connection was made.
        """
        pictures = self._streams[0]
        assert isinstance(pictures, VideoStream)
        if not pictures.codec_context.width:
            with suppress(av.error.InvalidDataError):
                packet.decode()
        return pictures.codec_context.width > 0 and pictures.codec_context.height > 0

    def _begin(self, seconds: float) -> None:
        self._out = av.open(str(self._part), "w", format="matroska")
        for stream in self._streams:
            copy = self._out.add_stream_from_template(stream)
            if isinstance(stream, VideoStream) and isinstance(copy, VideoStream):
                copy.codec_context.width, copy.codec_context.height = stream.codec_context.width, stream.codec_context.height
        self._begin_s = self._end_s = seconds
        self._last, self._packets = {}, 0

    def _mux(self, packet: Packet[VideoStream] | Packet[AudioStream], stream: int) -> None:
        """Write a packet into the piece, with times from the piece's beginning.

        Decoding times always increase, even if the camera sends other ones or none.
        """
        assert self._out is not None
        assert packet.pts is not None
        zero, next_one = round(self._begin_s / float(packet.time_base)), self._last.get(stream, -1) + 1
        decoded = next_one if packet.dts is None else max(packet.dts - zero, next_one)
        self._last[stream] = decoded
        packet.pts, packet.dts = max(packet.pts - zero, decoded), decoded
        packet.stream = self._out.streams[stream]  # type: ignore[assignment]  # of the same kind: made from the packet's own
        self._out.mux(packet)

    def end(self) -> None:
        """Finish the piece and give it its name. Raises `InputError` if it cannot be written."""
        if self._out is None:
            return
        out, self._out = self._out, None
        wall = self._wall()
        try:
            out.close()
            if wall is None or not self._packets:
                self._part.unlink()
                return
            with self._part.open("rb") as file:
                os.fsync(file.fileno())
            begin = wall.at(self._begin_s)
            path = self._name_piece(begin)
            self._part.rename(path)
            sync_folder(self._folder)
            size = path.stat().st_size
        except (OSError, av.error.FFmpegError) as error:
            raise cannot_write(self._part, OSError(error.errno, error.strerror or "no reason given")) from None
        self._ended(Piece(path, begin, max(self._end_s - self._begin_s, 0.0), self._packets, size))

    def _name_piece(self, begin_s: float) -> Path:
        """Return a path from the date, time and milliseconds in UTC (Z); a millisecond later if this file already exists."""
        thousandths = round(begin_s * 1000)
        while True:
            time = datetime.fromtimestamp(thousandths / 1000, UTC)
            path = self._folder / f"{time:%Y%m%dT%H%M%S}.{thousandths % 1000:03d}Z{ENDING}"
            if not path.exists():
                return path
            thousandths += 1

    def drop(self) -> None:
        """Discard the piece that is being written."""
        out, self._out = self._out, None
        with suppress(OSError, av.error.FFmpegError):
            if out is not None:
                out.close()
        self._part.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Make a camera's folder and delete unfinished files of a killed process in it. Raises `InputError` if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        for left in path.glob(f".recording-*{PART}"):
            left.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error


@dataclass(frozen=True)
class WallTime:
    """A map from seconds of a stream to seconds since 1970."""

    zero_s: float
    """The wall time of the stream's second 0."""
    source: Source

    @property
    def sigma_s(self) -> float:
        """Standard deviation of the wall time, seconds."""
        return SIGMA_S[self.source]

    def at(self, stream_s: float) -> float:
        """Convert a time of the stream, seconds, to seconds since 1970."""
        return self.zero_s + stream_s


class WallClock:
    """Estimates the wall time of one connection while packets arrive. A map once given stays, so that pieces fit together."""

    def __init__(self) -> None:
        self._earliest: float | None = None
        self._given: WallTime | None = None
        self.unset_s: float | None = None
        """Difference of the sender's clock from this computer's, seconds, if it is too large to use that clock; else None."""

    def arrived(self, stream_s: float, arrival_s: float, sender_zero_s: float | None) -> None:
        """Record the arrival of a packet.

        The packet with the smallest delay gives the best estimate, so the earliest of all zeros counts.

        Args:
            stream_s: time of the packet in the stream, seconds.
            arrival_s: wall time of its arrival on this computer, seconds since 1970.
            sender_zero_s: wall time of the stream's second 0 that the sender states; None if it states none.
        """
        zero = arrival_s - stream_s
        self._earliest = zero if self._earliest is None else min(self._earliest, zero)
        if sender_zero_s is None or (self._given is not None and self._given.source == "sender"):
            return
        apart = sender_zero_s - self._earliest
        if abs(apart) <= MOST_APART_S:
            self._given = WallTime(sender_zero_s, "sender")
        else:
            self.unset_s = apart

    def settled(self) -> WallTime | None:
        """Return the map that is used from now on; None before the first packet.

        A map from arrival times is still replaced if the sender states its time later.
        """
        if self._given is None and self._earliest is not None:
            self._given = WallTime(self._earliest, "arrival")
        return self._given
