"""Chapters of one recording are known by their names, formats and times; cameras that are numbered are no chapters."""

from dataclasses import replace
from pathlib import Path

import pytest

from passerby.common.errors import InputError
from passerby.perception.sources.files import VideoSource, list_files
from passerby.perception.video_camera import FileClock
from passerby.perception.video_probe import VideoInfo
from passerby.scene.start.folders import survey
from passerby.scene.start.recordings import find_chapters

LONG_S, BEGIN = 60.0, 1_790_000_000.0


def video(path: Path, created_s: float | None = None) -> VideoInfo:
    return VideoInfo(
        path, (640, 480), "h264", 25.0, False, 25.0, 1500, LONG_S, clock=FileClock(created_s)
    )  # fmt: skip


def found(
    *names: str, one_camera: bool = False, begin: dict[str, float] | None = None, **changes: VideoInfo
) -> list[list[str]]:
    times = begin or {}
    videos = [Path(name) for name in names]
    chapters = find_chapters(videos, lambda path: changes.get(path.stem, video(path, times.get(path.name))), one_camera)
    return [[path.name for path in one.paths] for one in chapters]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("GX020012.MP4", "GX010012.MP4"), [["GX010012.MP4", "GX020012.MP4"]]),
        (("GOPR0345.MP4", "GP010345.MP4", "GP020345.MP4", "GOPR0346.MP4"), [["GOPR0345.MP4", "GP010345.MP4", "GP020345.MP4"]]),
        (("GX010012.MP4", "GX010047.MP4"), []),
    ],
)
def test_a_makers_scheme_of_names_decides(names: tuple[str, ...], expected: list[list[str]]) -> None:
    assert found(*names) == expected


def test_a_counter_may_number_cameras():
    assert found("cam_001.mp4", "cam_002.mp4", one_camera=True) == []
    assert found("north_001.mp4", "north_002.mp4") == []
    assert found("cam_01.mp4", "cam_02.mp4", begin={"cam_01.mp4": BEGIN, "cam_02.mp4": BEGIN + LONG_S}) == []
    # In a folder of one camera a whole counter is enough.
    assert found("rec_002.mp4", "rec_001.mp4", one_camera=True) == [["rec_001.mp4", "rec_002.mp4"]]
    assert found("rec_001.mp4", "rec_003.mp4", one_camera=True) == []
    assert found("rec_017.mp4", "rec_018.mp4", one_camera=True) == []


@pytest.mark.parametrize("name", ["north", "cam"])
def test_times_that_follow_one_another_show_chapters(name: str) -> None:
    begin = {f"{name}_{number:03d}.mp4": BEGIN + LONG_S * number for number in range(3)}
    assert found(*begin, begin=begin) == [list(begin)]
    apart = {path: BEGIN + 20 * (time - BEGIN) for path, time in begin.items()}
    assert found(*begin, begin=apart, one_camera=True) == []
    together = {path: BEGIN + 3.0 * number for number, path in enumerate(begin)}
    assert found(*begin, begin=together, one_camera=True) == []


def test_chapters_have_one_format() -> None:
    other = replace(video(Path("GX020012.MP4")), size=(320, 240))
    assert found("GX010012.MP4", "GX020012.MP4", GX020012=other) == []
    slow = replace(video(Path("GX020012.MP4")), clock_fps=30.0, average_fps=30.0)
    assert found("GX010012.MP4", "GX020012.MP4", GX020012=slow) == []


def filled(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(bytes(8))
    return folder


TWO = [f"{camera}/GX0{chapter}0012.MP4" for camera in ("north", "south") for chapter in (1, 2)]


def test_a_folder_for_each_camera(tmp_path: Path) -> None:
    place = filled(tmp_path, *TWO, "north/GX010012.LRV", "north/GX010012.THM", "south/GL010012.MP4", "gate/GX010003.MP4")
    result = survey(place, video)
    videos = {camera.name: camera.video.relative_to(place).as_posix() for camera in result.cameras if camera.video}
    assert videos == {"gate": "gate/GX010003.MP4", "north": "north", "south": "south/GX[0-9][0-9]0012.MP4"}
    assert {camera.name: camera.recording and camera.recording.files for camera in result.cameras} == {
        "gate": None, "north": 2, "south": 2,
    }  # fmt: skip
    assert any(note.startswith("not used: 3 small copies or preview images") for note in result.notes)


def test_another_recording_in_a_cameras_folder_is_named(tmp_path: Path) -> None:
    result = survey(filled(tmp_path, *TWO, "north/GX010047.MP4"), video)
    north = next(camera for camera in result.cameras if camera.name == "north")
    assert north.video == tmp_path / "north" / "GX[0-9][0-9]0012.MP4"
    assert any("left out: GX010047.MP4" in note for note in result.notes)


@pytest.mark.parametrize("below", ["", "videos/"])
def test_all_cameras_in_one_folder(tmp_path, below):
    names = [f"{below}{name}.MP4" for name in ("GX010012", "GX020012", "GX010047", "GX020047", "GOPR0345", "GP010345", "side")]
    cameras = survey(filled(tmp_path, *names), video).cameras
    assert {one.name: [path.stem for path in list_files(VideoSource((one.video,))).paths] for one in cameras} == {
        "GOPR0345": ["GOPR0345", "GP010345"], "GX0012": ["GX010012", "GX020012"], "GX0047": ["GX010047", "GX020047"],
        "side": ["side"],
    }  # fmt: skip


def test_chapters_of_one_camera_are_not_enough(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds pieces of one camera's recording"):
        survey(filled(tmp_path, "GX010012.MP4", "GX020012.MP4"), video)


def test_a_note_tells_how_to_say_that_counters_are_chapters(tmp_path: Path) -> None:
    result = survey(filled(tmp_path, "a_001.mp4", "a_002.mp4", "b_001.mp4", "b_002.mp4"), video)
    assert len(result.cameras) == 4
    assert any("put the files of each camera into a folder of its own" in note for note in result.notes)
    assert not survey(filled(tmp_path / "numbered", "cam_001.mp4", "cam_002.mp4"), video).notes


def test_chapters_of_several_recordings_are_in_order(tmp_path: Path) -> None:
    names = ["GX010012.MP4", "GX020012.MP4", "GX010047.MP4", "GX020047.MP4"]
    assert [path.name for path in list_files(VideoSource((filled(tmp_path, *names),))).paths] == names
