"""Which cameras are found in a folder, by videos, boxes and folders of joints, and what is left alone or cannot be read."""

import json
from pathlib import Path
from typing import Any

import pytest

from passerby.common.errors import InputError
from passerby.findings.texts import texts_of
from passerby.interchange.rig_toml import read_rig
from passerby.perception.video_probe import VideoInfo
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from passerby.scene.start.folders import survey
from passerby.scene.start.start import start


def probe(path: Path) -> VideoInfo:
    """Every video is alike."""
    return VideoInfo(path, (640, 480), "h264", 25.0, False, 25.0, 250, 10.0)


def filled(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    return folder


def test_boxes_make_cameras_where_there_are_no_videos_and_embeddings_alone_do_not(tmp_path: Path) -> None:
    found = survey(filled(tmp_path, "tracks/a.txt", "tracks/b.txt", "embeddings/c.npz", "embeddings/a.npz"), probe)
    assert {camera.name: sorted(camera.files) for camera in found.cameras} == {"a": ["embeddings", "tracks"], "b": ["tracks"]}
    found = survey(filled(tmp_path / "filmed", "a.mp4", "b.mp4", "tracks/a.txt", "tracks/c.txt"), probe)
    assert {camera.name: list(camera.files) for camera in found.cameras} == {"a": ["tracks"], "b": []}
    assert found.notes == ["boxes or keypoints were found beside the videos: their lines in the scene file are commented out"]


def test_a_folder_that_cannot_be_used_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, shoot = Path.iterdir, filled(tmp_path / "shoot", "a.mp4")
    pieces = filled(tmp_path / "pieces", *(f"one/two/three/{number:03d}.mp4" for number in range(4)))

    def iterdir(self: Path) -> Any:
        if self == shoot:
            raise PermissionError(13, "Permission denied")
        return real(self)

    monkeypatch.setattr(Path, "iterdir", iterdir)
    for place, message in (
        (shoot, r"shoot: cannot be read \(Permission denied\): give a folder that you may read"),
        (pieces, r"holds pieces of one camera's recording \(.*000\.mp4, .*001\.mp4, \.\.\., 4 in a row\)"),
        (Path("rtsp://10.0.0.12/live"), "what is given for a folder .*: init needs the folder that these files lie in"),
    ):
        with pytest.raises(InputError, match=message):
            start(place, probe=probe)


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


FRAMES = 4


def write_joints(folder: Path, shift: float = 0.0) -> None:
    folder.mkdir(parents=True)
    for frame in range(FRAMES):
        joints = [value for joint in range(17) for value in (100 + shift + 10 * joint + frame, 200 + 5 * joint, 0.9)]
        empty = {"person_id": [-1], "pose_keypoints_2d": [0.0] * 51}
        content = {"version": 1.3, "people": [{"person_id": [-1], "pose_keypoints_2d": joints}, empty]}
        (folder / f"{folder.name}_{frame + 1:06d}.json").write_text(json.dumps(content))


def write_rig(path: Path, *names: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        "".join(
            f"[int_{name}_img]\nname = '{name}'\nsize = [640, 480]\nmatrix = [[500, 0, 320], [0, 500, 240], [0, 0, 1]]\n"
            "distortions = [0, 0, 0, 0, 0]\n"
            for name in names
        )
    )


@pytest.mark.parametrize("place", ["pose/", "", "pose-sync/"])
def test_folders_of_joints_make_cameras(tmp_path: Path, place: str) -> None:
    for number, name in enumerate(("cam01", "cam02")):
        write_joints(tmp_path / f"{place}{name}_json", 30.0 * number)
    write_rig(tmp_path / "calibration" / "Calib.toml", "cam01", "cam02")
    started = start(tmp_path)
    assert started.to_do == ()
    checked = check_scene(started.scene)
    assert not checked.faults
    assert {camera.name: (camera.keypoints, camera.joints) for camera in checked.cameras} == {
        "cam01": (FRAMES, 17), "cam02": (FRAMES, 17),
    }  # fmt: skip
    first, second = read_cameras(Scene.load(started.scene))
    assert (second.keypoints.xy - first.keypoints.xy)[..., 0].mean() == pytest.approx(30.0)
    assert all(any("left out" in text for text in texts_of(reading.findings)) for reading in (first, second))


def test_other_folders_of_json_are_no_cameras_and_a_broken_frame_is_a_fault_of_its_camera(tmp_path: Path) -> None:
    for name in ("cam01", "cam02"):
        write_joints(tmp_path / "pose" / f"{name}_json")
    write_rig(tmp_path / "Calib.toml", "cam01", "cam02")
    (tmp_path / "pose" / "settings").mkdir()
    (tmp_path / "pose" / "settings" / "a.json").write_text('{"version": 2}')
    (tmp_path / "pose" / "cam02_json" / "cam02_json_000002.json").write_text("{")
    started = start(tmp_path)
    assert [camera.found.name for camera in started.cameras] == ["cam01", "cam02"]
    assert any("cam02_json_000002.json" in fault for fault in check_scene(started.scene).faults)
