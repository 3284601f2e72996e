"""Pieces of a recording: where they begin and end, what they are called, and what is left where they cannot be written."""

import errno
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.recording import open_source
from passerby.recording import pieces as module
from passerby.recording.pieces import Piece, PieceWriter, WallTime, make_folder
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import wall_clock_of

BEGIN = datetime(2026, 3, 4, 5, 6, 7, 250_000, tzinfo=UTC).timestamp()
WALL = WallTime(BEGIN, "sender")
FPS, SECONDS, KEY_EVERY = 10, 6, 10
Change = Callable[[int, Any], bool]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.mkv"
    with VideoWriter(path, (64, 48), FPS, key_every=KEY_EVERY) as video:
        for number in range(SECONDS * FPS):
            video.write(np.full((48, 64, 3), 3 * number, np.uint8))
    return path


def recorded(
    film: Path, folder: Path, length_s: float = 2.0, wall: WallTime | None = WALL,
    changed: Change = lambda number, packet: True,
) -> list[Piece]:  # fmt: skip
    """Pieces of the film's packets, but for those for which `changed` says no."""
    make_folder(folder)
    pieces: list[Piece] = []
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        writer = PieceWriter(folder, [stream], length_s, lambda: wall, pieces.append)
        for number, packet in enumerate(container.demux(stream)):
            if changed(number, packet):
                writer.write(packet)
        writer.end()
        writer.end()  # what is ended stays so
    return pieces


def left_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def begins(pieces: list[Piece]) -> list[float]:
    return [round(piece.begin_s - BEGIN, 3) for piece in pieces]


def test_every_packet_is_in_one_piece_and_each_begins_with_a_key_frame(film: Path, tmp_path: Path) -> None:
    pieces = recorded(film, tmp_path)
    assert ([piece.packets for piece in pieces], begins(pieces)) == ([20, 20, 20], [0.0, 2.0, 4.0])
    assert [piece.size_bytes for piece in pieces] == [piece.path.stat().st_size for piece in pieces]
    assert left_in(tmp_path) == [piece.path.name for piece in pieces]
    for piece in pieces:
        with av.open(str(piece.path)) as container:
            assert next(container.demux(video=0)).is_keyframe


def test_a_name_that_is_taken_is_that_of_the_next_thousandth(film: Path, tmp_path: Path) -> None:
    """A camera whose clock was set back, or two runs at once: no piece is written over."""
    (first,) = recorded(film, tmp_path, 60.0)
    before = first.path.read_bytes()
    (second,) = recorded(film, tmp_path, 60.0)
    assert [piece.path.name for piece in (first, second)] == ["20260304T050607.250Z.mkv", "20260304T050607.251Z.mkv"]
    assert first.path.read_bytes() == before


def test_what_comes_before_the_first_key_frame_is_left_out_and_all_of_an_unknown_time(film: Path, tmp_path: Path) -> None:
    assert (recorded(film, tmp_path, wall=None), left_in(tmp_path)) == ([], [])
    (piece,) = recorded(film, tmp_path, 60.0, changed=lambda number, packet: number >= 4)
    assert (piece.packets, piece.begin_s) == (SECONDS * FPS - KEY_EVERY, pytest.approx(BEGIN + KEY_EVERY / FPS))


def test_without_key_frames_a_piece_ends_at_last(film: Path, tmp_path: Path) -> None:
    """And the next one begins where one comes."""
    pieces = recorded(film, tmp_path, 1.2, changed=lambda number, packet: number in (0, 50) or not packet.is_keyframe)
    assert (begins(pieces), pieces[0].seconds) == ([0.0, 5.0], pytest.approx(3.6, abs=1.5 / FPS))


def test_a_clock_that_jumps_back_begins_a_new_piece(film: Path, tmp_path: Path) -> None:
    def changed(number: int, packet: Any) -> bool:
        if number >= 30 and packet.pts is not None:
            packet.pts -= round(2.5 / packet.time_base)
            packet.dts -= round(2.5 / packet.time_base)
        return True

    pieces = recorded(film, tmp_path, 60.0, changed=changed)
    assert ([piece.packets for piece in pieces], begins(pieces)) == ([30, 30], [0.0, 0.5])


def failing(error: Exception) -> Callable[..., None]:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    return fail


@pytest.mark.parametrize("where", ["while a piece is written", "when it is to get its name"])
def test_a_disk_that_is_full_is_named_with_its_remedy(film, tmp_path, monkeypatch, where):
    """No piece is named that is not there."""
    full = failing(OSError(errno.ENOSPC, "No space left on device"))
    with monkeypatch.context() as patch:
        patch.setattr(*((PieceWriter, "_mux") if "written" in where else (module.os, "fsync")), full)
        message = r"\.recording-\d+\.part: cannot be written \(No space left on device\): make room there"
        with pytest.raises(InputError, match=message):
            recorded(film, tmp_path)
    assert all(name.startswith(".recording-") for name in left_in(tmp_path))
    make_folder(tmp_path)  # as the next recording does
    assert left_in(tmp_path) == []


def test_what_no_file_can_hold_is_a_fault_of_the_camera(film: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    invalid = av.error.InvalidDataError(errno.EINVAL, "Invalid data found when processing input")
    monkeypatch.setattr(PieceWriter, "_mux", failing(invalid))
    with pytest.raises(ValueError, match=r"sends what a Matroska file cannot hold \(Invalid data found"):
        recorded(film, tmp_path)
    assert left_in(tmp_path) == []


def test_a_folder_that_cannot_be_made_is_named_and_what_is_not_ours_stays(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="file: cannot be written"):
        make_folder(tmp_path / "file")
    (tmp_path / "a").mkdir()
    for name in (".recording-12.part", ".recording.part", "20260304T050607.250Z.mkv", "notes.txt"):
        (tmp_path / "a" / name).write_text("mine")
    make_folder(tmp_path / "a")
    assert left_in(tmp_path / "a") == [".recording.part", "20260304T050607.250Z.mkv", "notes.txt"]


@pytest.mark.parametrize("zone", ["UTC", "America/New_York", "Pacific/Auckland"])
def test_names_are_read_back_as_utc(film: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zone: str) -> None:
    """In New York clocks are set back half an hour later, and their 1:59 comes twice."""
    autumn_s = datetime(2026, 11, 1, 5, 59, 57, 250_000, tzinfo=UTC).timestamp()
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        pieces, _ = (recorded(film, tmp_path / name, wall=WallTime(autumn_s, "sender")) for name in "ab")
        names = [piece.path.name for piece in pieces]
        assert names == [f"20261101T{second}.250Z.mkv" for second in ("055957", "055959", "060001")]
        wall = open_source(VideoSource((tmp_path / "a",)), "a").info.wall
        assert (wall.utc, wall.seconds) == (True, pytest.approx(autumn_s, abs=1e-3))
        cameras = "".join(f'[cameras.{name}]\nvideo = "{name}"\nhfov_deg = 60\n' for name in "ab")
        (tmp_path / "scene.toml").write_text(f'[scene]\nfrom = "2026-11-01 01:59:59-04:00"\n{cameras}')
        scene = Scene.load(tmp_path / "scene.toml")
        assert wall_clock_of(scene, read_cameras(scene)).first.text == "2026-11-01T05:59:59+00:00"
    finally:
        monkeypatch.undo()
        time.tzset()
