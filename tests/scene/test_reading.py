"""One camera's files, read: what is odd about them."""

from pathlib import Path

import pytest

from passerby.scene.reading import read_camera
from passerby.scene.scene import Scene
from support.scenes.puppet_videos import film, puppets, scene_file


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filmed")
    film(puppets(1.0, 10.0, 2, 1), folder)
    return folder


@pytest.mark.parametrize(("fps", "odd"), [(10.0, False), (9.96, False), (10.04, False), (9.9, True), (10.1, True)])
def test_another_rate_than_the_video_s_own_is_believed_and_reported(filmed, fps, odd):
    path = scene_file(filmed, {"C1": "C1.mp4", "C2": "C2.mp4"}, extra=f"[scene]\nfps = {fps}")
    found = read_camera(Scene.load(path), "C1").findings
    values = {"video_fps": 10.0, "fps": fps}
    assert [(one.code, one.cameras, values.items() <= one.values.items()) for one in found] == [
        ("video_rate_differs", ("C1",), True)
    ] * odd
