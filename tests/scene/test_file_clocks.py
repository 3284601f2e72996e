"""When recordings began: creation times and timecodes of video files, and the sound of two videos."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np
import pytest

import passerby
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.findings.texts import texts_of
from passerby.perception.video import probe
from passerby.perception.video_camera import FileClock
from passerby.perception.video_probe import VideoInfo, WallTime
from passerby.scene.camera_input import CameraInput
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.sound import measure_by_sound, sound_to_hear
from passerby.scene.wall_clock import file_clock_findings, measure_by_file_clocks
from sources.sound import RATE, SoundCase, simulated_pair
from support.scenes.people_and_rigs import ring

BEGIN, LONG_S = 1_790_000_000.0, 900.0


def film(path: Path, created_s: float | None = None, timecode: str | None = None, fps: int = 10, shade: int = 0) -> VideoInfo:
    with av.open(str(path), "w") as container:
        if created_s is not None:
            time = datetime.fromtimestamp(created_s, UTC)
            container.metadata["creation_time"] = f"{time:%Y-%m-%dT%H:%M:%S}.000000Z"
        video = container.add_stream("mpeg4", rate=fps)
        video.width, video.height, video.pix_fmt = 32, 32, "yuv420p"
        if timecode is not None:
            video.metadata["timecode"] = timecode
        for number in range(2 * fps):
            picture = np.full((32, 32, 3), (number + shade) % 200, np.uint8)
            container.mux(video.encode(av.VideoFrame.from_ndarray(picture)))
        container.mux(video.encode())
    return probe(path)


def test_creation_times_and_timecodes_are_read_and_clocks_that_were_never_set_are_not(tmp_path: Path) -> None:
    for ending in ("mov", "mp4", "mkv"):
        assert film(tmp_path / f"a.{ending}", BEGIN).clock == FileClock(BEGIN)
        assert film(tmp_path / f"b.{ending}").clock == FileClock()
    for created_s in (0.0, -2_082_844_800.0, 315_532_800.0):
        assert film(tmp_path / "a.mp4", created_s).clock.created_s is None
    for text, seconds in (("10:07:30:05", 36450.5), ("00:00:00:00", 0.0)):
        assert film(tmp_path / "a.mov", None, text).clock == FileClock(None, seconds)


def reading(name: str, created_s: float | None = None, timecode_s: float | None = None, seconds: float = LONG_S) -> CameraInput:
    clock = FileClock(created_s, timecode_s)
    info = VideoInfo(Path(f"{name}.mp4"), (640, 480), "h264", 25.0, False, 25.0, None, seconds, clock=clock)
    return CameraInput(name, video=info, fps=25.0)


def scene(folder: Path, *names: str, search: str = "") -> Scene:
    path = folder / "scene.toml"
    tables = "".join(f'[cameras.{name}]\nvideo = "{name}.mp4"\n' for name in names)
    path.write_text(f"[association]\n{search}\n{tables}")
    return Scene.load(path)


def offsets(loaded: Scene, *readings: CameraInput) -> dict[tuple[str, str], list[float]]:
    out: dict[tuple[str, str], list[float]] = {}
    for one in measure_by_file_clocks(loaded, readings):
        out.setdefault(one.cameras, []).append(one.offset_s)
    return out


def test_recordings_that_begin_apart_are_a_finding_and_searched(tmp_path: Path) -> None:
    loaded = scene(tmp_path, "a", "b", "c")
    readings = [reading("a", BEGIN), reading("b", BEGIN + 450), reading("c", BEGIN + 2)]
    assert offsets(loaded, *readings) == {("a", "b"): [450.0], ("a", "c"): [2.0], ("b", "c"): [-448.0]}
    (text,) = texts_of(file_clock_findings(loaded, readings))
    assert "that of b 450.0 s after, that of c 2.0 s after that of a" in text
    assert "max_offset_s = 455" in text
    film(tmp_path / "a.mp4", BEGIN)
    film(tmp_path / "b.mp4", BEGIN + 450, shade=50)
    checked = check_scene(scene(tmp_path, "a", "b"))
    assert sum("by the creation times in their files" in text for text in checked.findings) == 1


def test_clocks_that_are_not_needed_are_not_mentioned(tmp_path: Path) -> None:
    """Where the search covers them, where it is stated how far it goes, of one camera, and where names have times."""
    loaded = scene(tmp_path, "a", "b")
    near, far = ([reading("a", BEGIN), reading("b", BEGIN + later)] for later in (4, 450))
    named = [reading("a", BEGIN), reading("b", BEGIN + 450)]
    for one in named:
        assert one.video is not None
        object.__setattr__(one.video, "wall", WallTime(BEGIN, True))
    for readings in (near, [reading("a", BEGIN), reading("b")], named):
        assert (offsets(loaded, *readings), file_clock_findings(loaded, readings)) == ({}, [])
    for search in ("max_offset_s = 0", "max_offset_s = 600"):
        stated = scene(tmp_path, "a", "b", search=search)
        assert (offsets(stated, *far), file_clock_findings(stated, far)) == ({}, [])


def test_times_under_which_nothing_was_filmed_together_are_not_used(tmp_path: Path) -> None:
    loaded = scene(tmp_path, "a", "b")
    exported = [reading("a", BEGIN, seconds=60.0), reading("b", BEGIN + 450, seconds=60.0)]
    assert offsets(loaded, *exported) == {}
    (found,) = file_clock_findings(loaded, exported)
    assert found.code == "file_clocks_unused"
    assert "max_offset_s = 455" in texts_of([found])[0]


def test_a_creation_time_may_be_that_of_the_end_and_timecodes_go_on_past_midnight(tmp_path):
    loaded = scene(tmp_path, "a", "b")
    readings = [reading("a", BEGIN + LONG_S), reading("b", BEGIN + LONG_S + 60.0, seconds=LONG_S + 60.0)]
    assert offsets(loaded, *readings) == {("a", "b"): [60.0, 0.0]}
    assert offsets(loaded, reading("a", None, 86300.0), reading("b", None, 100.0)) == {("a", "b"): [200.0]}
    # Two clocks that agree are one finding.
    (found,) = file_clock_findings(loaded, [reading("a", BEGIN, 1000.0), reading("b", BEGIN + 450, 1450.4)])
    assert found.values["found_by"] == "timecode"
    assert len(file_clock_findings(loaded, [reading("a", BEGIN, 1000.0), reading("b", BEGIN + 450, 1100.0)])) == 2


FPS = 5


def film_with_sound(path: Path, sound: Floats | None, *, seconds: int = 40) -> CameraInput:
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=FPS)
        video.width, video.height, video.pix_fmt = 32, 32, "yuv420p"
        audio = None if sound is None else container.add_stream("aac", rate=RATE, layout="mono")
        for number in range(seconds * FPS):
            picture = av.VideoFrame.from_ndarray(np.full((32, 32, 3), number % 200, np.uint8))
            container.mux(video.encode(picture))
        container.mux(video.encode())
        if audio is not None and sound is not None:
            for begin in range(0, len(sound), 1024):
                part = np.ascontiguousarray(sound[None, begin : begin + 1024], dtype=np.float32)
                frame = av.AudioFrame.from_ndarray(part, format="fltp", layout="mono")
                frame.sample_rate, frame.pts = RATE, begin
                container.mux(audio.encode(frame))
            container.mux(audio.encode())
    return CameraInput(path.stem, video=probe(path), fps=FPS)


def two_cameras(folder: Path, key: str = "") -> Scene:
    path = folder / "scene.toml"
    path.write_text(f'[association]\n{key}\n[cameras.a]\nvideo = "a.mp4"\n[cameras.b]\nvideo = "b.mp4"\n')
    return Scene.load(path)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[CameraInput], float]:
    folder = tmp_path_factory.mktemp("films")
    a, b, lag_s = simulated_pair(SoundCase(4, (38.0, 42.0)))
    return folder, [film_with_sound(folder / "a.mp4", a), film_with_sound(folder / "b.mp4", b)], lag_s


def test_the_sound_of_two_videos_tells_when_they_began(films: tuple[Path, list[CameraInput], float]) -> None:
    folder, readings, lag_s = films
    (measured,), (found,) = measure_by_sound(two_cameras(folder), readings)
    assert (measured.cameras, measured.found_by) == (("a", "b"), "sound")
    assert measured.offset_s == pytest.approx(-lag_s, abs=0.02)
    assert (found.code, found.cameras) == ("offset_by_sound", ("b", "a"))
    assert found.values["offset_s"] == measured.offset_s


def test_nothing_is_listened_to_where_no_offset_is_wanted(films: tuple[Path, list[CameraInput], float]) -> None:
    folder, readings, _ = films
    for key in ('sound = "off"', "max_offset_s = 0", 'mode = "appearance"'):
        assert measure_by_sound(two_cameras(folder, key), readings) == ((), ())


def test_silence_is_named_once_and_sound_of_one_camera_passed_over(films, tmp_path):
    folder, (first, _), _ = films
    silent = film_with_sound(tmp_path / "silent.mp4", np.zeros(15 * RATE))
    without = film_with_sound(tmp_path / "without.mp4", None)
    measured, findings = measure_by_sound(two_cameras(folder), [first, silent, without])
    assert measured == ()
    assert [(one.code, one.cameras) for one in findings] == [("sound_unusable", ("silent",))]
    assert measure_by_sound(two_cameras(folder), [first, without]) == ((), ())


def test_a_check_decodes_no_sound_and_a_calibration_does(films, tmp_path, monkeypatch):
    folder, readings, lag_s = films

    monkeypatch.setattr("passerby.perception.sound._decode_samples", None)
    (found,) = sound_to_hear(two_cameras(folder), readings)
    assert (found.code, found.cameras) == ("sound_unheard", ("a", "b"))
    assert sound_to_hear(two_cameras(folder, 'sound = "off"'), readings) == ()
    assert sound_to_hear(two_cameras(folder), [readings[0], film_with_sound(tmp_path / "without.mp4", None)]) == ()
    for name in "ab":
        (tmp_path / f"{name}.txt").write_text("1,-1,2,2,6,16,1\n150,-1,3,2,6,16,1\n")
    cameras = "".join(
        f'[cameras.{name}]\nvideo = "{folder / name}.mp4"\ndetections = "{name}.txt"\nhfov_deg = 60\n' for name in "ab"
    )
    (tmp_path / "scene.toml").write_text(cameras)
    both = Scene.load(tmp_path / "scene.toml")
    checked = check_scene(both)
    assert checked.faults == ()
    assert "sound_unheard" in [one.code for one in checked.diagnostics]
    assert read_inputs(both).measured == ()
    monkeypatch.undo()
    (measured,) = read_inputs(both, measure_clocks=measure_by_sound).measured
    assert measured.offset_s == pytest.approx(-lag_s, abs=0.02)


@pytest.mark.parametrize(
    ("command", "listener"),
    [("calibrate", "passerby.calibration.calibrate.measure_by_sound"), ("monitor", "passerby.monitoring.monitor.read_inputs")],
)
def test_only_a_calibration_measures_clocks_by_sound(command, listener, films, monkeypatch):
    asked = []

    def read(*arguments: object, **_: object) -> None:
        asked.append(arguments)
        raise InputError("read")

    monkeypatch.setattr(listener, read)
    rig = Rig(tuple(replace(camera, name=name) for camera, name in zip(ring(2), "ab", strict=True)))
    with pytest.raises(InputError, match="read"):
        passerby.calibrate(two_cameras(films[0])) if command == "calibrate" else passerby.monitor(rig, two_cameras(films[0]))
    assert len(asked) == 1
    assert measure_by_sound not in asked[0]
