"""Videos as they are written: read back by the decoder."""

import errno
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from passerby.common.errors import InputError
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
def test_the_pictures_come_back_in_order(tmp_path: Path, suffix: str) -> None:
    levels = [20 + 9 * k for k in range(25)]
    path = write(tmp_path / "new" / f"a.{suffix}", levels)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == 25
        back = [(frame.time, float(frame.to_ndarray(format="bgr24").mean())) for frame in container.decode(stream)]
    assert [time for time, _ in back] == pytest.approx([k / 25 for k in range(25)])
    assert [level for _, level in back] == pytest.approx(levels, abs=1.5)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_colours_come_back(tmp_path: Path) -> None:
    colour = np.array([30, 90, 200], dtype=np.uint8)
    with VideoWriter(tmp_path / "a.mp4", SIZE, fps=10, crf=5) as video:
        video.write(np.broadcast_to(colour, (SIZE[1], SIZE[0], 3)))
    with av.open(str(tmp_path / "a.mp4")) as container:
        back = next(container.decode(video=0)).to_ndarray(format="bgr24")
    assert np.abs(back.reshape(-1, 3).mean(axis=0) - colour).max() <= 2


def test_the_same_pictures_give_the_same_bytes(tmp_path: Path) -> None:
    a, b = (write(tmp_path / name, [10, 80, 200, 30]) for name in ("a.mp4", "b.mp4"))
    assert a.read_bytes() == b.read_bytes()


def test_timestamps_of_the_callers_own(tmp_path: Path) -> None:
    seconds = [0.0, 0.04, 0.055, 0.3, 1.25]
    path = write(tmp_path / "a.mp4", [10, 60, 110, 160, 210], seconds)
    with av.open(str(path)) as container:
        assert [frame.time for frame in container.decode(video=0)] == pytest.approx(seconds, abs=1e-4)


def test_nothing_is_left_of_a_video_that_was_not_finished(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"before")
    with pytest.raises(InputError):
        write(tmp_path / "a.mp4", [1, 2], [0.5, 0.0])
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.mp4": b"before"}


def test_a_video_needs_pictures(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="without frames"), VideoWriter(tmp_path / "a.mp4", SIZE, fps=25):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "size", "fps", "crf", "told"),
    [
        ("a.mp4", (63, 48), 25.0, 23, "even"),
        ("a.mp4", (0, 48), 25.0, 23, "even"),
        ("a.mp4", SIZE, 0.0, 23, "rate"),
        ("a.mp4", SIZE, 25.0, 60, "crf 60"),
        ("a.txt", SIZE, 25.0, 23, r"\.mp4"),
    ],
)
def test_what_cannot_be_a_video(tmp_path: Path, name: str, size: tuple[int, int], fps: float, crf: int, told: str) -> None:
    with pytest.raises(InputError, match=told):
        VideoWriter(tmp_path / name, size, fps, crf)


def test_pictures_that_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="frame 1 is uint8 of the shape"), VideoWriter(tmp_path / "a.mp4", SIZE, 25) as video:
        video.write(np.zeros((10, 10, 3), dtype=np.uint8))
    with pytest.raises(InputError, match="does not come after"):
        write(tmp_path / "b.mp4", [1, 2], [0.5, 0.5])
    with VideoWriter(tmp_path / "c.mp4", SIZE, 25) as video:
        video.write(grey(1))
        with pytest.raises(InputError, match="or none"):
            video.write(grey(1), 1.0)


def test_a_place_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "file" / "a.mp4", [1])


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
def test_a_disk_that_is_full_is_told_and_the_video_before_stays(tmp_path: Path, monkeypatch: Any, call: str) -> None:
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
