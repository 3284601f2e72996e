"""`from_s` and `until_s`: a part of a recording is used, of boxes and joints alike."""

import tomllib
from functools import cache
from pathlib import Path

import pytest
import tomli_w

import passerby
from passerby.common.errors import InputError
from passerby.evaluation.metrics import compare
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.simulation import SimulatedScene, SimulationOptions, simulate, write_scene
from passerby.simulation.disturbances import Move, film_disturbed, rig_after

MOVE = Move("C2", 11.0, turn_deg=(0.0, 8.0, 0.0))


@cache
def simulated() -> SimulatedScene:
    options = SimulationOptions(seconds=22.0, people=6, box_noise=0.02, seed=5)
    return simulate(options, film_disturbed(options, [MOVE]))


def written(folder: Path, *, fps: bool = True, keypoints: bool = False, **keys: float) -> Path:
    path = write_scene(simulated(), folder / "scene", keypoints=keypoints)
    content = tomllib.loads(path.read_text())
    content["cameras"]["C2"] |= keys
    if not fps:
        del content["scene"]["fps"]
    path.write_text(tomli_w.dumps(content))
    return path


@pytest.mark.system
def test_either_pose_of_a_camera_that_was_moved_can_be_had(tmp_path):
    before, after = simulated().rig, rig_after(simulated().rig, [MOVE])
    for name, keys, true in (("before", {"until_s": 10.8}, before), ("after", {"from_s": 11.2}, after)):
        calibration = passerby.calibrate(written(tmp_path / name, **keys))
        assert calibration.verdict == "accepted", calibration.reasons
        judged = compare(calibration.rig, true)
        assert judged.similarity.mean_position_mm < 60
        assert judged.similarity.mean_orientation_deg < 0.4


@pytest.mark.slow
def test_frames_are_counted_from_the_recording_s_own_beginning(tmp_path):
    seen = read_inputs(Scene.load(written(tmp_path, keypoints=True, from_s=2.0, until_s=4.0))).observations
    for part in (seen["C2"].boxes, seen["C2"].keypoints):
        assert (part.frame.min(), part.frame.max()) == (11, 21)
    assert seen["C1"].boxes.frame.max() == 110


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"from_s": 4.0, "until_s": 4.0}, "from_s = 4 is not before until_s = 4: nothing would be left"),
        ({"from_s": 100.0}, "[cameras.C2] from_s = 100: it saw people only from 0.0 to 21.8 s, so nothing is left"),
        ({"from_s": -1.0}, "[cameras.C2] from_s is -1.0"),
        ({"until_s": float("nan")}, "[cameras.C2] until_s"),
    ],
)
def test_what_leaves_nothing_is_an_error(tmp_path, keys, told):
    path = written(tmp_path, **keys)
    with pytest.raises(InputError) as error:
        read_inputs(Scene.load(path))
    assert told in str(error.value)


def test_seconds_need_a_frame_rate(tmp_path):
    path = written(tmp_path, fps=False, from_s=4.0)
    with pytest.raises(
        InputError, match=r"\[cameras.C2\] from_s: its frame rate is not known: set fps there, or under \[scene\] set fps to it"
    ):
        read_inputs(Scene.load(path))
