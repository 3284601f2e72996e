"""Which cameras are found in a folder, and what is told of what is left out or cannot be read."""

from pathlib import Path
from typing import Any

import pytest

from passerby.common.errors import InputError
from passerby.interchange.rig_toml import read_rig
from passerby.perception.video_probe import VideoInfo
from passerby.scene.start.folders import survey
from passerby.scene.start.start import start


def probe(path: Path) -> VideoInfo:
    """Every video is alike, but for those that say that they are broken."""
    if "broken" in path.name:
        raise InputError(f"{path}: is not a video")
    return VideoInfo(path, (640, 480), "h264", 25.0, False, 25.0, 250, 10.0)


def filled(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    return folder


def test_a_video_that_is_broken_stays_a_camera(tmp_path: Path) -> None:
    found = survey(filled(tmp_path, "a.mp4", "b.mp4", "broken.mp4"), probe)
    faults = {camera.name: camera.fault for camera in found.cameras}
    assert faults == {"a": None, "b": None, "broken": f"{tmp_path / 'broken.mp4'}: is not a video"}


def test_boxes_beside_videos_are_told_to_be_switched_off(tmp_path: Path) -> None:
    found = survey(filled(tmp_path, "a.mp4", "b.mp4", "tracks/a.txt", "tracks/c.txt"), probe)
    assert {camera.name: list(camera.files) for camera in found.cameras} == {"a": ["tracks"], "b": []}
    assert found.notes == ["boxes or keypoints were found beside the videos: their lines in the scene file are commented out"]


def test_boxes_make_cameras_where_there_are_no_videos_and_embeddings_alone_do_not(tmp_path: Path) -> None:
    found = survey(filled(tmp_path, "tracks/a.txt", "tracks/b.txt", "embeddings/c.npz", "embeddings/a.npz"), probe)
    assert {camera.name: sorted(camera.files) for camera in found.cameras} == {"a": ["embeddings", "tracks"], "b": ["tracks"]}


def test_numbered_videos_further_down_are_pieces_of_one_camera(tmp_path: Path) -> None:
    filled(tmp_path, *(f"one/two/three/{number:03d}.mp4" for number in range(4)))
    with pytest.raises(
        InputError, match=r"holds pieces of one camera's recording \(.*000\.mp4, .*001\.mp4, \.\.\., 4 in a row\)"
    ):
        survey(tmp_path, probe)


def forbidden(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.iterdir

    def iterdir(self: Path) -> Any:
        if self == folder:
            raise PermissionError(13, "Permission denied")
        return real(self)

    monkeypatch.setattr(Path, "iterdir", iterdir)


def test_a_folder_that_may_not_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forbidden(filled(tmp_path / "shoot", "a.mp4"), monkeypatch)
    with pytest.raises(InputError, match=r"shoot: cannot be read \(Permission denied\): give a folder that you may read"):
        survey(tmp_path / "shoot", probe)


def test_what_is_given_must_be_a_folders_path(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"what is given for a folder .*: init needs the folder that these files lie in"):
        start(Path("rtsp://10.0.0.12/live"), probe=probe)
    with pytest.raises(InputError, match="no such folder"):
        start(tmp_path / "none", probe=probe)


def test_a_file_that_is_no_text_is_not_replaced(tmp_path: Path) -> None:
    place = filled(tmp_path, "a.mp4", "b.mp4")
    (place / "scene.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"scene\.toml: is not a scene file, and is not replaced: choose another name with -o"):
        start(place, force=True, probe=probe)
    assert (place / "scene.toml").read_bytes() == b"\xff\xfe\x00"


def test_intrinsics_that_are_there_already_are_left_alone(tmp_path: Path) -> None:
    """A file of this name need not be ours: the next free name is taken."""
    place = filled(tmp_path, "left.mp4", "right.mp4")
    for name in ("intrinsics.toml", "intrinsics-2.toml"):
        (place / name).write_text("[mine]\n")
    numbers = "K: [500, 0, 320, 0, 500, 240, 0, 0, 1]\nD: [0, 0, 0, 0]\nimage_width: 640\nimage_height: 480\n"
    for name in ("left", "right"):
        (place / f"{name}.yaml").write_text(numbers)
    started = start(place, probe=probe)
    assert [path.name for path in started.written] == ["scene.toml", "intrinsics-3.toml"]
    assert read_rig(place / "intrinsics-3.toml").names == ("left", "right")
    assert (place / "intrinsics.toml").read_text() == (place / "intrinsics-2.toml").read_text() == "[mine]\n"
