"""One small film in every container and codec of the benchmark: the same pictures at the same times and in the same size."""

import tomllib
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.video.stream import VideoStream

from passerby.perception import video
from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.recording import open_source
from passerby.perception.video import VideoInfo, VideoReader, probe
from sources.packaging import PACKAGINGS, PLAIN, Packaging, available, pack, shown
from support.tiers import thinned

SIZE, FPS, COUNT, CAMERA = (128, 96), 12.5, 30, "C1"
MOST_OFF = 4.0
"""Grey levels, mean over a picture: what colours at half resolution and coarse coding cost. The wrong picture is off by 20."""


def film() -> list[np.ndarray]:
    """A pattern that moves through all pictures, with nothing symmetric about it."""
    rng = np.random.default_rng(8)
    wide = cv2.resize(rng.integers(30, 226, (6, 20, 3), dtype=np.uint8), (SIZE[0] + 8 * COUNT, SIZE[1]))
    return [wide[:, 8 * number : 8 * number + SIZE[0]].copy() for number in range(COUNT)]


def packed(packaging: Packaging, folder: Path, camera: str = CAMERA) -> VideoInfo:
    if not available(packaging):
        pytest.skip(f"this PyAV has no {packaging.encoder}")
    table = tomllib.loads(pack(packaging, film(), COUNT, FPS, folder, camera))
    return open_source(VideoSource((folder / table["video"],), fps=table.get("fps"))).info


@pytest.mark.parametrize("packaging", [PLAIN, *PACKAGINGS], ids=lambda packaging: packaging.key)
def test_pictures_times_and_size(packaging: Packaging, tmp_path: Path) -> None:
    info, expected = packed(packaging, tmp_path), shown(packaging, COUNT, FPS)
    assert (info.size, info.rotation) == ((SIZE[0] - packaging.less, SIZE[1] - packaging.less), packaging.rotation)
    assert info.variable == (packaging.share < 1)
    assert info.variable or info.clock_fps == pytest.approx(FPS)
    if packaging.codec and packaging.share == 1:
        assert (info.frames, info.seconds) == (len(expected), pytest.approx(len(expected) / FPS, abs=0.05))
    read = list(VideoReader(info))
    times = [float((number - expected[0]) / Fraction(FPS)) for number in expected]
    np.testing.assert_allclose([frame.seconds for frame in read], times, atol=0.006)
    clock = 100.0 if info.variable else FPS
    np.testing.assert_allclose([frame.number for frame in read], [round(time * clock) + 1 for time in times])
    original = film()
    for frame, number in zip(read, expected, strict=True):
        whole = original[number][: info.size[1], : info.size[0]].astype(int)
        assert np.abs(frame.picture - whole).mean() < MOST_OFF


def test_packagings_are_what_they_say(tmp_path: Path) -> None:
    """Files that were written another way would be read without showing anything."""
    by_key = {packaging.key: packaging for packaging in PACKAGINGS}

    def opened(key: str, camera: str = CAMERA):  # type: ignore[no-untyped-def]
        return av.open(str(packed(by_key[key], tmp_path / key, camera).path))

    with opened("hdr") as hdr, opened("rotated") as rotated, opened("edited") as edited:
        frame, turned = next(hdr.decode(video=0)), next(rotated.decode(video=0))
        assert (frame.format.name, frame.colorspace, turned.width, turned.height) == ("yuv420p10le", 9, *SIZE[::-1])
        assert sum(packet.is_discard for packet in edited.demux(video=0)) == 10
    with opened("sound") as sound, opened("sound", "C2") as silent:
        assert [len(container.streams.audio) for container in (sound, silent)] == [1, 0]


def test_a_piece_with_an_edit_list_is_as_long_as_it_shows(tmp_path: Path) -> None:
    edited = next(packaging for packaging in PACKAGINGS if packaging.cut_s)
    packed(edited, tmp_path, "part1")
    packed(edited, tmp_path, "part2")
    info = open_source(VideoSource((tmp_path,))).info
    shown_s = len(shown(edited, COUNT, FPS)) / FPS
    assert [piece.begin_s for piece in info.pieces] == pytest.approx([0.0, shown_s])
    assert probe(tmp_path / "part1.mp4").seconds == pytest.approx(shown_s)


LONG = 300
"""Pictures of a video that is read sparsely."""
CODECS = {
    "closed": ("a.mp4", "libx264", {"x264-params": "keyint=25:min-keyint=25:scenecut=0"}),
    "open": ("a.ts", "libx264", {"x264-params": "keyint=25:min-keyint=25:scenecut=0:open-gop=1:bframes=3:b-pyramid=normal"}),
    "hevc": ("a.mkv", "libx265", {"x265-params": "keyint=25:min-keyint=25:scenecut=0:open-gop=1:bframes=4:log-level=none"}),
    "one group": ("a.mp4", "libx264", {"x264-params": "keyint=1000:scenecut=0"}),
    "all key frames": ("a.mov", "mjpeg", {}),
    "no times": ("a.avi", "mpeg4", {"g": "25", "bf": "2"}),
}


def written(path: Path, codec: str, options: dict[str, str]) -> Path:
    rng = np.random.default_rng(5)
    wide = np.kron(rng.integers(20, 236, (6, 40, 3), dtype=np.uint8), np.ones((16, 16, 1), dtype=np.uint8))
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=({"preset": "ultrafast"} if "x26" in codec else {}) | options)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for number in range(LONG):
            picture = np.ascontiguousarray(wide[:, number : number + SIZE[0]])
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def compared(info: VideoInfo, rate: float, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int]:
    """How many pictures are decoded for a sparse reading, and for a full one, whose pictures are the same."""
    reader = VideoReader(info, rate)
    sparse = list(reader)
    few = reader.decoded.pictures
    monkeypatch.setattr(video, "SPARSE_RATE", 0.0)
    full = list(reader)
    assert [frame.number for frame in sparse] == [frame.number for frame in full]
    assert [frame.seconds for frame in sparse] == [frame.seconds for frame in full]
    for one, other in zip(sparse, full, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
    return few, reader.decoded.pictures


@thinned("rate", [0.67, 0.9, 0.31])
@pytest.mark.parametrize("name", CODECS)
def test_sparse_readings_give_the_same_pictures_and_decode_fewer(
    name: str, rate: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, codec, options = CODECS[name]
    few, all_of_them = compared(probe(written(tmp_path / file, codec, options)), rate, monkeypatch)
    assert all_of_them == LONG
    if rate < 0.5 and name not in ("one group", "no times"):
        assert few < 0.5 * LONG


def test_sparse_readings_of_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, codec, options = CODECS["open"]
    for number in range(2):
        written(tmp_path / f"part{number}.mp4", codec, options)
    info = open_source(VideoSource((tmp_path,))).info
    few, all_of_them = compared(info, 0.31, monkeypatch)
    assert few < 0.6 * all_of_them == 0.6 * 2 * LONG
