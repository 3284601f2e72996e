"""One film in the containers and codecs that phones, cameras and recorders write, all made with PyAV."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.video.stream import VideoStream
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

TURNS: Mapping[int, int | None] = {
    0: None, 90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE,
}  # fmt: skip
"""How upright pictures are stored by rotation of the file's metadata, degrees counter-clockwise."""
SOUND_HZ, SOUND_BLOCK = 48_000, 1024
JPEG_QUALITY = 95


@dataclass(frozen=True)
class Packaging:
    """A container and a codec, and what is unusual about them."""

    key: str
    text: str
    name: str  # of the file; {camera} stands for the camera's. Of images the pattern of their numbers.
    codec: str  # encoder of FFmpeg; "" for JPEG images
    pixels: str = "yuv420p"
    options: Mapping[str, str] = field(default_factory=dict)  # of the encoder
    colours: tuple[int, int, int] | None = None  # primaries, transfer and matrix, numbers of ITU-T H.273, where they are stated
    rotation: int = 0  # degrees counter-clockwise by which players turn the stored pictures: 0, 90, 180 or 270
    less: int = 0  # columns and rows that are left out at the right and at the bottom
    share: float = 1.0  # of the pictures that is written: where it is below 1 their times are uneven
    cut_s: float = 0.0  # at the beginning, that is stored, but left out by an edit list
    sound: str = ""  # the one camera with sound; no camera where it is empty
    b_frames: int = 2

    @property
    def encoder(self) -> str:
        """What has to be there."""
        return self.codec or "mjpeg"


PLAIN = Packaging("plain", "MP4, H.264", "{camera}.mp4", "libx264")
X264: Mapping[str, str] = {"preset": "veryfast", "threads": "1"}
HLG = (9, 18, 9)  # ITU-R BT.2100 as phones write it: primaries of BT.2020, hybrid log-gamma, matrix of BT.2020

PACKAGINGS: tuple[Packaging, ...] = (
    Packaging("rotated", "MOV, H.264, rotated by 90° in the metadata", "{camera}.MOV", "libx264", rotation=90),
    Packaging("upside-down", "MP4, H.264, rotated by 180° in the metadata", "{camera}.mp4", "libx264", rotation=180),
    Packaging("variable", "MP4, H.264, variable frame rate", "{camera}.mp4", "libx264", share=0.45),
    Packaging("edited", "MP4, H.264, an edit list that leaves out the first 0.8 s", "{camera}.mp4", "libx264", cut_s=0.8),
    Packaging("hevc", "MKV, HEVC", "{camera}.mkv", "libx265", options={"x265-params": "log-level=none:pools=1"}),
    Packaging("hdr", "MOV, HEVC, 10 bit, HDR (HLG)", "{camera}.mov", "libx265", "yuv420p10le",
              {"x265-params": "log-level=none:pools=1"}, HLG),
    Packaging("av1", "MP4, AV1, 10 bit", "{camera}.mp4", "libsvtav1", "yuv420p10le", {"preset": "8"}),
    Packaging("vp9", "WebM, VP9", "{camera}.webm", "libvpx-vp9", options={"deadline": "realtime", "cpu-used": "8"}),
    Packaging("odd", "MKV, H.264 4:4:4, odd width and height", "{camera}.mkv", "libx264", "yuv444p", less=1),
    Packaging("sound", "MPEG-TS, H.264, sound in one camera only", "{camera}.ts", "libx264", sound="C1"),
    Packaging("named", "AVI, MPEG-4, a name with spaces, umlauts and capitals", "Kamera Süd #{camera} (1).AVI", "mpeg4",
              options={"qscale": "3"}),
    Packaging("images", "JPEG images", "{camera}/frame_%06d.jpg", ""),
)  # fmt: skip
"""What is compared with `PLAIN`."""


def available(packaging: Packaging) -> bool:
    """Whether this PyAV can write it."""
    try:
        av.Codec(packaging.encoder, "w")
    except av.error.FFmpegError:
        return False
    return True


def shown(packaging: Packaging, count: int, fps: float) -> list[int]:
    """Of a film of so many pictures, those that a player of the packaging shows, from 0."""
    numbers = list(range(count))
    if packaging.share < 1:
        # The same pictures for every camera and run; the first and the last among them.
        chosen = np.random.default_rng(2).random(count) < packaging.share
        return [number for number in numbers if chosen[number] or number in (0, count - 1)]
    return numbers[round(packaging.cut_s * fps) :]


def pack(packaging: Packaging, pictures: Iterable[Picture], count: int, fps: float, folder: Path, camera: str) -> str:
    """Write a camera's film; its lines in the scene file, relative to the folder."""
    name = packaging.name.replace("{camera}", camera)
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    cropped = (picture[: picture.shape[0] - packaging.less, : picture.shape[1] - packaging.less] for picture in pictures)
    if not packaging.codec:
        for number, picture in enumerate(cropped, 1):
            cv2.imwrite(str(path.with_name(path.name % number)), picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        return f'video = "{name}"\nfps = {fps:g}\n'
    # Stored before the beginning: with an edit list pictures have times below zero.
    first = -round(packaging.cut_s * fps)
    wanted = set(range(count) if packaging.cut_s else shown(packaging, count, fps))
    muxing = {"use_editlist": "1", "avoid_negative_ts": "disabled"} if packaging.cut_s else {}
    with av.open(str(path), "w", options=muxing) as container:
        stream: VideoStream | None = None
        sound: Any = None
        for number, picture in enumerate(cropped):
            turned = _turned(picture, packaging.rotation)
            if stream is None:
                stream = _stream(container, packaging, turned, fps)
                sound = container.add_stream("aac", rate=SOUND_HZ) if packaging.sound == camera else None
            if number not in wanted:
                continue
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(turned), format="bgr24")
            frame = frame.reformat(format=packaging.pixels, **_colours(packaging))
            frame.pts, frame.time_base = first + number, 1 / Fraction(fps).limit_denominator(1001)
            container.mux(stream.encode(frame))
        assert stream is not None
        container.mux(stream.encode(None))
        if sound is not None:
            _write_noise(container, sound, count / fps)
    return f'video = "{name}"\n'


def _turned(picture: Picture, rotation: int) -> Picture:
    code = TURNS[rotation]
    return picture if code is None else np.asarray(cv2.rotate(picture, code), dtype=np.uint8)


def _stream(container: Any, packaging: Packaging, picture: Picture, fps: float) -> VideoStream:
    """The stream of a film whose stored pictures are as large as this one."""
    rate = Fraction(fps).limit_denominator(1001)
    options = {**(X264 if packaging.codec == "libx264" else {}), **packaging.options}
    stream: VideoStream = container.add_stream(packaging.codec, rate=rate, options=options)
    stream.height, stream.width = picture.shape[:2]
    stream.pix_fmt = packaging.pixels
    stream.codec_context.gop_size = round(2 * fps)
    stream.codec_context.bit_rate = 4_000_000
    if packaging.codec in ("libx264", "libx265"):
        stream.codec_context.options = {**options, "crf": "18"}
    if packaging.codec in ("libx264", "mpeg4"):
        stream.codec_context.max_b_frames = packaging.b_frames
    if packaging.colours is not None:
        context = stream.codec_context
        context.color_primaries, context.color_trc, context.colorspace = packaging.colours
    if packaging.rotation:
        stream.set_display_rotation(packaging.rotation)
    return stream


def _colours(packaging: Packaging) -> dict[str, Any]:
    """How colours are converted where the file states how they are to be read."""
    if packaging.colours is None:
        return {}
    return {"dst_colorspace": packaging.colours[2]}


def _write_noise(container: Any, stream: Any, seconds: float) -> None:
    """Quiet noise as long as the film."""
    rng = np.random.default_rng(1)
    for block in range(round(seconds * SOUND_HZ / SOUND_BLOCK)):
        samples = (0.01 * rng.standard_normal((1, SOUND_BLOCK))).astype(np.float32)
        frame = av.AudioFrame.from_ndarray(samples, format="fltp", layout="mono")
        frame.sample_rate, frame.pts = SOUND_HZ, block * SOUND_BLOCK
        frame.time_base = Fraction(1, SOUND_HZ)
        container.mux(stream.encode(frame))
    container.mux(stream.encode(None))
