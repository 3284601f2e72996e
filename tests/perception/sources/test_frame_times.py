"""Times of a video's frames by a table beside it: columns and units are recognised, and what cannot be such is an error."""

from pathlib import Path

import numpy as np
import pytest

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.kept import video_identity
from passerby.perception.sources.frame_times import apply_times, find_frame_times, read_frame_times
from passerby.perception.video import VideoReader, probe
from support.refusals import refused

FPS = 20.0
STEPS = np.array([0.05, 0.05, 0.2, 0.05, 0.15, 0.05, 0.05, 0.1, 0.05])
SECONDS = np.concatenate([[0.0], np.cumsum(STEPS)])
EPOCH = 1_790_000_000.25


def table(folder: Path, *rows: str) -> Path:
    path = folder / "a.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def written(folder: Path, values: Floats, heading: str = "") -> Path:
    rows = [f"{number},{value:.6f}" for number, value in enumerate(values.tolist(), 1)]
    return table(folder, *([heading] if heading else []), *rows)


@pytest.mark.parametrize("heading", ["", "frame,timestamp"])
@pytest.mark.parametrize("begin", [0.0, 12.5, EPOCH])
@pytest.mark.parametrize("unit", [1.0, 1e3, 1e6, 1e9])
def test_units_are_recognised(tmp_path: Path, heading: str, begin: float, unit: float) -> None:
    found = read_frame_times(written(tmp_path, (begin + SECONDS) * unit, heading), 1 / FPS)
    np.testing.assert_allclose(found.seconds, SECONDS, atol=1e-5)
    assert found.begin_s == (pytest.approx(EPOCH) if begin == EPOCH else None)


@pytest.mark.parametrize("rate", [0.01, 0.7, 24.0, 240.0])
@pytest.mark.parametrize("unit", [1.0, 1e3, 1e6, 1e9])
def test_a_unit_is_found_whatever_the_rate(tmp_path: Path, rate: float, unit: float) -> None:
    steps = np.random.default_rng(3).uniform(0.4, 2.5, 60) / rate
    seconds = np.concatenate([[0.0], np.cumsum(steps)])
    found = read_frame_times(written(tmp_path, seconds * unit), 1 / rate)
    np.testing.assert_allclose(found.seconds, seconds, atol=2e-6)


@pytest.mark.parametrize(
    "rows",
    [
        ("0.0", "0.05", "0.1"),
        ("timestamp_ms", "500", "550", "600"),
        ("# a logger", "frame;t", "1;7.0", "2;7.05", "3;7.1"),
        ("1 3.0", "2 3.05", "3 3.1"),
        ("name,stamp", "a.png,2026-11-22T08:30:00.000", "b.png,2026-11-22T08:30:00.050", "c.png,2026-11-22T08:30:00.100"),
        ("time_ns,frame", "1000000000,1", "1050000000,2", "1100000000,3"),
    ],
)
def test_tables_are_read_as_loggers_write_them(tmp_path: Path, rows: tuple[str, ...]) -> None:
    np.testing.assert_allclose(read_frame_times(table(tmp_path, *rows), 1 / FPS).seconds, [0.0, 0.05, 0.1], atol=1e-6)


@pytest.mark.parametrize(
    ("rows", "what"),
    [
        (("1,0.0", "2,0.1", "3,0.05"), "row 3: 0.05 is before the time of the row above it"),
        (("frame,time_s", "1,0.0", "2,x"), "row 3 .* has no time in column 2"),
        (("1,0.5",), "has 1 times"),
        (("1,5", "2,5", "3,5"), "all its times are the same"),
    ],
)
def test_what_is_no_table_of_times(tmp_path: Path, rows: tuple[str, ...], what: str) -> None:
    with refused(what, tmp_path / "a.csv"):
        read_frame_times(table(tmp_path, *rows))


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten frames that state 20 a second; each is as bright as its number."""
    path = tmp_path_factory.mktemp("film") / "a.mp4"
    with VideoWriter(path, (64, 48), FPS, crf=10) as video:
        for number in range(len(SECONDS)):
            video.write(np.full((48, 64, 3), 20 * number + 20, np.uint8))
    return path


def test_frames_are_numbered_by_the_table(film: Path, tmp_path: Path) -> None:
    times = read_frame_times(written(tmp_path, EPOCH + SECONDS), 1 / FPS)
    info = apply_times(probe(film), times)
    frames = list(VideoReader(info))
    np.testing.assert_allclose([frame.seconds for frame in frames], SECONDS, atol=1e-5)
    assert [frame.number for frame in frames] == (np.rint(SECONDS * 100) + 1).astype(int).tolist()
    np.testing.assert_allclose([frame.picture.mean() for frame in frames], 20.0 * np.arange(10) + 20, atol=4)
    np.testing.assert_array_equal(times.renumbered(np.arange(1, 11), "a"), [frame.number for frame in frames])
    assert info.clock.created_s == pytest.approx(EPOCH)
    assert video_identity(info) != video_identity(probe(film))


@pytest.mark.parametrize("rate", [0.5, 2.0, 5.0])
def test_frames_are_chosen_by_their_true_times(film: Path, tmp_path: Path, rate: float) -> None:
    info = apply_times(probe(film), read_frame_times(written(tmp_path, SECONDS), 1 / FPS))
    ticks = np.floor((SECONDS + 0.005) * rate)
    first = np.flatnonzero(np.diff(ticks, prepend=-1) > 0)
    np.testing.assert_allclose([frame.seconds for frame in VideoReader(info, rate)], SECONDS[first], atol=1e-5)


def test_as_many_times_as_frames_are_needed(film: Path, tmp_path: Path) -> None:
    times = read_frame_times(written(tmp_path, SECONDS[:5]), 1 / FPS)
    with pytest.raises(InputError, match=r"has 5 times, but a.mp4 has 10 frames"):
        apply_times(probe(film), times)
    with pytest.raises(InputError, match="camera a: has 5 times, but there are people in frame 6"):
        times.renumbered(np.array([1, 6]), "a")


def test_tables_are_found_beside_their_videos(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    for name in ("a.mp4", "b.mp4", "c.mp4", "a.csv", "b_timestamps.csv", "timestamps.csv", "d/v.mp4", "d/timestamps.csv"):
        (tmp_path / name).touch()
    for video, table in (("a", "a.csv"), ("b", "b_timestamps.csv"), ("c", None), ("d/v", "d/timestamps.csv")):
        assert find_frame_times(tmp_path / f"{video}.mp4") == (table and tmp_path / table)
