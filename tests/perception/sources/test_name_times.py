"""Times in the names of files."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from passerby.perception.sources.name_times import NamePattern, find_usual_time


def at(*parts: int) -> float:
    return datetime(*parts, tzinfo=UTC).timestamp()


HALF_PAST = at(2026, 11, 22, 8, 30, 5)


@pytest.mark.parametrize(
    ("path", "utc"),
    [
        ("recordings/2026-11-22/08/north/30.05.mp4", True),
        ("north_20261122083005.mp4", False),
        ("ch01_20261122-083005.mp4", False),
        ("north/2026-11-22_08-30-05.mkv", False),
        ("north/2026-11-22T08-30-05.mkv", False),
        ("vlc-record-2026-11-22-08h30m05s-rtsp___10.0.0.1_-.mp4", False),
        ("20261122-083005-083505_192.168.1.11-CH2.mp4", False),
        ("2026-11-22/001/dav/08/08.30.05-09.00.00[M][0@0][0].mp4", False),
        ("2026112208/30M05S_1795336205.mp4", True),
        ("north_20261122T083005Z.mp4", True),
        ("2026-11-22T08-30-05Zebra.mp4", False),
    ],
)
def test_usual_names(path: str, utc: bool) -> None:
    found = find_usual_time(Path("/x") / path)
    assert found is not None
    assert (found.seconds, found.resolution_s, found.utc) == (HALF_PAST, 1.0, utc)


@pytest.mark.parametrize(("name", "utc"), [("20261122083005250.jpg", False), ("20261122T083005.250Z.mkv", True)])
def test_thousandths_count(name: str, utc: bool) -> None:
    found = find_usual_time(Path(name))
    assert found is not None
    assert (found.seconds, found.resolution_s, found.utc) == (HALF_PAST + 0.25, 0.001, utc)


@pytest.mark.parametrize("name", ["cam1.mp4", "frame_000123.jpg", "north_20261350_083005.mp4", "1080p25.mp4", "30.05.mp4"])
def test_names_without_a_time(name: str) -> None:
    assert find_usual_time(Path("/videos") / name) is None


def test_a_pattern_reads_the_end_of_the_path() -> None:
    pattern = NamePattern("%Y-%m-%d/%H/*/%M.%S.mp4")
    found = pattern.time_of(Path("/any/recordings/2026-11-22/08/north (2)/30.05.mp4"))
    assert found is not None
    assert (found.seconds, found.utc) == (HALF_PAST, False)
    assert pattern.time_of(Path("/any/recordings/2026-11-22/08/north/30.05.mkv")) is None


def test_a_pattern_knows_time_zones() -> None:
    found = NamePattern("%Y%m%d_%H%M%S%z*.mp4").time_of(Path("20261122_093005+0100_front.mp4"))
    assert found is not None
    assert (found.seconds, found.utc) == (HALF_PAST, True)


@pytest.mark.parametrize(
    ("text", "why"), [("%H.%M.mp4", "date"), ("%Q.mp4", "%Q"), ("%Y%m%d%H/%H.mp4", "twice"), ("north.mp4", "date")]
)
def test_patterns_without_a_time_are_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        NamePattern(text)
