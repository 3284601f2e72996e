"""One camera's files, read: what is odd about them."""

from __future__ import annotations

from pathlib import Path

import pytest

from passerby.findings.finding import Finding
from passerby.scene.reading import read_camera
from passerby.scene.scene import Scene
from support.scenes.puppet_videos import film, puppets, scene_file


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two videos of a second, 10 frames per second."""
    folder = tmp_path_factory.mktemp("filmed")
    film(puppets(1.0, 10.0, 2, 1), folder)
    return folder


def findings_at(folder: Path, fps: float) -> list[Finding]:
    path = scene_file(folder, {"C1": "C1.mp4", "C2": "C2.mp4"}, extra=f"[scene]\nfps = {fps}")
    return read_camera(Scene.load(path), "C1").findings


@pytest.mark.parametrize("fps", [10.0, 9.96, 10.04])
def test_a_rate_that_is_nearly_the_video_s_own_is_nothing_odd(filmed: Path, fps: float) -> None:
    assert findings_at(filmed, fps) == []


@pytest.mark.parametrize("fps", [5.0, 9.9, 10.1])
def test_another_rate_than_the_video_s_own_is_believed_and_reported(filmed: Path, fps: float) -> None:
    (found,) = findings_at(filmed, fps)
    assert (found.code, found.cameras) == ("video_rate_differs", ("C1",))
    assert (found.values["video_fps"], found.values["fps"]) == (10.0, fps)
