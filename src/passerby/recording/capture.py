"""Recording of all cameras at once, one thread each. Broken connections are opened again, and the gaps are listed."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import av
from av.audio.stream import AudioStream
from av.container import InputContainer
from av.error import FFmpegError, HTTPForbiddenError, HTTPUnauthorizedError
from av.video.stream import VideoStream

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent, tell_warning
from passerby.recording.pieces import Piece, PieceWriter, Source, WallClock, make_folder
from passerby.recording.settings import DEVICE, Stream

STAGE = "recording"
SCHEMA_VERSION = 1
"""Version of the file `recording.json`; new keys need no new version."""
LOOK_EVERY_S = 0.25
FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 8.0
"""Shortest and longest wait before a connection is tried again, seconds; it doubles each time until pictures arrive again."""
OTHERS_WAIT_S = 2.0
"""If one camera fails at the beginning, the others have this many seconds to connect or to fail: all are reported at once."""
RESERVE_BYTES = 500_000_000
"""Free space of the disk that is left to other programs."""
SHORTEST_GAP_S = 0.5
"""Shortest gap that is listed: cameras leave out single pictures."""

Ended = Literal["time", "stopped", "space", "disk"]


@dataclass(frozen=True)
class CaptureOptions:
    """Options of a recording. Raises `InputError` for a value that is out of range."""

    seconds: float
    piece_s: float = 10.0
    timeout_s: float = 10.0
    """A host that sends nothing for this many seconds counts as disconnected."""
    most_bytes: float = float("inf")
    """Maximum size of all files of this recording together."""
    without_missing: bool = False
    """Whether the other cameras are recorded if one cannot be reached at the beginning."""
    to_go_on: str = "with --without-missing"
    """The option that sets `without_missing`, as a message names it."""

    def __post_init__(self) -> None:
        limits = {"--seconds": (self.seconds, 7 * 86400), "--piece": (self.piece_s, 3600), "--timeout": (self.timeout_s, 600)}
        for name, (value, most) in limits.items():
            if not 1 <= value <= most:
                raise InputError(f"{name} {value:g}: give 1 to {most} seconds")
        if not self.most_bytes > 0:
            raise InputError("--max-gb: give a number above 0")


@dataclass(frozen=True)
class Gap:
    """An interval of time in which nothing was recorded."""

    from_s: float
    until_s: float
    """Seconds since 1970."""


@dataclass(frozen=True)
class CameraRecording:
    """The recording of one camera."""

    camera: str
    pieces: tuple[Piece, ...]
    clock: Source | None
    """Source of the times of the pieces; None without pieces."""
    unset_s: float | None
    """Difference of the camera's clock from this computer's, seconds, if it is too large to use that clock; else None."""
    fault: str | None
    """Reason why the last connection failed; None if it did not."""

    @property
    def seconds(self) -> float:
        """Total length of all pieces, seconds."""
        return sum(piece.seconds for piece in self.pieces)

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Gaps longer than `SHORTEST_GAP_S` between one piece and the next."""
        found = []
        for one, other in zip(self.pieces, self.pieces[1:], strict=False):
            if other.begin_s - (one.begin_s + one.seconds) > SHORTEST_GAP_S:
                found.append(Gap(one.begin_s + one.seconds, other.begin_s))
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "name": self.camera,
            "seconds": self.seconds,
            "clock": self.clock,
            "clock_off_s": self.unset_s,
            "pieces": [
                {"file": f"{p.path.parent.name}/{p.path.name}", "begin": p.begin_s, "seconds": p.seconds} for p in self.pieces
            ],
            "gaps": [{"from": gap.from_s, "until": gap.until_s} for gap in self.gaps],
            "fault": self.fault,
        }


@dataclass(frozen=True)
class Recording:
    """The recordings of all cameras."""

    cameras: tuple[CameraRecording, ...]
    ended: Ended
    """Reason of the end: the time was over, it was stopped, it had reached its maximum size, or the disk was nearly full."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"schema_version": SCHEMA_VERSION, "ended": self.ended, "cameras": [camera.to_dict() for camera in self.cameras]}


def record(
    streams: tuple[Stream, ...],
    folder: Path,
    options: CaptureOptions,
    tell: Progress = silent,
    stop: threading.Event | None = None,
) -> Recording:
    """Record all streams into folders that have the names of their cameras.

    Args:
        streams: at least one.
        folder: the cameras' folders are made in it; files that are in them stay.
        options: duration and limits of the recording.
        tell: called with the seconds since the beginning, for each camera.
        stop: ends the recording as soon as it is set; pieces that are being written are finished.

    Raises:
        InputError: a camera cannot be reached at the beginning (unless `without_missing` is set), no camera has sent anything,
            or the folder cannot be written.
    """
    stop = stop or threading.Event()
    until = time.monotonic() + options.seconds
    for stream in streams:
        make_folder(folder / stream.camera)
    recorders = [_Recorder(stream, folder / stream.camera, options, until, stop) for stream in streams]
    ended: Ended = "time"
    with _run_recorders(recorders, stop):
        ended = _supervised(recorders, folder, options, tell, stop)
    for recorder in recorders:
        if recorder.failure is not None:
            raise recorder.failure
    result = Recording(tuple(recorder.result() for recorder in recorders), ended)
    if not any(camera.pieces for camera in result.cameras) and ended == "time":
        raise InputError("; ".join(recorder.explained() for recorder in recorders))
    return result


@contextmanager
def _run_recorders(recorders: list[_Recorder], stop: threading.Event) -> Iterator[None]:
    """Run each recorder in a thread; the threads have ended when the block has.

    After an error, the function does not wait for threads that have no connection yet: a host that does not answer would delay
    the message. Such a thread writes nothing (`_connection`).
    """
    threads = {
        threading.Thread(target=recorder.run, name=f"recording {recorder.stream.camera}", daemon=True): recorder
        for recorder in recorders
    }
    for thread in threads:
        thread.start()
    ended = False
    try:
        yield
        ended = True
    finally:
        stop.set()
        for thread, recorder in threads.items():
            if ended or recorder.opened:
                thread.join()


def _supervised(
    recorders: list[_Recorder], folder: Path, options: CaptureOptions, tell: Progress, stop: threading.Event
) -> Ended:
    """Wait for the end of the recording; report progress, and check for missing cameras and for the limits of size and disk."""
    began = time.monotonic()
    warned: set[str] = set()
    while not all(recorder.done for recorder in recorders):
        if stop.wait(LOOK_EVERY_S):
            return "stopped"
        now = time.monotonic() - began
        for recorder in recorders:
            tell(STAGE, min(int(now), int(options.seconds)), int(options.seconds), part=recorder.stream.camera)
            if recorder.failure is not None:
                return "stopped"
        missing = [recorder for recorder in _missing(recorders, began, now, options) if recorder.stream.camera not in warned]
        if missing and not options.without_missing:
            raise InputError(f"{'; '.join(one.explained() for one in missing)}; {options.to_go_on} the other cameras go on")
        for recorder in missing:
            warned.add(recorder.stream.camera)
            tell_warning(tell, f"{recorder.explained()}; the other cameras go on")
        if sum(recorder.size_bytes for recorder in recorders) >= options.most_bytes:
            return "space"
        if shutil.disk_usage(folder).free < RESERVE_BYTES:
            return "disk"
    return "time"


def _missing(recorders: list[_Recorder], began: float, now: float, options: CaptureOptions) -> list[_Recorder]:
    """Return the recorders of the cameras that cannot be reached, as soon as this is known; none before.

    It is known if a camera refuses the user, or if its connections have failed until `timeout_s`. The others then have
    `OTHERS_WAIT_S` to connect or to fail, so that one message names all.
    """
    failed = [recorder for recorder in recorders if recorder.fault and not recorder.connected]
    known_s = [recorder.refused_at - began for recorder in failed if recorder.refused_at is not None]
    if failed and now >= options.timeout_s:
        known_s.append(options.timeout_s)
    if not known_s:
        return []
    answered = all(recorder.fault or recorder.connected for recorder in recorders)
    return failed if answered or now >= min(known_s) + OTHERS_WAIT_S else []


@dataclass(eq=False)
class _Recorder:
    """Recorder of one camera."""

    stream: Stream
    folder: Path
    options: CaptureOptions
    until: float
    """End of the recording, by the monotonic clock."""
    stop: threading.Event
    connected: bool = False
    """Whether any picture has arrived so far."""
    opened: bool = False
    """Whether there has been a connection, and so perhaps a file."""
    refused_at: float | None = None
    """Time at which the camera refused the user name and password, by the monotonic clock; None if it did not."""
    done: bool = False
    fault: str | None = None
    failure: InputError | None = None
    """Error that makes it useless to continue: the folder cannot be written."""
    size_bytes: int = 0
    pieces: list[Piece] = field(default_factory=list)
    clock: WallClock = field(default_factory=WallClock)
    source: Source | None = None

    @property
    def over(self) -> bool:
        """Whether the recording has ended."""
        return self.stop.is_set() or time.monotonic() >= self.until

    def run(self) -> None:
        """Connect repeatedly until the end. Stop if the camera refuses the user: many cameras lock a user who tries often."""
        wait = FIRST_WAIT_S
        try:
            while not self.over:
                before = len(self.pieces)
                try:
                    self._connection()
                    if not self.over:
                        self.fault = "the stream ended"
                    elif len(self.pieces) > before:
                        self.fault = None
                except FFmpegError as error:
                    self.fault = self.stream.hidden(error.strerror or type(error).__name__)
                    if isinstance(error, HTTPUnauthorizedError | HTTPForbiddenError) and not self.connected:
                        self.refused_at = time.monotonic()
                        return
                except (IndexError, ValueError) as error:
                    self.fault = self.stream.hidden(str(error))
                wait = FIRST_WAIT_S if len(self.pieces) > before else min(2 * wait, LONGEST_WAIT_S)
                if not self.over:
                    self.stop.wait(min(wait, max(0.0, self.until - time.monotonic())))
        except InputError as error:
            self.failure = error
        finally:
            self.done = True

    def _connection(self) -> None:
        """Record until the connection breaks or the recording ends."""
        self.clock = WallClock()
        with _open_stream(self.stream, self.options.timeout_s) as container:
            self.opened = True
            if self.stop.is_set():
                return
            if not container.streams.video:
                raise ValueError("has no pictures, only sound")
            streams: list[VideoStream | AudioStream] = [container.streams.video[0], *container.streams.audio[:1]]
            writer = PieceWriter(self.folder, streams, self.options.piece_s, self.clock.settled, self._end_connection)
            try:
                self._packets(container, streams, writer)
            finally:
                writer.end()

    def _packets(self, container: InputContainer, streams: list[VideoStream | AudioStream], writer: PieceWriter) -> None:
        packet: Any
        for packet in container.demux(*streams):
            if packet.stream is streams[0] and packet.pts is not None and packet.time_base is not None:
                zero = container.start_time_realtime
                sender = None if zero is None or zero <= 0 else zero / 1e6
                self.clock.arrived(float(packet.pts * packet.time_base), time.time(), sender)
                self.connected = True
            writer.write(packet)
            if self.over:
                return

    def _end_connection(self, piece: Piece) -> None:
        self.pieces.append(piece)
        self.size_bytes += piece.size_bytes
        settled = self.clock.settled()
        self.source = None if settled is None else settled.source

    def explained(self) -> str:
        """Return a message that names the camera, the reason why it sends nothing, and the remedy."""
        remedy = "check the address, the user name and password, and that the camera is on"
        if self.refused_at is not None:
            remedy = "give the user name and password that the camera accepts"
        return f"camera {self.stream.camera} ({self.stream.shown}): {self.fault or 'sends no pictures'}: {remedy}"

    def result(self) -> CameraRecording:
        """Return the recording of this camera, with its pieces in the order of time."""
        pieces = tuple(sorted(self.pieces, key=lambda piece: piece.begin_s))
        return CameraRecording(self.stream.camera, pieces, self.source, self.clock.unset_s, self.fault)


PROTOCOLS = "rtsp,rtsps,rtp,srtp,udp,tcp,tls,http,https,httpproxy,crypto"
"""Protocols to which a stream may redirect: not to files of this computer."""


def _open_stream(stream: Stream, timeout_s: float) -> InputContainer:
    """Open a connection to a stream."""
    if DEVICE.fullmatch(stream.address):
        return av.open(stream.address, format="v4l2", options={"input_format": "mjpeg"}, timeout=timeout_s)
    options: Mapping[str, str] = {"protocol_whitelist": PROTOCOLS}
    if stream.address.startswith("rtsp"):
        options = {**options, "rtsp_transport": stream.transport}
    container = av.open(stream.address, options=dict(options), timeout=timeout_s)
    if container.format.name == "mpjpeg":
        # Pictures of this format carry no times: the times of their arrival are used.
        container.close()
        container = av.open(stream.address, options={**options, "use_wallclock_as_timestamps": "1"}, timeout=timeout_s)
    return container
