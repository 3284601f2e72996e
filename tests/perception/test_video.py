"""Videos as pictures: every picture of these carries its number in its pixels."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.stream import VideoStream

from passerby.common.errors import InputError
from passerby.perception.pictures import Frame
from passerby.perception.video import VideoInfo, expected_count, fit_of_size, frames, probe
from support.scenes.numbered_videos import SIZE, number_in, numbered, written


def encoded(
    path: Path,
    codec: str,
    count: int = 100,
    kind: str | None = None,
    options: dict[str, str] | None = None,
    noise: int = 0,
    first_pts: int = 0,
    prepare: Callable[[VideoStream], None] = lambda stream: None,
) -> Path:
    """A video by another codec or in another container, 25 pictures a second; noise makes its packets large."""
    rng = np.random.default_rng(3)
    with av.open(str(path), "w", format=kind, options=options or {}) as container:
        stream = container.add_stream(codec, rate=25)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.codec_context.gop_size = 25
        prepare(stream)
        for k in range(count):
            picture = np.clip(numbered(k + 1) + rng.integers(-noise, noise + 1, numbered(0).shape), 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = first_pts + k, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def check(read: list[Frame], expected: list[int]) -> None:
    """The numbers, and that the pictures are those of the numbers."""
    assert [frame.number for frame in read] == expected
    assert [number_in(frame.picture) for frame in read] == expected


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("videos") / "plain.mp4")


def test_what_a_video_holds(plain: Path) -> None:
    info = probe(plain)
    assert (info.size, info.codec, info.clock_fps, info.variable, info.frames) == (SIZE, "h264", 25.0, False, 100)
    assert info.seconds == pytest.approx(4.0)


def test_all_pictures(plain: Path) -> None:
    reader = frames(plain)
    read = list(reader)
    check(read, list(range(1, 101)))
    assert [frame.seconds for frame in read] == pytest.approx([k / 25 for k in range(100)])
    assert all(frame.picture.shape == (64, 96, 3) and frame.picture.dtype == np.uint8 for frame in read)
    assert reader.decoded is not None
    assert (reader.decoded.pictures, reader.decoded.broken, reader.decoded.ended_early) == (100, 0, None)


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0, 7.0, 12.5, 24.0, 25.0, 60.0, 1 / 3])
def test_the_picture_at_or_after_each_tick(plain: Path, rate: float) -> None:
    if rate >= 25:
        expected = list(range(1, 101))
    else:
        ticks = range(int(4 * rate) + 1)
        wanted = [-(-Fraction(25) * k // Fraction(rate).limit_denominator(100)) + 1 for k in ticks]
        expected = sorted({int(n) for n in wanted if n <= 100})
    check(list(frames(plain, rate)), expected)
    assert expected_count(probe(plain), rate) == pytest.approx(len(expected), abs=1)


@pytest.mark.parametrize("rate", [None, 7.0, 10.0])
@pytest.mark.parametrize("after", [0, 1, 37, 99, 500])
def test_going_on_after_a_picture(plain: Path, rate: float | None, after: int) -> None:
    whole = [frame for frame in frames(plain, rate) if frame.number > after]
    rest = list(frames(plain, rate, after=after))
    assert [(f.number, f.seconds) for f in rest] == [(f.number, f.seconds) for f in whole]
    assert all((a.picture == b.picture).all() for a, b in zip(rest, whole, strict=True))


def test_threads_and_repetition_change_nothing(plain: Path) -> None:
    reader = frames(plain, 10.0)
    one = [frame.picture for frame in reader]
    for other in (reader, frames(probe(plain), 10.0, threads=3)):
        assert all((a == b.picture).all() for a, b in zip(one, other, strict=True))


def test_timestamps_of_a_variable_rate_are_honoured(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    seconds = np.cumsum(rng.uniform(0.021, 0.12, 120)) - 0.02
    path = written(tmp_path / "a.mp4", 120, 15, list(seconds))
    info = probe(path)
    assert info.variable
    assert info.clock_fps == 100.0
    read = list(frames(info))
    shown = seconds - seconds[0]
    assert [number_in(frame.picture) for frame in read] == list(range(1, 121))
    assert np.abs((np.array([frame.number for frame in read]) - 1) / 100 - shown).max() <= 0.00501
    assert [frame.seconds for frame in read] == pytest.approx(list(shown), abs=1e-4)
    sampled = [number_in(frame.picture) - 1 for frame in frames(info, 5.0)]
    ticks = np.arange(0, shown[-1], 0.2)
    assert len(sampled) == pytest.approx(len(ticks), abs=1)
    late = shown[sampled[: len(ticks)]] - ticks[: len(sampled)]
    assert late.min() >= -0.006
    assert late.max() <= 0.12
    assert number_in(next(iter(frames(info, 5.0, after=300))).picture) - 1 == next(k for k in sampled if shown[k] > 2.995)


def test_a_constant_rate_with_pictures_left_out_keeps_its_clock(tmp_path: Path) -> None:
    kept = [k for k in range(100) if k % 9 != 4 and not 40 <= k < 50]
    path = written(tmp_path / "a.mp4", len(kept), 25, [k / 25 for k in kept])
    assert (probe(path).clock_fps, probe(path).variable) == (25.0, False)
    read = list(frames(path))
    assert [frame.number for frame in read] == [k + 1 for k in kept]
    assert [number_in(frame.picture) for frame in read] == list(range(1, len(kept) + 1))


@pytest.mark.parametrize(
    ("name", "codec", "b_frames"),
    [("a.avi", "mpeg4", 0), ("b.avi", "mpeg4", 2), ("c.avi", "mjpeg", 0), ("d.ts", "libx264", 2), ("e.mkv", "libx264", 2),
     ("f.flv", "libx264", 2), ("g.h264", "libx264", 0)],
)  # fmt: skip
def test_other_containers_and_codecs(tmp_path: Path, name: str, codec: str, b_frames: int) -> None:
    def prepare(stream: VideoStream) -> None:
        stream.codec_context.max_b_frames = b_frames

    path = encoded(tmp_path / name, codec, prepare=prepare)
    assert probe(path).clock_fps == pytest.approx(25.0)
    check(list(frames(path)), list(range(1, 101)))
    check(list(frames(path, 5.0, after=31)), list(range(36, 101, 5)))


def test_numbers_count_from_the_first_picture(tmp_path: Path) -> None:
    path = encoded(tmp_path / "a.mkv", "libx264", first_pts=1000)
    read = list(frames(path, 5.0))
    check(read, list(range(1, 101, 5)))
    assert read[0].seconds == 0.0


@pytest.mark.parametrize(("degrees", "size"), [(90, (64, 96)), (180, SIZE), (-90, (64, 96))])
def test_a_rotation_for_the_player_is_made(tmp_path: Path, degrees: int, size: tuple[int, int]) -> None:
    path = encoded(tmp_path / "a.mp4", "libx264", count=3, prepare=lambda stream: stream.set_display_rotation(degrees))
    info = probe(path)
    assert (info.size, info.rotation) == (size, degrees % 360)
    pictures = [frame.picture for frame in frames(info)]
    assert all(p.shape == (size[1], size[0], 3) for p in pictures)
    assert [number_in(np.rot90(p, -degrees // 90)) for p in pictures] == [1, 2, 3]


# What is broken or missing.


def cut(path: Path, part: float, name: str) -> Path:
    """The first part of a file."""
    data = path.read_bytes()
    shorter = path.with_name(name)
    shorter.write_bytes(data[: int(len(data) * part)])
    return shorter


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [("a.mp4", "libx264", {"movflags": "faststart"}), ("b.avi", "mpeg4", {}), ("c.avi", "mjpeg", {})],
)
def test_a_truncated_video_gives_what_is_there_and_tells(
    tmp_path: Path, name: str, codec: str, options: dict[str, str]
) -> None:
    path = cut(encoded(tmp_path / name, codec, options=options, noise=20), 0.6, f"cut-{name}")
    reader = frames(path)
    read = list(reader)
    assert 15 < len(read) < 90
    check(read[:-2], list(range(1, len(read) - 1)))
    assert reader.decoded is not None
    assert reader.decoded.ended_early is not None
    assert "of the 4.0 s" in reader.decoded.ended_early


def test_a_truncated_matroska_tells_too(tmp_path: Path) -> None:
    path = cut(encoded(tmp_path / "a.mkv", "libx264", count=200, noise=10), 0.4, "cut.mkv")
    reader = frames(path)
    assert 40 < len(list(reader)) < 120
    assert reader.decoded is not None
    assert "of the 8.0 s" in (reader.decoded.ended_early or "")


def test_broken_packets_are_passed_over_and_counted(tmp_path: Path) -> None:
    path = encoded(tmp_path / "a.avi", "mpeg4", noise=30)
    with av.open(str(path)) as container:
        packets = [(p.pos, p.size) for p in container.demux(video=0) if p.pos is not None and p.size]
    data = bytearray(path.read_bytes())
    for start, size in packets[40:43]:
        data[start : start + size] = bytes(size)
    path.write_bytes(data)
    reader = frames(path)
    read = {frame.number: number_in(frame.picture) for frame in reader}
    assert all(number == read[number] for number in read if number <= 40 or number > 51)
    assert set(range(1, 41)) | set(range(52, 101)) <= set(read)
    assert reader.decoded is not None
    assert reader.decoded.broken >= 3
    assert reader.decoded.first_broken_s == pytest.approx(1.6, abs=0.1)
    assert reader.decoded.ended_early is None


def test_an_unfinished_recording(tmp_path: Path) -> None:
    path = cut(encoded(tmp_path / "a.mp4", "libx264"), 0.6, "cut.mp4")
    with pytest.raises(InputError, match=r"cut\.mp4.*cut off before its index"):
        probe(path)


def changed_size(path: Path) -> Path:
    """A raw stream of two videos of different sizes, one after the other."""
    parts = []
    for k, size in enumerate([(96, 64), (128, 96)]):
        one = path.with_name(f"{k}.h264")
        with av.open(str(one), "w", format="h264") as container:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
            for n in range(25):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(numbered(n, size), format="bgr24")))
            container.mux(stream.encode(None))
        parts.append(one.read_bytes())
    path.write_bytes(b"".join(parts))
    return path


def test_a_size_that_changes_half_way(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.h264: the frames change from 96 x 64 to 128 x 96 after 0\.9\d s"):
        list(frames(changed_size(tmp_path / "a.h264")))


def audio_only(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=16000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 16000), dtype=np.float32), format="fltp", layout="mono")
        sound.rate, sound.pts = 16000, 0
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))
    return path


def with_text(path: Path) -> Path:
    path.write_text("this is no video\n" * 50)
    return path


def with_nothing(path: Path) -> Path:
    path.write_bytes(b"")
    return path


def of_unknown_codec(path: Path) -> Path:
    """A real MP4 whose codec is called zzzz."""
    path.write_bytes(encoded(path, "libx264", count=10).read_bytes().replace(b"avc1", b"zzzz"))
    return path


def of_rubbish(path: Path) -> Path:
    """A real AVI whose pictures are all zeros."""
    encoded(path, "mpeg4", count=10)
    with av.open(str(path)) as container:
        packets = [(p.pos, p.size) for p in container.demux(video=0) if p.pos is not None and p.size]
    data = bytearray(path.read_bytes())
    for start, size in packets:
        data[start : start + size] = bytes(size)
    path.write_bytes(data)
    return path


def a_picture(path: Path) -> Path:
    return encoded(path, "png", count=1, kind="image2", prepare=lambda stream: setattr(stream, "pix_fmt", "rgb24"))


@pytest.mark.parametrize(
    ("make", "name", "told"),
    [
        (lambda path: path, "none.mp4", "no such file"),
        (lambda path: path.parent, "", "is a folder"),
        (with_nothing, "empty.mp4", "0 bytes"),
        (with_text, "text.mp4", "not a video.*convert it"),
        (with_text, "text.txt", "not a video"),
        (audio_only, "sound.mp4", "no video stream, only audio"),
        (of_unknown_codec, "codec.mp4", "codec is unknown.*ffmpeg -i codec.mp4"),
        (of_rubbish, "rubbish.avi", "nothing of it can be decoded"),
        (a_picture, "picture.png", "not a video"),
    ],
)
def test_what_is_no_video(tmp_path: Path, make: Callable[[Path], Path], name: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        probe(make(tmp_path / name))
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_rates_that_cannot_be(plain: Path, rate: float) -> None:
    with pytest.raises(InputError, match="per second"):
        frames(plain, rate)


def test_progress_of_a_video_of_unknown_length(plain: Path) -> None:
    known = probe(plain)
    unknown = VideoInfo(known.path, known.size, known.codec, 25.0, False, 25.0, frames=None, seconds=None)
    assert expected_count(unknown) is None
    assert expected_count(unknown, 5.0) is None


def test_sizes_of_video_and_lens() -> None:
    assert fit_of_size((1920, 1080), (1920, 1080)) == "same"
    assert fit_of_size((1080, 1920), (1088, 1920)) == "cropped"
    assert fit_of_size((1920, 1080), (1920, 1088)) == "cropped"
    for video, lens, told in [
        ((1080, 1920), (1920, 1080), "1080 x 1920.*1920 x 1080.*rotated by 90"),
        ((960, 540), (1920, 1080), "scaled by 0.5"),
        ((1280, 720), (1920, 1080), "scaled by 0.6667"),
        ((1920, 1088), (1920, 1080), "give the intrinsics of this video"),
        ((1920, 1064), (1920, 1080), "give the intrinsics of this video"),
        ((640, 480), (1920, 1080), "give the intrinsics of this video"),
    ]:
        with pytest.raises(InputError, match=told):
            fit_of_size(video, lens)


def test_real_videos(data_root: Path) -> None:
    info = probe(data_root / "pets2009" / "V1.avi")
    assert (info.size, info.clock_fps, info.variable, info.frames) == ((768, 576), 10.0, False, 795)
    info = probe(data_root / "pose2sim_single" / "videos" / "cam01.mp4")
    assert (info.clock_fps, info.variable, info.frames) == (60.0, False, 100)
    assert [frame.number for frame in frames(info, 10.0)] == list(range(1, 101, 6))
