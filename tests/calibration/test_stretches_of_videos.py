"""Calibrations from a part of the videos: how much is watched, and that the stretches that teach most come first."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.calibration import calibrate as module
from passerby.calibration.calibrate import CalibrationInterrupted
from passerby.calibration.effort import Effort, Step, foresee, is_enough, note_of_effort, sizes
from passerby.common.errors import InputError
from passerby.common.progress import silent
from passerby.evaluation.metrics import compare
from passerby.scene.inputs import open_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from support.scenes.puppet_videos import film, puppets, scene_file

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def made():
    """Three cameras, a hundred seconds, three pictures a second."""
    return puppets(100.0, 3.0, 3, 6)


@pytest.fixture(scope="module")
def scene(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stretches")
    film(made, folder, key_every=15)
    return scene_file(folder, {name: f"{name}.mp4" for name in made.rig.names}, perception=PERCEPTION)


AIMED, ENDLESS = Effort(), Effort(target_m=None, budget_s=1e9)
PERCEPTION = 'detector = "background"\nembedder = "none"\nkeypoints = "none"\nfps = 3'


def poses(found):
    return [(camera.name, camera.pose.t_cw.tolist(), camera.pose.R_cw.tolist()) for camera in found.rig]


def used_s(found):
    return [one.values["used_s"] for one in found.notices if one.code == "videos_used_in_part"]


@pytest.fixture(scope="module")
def from_part(scene, tmp_path_factory):
    """The calibration from a part, the rigs before it, and its folder."""
    shown, out = [], tmp_path_factory.mktemp("part") / "out"
    found = passerby.calibrate(scene, keep=out, show=shown.append, effort=AIMED)
    return found, shown, out


def test_a_part_is_enough_and_what_was_not_watched_is_no_missed_person(from_part, made):
    found, shown, _ = from_part
    assert found.verdict == "accepted", found.reasons
    assert [used_s(one) for one in shown] == [[pytest.approx(33.3, abs=0.1)]], "the first rig"
    assert used_s(found) == [pytest.approx(66.7, abs=0.1)]
    assert compare(found.rig, made.rig).similarity.mean_position_mm < 80
    frames = np.concatenate([boxes.frame for boxes in found.tracks.values()])
    assert frames.max() <= 200, "two thirds of 300"
    assert not [one for one in found.doubts if "predict" in one.code or "missed" in one.code]


def test_all_of_it_is_used_where_that_is_asked_for_and_goes_on_from_the_part(from_part, scene, made, tmp_path):
    _, _, out = from_part
    kept = tmp_path / "out"
    shutil.copytree(out, kept)
    before = {path.relative_to(kept) for path in kept.rglob("*.npz")}
    everything = passerby.calibrate(scene, keep=kept, effort=ENDLESS)
    assert not used_s(everything)
    assert before < {path.relative_to(kept) for path in kept.rglob("*.npz")}
    anew = passerby.calibrate(scene, effort=ENDLESS)
    assert poses(everything) == poses(anew)
    assert compare(everything.rig, made.rig).similarity.mean_position_mm < 60


def test_the_same_is_made_of_what_is_kept(from_part, scene):
    found, _, out = from_part
    again = passerby.calibrate(scene, keep=out, effort=AIMED)
    assert used_s(again) == used_s(found)
    assert poses(again) == poses(found)


def test_people_may_come_late(made, tmp_path):
    later = {name: boxes.take(boxes.frame > 110) for name, boxes in made.boxes.items()}
    film(replace(made, boxes=later), tmp_path, key_every=15)
    late = scene_file(tmp_path, {name: f"{name}.mp4" for name in made.rig.names}, perception=PERCEPTION)
    shown = []
    found = passerby.calibrate(late, show=shown.append)
    assert len(found.rig.posed()) == 3
    assert used_s(shown[0]) == [pytest.approx(66.7, abs=0.1)], "nobody was seen before"


def test_where_the_scene_points_at_people_all_is_watched(scene, made, tmp_path):
    pointing = '[[scale.people]]\ncamera = "C1"\ntime_s = 80.0\nat = [100, 100]\nheight_m = 1.8\n'
    for extra, stretches in (("", 3), (pointing, 0)):
        files = {name: str(scene.parent / f"{name}.mp4") for name in made.rig.names}
        path = scene_file(tmp_path, files, extra, PERCEPTION, name=f"{stretches}.toml")
        (tmp_path / "rig.toml").write_text((scene.parent / "rig.toml").read_text())
        loaded = Scene.load(path)
        assert len(SceneVideoProcessor(None, None, silent).plan_stretches(loaded, open_inputs(loaded))) == stretches


def test_a_file_that_was_cut_off_is_an_error(scene, tmp_path):
    folder = tmp_path / "cut"
    shutil.copytree(scene.parent, folder)
    with (folder / "C2.mp4").open("r+b") as video:
        video.truncate((folder / "C2.mp4").stat().st_size // 4)
    with pytest.raises(InputError, match=r"C2\.mp4: camera C2: the video ends after .* it was cut off"):
        passerby.calibrate(folder / scene.name)


def test_interrupted_after_the_first_rig_that_rig_is_there(from_part, scene, monkeypatch, tmp_path):
    _, shown, out = from_part
    estimates, real = [], module.calibrate_inputs

    def second_is_interrupted(*given, **named):
        estimates.append(given)
        if len(estimates) > 1:
            raise KeyboardInterrupt
        return real(*given, **named)

    monkeypatch.setattr(module, "calibrate_inputs", second_is_interrupted)
    with pytest.raises(CalibrationInterrupted) as stopped:
        passerby.calibrate(scene, keep=out, effort=AIMED)
    assert used_s(stopped.value.calibration) == used_s(shown[0])
    stopped.value.calibration.write(tmp_path / "written", report=False)
    assert json.loads((tmp_path / "written" / "calibration.json").read_text())["verdict"] == shown[0].verdict


def step(used_s, points_m=0.03, ground_m=0.2, verdict="accepted", ended_s=10.0):
    return Step(used_s, ended_s, verdict, points_m, ground_m)


@pytest.mark.unit
def test_each_step_is_twice_as_long_to_the_end():
    assert [list(sizes(count)) for count in (0, 1, 11)] == [[0], [1], [1, 2, 4, 8, 11]]


@pytest.mark.unit
@pytest.mark.parametrize(
    ("steps", "enough"),
    [
        ([step(30, 0.01, 0.01)], False),
        ([step(30, 0.04), step(60, 0.03, 0.2)], True),
        ([step(30, 0.10, 0.04), step(60, 0.07, 0.03)], False),
        ([step(30, 0.10, 0.04), step(60, 0.095, 0.03)], False),
        ([step(120, 0.10, 0.04), step(240, 0.095, 0.03)], True),
        ([step(30, 0.04, verdict="doubtful"), step(60, 0.03)], False),
        ([step(120, 0.04, verdict="doubtful"), step(240, 0.03, verdict="doubtful")], False),
        ([step(120, 0.04, verdict="doubtful"), step(240, 0.039, verdict="doubtful")], True),
        ([step(30, None, None, "refused"), step(60, None, None, "refused")], False),
        ([step(60, 0.04, verdict="doubtful"), step(120, 0.039, verdict="doubtful")], False),
    ],
    ids=["not confirmed", "target", "still better", "too little for a missed target", "barely better", "verdict changes",
         "doubt, better", "doubt, settled", "none", "too little for a doubt"],
)  # fmt: skip
def test_it_ends_where_the_target_is_reached_or_more_would_barely_help(steps, enough):
    assert is_enough(steps, Effort(target_m=0.05)) is enough
    assert not is_enough(steps, Effort(target_m=None))


@pytest.mark.unit
def test_no_step_is_begun_that_would_take_longer_than_there_is():
    steps = [step(30, None, None, "refused", ended_s=20.0)]
    assert not is_enough(steps, Effort(budget_s=60.0))
    assert is_enough(steps, Effort(budget_s=59.0))


@pytest.mark.unit
def test_what_more_would_bring_is_foreseen():
    # A constant of 3 cm, and 4 cm after a minute that fall with the time.
    steps = [step(60, 0.05, None), step(240, (0.03**2 + 0.02**2) ** 0.5, None)]
    points, ground = foresee(steps, 960.0)
    assert points == pytest.approx((0.03**2 + 0.01**2) ** 0.5)
    assert ground is None
    note = note_of_effort(steps, 960.0)
    assert (note.values["used_s"], note.values["recorded_s"]) == (240, 960.0)
    assert (note.values["now_points_m"], note.values["points_m"]) == (steps[-1].points_m, points)
    assert note_of_effort(steps, 240.0) is None
