"""Folders with a JSON file of people per frame, as OpenPose and Pose2Sim write them, become cameras or belong to them."""

import json
from pathlib import Path

import pytest

from passerby.findings.texts import texts_of
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from passerby.scene.start.start import start

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


def test_what_is_left_out_of_a_folder_is_reported(tmp_path: Path) -> None:
    for name in ("cam01", "cam02"):
        write_joints(tmp_path / "pose" / f"{name}_json")
    write_rig(tmp_path / "Calib.toml", "cam01", "cam02")
    readings = read_cameras(Scene.load(start(tmp_path).scene))
    assert all(any("left out" in text for text in texts_of(reading.findings)) for reading in readings)


def test_other_folders_of_json_are_none(tmp_path: Path) -> None:
    for name in ("cam01", "cam02"):
        write_joints(tmp_path / "pose" / f"{name}_json")
    (tmp_path / "pose" / "settings").mkdir()
    (tmp_path / "pose" / "settings" / "a.json").write_text('{"version": 2}')
    assert [camera.found.name for camera in start(tmp_path).cameras] == ["cam01", "cam02"]


def test_a_broken_frame_is_a_fault_of_the_camera(tmp_path: Path) -> None:
    for name in ("cam01", "cam02"):
        write_joints(tmp_path / "pose" / f"{name}_json")
    write_rig(tmp_path / "Calib.toml", "cam01", "cam02")
    (tmp_path / "pose" / "cam02_json" / "cam02_json_000002.json").write_text("{")
    checked = check_scene(start(tmp_path).scene)
    assert any("cam02_json_000002.json" in fault for fault in checked.faults)
