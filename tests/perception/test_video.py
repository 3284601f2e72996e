"""Videos as pictures: every picture of these carries its number in its pixels."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.stream import VideoStream

from passerby.common.errors import InputError
from passerby.perception.pictures import Frame
from passerby.perception.video import expected_count, fit_of_size, frames, probe
from support.refusals import refused
from support.scenes.numbered_videos import SIZE, number_in, numbered, written


def encoded(
    path: Path,
    codec: str,
    count: int = 100,
    kind: str | None = None,
    options: dict[str, str] | None = None,
    noise: int = 0,
    first_pts: int = 0,
    size: tuple[int, int] = SIZE,
    prepare: Callable[[VideoStream], None] = lambda stream: None,
) -> Path:
    """A video by another codec or in another container, 25 pictures a second; noise makes its packets large."""
    rng = np.random.default_rng(3)
    with av.open(str(path), "w", format=kind, options=options or {}) as container:
        stream = container.add_stream(codec, rate=25)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = size
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.codec_context.gop_size = 25
        prepare(stream)
        for k in range(count):
            plain = numbered(k + 1, size)
            picture = np.clip(plain + rng.integers(-noise, noise + 1, plain.shape), 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = first_pts + k, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def check(read: list[Frame], expected: list[int]) -> None:
    """The numbers, and that the pictures are those of the numbers."""
    assert ([frame.number for frame in read], [number_in(frame.picture) for frame in read]) == (expected, expected)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("videos") / "plain.mp4")


def test_all_pictures(plain: Path) -> None:
    info = probe(plain)
    assert (info.size, info.codec, info.clock_fps, info.variable, info.frames) == (SIZE, "h264", 25.0, False, 100)
    assert info.seconds == pytest.approx(4.0)
    reader = frames(plain)
    read = list(reader)
    check(read, list(range(1, 101)))
    assert [frame.seconds for frame in read] == pytest.approx([k / 25 for k in range(100)])
    assert all(frame.picture.shape == (64, 96, 3) and frame.picture.dtype == np.uint8 for frame in read)
    assert (reader.decoded.pictures, reader.decoded.broken, reader.decoded.ended_early) == (100, 0, None)
    unknown = replace(info, frames=None, seconds=None)
    assert (expected_count(unknown), expected_count(unknown, 5.0)) == (None, None)


@pytest.mark.parametrize("rate", [1.0, 7.0, 12.5, 24.0, 25.0, 60.0, 1 / 3])
def test_the_picture_at_or_after_each_tick(plain: Path, rate: float) -> None:
    ticks = range(int(4 * rate) + 1)
    wanted = {int(-(-Fraction(25) * k // Fraction(rate).limit_denominator(100))) + 1 for k in ticks}
    expected = sorted(number for number in wanted if number <= 100)
    check(list(frames(plain, rate)), expected)
    assert expected_count(probe(plain), rate) == pytest.approx(len(expected), abs=1)
    if rate >= 25:
        assert len(expected) == 100


@pytest.mark.parametrize("rate", [None, 7.0, 10.0])
@pytest.mark.parametrize("after", [0, 1, 37, 99, 500])
def test_going_on_after_a_picture(plain: Path, rate: float | None, after: int) -> None:
    whole = [frame for frame in frames(plain, rate) if frame.number > after]
    rest = list(frames(plain, rate, after=after))
    assert [(f.number, f.seconds) for f in rest] == [(f.number, f.seconds) for f in whole]
    assert all((a.picture == b.picture).all() for a, b in zip(rest, whole, strict=True))


def test_threads_and_repetition_change_nothing_and_rates_that_cannot_be_are_refused(plain: Path) -> None:
    reader = frames(plain, 10.0)
    for other in (reader, frames(probe(plain), 10.0, threads=3)):
        assert all((a.picture == b.picture).all() for a, b in zip(list(reader), other, strict=True))
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="per second"):
            frames(plain, rate)


def test_timestamps_of_a_variable_rate_are_honoured(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    seconds = np.cumsum(rng.uniform(0.021, 0.12, 120)) - 0.02
    path = written(tmp_path / "a.mp4", 120, 15, list(seconds))
    info = probe(path)
    assert (info.variable, info.clock_fps) == (True, 100.0)
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
    ("name", "codec", "b_frames", "first_pts"),
    [("b.avi", "mpeg4", 2, 0), ("c.avi", "mjpeg", 0, 0), ("d.ts", "libx264", 2, 0), ("e.mkv", "libx264", 2, 1000),
     ("f.flv", "libx264", 2, 0), ("g.h264", "libx264", 0, 0)],
)  # fmt: skip
def test_other_containers_and_codecs(tmp_path: Path, name: str, codec: str, b_frames: int, first_pts: int) -> None:
    """Numbers count from the first picture."""
    path = encoded(
        tmp_path / name, codec, first_pts=first_pts,
        prepare=lambda stream: setattr(stream.codec_context, "max_b_frames", b_frames),
    )  # fmt: skip
    assert probe(path).clock_fps == pytest.approx(25.0)
    read = list(frames(path))
    check(read, list(range(1, 101)))
    assert read[0].seconds == 0.0
    check(list(frames(path, 5.0, after=31)), list(range(36, 101, 5)))


def test_a_rotation_for_the_player_is_made(tmp_path: Path) -> None:
    """Clockwise; counter-clockwise and upside down among the packagings."""
    path = encoded(tmp_path / "a.mp4", "libx264", count=3, prepare=lambda stream: stream.set_display_rotation(-90))
    info = probe(path)
    assert (info.size, info.rotation) == (SIZE[::-1], 270)
    turned = [(frame.picture.shape, number_in(np.rot90(frame.picture))) for frame in frames(info)]
    assert turned == [((SIZE[0], SIZE[1], 3), number) for number in (1, 2, 3)]


def cut(path: Path, part: float) -> Path:
    """The first part of a file."""
    data = path.read_bytes()
    shorter = path.with_name(f"cut-{path.name}")
    shorter.write_bytes(data[: int(len(data) * part)])
    return shorter


@pytest.mark.parametrize(
    ("name", "codec", "options", "count", "part"),
    [("a.mp4", "libx264", {"movflags": "faststart"}, 100, 0.6), ("b.avi", "mpeg4", {}, 100, 0.6),
     ("c.avi", "mjpeg", {}, 100, 0.6), ("d.mkv", "libx264", {}, 200, 0.4)],
)  # fmt: skip
def test_a_truncated_video_gives_what_is_there_and_says_so(tmp_path, name, codec, options, count, part):
    reader = frames(cut(encoded(tmp_path / name, codec, count, options=options, noise=20), part))
    read = list(reader)
    assert 15 < len(read) < 90
    check(read[:-2], list(range(1, len(read) - 1)))
    assert f"of the {count / 25} s" in reader.decoded.ended_early


def test_broken_packets_are_passed_over_and_counted(tmp_path: Path) -> None:
    reader = frames(with_zeros(encoded(tmp_path / "a.avi", "mpeg4", noise=30), slice(40, 43)))
    read = {frame.number: number_in(frame.picture) for frame in reader}
    assert all(number == read[number] for number in read if number <= 40 or number > 51)
    assert set(range(1, 41)) | set(range(52, 101)) <= set(read)
    assert reader.decoded.broken >= 3
    assert reader.decoded.first_broken_s == pytest.approx(1.6, abs=0.1)
    assert reader.decoded.ended_early is None


def test_an_unfinished_recording_and_a_size_that_changes_half_way_are_errors(tmp_path: Path) -> None:
    """The latter is a raw stream of two videos, one after the other."""
    with pytest.raises(InputError, match=r"cut-a\.mp4.*cut off before its index"):
        probe(cut(encoded(tmp_path / "a.mp4", "libx264"), 0.6))
    path = tmp_path / "a.h264"
    parts = [encoded(path, "libx264", 25, "h264", size=size).read_bytes() for size in (SIZE, (128, 96))]
    path.write_bytes(b"".join(parts))
    with pytest.raises(InputError, match=r"a\.h264: the frames change from 96 x 64 to 128 x 96 after 0\.9\d s"):
        list(frames(path))


def audio_only(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=16000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 16000), dtype=np.float32), format="fltp", layout="mono")
        sound.rate, sound.pts = 16000, 0
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))
    return path


def of_unknown_codec(path: Path) -> Path:
    """A real MP4 whose codec is called zzzz."""
    path.write_bytes(encoded(path, "libx264", count=10).read_bytes().replace(b"avc1", b"zzzz"))
    return path


def with_zeros(path: Path, packets: slice) -> Path:
    """A real AVI in place of some of whose pictures there are zeros."""
    with av.open(str(path)) as container:
        places = [(p.pos, p.size) for p in container.demux(video=0) if p.pos is not None and p.size]
    data = bytearray(path.read_bytes())
    for start, size in places[packets]:
        data[start : start + size] = bytes(size)
    path.write_bytes(data)
    return path


def a_picture(path: Path) -> Path:
    return encoded(path, "png", count=1, kind="image2", prepare=lambda stream: setattr(stream, "pix_fmt", "rgb24"))


def holding(content: bytes) -> Callable[[Path], Path]:
    return lambda path: (path.write_bytes(content) and path) or path


TEXT = holding(b"this is no video\n" * 50)


@pytest.mark.parametrize(
    ("make", "name", "said"),
    [
        (lambda path: path, "none.mp4", "no such file"),
        (lambda path: path.parent, "", "is a folder"),
        (holding(b""), "empty.mp4", "0 bytes"),
        (TEXT, "text.mp4", "not a video.*convert it"),
        (TEXT, "text.txt", "not a video"),
        (audio_only, "sound.mp4", "no video stream, only audio"),
        (of_unknown_codec, "codec.mp4", "codec is unknown.*ffmpeg -i codec.mp4"),
        (lambda path: with_zeros(encoded(path, "mpeg4", count=10), slice(None)), "rubbish.avi", "nothing of it can be decoded"),
        (a_picture, "picture.png", "not a video"),
    ],
)
def test_what_is_no_video(tmp_path: Path, make: Callable[[Path], Path], name: str, said: str) -> None:
    with refused(said, name):
        probe(make(tmp_path / name))


@pytest.mark.parametrize(
    ("video", "said"),
    [((1080, 1920), "1080 x 1920.*1920 x 1080.*rotated by 90"), ((960, 540), "scaled by 0.5"),
     ((1280, 720), "scaled by 0.6667"),
     *((size, "give the intrinsics of this video") for size in ((1920, 1088), (1920, 1064), (640, 480)))],
)  # fmt: skip
def test_sizes_of_video_and_lens(video, said):
    fits = [fit_of_size(*sizes) for sizes in (((1920, 1080),) * 2, ((1080, 1920), (1088, 1920)), ((1920, 1080), (1920, 1088)))]
    assert fits == ["same", "cropped", "cropped"]
    with pytest.raises(InputError, match=said):
        fit_of_size(video, (1920, 1080))


def test_real_videos(data_root: Path) -> None:
    info = probe(data_root / "pets2009" / "V1.avi")
    assert (info.size, info.clock_fps, info.variable, info.frames) == ((768, 576), 10.0, False, 795)
    info = probe(data_root / "pose2sim_single" / "videos" / "cam01.mp4")
    assert (info.clock_fps, info.variable, info.frames) == (60.0, False, 100)
    assert [frame.number for frame in frames(info, 10.0)] == list(range(1, 101, 6))
