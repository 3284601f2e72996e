"""Creation times and timecodes of video files: read, compared, and used where the ordinary search does not reach."""

from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np
import pytest

from passerby.findings.texts import texts_of
from passerby.perception.video import probe
from passerby.perception.video_camera import FileClock
from passerby.perception.video_probe import VideoInfo, WallTime
from passerby.scene.camera_input import CameraInput
from passerby.scene.check import check_scene
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import file_clock_findings, measure_by_file_clocks

BEGIN, LONG_S = 1_790_000_000.0, 900.0
SEARCH_S = 5.0


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


@pytest.mark.parametrize("ending", ["mov", "mp4", "mkv"])
def test_creation_times_are_read(tmp_path: Path, ending: str) -> None:
    assert film(tmp_path / f"a.{ending}", BEGIN).clock == FileClock(BEGIN)
    assert film(tmp_path / f"b.{ending}").clock == FileClock()


@pytest.mark.parametrize("created_s", [0.0, -2_082_844_800.0, 315_532_800.0])
def test_clocks_that_were_never_set_tell_nothing(tmp_path: Path, created_s: float) -> None:
    assert film(tmp_path / "a.mp4", created_s).clock.created_s is None


@pytest.mark.parametrize(("text", "seconds"), [("10:07:30:05", 36450.5), ("00:00:00:00", 0.0)])
def test_timecodes_are_read(tmp_path: Path, text: str, seconds: float) -> None:
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


def test_recordings_that_begin_apart_are_told_and_searched(tmp_path: Path) -> None:
    loaded = scene(tmp_path, "a", "b", "c")
    readings = [reading("a", BEGIN), reading("b", BEGIN + 450), reading("c", BEGIN + 2)]
    assert offsets(loaded, *readings) == {("a", "b"): [450.0], ("a", "c"): [2.0], ("b", "c"): [-448.0]}
    (text,) = texts_of(file_clock_findings(loaded, readings))
    assert "that of b 450.0 s after, that of c 2.0 s after that of a" in text
    assert "max_offset_s = 455" in text


def test_what_the_search_covers_is_not_mentioned(tmp_path: Path) -> None:
    loaded = scene(tmp_path, "a", "b")
    near = [reading("a", BEGIN), reading("b", BEGIN + 4)]
    assert (offsets(loaded, *near), file_clock_findings(loaded, near)) == ({}, [])
    far = [reading("a", BEGIN), reading("b", BEGIN + 450)]
    for search in ("max_offset_s = 0", "max_offset_s = 600"):
        stated = scene(tmp_path, "a", "b", search=search)
        assert (offsets(stated, *far), file_clock_findings(stated, far)) == ({}, [])
    only = [reading("a", BEGIN), reading("b")]
    assert (offsets(loaded, *only), file_clock_findings(loaded, only)) == ({}, [])


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


def test_two_clocks_that_agree_are_told_once(tmp_path):
    loaded = scene(tmp_path, "a", "b")
    (found,) = file_clock_findings(loaded, [reading("a", BEGIN, 1000.0), reading("b", BEGIN + 450, 1450.4)])
    assert found.values["found_by"] == "timecode"
    assert len(file_clock_findings(loaded, [reading("a", BEGIN, 1000.0), reading("b", BEGIN + 450, 1100.0)])) == 2


def test_times_in_names_come_first(tmp_path: Path) -> None:
    loaded = scene(tmp_path, "a", "b")
    readings = [reading("a", BEGIN), reading("b", BEGIN + 450)]
    for one in readings:
        assert one.video is not None
        object.__setattr__(one.video, "wall", WallTime(BEGIN, True))
    assert (offsets(loaded, *readings), file_clock_findings(loaded, readings)) == ({}, [])


def test_check_tells_of_it(tmp_path: Path) -> None:
    film(tmp_path / "a.mp4", BEGIN)
    film(tmp_path / "b.mp4", BEGIN + 450, shade=50)
    checked = check_scene(scene(tmp_path, "a", "b"))
    assert sum("by the creation times in their files" in text for text in checked.findings) == 1
