"""Times in the names of files."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from passerby.perception.sources.name_times import NamePattern, find_usual_time

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
def test_usual_names(path: str, later_s: float, resolution_s: float, utc: bool) -> None:
    found = find_usual_time(Path("/x") / path)
    assert (found.seconds, found.resolution_s, found.utc) == (HALF_PAST + later_s, resolution_s, utc)


@pytest.mark.parametrize("name", ["cam1.mp4", "frame_000123.jpg", "north_20261350_083005.mp4", "1080p25.mp4", "30.05.mp4"])
def test_names_without_a_time(name: str) -> None:
    assert find_usual_time(Path("/videos") / name) is None


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


@pytest.mark.parametrize(
    ("text", "why"), [("%H.%M.mp4", "date"), ("%Q.mp4", "%Q"), ("%Y%m%d%H/%H.mp4", "twice"), ("north.mp4", "date")]
)
def test_patterns_without_a_time_are_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        NamePattern(text)
