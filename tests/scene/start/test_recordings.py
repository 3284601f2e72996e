"""Which videos are pieces of one recording, by times and counters in their names, and how cameras are called."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.perception.sources.files import VideoSource, list_files
from passerby.perception.video_camera import FileClock
from passerby.perception.video_probe import VideoInfo
from passerby.scene.scene import CAMERA_NAME
from passerby.scene.start.folders import survey
from passerby.scene.start.recordings import camera_names, find_chapters, is_numbered_series, match_names, pieces_among, start_of

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
def test_times_in_names_are_read(stem, rest, seconds):
    assert start_of(stem) == (rest, pytest.approx(seconds))


def test_names_without_a_time_and_series_of_numbers():
    for stem in ("cam1", "walk_cam1_1080p", "20240501", "cam_20240501_1", "GX010001", "20241301_100305", "20240501_256161",
                 "75.10", "1.2.3"):  # fmt: skip
        assert start_of(stem) is None, stem
    for stems, numbered in ((("000", "001", "002"), True), (("10.05", "10.15", "10.25"), True), (("000", "001"), False),
                            (("take1", "take2", "take3"), False)):  # fmt: skip
        assert is_numbered_series(paths(*stems)) is numbered


def paths(*stems, ending=".mp4"):
    return [Path(f"{stem}{ending}") for stem in stems]


MINUTES = paths(*(f"front_2024-05-01_10-{minute:02d}-00" for minute in range(12)))


def test_files_one_after_another_are_pieces_of_one_recording():
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


@pytest.mark.parametrize(
    ("texts", "names"),
    [
        (["walk_cam1_1080p", "walk_cam2_1080p"], ["cam1", "cam2"]),
        (["2024-05-01 north", "2024-05-01 gate"], ["north", "gate"]),
        # A bare number is no sensible name; its word stays.
        (["cam_1", "cam_2"], ["cam_1", "cam_2"]),
        (["hd_00_00", "hd_00_01"], ["hd_00_00", "hd_00_01"]),
        (["walk_cam_1_x", "walk_cam_2_x"], ["cam_1", "cam_2"]),
        (["1_video", "2_video"], ["1_video", "2_video"]),
        (["Cam 1 (left)", "Cam 2 (right)"], ["1 left", "2 right"]),
        (["a/b?", "a:b"], ["b", "b-2"]),
        (["A", "a", "a-2"], ["A", "a-3", "a-2"]),
        (["metadata", "x"], ["metadata camera", "x"]),
        (["...", "Türkamera 2"], ["camera", "Türkamera 2"]),
        (["walk_cam1_1080p"], ["walk_cam1_1080p"]),
    ],
)
def test_names_are_the_parts_that_differ(texts, names):
    assert camera_names(texts) == names


@settings(max_examples=60)
@given(st.lists(st.text(min_size=1, max_size=12), min_size=1, max_size=6))
def test_names_are_valid_and_differ(texts):
    names = camera_names(texts)
    assert all(CAMERA_NAME.fullmatch(name) and name != "metadata" for name in names)
    assert len({name.casefold() for name in names}) == len(texts)


@pytest.mark.parametrize(
    ("cameras", "others", "pairs"),
    [
        (["north", "gate"], [["gate"], ["north"]], {0: 1, 1: 0}),
        (["cam1", "cam2"], [["int_cam02_img"], ["int_cam01_img"]], {0: 1, 1: 0}),
        (["A", "B"], [["cam_0", "A"], ["cam_1", "B"]], {0: 0, 1: 1}),
        (["cam1", "north"], [["C1"], ["north"]], {0: 0, 1: 1}),
        # Counted from 1 here, from 0 there: which is which cannot be told.
        (["cam1", "cam2"], [["x1"], ["y1"], ["x2"]], {}),
        (["cam1", "cam2"], [["lens"]], {}),
        ([f"left {'9' * 5000}", "left 2"], [[f"cam{'9' * 5000}"], ["cam002"]], {0: 0, 1: 1}),
    ],
)
def test_names_match_by_words_and_numbers(cameras, others, pairs):
    assert match_names(cameras, others) == pairs


LONG_S, BEGIN = 60.0, 1_790_000_000.0


def video(path: Path, created_s: float | None = None) -> VideoInfo:
    return VideoInfo(path, (640, 480), "h264", 25.0, False, 25.0, 1500, LONG_S, clock=FileClock(created_s))


def found(
    *names: str, one_camera: bool = False, begin: dict[str, float] | None = None, **changes: VideoInfo
) -> list[list[str]]:
    times = begin or {}
    videos = [Path(name) for name in names]
    chapters = find_chapters(videos, lambda path: changes.get(path.stem, video(path, times.get(path.name))), one_camera)
    return [[path.name for path in one.paths] for one in chapters]


@pytest.mark.parametrize(
    ("names", "one_camera", "expected"),
    [
        (("GX020012.MP4", "GX010012.MP4"), False, [["GX010012.MP4", "GX020012.MP4"]]),
        (("GOPR0345.MP4", "GP010345.MP4", "GP020345.MP4", "GOPR0346.MP4"), False,
         [["GOPR0345.MP4", "GP010345.MP4", "GP020345.MP4"]]),
        (("GX010012.MP4", "GX010047.MP4"), False, []),
        # A counter may number cameras; in a folder of one camera a whole counter is enough.
        (("cam_001.mp4", "cam_002.mp4"), True, []),
        (("north_001.mp4", "north_002.mp4"), False, []),
        (("rec_002.mp4", "rec_001.mp4"), True, [["rec_001.mp4", "rec_002.mp4"]]),
        (("rec_001.mp4", "rec_003.mp4"), True, []),
        (("rec_017.mp4", "rec_018.mp4"), True, []),
    ],
)  # fmt: skip
def test_a_makers_scheme_of_names_decides_and_a_counter_may_number_cameras(names, one_camera, expected) -> None:
    assert found(*names, one_camera=one_camera) == expected


@pytest.mark.parametrize("name", ["north", "cam"])
def test_times_that_follow_one_another_show_chapters_of_one_format(name: str) -> None:
    begin = {f"{name}_{number:03d}.mp4": BEGIN + LONG_S * number for number in range(3)}
    assert found(*begin, begin=begin) == [list(begin)]
    apart = {path: BEGIN + 20 * (time - BEGIN) for path, time in begin.items()}
    assert found(*begin, begin=apart, one_camera=True) == []
    together = {path: BEGIN + 3.0 * number for number, path in enumerate(begin)}
    assert found(*begin, begin=together, one_camera=True) == []
    assert found("cam_01.mp4", "cam_02.mp4", begin={"cam_01.mp4": BEGIN, "cam_02.mp4": BEGIN + LONG_S}) == []
    own = video(Path("GX020012.MP4"))
    for other in (replace(own, size=(320, 240)), replace(own, clock_fps=30.0, average_fps=30.0)):
        assert found("GX010012.MP4", "GX020012.MP4", GX020012=other) == []


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
    # Another recording in a camera's folder is named, and not used.
    result = survey(filled(tmp_path, "north/GX010047.MP4"), video)
    north = next(camera for camera in result.cameras if camera.name == "north")
    assert north.video == tmp_path / "north" / "GX[0-9][0-9]0012.MP4"
    assert any("left out: GX010047.MP4" in note for note in result.notes)


@pytest.mark.parametrize("below", ["", "videos/"])
def test_all_cameras_in_one_folder(tmp_path, below):
    names = ["GX010012.MP4", "GX020012.MP4", "GX010047.MP4", "GX020047.MP4"]
    with pytest.raises(InputError, match="holds pieces of one camera's recording"):
        survey(filled(tmp_path / "one", *names[:2]), video)
    place = filled(tmp_path / "all", *(f"{below}{name}" for name in (*names, "GOPR0345.MP4", "GP010345.MP4", "side.MP4")))
    cameras = survey(place, video).cameras
    assert {one.name: [path.stem for path in list_files(VideoSource((one.video,))).paths] for one in cameras} == {
        "GOPR0345": ["GOPR0345", "GP010345"], "GX0012": ["GX010012", "GX020012"], "GX0047": ["GX010047", "GX020047"],
        "side": ["side"],
    }  # fmt: skip
    # Read as one source, chapters of several recordings are in order.
    several = filled(tmp_path / "several", *names)
    assert [path.name for path in list_files(VideoSource((several,))).paths] == names
    result = survey(filled(tmp_path / "counters", "a_001.mp4", "a_002.mp4", "b_001.mp4", "b_002.mp4"), video)
    assert len(result.cameras) == 4
    assert any("put the files of each camera into a folder of its own" in note for note in result.notes)
    assert not survey(filled(tmp_path / "numbered", "cam_001.mp4", "cam_002.mp4"), video).notes
