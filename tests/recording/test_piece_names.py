"""What a recording's files are called is read back as what it was, in UTC, wherever that is done."""

import time
from datetime import UTC, datetime

import av
import numpy as np
import pytest

from passerby.interchange.video_writer import VideoWriter
from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.recording import open_source
from passerby.recording.pieces import PieceWriter, WallTime
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import wall_clock_of

BEGIN = datetime(2026, 11, 1, 5, 59, 57, 250_000, tzinfo=UTC).timestamp()
"""Half an hour before clocks in New York are set back, and their 1:59 comes twice."""


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    with VideoWriter(path, (64, 48), 10, key_every=10) as video:
        for number in range(60):
            video.write(np.full((48, 64, 3), 3 * number, np.uint8))
    return path


def recorded(film, folder):
    """What `passerby record` would leave of the film."""
    folder.mkdir()
    pieces = []
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        writer = PieceWriter(folder, [stream], 2.0, lambda: WallTime(BEGIN, "sender"), pieces.append)
        for packet in container.demux(stream):
            writer.write(packet)
        writer.end()
    return pieces


@pytest.mark.parametrize("zone", ["UTC", "America/New_York", "Pacific/Auckland"])
def test_names_are_read_back_as_utc(film, tmp_path, monkeypatch, zone):
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        pieces = recorded(film, tmp_path / "a")
        assert [piece.path.name for piece in pieces] == [f"20261101T05595{n}.250Z.mkv" for n in (7, 9)] + [
            "20261101T060001.250Z.mkv"
        ]
        found = open_source(VideoSource((tmp_path / "a",)), "a").info
        assert found.wall is not None
        assert found.wall.utc
        assert found.wall.seconds == pytest.approx(BEGIN, abs=1e-3)
        recorded(film, tmp_path / "b")
        cameras = "".join(f'[cameras.{name}]\nvideo = "{name}"\nhfov_deg = 60\n' for name in "ab")
        (tmp_path / "scene.toml").write_text(f'[scene]\nfrom = "2026-11-01 01:59:59-04:00"\n{cameras}')
        scene = Scene.load(tmp_path / "scene.toml")
        clock = wall_clock_of(scene, read_cameras(scene))
        assert clock is not None
        assert clock.first is not None
        assert clock.first.text == "2026-11-01T05:59:59+00:00"
    finally:
        monkeypatch.undo()
        time.tzset()
