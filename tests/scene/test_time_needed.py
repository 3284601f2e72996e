"""How long a calibration will take, by what its files say."""

import json
from dataclasses import replace

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.core.lens import Lens
from passerby.core.observations import Boxes
from passerby.perception.video import probe
from passerby.scene.camera_input import CameraInput
from passerby.scene.scene import Scene
from passerby.scene.time_needed import USED_S, foresee_time
from support.scenes.handmade_files import write_scene
from support.scenes.numbered_videos import written
from support.scenes.puppet_videos import scene_file

BACKGROUND = {"detector": "background"}


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return probe(written(tmp_path_factory.mktemp("video") / "a.mp4", 50))


@pytest.fixture
def two_videos(tmp_path):
    for name in ("A.mp4", "B.mp4"):
        written(tmp_path / name, 50)
    return Scene.load(scene_file(tmp_path, {"A": "A.mp4", "B": "B.mp4"}))


def filmed(video, seconds, size=(1920, 1080)):
    seen = replace(video, seconds=seconds, size=size, average_fps=25.0, clock_fps=25.0)
    return [CameraInput(name, video=seen, awaiting=True) for name in ("A", "B")]


def test_a_calibration_takes_no_longer_than_what_is_used_of_a_long_recording(video, two_videos):
    minute, ten, hour = (foresee_time(two_videos, filmed(video, seconds), BACKGROUND) for seconds in (USED_S[0], 600.0, 3600.0))
    assert minute[0] == ten[0] == hour[0]
    assert minute[1] < ten[1] == hour[1] < 1.1 * USED_S[1] / USED_S[0] * minute[1]


def test_more_work_takes_longer(video, two_videos):
    usual = foresee_time(two_videos, filmed(video, 60.0), BACKGROUND)
    for inputs, perception in (
        (filmed(video, 60.0, (3840, 2160)), BACKGROUND),
        (filmed(video, 60.0), {"detector": {"network": "yolox-nano"}}),
        (filmed(video, 60.0), BACKGROUND | {"keypoints": {"network": "movenet-thunder"}}),
        ([replace(one, lens=Lens.unknown((1920, 1080))) for one in filmed(video, 60.0)], BACKGROUND),
    ):
        assert all(longer > short for longer, short in zip(foresee_time(two_videos, inputs, perception), usual, strict=True))
    assert foresee_time(two_videos, filmed(video, None), BACKGROUND) is None


def test_boxes_take_as_long_as_there_are_many_and_the_time_is_printed(tmp_path, capsys):
    path = write_scene(tmp_path)
    loaded = Scene.load(path)

    def boxes(count):
        frame = np.arange(count)
        return [CameraInput("A", boxes=Boxes(frame, frame * 0, np.ones((count, 4)), np.ones(count)))]

    few, many, more = (foresee_time(loaded, boxes(count), {}) for count in (10, 10_000, 1_000_000))
    assert few[1] < 10 < many[1] < more[1] < 120, "no more than so many are used"
    status = run(["check", str(path), "--json"])
    assert status != 2
    least, most = json.loads(capsys.readouterr().out)["time_s"]
    assert 0 < least < most
    assert run(["check", str(path)]) == status
    assert "a calibration takes about " in capsys.readouterr().out
