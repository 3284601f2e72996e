"""Times of a video's frames by a table beside it, times in the names of files, and where pieces of a recording lie."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.kept import video_identity
from passerby.perception.sources.files import follow_at_once, gaps_between, place_by_names
from passerby.perception.sources.frame_times import apply_times, find_frame_times, read_frame_times
from passerby.perception.sources.name_times import NamePattern, find_usual_time
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
def test_units_are_recognised_whatever_the_rate(tmp_path: Path, heading: str, begin: float, unit: float) -> None:
    found = read_frame_times(written(tmp_path, (begin + SECONDS) * unit, heading), 1 / FPS)
    np.testing.assert_allclose(found.seconds, SECONDS, atol=1e-5)
    assert found.begin_s == (pytest.approx(EPOCH) if begin == EPOCH else None)
    for rate in (0.01, 0.7, 24.0, 240.0):
        seconds = np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).uniform(0.4, 2.5, 60) / rate)])
        found = read_frame_times(written(tmp_path, seconds * unit, heading), 1 / rate)
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


def test_frames_are_numbered_and_chosen_by_the_table(film: Path, tmp_path: Path) -> None:
    times = read_frame_times(written(tmp_path, EPOCH + SECONDS), 1 / FPS)
    info = apply_times(probe(film), times)
    frames = list(VideoReader(info))
    np.testing.assert_allclose([frame.seconds for frame in frames], SECONDS, atol=1e-5)
    assert [frame.number for frame in frames] == (np.rint(SECONDS * 100) + 1).astype(int).tolist()
    np.testing.assert_allclose([frame.picture.mean() for frame in frames], 20.0 * np.arange(10) + 20, atol=4)
    np.testing.assert_array_equal(times.renumbered(np.arange(1, 11), "a"), [frame.number for frame in frames])
    assert info.clock.created_s == pytest.approx(EPOCH)
    assert video_identity(info) != video_identity(probe(film))
    few = read_frame_times(written(tmp_path, SECONDS[:5]), 1 / FPS)
    with pytest.raises(InputError, match=r"has 5 times, but a.mp4 has 10 frames"):
        apply_times(probe(film), few)
    with pytest.raises(InputError, match="camera a: has 5 times, but there are people in frame 6"):
        few.renumbered(np.array([1, 6]), "a")
    for rate in (0.5, 2.0, 5.0):
        first = np.flatnonzero(np.diff(np.floor((SECONDS + 0.005) * rate), prepend=-1) > 0)
        np.testing.assert_allclose([frame.seconds for frame in VideoReader(info, rate)], SECONDS[first], atol=1e-5)


def test_tables_are_found_beside_their_videos(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    for name in ("a.mp4", "b.mp4", "c.mp4", "a.csv", "b_timestamps.csv", "timestamps.csv", "d/v.mp4", "d/timestamps.csv"):
        (tmp_path / name).touch()
    for video, table in (("a", "a.csv"), ("b", "b_timestamps.csv"), ("c", None), ("d/v", "d/timestamps.csv")):
        assert find_frame_times(tmp_path / f"{video}.mp4") == (table and tmp_path / table)


HALF_PAST = datetime(2026, 11, 22, 8, 30, 5, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("path", "later_s", "resolution_s", "utc"),
    [
        ("recordings/2026-11-22/08/north/30.05.mp4", 0, 1.0, True),
        ("north_20261122083005.mp4", 0, 1.0, False),
        ("ch01_20261122-083005.mp4", 0, 1.0, False),
        ("north/2026-11-22_08-30-05.mkv", 0, 1.0, False),
        ("north/2026-11-22T08-30-05.mkv", 0, 1.0, False),
        ("vlc-record-2026-11-22-08h30m05s-rtsp___10.0.0.1_-.mp4", 0, 1.0, False),
        ("20261122-083005-083505_192.168.1.11-CH2.mp4", 0, 1.0, False),
        ("2026-11-22/001/dav/08/08.30.05-09.00.00[M][0@0][0].mp4", 0, 1.0, False),
        ("2026112208/30M05S_1795336205.mp4", 0, 1.0, True),
        ("north_20261122T083005Z.mp4", 0, 1.0, True),
        ("2026-11-22T08-30-05Zebra.mp4", 0, 1.0, False),
        ("20261122083005250.jpg", 0.25, 0.001, False),
        ("20261122T083005.250Z.mkv", 0.25, 0.001, True),
    ],
)
def test_usual_names_with_times(path: str, later_s: float, resolution_s: float, utc: bool) -> None:
    found = find_usual_time(Path("/x") / path)
    assert (found.seconds, found.resolution_s, found.utc) == (HALF_PAST + later_s, resolution_s, utc)


@pytest.mark.parametrize(
    ("pattern", "path", "utc"),
    [
        ("%Y-%m-%d/%H/*/%M.%S.mp4", "/any/recordings/2026-11-22/08/north (2)/30.05.mp4", False),
        ("%Y%m%d_%H%M%S%z*.mp4", "20261122_093005+0100_front.mp4", True),
    ],
)
def test_a_pattern_reads_the_end_of_the_path_and_knows_time_zones(pattern: str, path: str, utc: bool) -> None:
    found = NamePattern(pattern).time_of(Path(path))
    assert (found.seconds, found.utc) == (HALF_PAST, utc)
    assert NamePattern(pattern).time_of(Path(path).with_suffix(".mkv")) is None


def test_names_and_patterns_without_a_time() -> None:
    for name in ("cam1.mp4", "frame_000123.jpg", "north_20261350_083005.mp4", "1080p25.mp4", "30.05.mp4"):
        assert find_usual_time(Path("/videos") / name) is None
    for text, why in (("%H.%M.mp4", "date"), ("%Q.mp4", "%Q"), ("%Y%m%d%H/%H.mp4", "twice"), ("north.mp4", "date")):
        with pytest.raises(ValueError, match=why):
            NamePattern(text)


@pytest.mark.parametrize("length", [10.0, 10.03, 9.7])
def test_pieces_that_follow_at_once_keep_doing_so(length: float) -> None:
    """Names leave fractions off; the recording has none of the jumps that these would make."""
    true = 1000.4 + length * np.arange(40)
    found = place_by_names(np.floor(true), np.full(40, length), 1.0)
    np.testing.assert_allclose(np.diff(found), length, atol=1e-9)
    assert np.abs(found - true).max() < (0.65 if length == 10 else 0.1)


def test_missing_pieces_a_drift_and_a_break_do_not_shift_the_others() -> None:
    """The drift: lengths that are off by a thousandth; after 100 pieces the names say otherwise by a second."""
    kept = np.sort(np.random.default_rng(4).choice(120, 100, replace=False))
    true = (1000.73 + 10.03 * np.arange(120))[kept]
    error = place_by_names(np.floor(true), np.full(100, 10.03), 1.0) - true
    assert np.ptp(error) < 1e-6
    assert np.abs(error).max() < 0.1
    true = 1000.2 + 10.01 * np.arange(400)
    found = place_by_names(np.floor(true), np.full(400, 10.0), 1.0)
    assert np.abs(found - true).max() < 0.5
    assert np.abs(np.diff(found) - 10.01).max() < 0.3
    true = np.concatenate([1000.5 + 10 * np.arange(5), 5003.9 + 10 * np.arange(5)])
    found = place_by_names(np.floor(true), np.full(10, 10.0), 1.0)
    assert np.abs(found - true).max() < 0.75
    gaps = gaps_between(found, np.full(10, 10.0))
    assert (gaps.count, gaps.longest_s) == (1, pytest.approx(5003.9 - 1050.5, abs=1.5))


def test_gaps_and_overlaps() -> None:
    gaps = gaps_between(np.array([0.0, 10.0, 25.0, 33.0]), np.full(4, 10.0))
    assert (gaps.count, gaps.seconds, gaps.longest_at_s) == (1, 5.0, 20.0)
    assert (gaps.overlaps, gaps.overlap_s, gaps.inside) == (1, 2.0, 0)
    assert gaps_between(np.array([0.0, 0.0, 10.0, 10.0]), np.full(4, 10.0)).inside == 2
    # Recorders that begin early cover no piece wholly.
    gaps = gaps_between(np.arange(0.0, 200.0, 8.0), np.full(25, 10.0), 1.0)
    assert (gaps.overlaps, gaps.overlap_s, gaps.inside, gaps.irregular) == (24, 48.0, 0, False)
    np.testing.assert_array_equal(follow_at_once(np.array([3.0, 4.0, 5.0])), [0.0, 3.0, 7.0])


@pytest.mark.parametrize("length", [6.0, 9.3])
@pytest.mark.parametrize("back_s", [17.0, 60.0])
def test_a_clock_that_is_set_back_puts_pieces_into_the_time_of_others(length: float, back_s: float) -> None:
    true = 1000.4 + length * np.arange(30)
    named = np.sort(np.floor(np.where(np.arange(30) < 15, true, true - back_s)))
    begins = place_by_names(named, np.full(30, length), 1.0)
    gaps = gaps_between(begins, np.full(30, length), 1.0)
    assert gaps.irregular
    assert gaps.overlap_s == pytest.approx(back_s, abs=2)
    assert back_s < 30 or 0.9 * back_s / length < gaps.inside <= 2 * back_s / length
    assert 1000.4 + 15 * length - back_s - 1.0 <= gaps.longest_overlap_at_s <= 1000.4 + 15 * length + 1.0
