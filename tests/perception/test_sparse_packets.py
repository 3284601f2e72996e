"""Sparse readings: the same pictures as of a full one, and fewer decoded."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.stream import VideoStream

from passerby.perception import video
from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.recording import open_source
from passerby.perception.video import VideoInfo, VideoReader, probe
from support.tiers import thinned

COUNT, FPS, SIZE = 300, 25, (128, 96)

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
        stream = container.add_stream(
            codec, rate=FPS, options={"preset": "ultrafast", **options} if "x26" in codec else options
        )
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for number in range(COUNT):
            picture = np.ascontiguousarray(wide[:, number : number + SIZE[0]])
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
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
def test_the_same_pictures(name: str, rate: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, codec, options = CODECS[name]
    few, all_of_them = compared(probe(written(tmp_path / file, codec, options)), rate, monkeypatch)
    assert all_of_them == COUNT
    if rate < 0.5 and name not in ("one group", "no times"):
        assert few < 0.5 * COUNT


def test_pieces_and_a_part_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, codec, options = CODECS["open"]
    for number in range(2):
        written(tmp_path / f"part{number}.mp4", codec, options)
    info = open_source(VideoSource((tmp_path,))).info
    few, all_of_them = compared(info, 0.31, monkeypatch)
    assert few < 0.6 * all_of_them == 0.6 * 2 * COUNT
