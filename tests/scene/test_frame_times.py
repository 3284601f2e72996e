"""`times`: a camera's video, boxes and keypoints by the times of a table, and how `init` finds it."""

from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.video import VideoReader
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from passerby.scene.start.start import start

FPS, FRAMES = 20.0, 30
RIG = "".join(
    f"[{name}]\nsize = [64, 48]\ndistortions = [0, 0, 0, 0, 0]\nmatrix = [[60, 0, 32], [0, 60, 24], [0, 0, 1]]\n"
    for name in "ab"
)


def film(path: Path, shade: int = 0) -> None:
    with VideoWriter(path, (64, 48), FPS, crf=30) as video:
        for number in range(FRAMES):
            video.write(np.full((48, 64, 3), 4 * number + shade, np.uint8))


def seconds(seed: int) -> np.ndarray:
    steps = np.random.default_rng(seed).uniform(0.03, 0.09, FRAMES - 1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def write_times(path: Path, times: np.ndarray, begin: float = 1_790_000_000.0) -> None:
    path.write_text("frame,time_ns\n" + "".join(f"{k},{round((begin + time) * 1e9)}\n" for k, time in enumerate(times)))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number, name in enumerate("ab"):
        film(tmp_path / f"{name}.mp4", 10 * number)
    write_times(tmp_path / "a.csv", seconds(1))
    return tmp_path


def test_init_finds_the_table_and_the_video_is_read_by_it(folder: Path) -> None:
    started = start(folder)
    assert any("camera a: the times of its frames are those of a.csv" in note for note in started.notes)
    scene = Scene.load(started.scene)
    assert {name: table.times for name, table in scene.cameras.items()} == {"a": Path("a.csv"), "b": None}
    first, second = read_cameras(scene)
    assert not first.faults + second.faults
    assert (first.fps, second.fps) == (100.0, FPS)
    assert first.video.average_fps == pytest.approx((FRAMES - 1) / seconds(1)[-1])
    np.testing.assert_allclose([frame.seconds for frame in VideoReader(first.video)], seconds(1), atol=1e-6)
    assert not check_scene(started.scene).faults
    # A table that does not fit is named and not used.
    write_times(folder / "b.csv", seconds(2)[:9])
    started = start(folder, force=True)
    assert any("b.csv: has 9 times, but b.mp4 has 30 frames" in note for note in started.notes)
    assert Scene.load(started.scene).cameras["b"].times is None


def boxes(path: Path, frames: list[int]) -> None:
    path.write_text("".join(f"{frame},1,20,10,10,30,1,-1,-1,-1\n" for frame in frames))


def scene(folder: Path, **extra: str) -> Path:
    (folder / "rig.toml").write_text(RIG)
    text = "".join(
        f'[cameras.{name}]\nintrinsics = "rig.toml"\ntracks = "{name}.txt"\n{extra.get(name, "")}\n' for name in "ab"
    )
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def test_boxes_of_a_camera_are_at_the_times_of_their_frames(folder: Path) -> None:
    for name in "ab":
        boxes(folder / f"{name}.txt", [1, 2, 30])
    for video in ("", '\nvideo = "a.mp4"'):
        first, second = read_cameras(Scene.load(scene(folder, a=f'times = "a.csv"{video}', b="fps = 20.0")))
        assert not first.faults + second.faults
        np.testing.assert_allclose((first.boxes.frame - 1) / first.fps, seconds(1)[[0, 1, 29]], atol=0.00501)
        assert second.boxes.frame.tolist() == [1, 2, 30]


def test_what_contradicts_the_table_is_a_fault(folder: Path) -> None:
    boxes(folder / "a.txt", [1, 31])
    boxes(folder / "b.txt", [1, 2])
    faults = check_scene(scene(folder, a='times = "a.csv"', b="fps = 20.0")).faults
    assert any("a.csv: camera a: has 30 times, but there are people in frame 31" in fault for fault in faults)
    with pytest.raises(InputError, match="has times and fps: delete one of them"):
        Scene.load(scene(folder, a='times = "a.csv"\nfps = 20', b="fps = 20.0"))
