"""Packets of one connection written into pieces that are whole, and the wall time of packets.

Pieces are Matroska files, which hold every codec of network cameras as it comes. Their names are their wall times, in UTC.
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
"""Lengths of a piece, after which it ends without a key frame: some cameras send none for minutes."""
Source = Literal["sender", "arrival"]
SIGMA_S: dict[Source, float] = {"sender": 0.05, "arrival": 0.5}
"""Standard deviations: network cameras set their clocks by NTP; encoders and networks hold pictures back for up to a second."""
MOST_APART_S = 60.0
"""A sender whose clock differs by more from that of this computer has not been set."""


@dataclass(frozen=True)
class Piece:
    """A file that was written as a whole."""

    path: Path
    begin_s: float
    """Seconds since 1970."""
    seconds: float
    """From its first packet to the end of its last."""
    packets: int
    """Of the pictures."""
    size_bytes: int


class PieceWriter:
    """Writes the packets of one connection.

    Args:
        folder: of the camera.
        streams: of the connection: pictures, and sound where there is any.
        length_s: of a piece.
        wall: the wall time of the connection, asked for when a piece ends.
        ended: called for each piece.
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
        """Add a packet. Those before the first key frame that tells its size, and those without a time, are left out.

        Raises `InputError` where the file cannot be written, and `ValueError` where no file can hold what the camera sends.
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
        """Whether the size of the pictures is known, if need be from this one.

        A file cannot be begun without it, and a camera that sends nothing for long after it was connected to has not stated it.
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
        """Times count from the piece's beginning; those of decoding ascend, whatever the camera says or leaves out."""
        assert self._out is not None
        assert packet.pts is not None
        zero, next_one = round(self._begin_s / float(packet.time_base)), self._last.get(stream, -1) + 1
        decoded = next_one if packet.dts is None else max(packet.dts - zero, next_one)
        self._last[stream] = decoded
        packet.pts, packet.dts = max(packet.pts - zero, decoded), decoded
        packet.stream = self._out.streams[stream]  # type: ignore[assignment]  # of the same kind: made from the packet's own
        self._out.mux(packet)

    def end(self) -> None:
        """Finish the piece: it gets its name. Raises `InputError` where that cannot be written."""
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
        """Date, time and thousandths in UTC, which the Z says; later by a thousandth where there is one already."""
        thousandths = round(begin_s * 1000)
        while True:
            time = datetime.fromtimestamp(thousandths / 1000, UTC)
            path = self._folder / f"{time:%Y%m%dT%H%M%S}.{thousandths % 1000:03d}Z{ENDING}"
            if not path.exists():
                return path
            thousandths += 1

    def drop(self) -> None:
        """Forget the piece that is being written."""
        out, self._out = self._out, None
        with suppress(OSError, av.error.FFmpegError):
            if out is not None:
                out.close()
        self._part.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Make a camera's folder, and forget what a killed process left in it. Raises `InputError` where that cannot be done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        for left in path.glob(f".recording-*{PART}"):
            left.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error


@dataclass(frozen=True)
class WallTime:
    """Maps seconds of a stream to seconds since 1970."""

    zero_s: float
    """The wall time of the stream's second 0."""
    source: Source

    @property
    def sigma_s(self) -> float:
        """One sigma."""
        return SIGMA_S[self.source]

    def at(self, stream_s: float) -> float:
        """Seconds since 1970."""
        return self.zero_s + stream_s


class WallClock:
    """Learns the wall time of one connection as packets arrive. A time once given stays, so that pieces fit each other."""

    def __init__(self) -> None:
        self._earliest: float | None = None
        self._given: WallTime | None = None
        self.unset_s: float | None = None
        """How far the sender's clock is from this computer's, where it is too far to be used."""

    def arrived(self, stream_s: float, arrival_s: float, sender_zero_s: float | None) -> None:
        """A packet of a second of the stream has arrived; the sender says when its second 0 was, or nothing.

        The packet that was held back the least tells the most, so the earliest of all zeros counts.
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
        """The mapping from now on; None before the first packet. A later word of the sender still replaces that by arrival."""
        if self._given is None and self._earliest is not None:
            self._given = WallTime(self._earliest, "arrival")
        return self._given
