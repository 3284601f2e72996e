"""Pieces of recordings are known by the times in their names, and several cameras with times in theirs are none."""

from datetime import datetime
from pathlib import Path

import pytest

from passerby.scene.start.recordings import is_numbered_series, pieces_among, start_of

TEN = datetime(2024, 5, 1, 10, 3, 5).timestamp()


@pytest.mark.parametrize(
    ("stem", "rest", "seconds"),
    [
        ("2024-05-01_10-03-05", "", TEN),
        ("2024-05-01T10:03:05Z", "z", TEN),
        ("Front Door_2024-05-01_10.03.05", "front door_", TEN),
        ("20240501_1003", "", TEN - 5),
        ("gate-1714557785123", "gate-", 1714557785.123),
        ("05.10", "", 310.0),
        ("10-05-20", "", 36320.0),
    ],
)
def test_times_in_names(stem, rest, seconds):
    assert start_of(stem) == (rest, pytest.approx(seconds))


@pytest.mark.parametrize(
    "stem", ["cam1", "walk_cam1_1080p", "20240501", "cam_20240501_1", "GX010001", "20241301_100305", "20240501_256161", "75.10",
             "1.2.3"],
)  # fmt: skip
def test_names_without_a_time(stem):
    assert start_of(stem) is None


def paths(*stems, ending=".mp4"):
    return [Path(f"{stem}{ending}") for stem in stems]


MINUTES = paths(*(f"front_2024-05-01_10-{minute:02d}-00" for minute in range(12)))


def test_one_after_another():
    asked = []

    def length(path):
        asked.append(path)
        return 60.0

    assert pieces_among([*reversed(MINUTES), Path("gate.mp4")], length) == MINUTES
    assert len(asked) == 8, "a day has thousands"
    assert pieces_among(MINUTES, lambda path: 62.0) == MINUTES  # each goes on a little after the next has begun
    assert pieces_among(MINUTES, lambda path: 10.0) == MINUTES  # movement alone is recorded
    assert pieces_among(MINUTES[:2], lambda path: 60.0) == MINUTES[:2]
    assert pieces_among(paths("00.00", "00.10", "00.20"), lambda path: 10.0) == paths("00.00", "00.10", "00.20")


@pytest.mark.parametrize(
    ("videos", "seconds"),
    [
        (paths("VID_20240501_100000", "VID_20240501_100007", "VID_20240501_100100"), 300.0),
        (paths("VID_20240501_100000", "VID_20240501_100000-2"), 300.0),
        (paths("front_20240501_100000", "gate_20240501_110000", "yard_20240501_120000"), 60.0),
        (paths("VID_20240501_100000", "VID_20240509_183000"), 60.0),
        (paths("cam1", "cam2", "cam3"), 60.0),
        (paths("01.01", "01.02", "01.03"), 60.0),
        (MINUTES, None),
    ],
    ids=["phones", "same start", "cameras", "a wrong clock", "no times", "floor and number", "lengths not known"],
)
def test_cameras_are_no_pieces(videos, seconds):
    assert pieces_among(videos, lambda path: seconds) == []


def test_numbers_for_names():
    assert is_numbered_series(paths("000", "001", "002"))
    assert is_numbered_series(paths("10.05", "10.15", "10.25"))
    assert not is_numbered_series(paths("000", "001"))
    assert not is_numbered_series(paths("take1", "take2", "take3"))
