"""When people are seen in long recordings, by a few key frames."""

import numpy as np
import pytest

from passerby.scene.start import recordings_found
from passerby.scene.start.recordings_found import RecordingSurvey, look_at, propose_span
from support.scenes.puppet_videos import draw, wall, write_video

SIZE, MINUTES, BUSY, PEOPLE = (160, 120), 64, range(20, 36), 3
BEGIN = 1_790_000_000.0


def picture(minute, camera):
    shown = wall(SIZE, camera).copy()
    rng = np.random.default_rng((minute, camera))
    for who in range(PEOPLE if minute in BUSY else 0):
        left = 8 + 48 * who + float(rng.uniform(0, 16))
        draw(shown, np.array([left, float(rng.uniform(40, 55)), 16.0, 48.0]), who)
    return shown


@pytest.fixture(scope="module")
def cameras(tmp_path_factory):
    """A file a minute, the busy ones from 20 to 36; one of them is broken."""
    folder = tmp_path_factory.mktemp("minutes")
    found = []
    for camera in range(2):
        paths = [folder / f"{camera}-{minute:02d}.mp4" for minute in range(MINUTES)]
        for minute, path in enumerate(paths):
            write_video(path, iter([picture(minute, camera)] * 2), 1.0)
        found.append((tuple(paths), tuple(BEGIN + 60 * minute for minute in range(MINUTES))))
    found[0][0][25].write_bytes(b"broken")
    return found


@pytest.mark.slow
def test_people_are_seen_when_they_are_there_and_the_busiest_span_is_proposed(cameras):
    look = look_at(cameras, BEGIN, BEGIN + 60 * MINUTES)
    assert len(look.people) == 2 * MINUTES - 1
    busy = look.mean_in(BEGIN + 60 * BUSY.start, BEGIN + 60 * BUSY.stop - 1)
    assert busy == pytest.approx(PEOPLE, abs=0.5)
    assert look.mean_in(BEGIN, BEGIN + 60 * BUSY.start - 1) < 0.2
    assert look.mean_in(0.0, 1.0) == 0.0
    surveys = [RecordingSurvey(None, len(paths), begins, paths) for paths, begins in cameras]  # type: ignore[arg-type]
    span = propose_span(surveys)
    assert span is not None
    begin = np.datetime64(span.first.replace(" ", "T")).astype("datetime64[s]").astype(float)
    assert abs(begin - (BEGIN + 60 * BUSY.start)) <= 120
    assert "saw most people" in span.why


def test_a_day_of_many_cameras_costs_no_more(monkeypatch, tmp_path):
    opened = []
    monkeypatch.setattr(recordings_found, "key_picture", lambda path, second: opened.append(path))
    paths = [tmp_path / f"{number}.mp4" for number in range(8640)]
    begins = [BEGIN + 10 * number for number in range(8640)]
    look = look_at([(paths, begins)] * 5, BEGIN, BEGIN + 86400)
    assert 0 < len(opened) <= 291
    assert len(look.people) == 0
