"""Videos as they are written, read back by the decoder, and pictures of floor plans."""

import errno
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import decode_plan_picture, read_plan_picture
from passerby.interchange.video_writer import VideoWriter

SIZE = (64, 48)


def grey(level: int) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), level, dtype=np.uint8)


def write(path: Path, levels: list[int], seconds: list[float] | None = None) -> Path:
    with VideoWriter(path, SIZE, fps=25, crf=15) as video:
        for row, level in enumerate(levels):
            video.write(grey(level), None if seconds is None else seconds[row])
    return path


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_the_pictures_come_back_in_order_and_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    levels = [20 + 9 * k for k in range(25)]
    path, again = (write(tmp_path / name / f"a.{suffix}", levels) for name in ("new", "again"))
    if suffix == "mp4":
        assert path.read_bytes() == again.read_bytes()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == 25
        back = [(frame.time, float(frame.to_ndarray(format="bgr24").mean())) for frame in container.decode(stream)]
    assert [time for time, _ in back] == pytest.approx([k / 25 for k in range(25)])
    assert [level for _, level in back] == pytest.approx(levels, abs=1.5)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_colours_and_timestamps_of_the_callers_own_come_back(tmp_path: Path) -> None:
    colour, seconds = np.array([30, 90, 200], dtype=np.uint8), [0.0, 0.04, 0.055, 0.3, 1.25]
    with VideoWriter(tmp_path / "a.mp4", SIZE, fps=10, crf=5) as video:
        for second in seconds:
            video.write(np.broadcast_to(colour, (SIZE[1], SIZE[0], 3)), second)
    with av.open(str(tmp_path / "a.mp4")) as container:
        back = [(frame.time, frame.to_ndarray(format="bgr24")) for frame in container.decode(video=0)]
    assert [time for time, _ in back] == pytest.approx(seconds, abs=1e-4)
    assert np.abs(back[0][1].reshape(-1, 3).mean(axis=0) - colour).max() <= 2


@pytest.mark.parametrize(("name", "size", "fps", "crf", "message"), [
    ("a.mp4", (63, 48), 25.0, 23, "even"), ("a.mp4", (0, 48), 25.0, 23, "even"), ("a.mp4", SIZE, 0.0, 23, "rate"),
    ("a.mp4", SIZE, 25.0, 60, "crf 60"), ("a.txt", SIZE, 25.0, 23, r"\.mp4"),
])  # fmt: skip
def test_what_cannot_be_a_video_is_refused(
    tmp_path: Path, name: str, size: tuple[int, int], fps: float, crf: int, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        VideoWriter(tmp_path / name, size, fps, crf)
    with pytest.raises(InputError, match="without frames"), VideoWriter(tmp_path / "a.mp4", SIZE, fps=25):
        pass
    assert list(tmp_path.iterdir()) == []


def test_pictures_that_do_not_fit_leave_the_video_before(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"before")
    with pytest.raises(InputError, match="frame 1 is uint8 of the shape"), VideoWriter(tmp_path / "a.mp4", SIZE, 25) as video:
        video.write(np.zeros((10, 10, 3), dtype=np.uint8))
    for seconds in ([0.5, 0.5], [0.5, 0.0]):
        with pytest.raises(InputError, match="does not come after"):
            write(tmp_path / "a.mp4", [1, 2], seconds)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.mp4": b"before"}
    with VideoWriter(tmp_path / "c.mp4", SIZE, 25) as video:
        video.write(grey(1))
        with pytest.raises(InputError, match="or none"):
            video.write(grey(1), 1.0)
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "a.mp4" / "a.mp4", [1])


class FullDisk:
    """A file of FFmpeg's on a disk that is full from some call on."""

    def __init__(self, container: Any, call: str) -> None:
        self._container, self._call = container, call

    def __getattr__(self, name: str) -> Any:
        return getattr(self._container, name)

    def mux(self, packets: Any) -> None:
        if self._call in ("mux", "mux, then close"):
            raise OSError(errno.ENOSPC, "No space left on device")
        self._container.mux(packets)

    def close(self) -> None:
        self._container.close()
        if self._call in ("close", "mux, then close"):
            raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("call", ["mux", "close", "mux, then close"])
def test_a_disk_that_is_full_is_an_error_and_the_video_before_stays(tmp_path: Path, monkeypatch: Any, call: str) -> None:
    (tmp_path / "a.mp4").write_bytes(b"before")
    real = av.open
    monkeypatch.setattr("passerby.interchange.video_writer.av.open", lambda *a, **named: FullDisk(real(*a, **named), call))
    with pytest.raises(InputError, match=r"a.mp4: cannot be written .No space left on device.: choose a folder with space"):
        write(tmp_path / "a.mp4", [1, 2])
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.mp4": b"before"}


def test_nothing_is_left_of_a_video_that_ffmpeg_does_not_begin(tmp_path: Path, monkeypatch: Any) -> None:
    def broken(*arguments: Any, **named: Any) -> None:
        raise av.error.FFmpegError(1, "broken")

    monkeypatch.setattr("passerby.interchange.video_writer.av.open", broken)
    with pytest.raises(av.error.FFmpegError):
        write(tmp_path / "a.mp4", [1])
    assert not list(tmp_path.iterdir())


def encoded(height=20, width=30, ending=".png"):
    picture = np.zeros((height, width, 3), np.uint8)
    picture[:, :10] = (0, 0, 255)
    return cv2.imencode(ending, picture)[1].tobytes()


def test_a_plan_is_read_in_colours(tmp_path):
    (tmp_path / "plan.png").write_bytes(encoded())
    picture = read_plan_picture(tmp_path / "plan.png")
    assert (picture.shape, picture[5, 5].tolist(), picture[5, 25].tolist()) == ((20, 30, 3), [0, 0, 255], [0, 0, 0])


@pytest.mark.parametrize(("content", "message"), [
    (b"", r"plan\.png: is no picture that can be read: give a PNG or JPEG"),
    (encoded()[:30], r"plan\.png: is no picture that can be read: give a PNG or JPEG"),
    (encoded(3), r"plan\.png: is 30 x 3 pixels: give a picture of the plan"),
    (None, "no such file: a picture of the plan"),
])  # fmt: skip
def test_what_is_no_picture_of_a_plan_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "plan.png").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_plan_picture(tmp_path / "plan.png")


def test_what_the_decoder_does_not_take_is_refused(monkeypatch):
    def broken(*arguments):
        raise cv2.error("too large")

    monkeypatch.setattr(cv2, "imdecode", broken)
    with pytest.raises(InputError, match=r"^the upload: is no picture that can be read"):
        decode_plan_picture(encoded(), "the upload")
