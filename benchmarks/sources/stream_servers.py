"""Servers of streams on loopback, which play a film as a network camera does: RTSP with RTP over TCP, and MJPEG over HTTP.

RFC 2326 (RTSP), RFC 3550 (RTP, RTCP), RFC 6184 (H.264 over RTP). For the tests of recording too.
"""

from __future__ import annotations

import base64
import http.server
import re
import socket
import socketserver
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import av

CLOCK = 90_000
NTP_1900 = 2_208_988_800
LARGEST = 1400


@dataclass(frozen=True, eq=False)
class Film:
    """Pictures of an H.264 film, coded, and when each is shown."""

    pictures: list[tuple[float, bool, list[bytes]]]  # seconds, whether it can be decoded by itself, and its NAL units

    @classmethod
    def read(cls, path: Path) -> Film:
        """The film in a file."""
        pictures = []
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            to_units = av.BitStreamFilterContext("h264_mp4toannexb", stream)
            for packet in container.demux(stream):
                if packet.pts is None or packet.time_base is None:
                    continue
                seconds, key = float(packet.pts * packet.time_base), packet.is_keyframe
                for part in to_units.filter(packet):
                    units = [unit for unit in re.split(b"\x00\x00\x00?\x01", bytes(part)) if unit]
                    pictures.append((seconds, key, units))
        return cls(pictures)

    @property
    def parameters(self) -> list[bytes]:
        """Its first sequence and picture parameter sets."""
        units = [unit for _, _, units in self.pictures for unit in units]
        return [next(unit for unit in units if unit[0] & 31 == kind) for kind in (7, 8)]


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that films without end, whoever looks: what was missed is gone."""

    film: Film
    password: str = ""
    clock_off_s: float = 0.0  # of the wall clock that its sender reports tell; NaN: it tells none
    breaks_s: Sequence[float] = ()  # seconds of the film at which it closes all connections
    on_s: float = 0.0  # second of the film at which it is switched on: before it answers nobody
    silent_s: float = 0.0  # how long it sends nothing after it was asked to play
    began: float = field(default_factory=time.time)  # wall time of second 0 of the film
    connections: list[float] = field(default_factory=list)  # when clients connected


class _Rtsp(socketserver.BaseRequestHandler):
    server: _Server

    def handle(self) -> None:
        self.camera = self.server.camera
        self.camera.connections.append(time.time())
        if time.time() < self.camera.began + self.camera.on_s:
            return
        self.lock = threading.Lock()
        self.playing: threading.Thread | None = None
        self.over = threading.Event()
        try:
            while request := self._request():
                self._answer(*request)
        except OSError:
            pass
        finally:
            self.over.set()
            if self.playing:
                self.playing.join()

    def _request(self) -> tuple[str, dict[str, str]] | None:
        text = b""
        while not text.endswith(b"\r\n\r\n"):
            byte = self.request.recv(1)
            if not byte:
                return None
            if not text and byte == b"$":  # a report of the receiver
                _, length = struct.unpack(">BH", self._exactly(3))
                self._exactly(length)
                continue
            text += byte
        first, *lines = text.decode().split("\r\n")
        return first.split()[0], dict(line.split(": ", 1) for line in lines if ": " in line)

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = self.request.recv(count - len(data))
            if not part:
                raise OSError
            data += part
        return data

    def _send(self, data: bytes) -> None:
        with self.lock:
            self.request.sendall(data)

    def _answer(self, method: str, headers: dict[str, str]) -> None:
        status, extra, body = "200 OK", {}, b""
        login = headers.get("Authorization", "").removeprefix("Basic ")
        if self.camera.password and login != base64.b64encode(self.camera.password.encode()).decode():
            status, extra = "401 Unauthorized", {"WWW-Authenticate": 'Basic realm="camera"'}
        elif method == "OPTIONS":
            extra = {"Public": "OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN"}
        elif method == "DESCRIBE":
            sets = ",".join(base64.b64encode(unit).decode() for unit in self.camera.film.parameters)
            body = (
                "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nc=IN IP4 0.0.0.0\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\n"
                f"a=rtpmap:96 H264/{CLOCK}\r\na=fmtp:96 packetization-mode=1; sprop-parameter-sets={sets}\r\n"
                "a=control:track\r\n"
            ).encode()
            extra = {"Content-Type": "application/sdp"}
        elif method == "SETUP":
            if "TCP" in headers.get("Transport", ""):
                extra = {"Transport": "RTP/AVP/TCP;unicast;interleaved=0-1", "Session": "1"}
            else:
                status = "461 Unsupported Transport"
        elif method == "PLAY":
            extra = {"Session": "1", "Range": "npt=now-"}
        head = "".join(f"{name}: {value}\r\n" for name, value in extra.items())
        answer = f"RTSP/1.0 {status}\r\nCSeq: {headers.get('CSeq', 0)}\r\n{head}Content-Length: {len(body)}\r\n\r\n"
        self._send(answer.encode() + body)
        if method == "PLAY" and status == "200 OK":
            self.playing = threading.Thread(target=self._play)
            self.playing.start()

    def _play(self) -> None:
        camera, number, begun, count = self.camera, 0, False, 0
        if self.over.wait(camera.silent_s):
            return
        joined = time.time() - camera.began
        breaks = [second for second in camera.breaks_s if second > joined]
        try:
            for seconds, key, units in camera.film.pictures:
                if seconds < joined or not (key or begun):
                    continue
                while (left := camera.began + seconds - time.time()) > 0:
                    if self.over.wait(min(left, 0.05)):
                        return
                if breaks and seconds >= breaks[0]:
                    self.request.shutdown(socket.SHUT_RDWR)
                    return
                stamp = round(seconds * CLOCK) + 12345 & 0xFFFFFFFF
                if count % 50 == 0 and camera.clock_off_s == camera.clock_off_s:
                    self._report(stamp, camera.began + seconds + camera.clock_off_s + NTP_1900)
                begun, count = True, count + 1
                for last, payload in _payloads(units):
                    head = struct.pack(">BBHII", 0x80, 96 | last << 7, number & 0xFFFF, stamp, 7)
                    self._send(struct.pack(">cBH", b"$", 0, len(head) + len(payload)) + head + payload)
                    number += 1
            self.request.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass

    def _report(self, stamp: int, ntp: float) -> None:
        report = struct.pack(">BBHIIIIII", 0x80, 200, 6, 7, int(ntp), int(ntp % 1 * 2**32), stamp, 0, 0)
        self._send(struct.pack(">cBH", b"$", 1, len(report)) + report)


def _payloads(units: Sequence[bytes]) -> list[tuple[bool, bytes]]:
    """Whether it is the picture's last, and the payload, of each packet."""
    parts = []
    for unit in units:
        if len(unit) <= LARGEST:
            parts.append(unit)
            continue
        pieces = [unit[1:][start : start + LARGEST] for start in range(0, len(unit) - 1, LARGEST)]
        for index, piece in enumerate(pieces):
            edge = (index == 0) << 7 | (index == len(pieces) - 1) << 6
            parts.append(bytes([unit[0] & 0xE0 | 28, unit[0] & 31 | edge]) + piece)
    return [(index == len(parts) - 1, part) for index, part in enumerate(parts)]


class _Mjpeg(http.server.BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        try:
            for picture in self.server.pictures:
                self.wfile.write(b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(picture))
                self.wfile.write(picture + b"\r\n")
                self.wfile.flush()
                time.sleep(1 / self.server.fps)
        except OSError:
            pass

    def log_message(self, *_: object) -> None:
        pass


class _Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    allow_reuse_address, daemon_threads = True, True
    camera: Camera
    pictures: Sequence[bytes]
    fps: float


@contextmanager
def _served(server: _Server) -> Iterator[int]:
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@contextmanager
def rtsp_camera(film: Film, **options: Any) -> Iterator[tuple[int, Camera]]:
    """A camera with these options; its port and itself."""
    server = _Server(("127.0.0.1", 0), _Rtsp)
    server.camera = Camera(film, **options)
    with _served(server) as port:
        yield port, server.camera


@contextmanager
def mjpeg_camera(pictures: Sequence[bytes], fps: float) -> Iterator[int]:
    """A camera that sends JPEG pictures; its port."""
    server = _Server(("127.0.0.1", 0), _Mjpeg)
    server.pictures, server.fps = pictures, fps
    with _served(server) as port:
        yield port
