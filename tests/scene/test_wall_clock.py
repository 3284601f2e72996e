"""`video` as pieces and pictures, `from` and `until`, and the second that frame numbers of all cameras count from."""

import json
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.findings.texts import texts_of
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.video import VideoReader
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import wall_clock_of

SIZE, FPS = (64, 48), 5
BEGIN = datetime(2026, 11, 22, 8, 0, 0, tzinfo=UTC).timestamp()
COLOURS = {"north": 60, "south": 120, "east": 180}


def film(path: Path, count: int, colour: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with VideoWriter(path, SIZE, FPS, crf=30, key_every=FPS) as video:
        for _ in range(count):
            video.write(np.full((SIZE[1], SIZE[0], 3), colour, np.uint8))


def frigate(folder: Path, camera: str, second: float, day: int = 22) -> Path:
    time = datetime.fromtimestamp(BEGIN + int(second), UTC).replace(day=day)
    return folder / "recordings" / f"{time:%Y-%m-%d}" / f"{time:%H}" / camera / f"{time:%M.%S}.mp4"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pieces of 4 s, three a camera; the southern camera begins two minutes later, the eastern one has one file."""
    path = tmp_path_factory.mktemp("scene")
    for camera, later in (("north", 300), ("south", 420)):
        for piece in range(3):
            film(frigate(path, camera, later + 4 * piece), 20, COLOURS[camera])
    film(path / "east.mp4", 20, COLOURS["east"])
    return path


def scene(folder: Path, *cameras: str, span: str = "", name: str = "scene.toml", **videos: str) -> Path:
    patterns = {name: f'"recordings/*/*/{name}/*.mp4"' for name in ("north", "south")} | {"east": '"east.mp4"'} | videos
    tables = "".join(f"[cameras.{camera}]\nvideo = {patterns[camera]}\n" for camera in cameras)
    (folder / name).write_text(f"[scene]\n{span}\n{tables}")
    return folder / name


def test_frames_count_from_one_second_and_cameras_without_wall_times_are_a_finding(folder):
    loaded = Scene.load(scene(folder, "north", "south"))
    north, south = read_cameras(loaded)
    assert not north.faults + south.faults
    first, later = (next(iter(VideoReader(one.video))).number for one in (north, south))
    assert 1 <= first <= 1 + FPS
    assert later - first == 120 * FPS
    assert wall_clock_of(loaded, [north, south]).origin.text == "2026-11-22T08:05:00+00:00"
    _, east = read_cameras(Scene.load(scene(folder, "north", "east")))
    assert next(iter(VideoReader(east.video))).number == 1
    (text,) = texts_of(east.findings)
    assert "camera east: it is not known when the recording began" in text
    assert "2026-11-22T08:05:00+00:00" in text


def test_a_gap_makes_no_recording_long(folder: Path, tmp_path: Path) -> None:
    """The clock of one recorder jumps an hour ahead: that is a gap, and the other camera's video was not cut short."""
    for piece, later in enumerate((0, 4, 3600)):
        film(frigate(tmp_path, "north", later), 20, 10 + piece)
        film(frigate(tmp_path, "south", 4 * piece), 20, 40 + piece)
    found = check_scene(scene(tmp_path, "north", "south"))
    assert found.faults == ()
    assert "recording_gaps" in [one.code for one in found.diagnostics]


def test_a_fault_of_one_camera_is_all_that_is_said_of_it(folder: Path, tmp_path: Path) -> None:
    """A camera whose files cannot be read has neither a rate nor a wall time, and to say so would only mislead."""
    for camera in ("north", "south"):
        film(frigate(tmp_path, camera, 0), 20, COLOURS[camera])
    found = check_scene(scene(tmp_path, "north", "south", south='"recordings/*/*/sauth/*.mp4"'))
    assert len(found.faults) == 1
    assert [one.code for one in found.diagnostics if one.code in ("wall_clock_missing", "frame_rate_missing")] == []


def test_files_of_people_keep_their_numbers(folder):
    path = scene(folder, "north", "south")
    (folder / "north.txt").write_text("3,-1,5,5,10,30,1,-1,-1,-1\n")
    path.write_text(path.read_text().replace("[cameras.south]", 'tracks = "north.txt"\n[cameras.south]'))
    north, south = (next(iter(VideoReader(one.video))).number for one in read_cameras(Scene.load(path)))
    assert north == 1
    assert south <= 1 + FPS


@pytest.mark.parametrize(
    "span",
    [
        'from = "08:05:03"\nuntil = "08:07:10"',
        "from = 08:05:03\nuntil = 08:07:10",
        'from = "2026-11-22 08:05:03"\nuntil = "2026-11-22T08:07:10"',
        "from = 2026-11-22T09:05:03+01:00\nuntil = 2026-11-22T09:07:10+01:00",
    ],
)
def test_a_span_of_wall_time(folder, span):
    loaded = Scene.load(scene(folder, "north", "south", span=span))
    north, south = read_cameras(loaded)
    assert not north.faults + south.faults
    assert [path.name for path in north.video.files] == ["05.00.mp4", "05.04.mp4", "05.08.mp4"]
    assert next(iter(VideoReader(north.video))).number <= 2
    clock = wall_clock_of(loaded, [north, south])
    assert clock.origin.seconds == clock.first.seconds == BEGIN + 303
    assert VideoReader(south.video).info.seconds == pytest.approx(10.0, abs=1.0)


def test_a_time_of_day_on_two_days_needs_a_date(folder: Path, tmp_path: Path) -> None:
    for camera in ("north", "south"):
        for day in (22, 23):
            film(frigate(tmp_path, camera, 300, day), 5, COLOURS[camera])
    faults = check_scene(scene(tmp_path, "north", "south", span='from = "08:00"\nuntil = "09:00"')).faults
    assert any("2 days of the recordings have this time" in fault for fault in faults)
    report = check_scene(scene(tmp_path, "north", "south", span='from = "2026-11-23 08:00"'))
    assert report.faults == ()


def test_unknown_time_zones_are_not_compared_with_utc(folder: Path, tmp_path: Path) -> None:
    for camera in ("north", "south"):
        film(frigate(tmp_path, camera, 300), 5, COLOURS[camera])
    film(tmp_path / "west" / "20261122_080500.mp4", 5, 90)
    path = scene(tmp_path, "north", "east", east='"west"')
    assert any("do not tell their time zone, those of camera north" in fault for fault in check_scene(path).faults)
    path = scene(tmp_path, "east", "south", span='from = "09:00+01:00"', east='"west"')
    assert any("has an offset from UTC" in fault for fault in check_scene(path).faults)


def test_check_shows_pieces_and_pictures(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images = folder / "images"
    images.mkdir(exist_ok=True)
    for number in (1, 2, 3, 40):
        cv2.imwrite(str(images / f"frame_{number:06}.jpg"), np.full((SIZE[1], SIZE[0], 3), 99, np.uint8))
    path = scene(folder, "north", "east", east='"images"')
    path.write_text(path.read_text() + "fps = 5\n")
    run(["check", str(path), "--json"])
    told = json.loads(capsys.readouterr().out)
    north, east = (camera["video"] for camera in told["cameras"])
    assert ((north["pieces"], east["pieces"]), north["from"]) == ((3, 4), "2026-11-22T08:05:00+00:00")
    assert east["seconds"] == pytest.approx(8.0)
    assert any("1 gap between its images" in text for text in told["findings"])
    run(["check", str(path)])


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ('video_names = "%H.mp4"', "date"),
        ('video_names = "%Y%m%d%H%M%S.mp4"\nvideo_times = "t.csv"', "delete one"),
        ("video = []", "a path, a pattern or a list"),
        ('video = ["rtsp://user:secret@host/1"]', "address of a stream"),
        ('from = "09:00"\nuntil = "08:00"', "is not before until"),
        ('from = "08:00"\nuntil = "2026-11-22 09:00"', "both have a date"),
        ('from = "soon"', "'soon' is no time"),
        ("from = 8", "8 is no time"),
        ('from = "08:00"\nfrom_s = 3', "'from_s': did you mean 'from'"),
    ],
)
def test_keys_that_contradict_and_spans_that_are_none_are_errors(folder: Path, keys: str, why: str) -> None:
    path = scene(folder, "north", "south", span=keys if keys.startswith("from") else "")
    text = path.read_text()
    if keys.startswith("video ="):
        text = text.replace('video = "recordings/*/*/south/*.mp4"', keys)
    elif keys.startswith("video_"):
        text += keys
    path.write_text(text)
    with pytest.raises(InputError, match=why) as raised:
        Scene.load(path)
    assert "secret" not in str(raised.value)


def test_what_the_files_contradict_is_a_fault(folder: Path) -> None:
    """Spans in which nothing was filmed, a span without wall times, and a piece of two cameras."""
    (folder / "west.mp4").write_bytes((folder / "east.mp4").read_bytes())
    shared = '["recordings/*/*/south/*.mp4", "recordings/*/*/north/05.04.mp4"]'
    for path, why in (
        (scene(folder, "north", "south", name="1.toml", span='from = "11:00"\nuntil = "12:00"'),
         "show nothing of that time: their files begin from 2026-11-22T08:05:00"),
        (scene(folder, "north", "south", name="2.toml", span='from = "2026-11-21 11:00"\nuntil = "2026-11-21 12:00"'),
         "has no file in the span"),
        (scene(folder, "east", "north", name="3.toml", span='from = "08:00"', north='"west.mp4"'),
         "no camera's files tell their wall times"),
        (scene(folder, "north", "south", name="4.toml", south=shared), "05.04.mp4 is camera north's too"),
    ):  # fmt: skip
        assert any(why in fault for fault in check_scene(path).faults)
